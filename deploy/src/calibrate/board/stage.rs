//! Boards as the first stage of `farfield calibrate all`: the lens of every camera of which none is given.

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
use super::look::{found, recorded, size_px};
use super::{files, lens_found};
use crate::calibrate::kept::{Kept, fingerprint};
use crate::calibrate::lenses::{Lens, LensFile, lenses};
use crate::calibrate::{refuse_existing, write};
use crate::init::recordings::{entries, is_picture, is_video};

/// How the line begins that says of what a lens was made.
const MARK: &str = "# farfield calibrate board: ";

/// Boards that each camera filmed.
#[derive(Debug, Args)]
pub(in crate::calibrate) struct BoardsArgs {
    /// Boards that each camera filmed, for its lens.
    ///
    /// Where --lens gives none. The folder has for each camera a video NAME.mp4, or a folder NAME of pictures or videos, as `farfield calibrate board` takes them.
    #[arg(long, value_name = "DIR")]
    boards: Option<PathBuf>,
    #[command(flatten)]
    kind: BoardKindArgs,
    /// Folder for NAME.yml: the lenses that boards tell.
    ///
    /// Each is written when its camera's boards are looked through, and taken as it is where it is of the same pictures, board
    /// and options.
    #[arg(
        long,
        value_name = "DIR",
        default_value = "lenses",
        hide_short_help = true
    )]
    lenses: PathBuf,
}

/// What is said of a lens under its file.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct FoundLens {
    /// Pictures of the board that it is of.
    pictures: usize,
    /// Between drawn and seen corners, pixels, to a thousandth.
    rms_px: f64,
}

impl FoundLens {
    fn of(found: &BoardCalibration) -> Self {
        Self {
            pictures: found.pictures.len(),
            rms_px: (1000.0 * found.rms_px).round() / 1000.0,
        }
    }
}

/// The cameras whose lenses boards tell; all is known to be there before anything is looked at.
pub(in crate::calibrate) struct BoardStage<'a> {
    args: &'a BoardsArgs,
    board: Option<Board>,
    cameras: Vec<BoardCamera>,
}

/// A camera, and what is there of its lens.
struct BoardCamera {
    name: String,
    recorded: Vec<PathBuf>,
    made_of: String,
    file: PathBuf,
    kept: Option<FoundLens>,
}

impl BoardsArgs {
    /// The boards of the cameras `names` without a lens.
    ///
    /// # Errors
    /// [`NodeError::Refused`] where a camera has no board, a board cannot be, or a lens is there of something else.
    pub(in crate::calibrate) fn stage(
        &self,
        names: &[&str],
        replace: bool,
    ) -> Result<BoardStage<'_>, NodeError> {
        let prepared = || {
            let Some(folder) = &self.boards else {
                ensure!(
                    !self.kind.says_something(),
                    "the board that is described is in no picture: give the folder of boards by --boards DIR"
                );
                ensure!(
                    names.is_empty(),
                    "no lens of camera `{}`: give it by --lens, or pictures of a board by --boards DIR",
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
        for camera in cameras.iter().filter(|it| it.kept.is_none()) {
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
                    || (stem(path) && (is_video(path) || is_picture(path)))
            })
            .collect();
        if mine.is_empty() {
            bail!(
                "{}: found no boards of camera `{name}`, expected a video called so, or a folder of pictures; or give its lens \
                 by --lens {name}=FILE",
                folder.display()
            );
        }
        let recorded = recorded(&mine)?;
        let options = format!("{board:?} {:?} {name}", self.kind.coefficients);
        let made_of = fingerprint(&[&BOARD_REVISION.to_string(), &options], &recorded)?;
        let file = self.lenses.join(format!("{name}.yml"));
        Ok(BoardCamera {
            kept: Kept::find(MARK, &file, &made_of),
            name: name.to_owned(),
            recorded,
            made_of,
            file,
        })
    }
}

impl BoardStage<'_> {
    /// The first picture or video of each camera's boards, and how large its pictures are.
    ///
    /// # Errors
    /// What cannot be read.
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

    /// The lenses: looked for, and written, where they are not there yet.
    ///
    /// # Errors
    /// [`NodeError::Refused`] where boards do not carry a lens, [`NodeError::Failed`] where the disk is in the way.
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
            .map(|it| LensFile::of_camera(&it.name, &it.file))
            .collect();
        lenses(&files).map_err(NodeError::Refused)
    }

    fn make(&self, board: &Board, camera: &BoardCamera) -> Result<(), NodeError> {
        let (name, file) = (&camera.name, camera.file.display());
        if let Some(kept) = &camera.kept {
            say(format_args!(
                "camera {name}: its lens is taken from {file}, where it was found earlier ({:.3} px over {} pictures)",
                kept.rms_px, kept.pictures
            ));
            return Ok(());
        }
        let looked = found(board, camera.recorded.clone(), self.args.kind.coefficients);
        let looked = looked.with_context(|| format!("the boards of camera `{name}`"));
        let looked = looked.map_err(NodeError::Refused)?;
        let texts =
            files(name, &lens_found(&looked), Format::OpenCvYaml).map_err(NodeError::refused)?;
        let lines: String = texts.into_iter().map(|it| it.text).collect();
        let said = FoundLens::of(&looked);
        say(format_args!(
            "camera {name}: {:.3} px between drawn and seen corners, over {} pictures, {file}",
            said.rms_px, said.pictures
        ));
        for remark in &looked.remarks {
            say(format_args!("camera {name}: {remark}"));
        }
        let text = Kept::text(MARK, &lines, said, &camera.made_of);
        write(&camera.file, &text)
    }
}
