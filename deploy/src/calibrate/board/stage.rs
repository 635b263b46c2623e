//! Boards as the first stage of `farfield calibrate all`: computes the lenses of all cameras without a given lens.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use clap::Args;
use farfield_calibration::board::{BOARD_REVISION, BoardCalibration};
use farfield_calibration::formats::Format;
use farfield_node::process::{NodeError, say};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde::{Deserialize, Serialize};

use super::kind::{Board, BoardKindArgs};
use super::scan::{found, recorded, size_px};
use super::{files, lens_found};
use crate::calibrate::cached::{Cached, fingerprint};
use crate::calibrate::lenses::{Lens, LensFile, lenses};
use crate::calibrate::{refuse_existing, write};
use crate::init::recordings::{entries, is_image, is_video};

/// Start of the line with the cache entry.
const MARK: &str = "# farfield calibrate board: ";

#[derive(Debug, Args)]
pub(in crate::calibrate) struct BoardsArgs {
    /// Recordings of boards by each camera, for its lens.
    ///
    /// For cameras without --lens. The folder has a video NAME.mp4 for each camera, or a folder NAME of images or
    /// videos, as for `farfield calibrate board`.
    #[arg(long, value_name = "DIR")]
    boards: Option<PathBuf>,
    #[command(flatten)]
    kind: BoardKindArgs,
    /// Folder for NAME.yml: the lenses from boards.
    ///
    /// Each is written after the scan of its camera's boards, and reused if images, board and options are still the
    /// same.
    #[arg(
        long,
        value_name = "DIR",
        default_value = "lenses",
        hide_short_help = true
    )]
    lenses: PathBuf,
}

/// Facts that are stored with the file of a lens.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct FoundLens {
    /// Number of images with the board.
    pictures: usize,
    /// RMS distance between projected and detected corners, pixels, to a thousandth.
    rms_px: f64,
}

impl FoundLens {
    fn new(found: &BoardCalibration) -> Self {
        Self {
            pictures: found.pictures.len(),
            rms_px: (1000.0 * found.rms_px).round() / 1000.0,
        }
    }
}

/// The cameras whose lenses are computed from boards; all their files were found.
pub(in crate::calibrate) struct BoardStage<'a> {
    args: &'a BoardsArgs,
    board: Option<Board>,
    cameras: Vec<BoardCamera>,
}

/// A camera, and its earlier result.
struct BoardCamera {
    name: String,
    recorded: Vec<PathBuf>,
    made_of: String,
    file: PathBuf,
    cached: Option<FoundLens>,
}

impl BoardsArgs {
    /// The boards of the cameras `names` without a lens.
    ///
    /// # Errors
    /// [`NodeError::Refused`] where a camera has no board, a board is invalid, or its lens file already exists and was made
    /// from something else.
    pub(in crate::calibrate) fn stage(
        &self,
        names: &[&str],
        replace: bool,
    ) -> Result<BoardStage<'_>, NodeError> {
        let prepared = || {
            let Some(folder) = &self.boards else {
                ensure!(
                    !self.kind.is_given(),
                    "a board is described, but there are no images of it: set their folder with --boards DIR"
                );
                ensure!(
                    names.is_empty(),
                    "no lens of camera `{}`: set it with --lens, or give images of a board with --boards DIR",
                    names.join("`, `")
                );
                return Ok((None, Vec::new()));
            };
            let board = self.kind.board()?;
            let each = names.iter().map(|name| self.camera(folder, name, &board));
            let cameras = each.collect::<anyhow::Result<Vec<_>>>()?;
            Ok((Some(board), cameras))
        };
        let (board, cameras) = prepared().map_err(NodeError::Refused)?;
        for camera in cameras.iter().filter(|it| it.cached.is_none()) {
            refuse_existing(&camera.file, replace)?;
        }
        Ok(BoardStage {
            args: self,
            board,
            cameras,
        })
    }

    fn camera(&self, folder: &Path, name: &str, board: &Board) -> anyhow::Result<BoardCamera> {
        let inside = entries(folder)?;
        let stem = |path: &Path| path.file_stem().is_some_and(|it| it == name);
        let mine: Vec<PathBuf> = inside
            .into_iter()
            .filter(|path| {
                (path.is_dir() && path.file_name().is_some_and(|it| it == name))
                    || (stem(path) && (is_video(path) || is_image(path)))
            })
            .collect();
        if mine.is_empty() {
            bail!(
                "{}: found no boards of camera `{name}`, expected a video or a folder of images of that name; or set its lens \
                 with --lens {name}=FILE",
                folder.display()
            );
        }
        let recorded = recorded(&mine)?;
        let options = format!("{board:?} {:?} {name}", self.kind.coefficients);
        let made_of = fingerprint(&[&BOARD_REVISION.to_string(), &options], &recorded)?;
        let file = self.lenses.join(format!("{name}.yml"));
        Ok(BoardCamera {
            cached: Cached::find(MARK, &file, &made_of),
            name: name.to_owned(),
            recorded,
            made_of,
            file,
        })
    }
}

impl BoardStage<'_> {
    /// The first image or video of each camera's boards, and its image size.
    ///
    /// # Errors
    /// An unreadable file.
    pub(in crate::calibrate) fn first_sizes(
        &self,
    ) -> anyhow::Result<BTreeMap<&str, (&Path, [u32; 2])>> {
        let firsts = self
            .cameras
            .iter()
            .filter_map(|camera| Some((camera.name.as_str(), camera.recorded.first()?)));
        firsts
            .map(|(name, path)| Ok((name, (path.as_path(), size_px(path)?))))
            .collect()
    }

    /// The lenses: computed and written unless they are cached.
    ///
    /// # Errors
    /// [`NodeError::Refused`] where the boards do not determine a lens, [`NodeError::Failed`] for errors of the disk.
    pub(in crate::calibrate) fn lenses(&self) -> Result<BTreeMap<String, Lens>, NodeError> {
        let (Some(board), false) = (&self.board, self.cameras.is_empty()) else {
            return Ok(BTreeMap::new());
        };
        let each: Vec<Result<(), NodeError>> = self
            .cameras
            .par_iter()
            .map(|camera| self.make(board, camera))
            .collect();
        each.into_iter().collect::<Result<(), _>>()?;
        let files = self.cameras.iter();
        let files: Vec<LensFile> = files
            .map(|it| LensFile::for_camera(&it.name, &it.file))
            .collect();
        lenses(&files).map_err(NodeError::Refused)
    }

    fn make(&self, board: &Board, camera: &BoardCamera) -> Result<(), NodeError> {
        let (name, file) = (&camera.name, camera.file.display());
        if let Some(cached) = &camera.cached {
            say(format_args!(
                "camera {name}: its lens in {file} from an earlier scan is reused ({:.3} px over {} images)",
                cached.rms_px, cached.pictures
            ));
            return Ok(());
        }
        let computed = found(board, camera.recorded.clone(), self.args.kind.coefficients);
        let computed = computed.with_context(|| format!("the boards of camera `{name}`"));
        let computed = computed.map_err(NodeError::Refused)?;
        let texts =
            files(name, &lens_found(&computed), Format::OpenCvYaml).map_err(NodeError::refused)?;
        let lines: String = texts.into_iter().map(|it| it.text).collect();
        let facts = FoundLens::new(&computed);
        say(format_args!(
            "camera {name}: {:.3} px between projected and detected corners, over {} images, {file}",
            facts.rms_px, facts.pictures
        ));
        for remark in &computed.remarks {
            say(format_args!("camera {name}: {remark}"));
        }
        let text = Cached::text(MARK, &lines, facts, &camera.made_of);
        write(&camera.file, &text)
    }
}
