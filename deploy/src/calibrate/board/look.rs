//! Pictures and videos of one camera, looked through for a board, and the lens that it tells.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use farfield_calibration::board::{
    BoardCalibration, BoardView, Coefficients, DetectError, calibrate,
};
use farfield_edge::source::open_video_alone;
use farfield_node::process::say;
use image::GrayImage;
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

use super::kind::Board;
use super::video;
use crate::init::recordings::{is_picture, is_video};

/// Most pictures of one camera.
const MAX_PICTURES: usize = 2000;

/// Pictures in which another board is looked for where this one is not found.
const SAMPLES: usize = 3;

/// A picture in which it was looked for.
struct LookedAt {
    name: String,
    size_px: [u32; 2],
    view: Result<BoardView, DetectError>,
}

/// The lens that `board` tells in `recorded` pictures and videos of one camera.
///
/// # Errors
/// What cannot be read, pictures of different sizes, and pictures that do not carry what is asked.
pub(super) fn found(
    board: &Board,
    recorded: Vec<PathBuf>,
    coefficients: Coefficients,
) -> anyhow::Result<BoardCalibration> {
    let (videos, paths): (Vec<PathBuf>, Vec<PathBuf>) =
        recorded.into_iter().partition(|path| is_video(path));
    let looked: Vec<LookedAt> = paths
        .par_iter()
        .map(|path| look(path, board))
        .collect::<anyhow::Result<_>>()?;
    let mut gathered = Gathered::default();
    for path in &videos {
        let filmed = video::look(path, |name, picture| board.detect(name, picture))?;
        say(format_args!(
            "{}: of {} pictures {} were looked at, {} show the board, {} are used",
            path.display(),
            filmed.pictures,
            filmed.looked,
            filmed.shown.len(),
            filmed.used.len()
        ));
        gathered.is_as_large(&path.display().to_string(), filmed.size_px)?;
        gathered.looked += filmed.looked;
        gathered.shown.extend(filmed.shown);
        gathered.used.extend(filmed.used);
        gathered.larger.extend(filmed.larger);
        gathered.blank.extend(filmed.blank);
    }
    for it in looked {
        gathered.is_as_large(&it.name, it.size_px)?;
        gathered.looked += 1;
        match it.view {
            Ok(view) => {
                gathered.shown.push(view.clone());
                gathered.used.push(view);
            }
            Err(error @ (DetectError::Board(_) | DetectError::Bytes { .. })) => {
                return Err(anyhow!(error));
            }
            Err(error) => {
                if let DetectError::OtherBoard { found, .. } = error {
                    gathered.larger.push(found);
                }
                gathered.unseen.push((it.name, error.to_string()));
            }
        }
    }
    let size_px = gathered.first.map_or([0, 0], |(_, size_px)| size_px);
    board.check_size(&gathered.shown, &gathered.larger)?;
    let calibrated = calibrate(size_px, &gathered.used, coefficients);
    let (shown, looked) = (gathered.shown.len(), gathered.looked);
    let mut found = calibrated.map_err(|error| {
        // A wrong word about the board is no matter of more pictures.
        let other = board.other(&samples(&paths, gathered.blank));
        let other = other.map_or_else(String::new, |it| format!("; {it}"));
        anyhow!(
            "{error} (the board was found in {shown} of the {looked} pictures that were looked at){other}"
        )
    })?;
    found.left_out.extend(gathered.unseen);
    Ok(found)
}

/// Some pictures of a camera, evenly spread, in which another board is looked for.
fn samples(paths: &[PathBuf], filmed: Vec<GrayImage>) -> Vec<GrayImage> {
    let step = paths.len().div_ceil(SAMPLES).max(1);
    let read = paths
        .iter()
        .step_by(step)
        .filter_map(|path| image::open(path).ok());
    let read = read.map(image::DynamicImage::into_luma8);
    read.chain(filmed).take(SAMPLES).collect()
}

/// What pictures and videos of one camera gave.
#[derive(Default)]
struct Gathered {
    /// The first of them, and how large its pictures are.
    first: Option<(String, [u32; 2])>,
    /// All pictures that show the board, and those of them that are used.
    shown: Vec<BoardView>,
    used: Vec<BoardView>,
    /// Pictures without a board, and why.
    unseen: Vec<(String, String)>,
    /// Corners along the sides of boards that are larger than the one that is looked for.
    larger: Vec<[u32; 2]>,
    /// Some pictures of videos that do not show the board.
    blank: Vec<GrayImage>,
    looked: usize,
}

impl Gathered {
    /// Refuses pictures that are not as large as those before.
    fn is_as_large(&mut self, name: &str, size_px: [u32; 2]) -> anyhow::Result<()> {
        let first = self.first.get_or_insert_with(|| (name.to_owned(), size_px));
        let ([w, h], [other_w, other_h]) = (first.1, size_px);
        let remedy = if [other_h, other_w] == [w, h] {
            "the camera was turned on its side: hold it as it will stand"
        } else {
            "one camera at a time, with the settings that it will have"
        };
        ensure!(
            first.1 == size_px,
            "{name}: found pictures of {other_w}x{other_h}, expected {w}x{h} as of {}: {remedy}",
            first.0
        );
        Ok(())
    }
}

/// The pictures and videos that are meant, folders opened, in the order of their names.
///
/// # Errors
/// What cannot be read, folders without any, and too many.
pub(super) fn recorded(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in paths {
        if path.is_dir() {
            let mut inside = Vec::new();
            for entry in fs::read_dir(path).with_context(|| path.display().to_string())? {
                let entry = entry.with_context(|| path.display().to_string())?.path();
                if is_picture(&entry) || is_video(&entry) {
                    inside.push(entry);
                }
            }
            ensure!(
                !inside.is_empty(),
                "{}: found no picture in it, expected JPEG or PNG files, or videos",
                path.display()
            );
            inside.sort();
            all.extend(inside);
        } else {
            all.push(path.clone());
        }
        ensure!(
            all.len() <= MAX_PICTURES,
            "found more than {MAX_PICTURES} pictures: thirty that reach every corner are enough"
        );
    }
    Ok(all)
}

/// How large the pictures of a picture or a video are, without looking at them.
///
/// # Errors
/// What cannot be read.
pub(super) fn size_px(path: &Path) -> anyhow::Result<[u32; 2]> {
    let named = || path.display().to_string();
    if is_video(path) {
        let (info, _) = open_video_alone(path)?;
        return info.size_px.with_context(named);
    }
    let (width, height) = image::image_dimensions(path).with_context(named)?;
    Ok([width, height])
}

fn look(path: &Path, board: &Board) -> anyhow::Result<LookedAt> {
    let name = path.display().to_string();
    let picture = image::open(path)
        .with_context(|| name.clone())?
        .into_luma8();
    let view = board.detect(&name, &picture);
    Ok(LookedAt {
        size_px: [picture.width(), picture.height()],
        name,
        view,
    })
}
