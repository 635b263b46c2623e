//! Detects a board in images and videos of one camera, and computes the lens.

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
use crate::init::recordings::{is_image, is_video};

/// Limit for the images of one camera.
const MAX_PICTURES: usize = 2000;

/// Number of images in which another board is tried if this one is not found.
const SAMPLES: usize = 3;

/// A scanned image.
struct ScannedImage {
    name: String,
    size_px: [u32; 2],
    view: Result<BoardView, DetectError>,
}

/// Computes the lens from `recorded` images and videos of `board` of one camera.
///
/// # Errors
/// Unreadable files, images of different sizes, and too few or unsuitable images.
pub(super) fn found(
    board: &Board,
    recorded: Vec<PathBuf>,
    coefficients: Coefficients,
) -> anyhow::Result<BoardCalibration> {
    let (videos, paths): (Vec<PathBuf>, Vec<PathBuf>) =
        recorded.into_iter().partition(|path| is_video(path));
    let scanned: Vec<ScannedImage> = paths
        .par_iter()
        .map(|path| scan(path, board))
        .collect::<anyhow::Result<_>>()?;
    let mut gathered = Gathered::default();
    for path in &videos {
        let filmed = video::scan(path, |name, picture| board.detect(name, picture))?;
        say(format_args!(
            "{}: {} images, {} scanned, {} show the board, {} are used",
            path.display(),
            filmed.pictures,
            filmed.scanned,
            filmed.shown.len(),
            filmed.used.len()
        ));
        gathered.check_size(&path.display().to_string(), filmed.size_px)?;
        gathered.scanned += filmed.scanned;
        gathered.shown.extend(filmed.shown);
        gathered.used.extend(filmed.used);
        gathered.larger.extend(filmed.larger);
        gathered.blank.extend(filmed.blank);
    }
    for it in scanned {
        gathered.check_size(&it.name, it.size_px)?;
        gathered.scanned += 1;
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
    let (shown, scanned) = (gathered.shown.len(), gathered.scanned);
    let mut found = calibrated.map_err(|error| {
        // A wrong description of the board is not solved by more images.
        let other = board.other(&samples(&paths, gathered.blank));
        let other = other.map_or_else(String::new, |it| format!("; {it}"));
        anyhow!("{error} (the board was found in {shown} of the {scanned} scanned images){other}")
    })?;
    found.left_out.extend(gathered.unseen);
    Ok(found)
}

/// Some images of a camera, evenly spread, in which another board is tried.
fn samples(paths: &[PathBuf], filmed: Vec<GrayImage>) -> Vec<GrayImage> {
    let step = paths.len().div_ceil(SAMPLES).max(1);
    let read = paths
        .iter()
        .step_by(step)
        .filter_map(|path| image::open(path).ok());
    let read = read.map(image::DynamicImage::into_luma8);
    read.chain(filmed).take(SAMPLES).collect()
}

/// Results of the images and videos of one camera.
#[derive(Default)]
struct Gathered {
    /// The first image or video, and its image size.
    first: Option<(String, [u32; 2])>,
    /// All images that show the board, and those that are used.
    shown: Vec<BoardView>,
    used: Vec<BoardView>,
    /// Images without the board, and why.
    unseen: Vec<(String, String)>,
    /// Corners along the sides of boards that are larger than the given one.
    larger: Vec<[u32; 2]>,
    /// Some images of videos that do not show the board.
    blank: Vec<GrayImage>,
    scanned: usize,
}

impl Gathered {
    /// Refuses images of another size than those before.
    fn check_size(&mut self, name: &str, size_px: [u32; 2]) -> anyhow::Result<()> {
        let first = self.first.get_or_insert_with(|| (name.to_owned(), size_px));
        let ([w, h], [other_w, other_h]) = (first.1, size_px);
        let remedy = if [other_h, other_w] == [w, h] {
            "the camera was turned on its side: hold it as in use"
        } else {
            "give images of one camera only, with its final settings"
        };
        ensure!(
            first.1 == size_px,
            "{name}: found images of {other_w}x{other_h}, expected {w}x{h} as in {}: {remedy}",
            first.0
        );
        Ok(())
    }
}

/// The images and videos in `paths`, with the content of folders sorted by name.
///
/// # Errors
/// Unreadable folders, folders without any, and too many files.
pub(super) fn recorded(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in paths {
        if path.is_dir() {
            let mut inside = Vec::new();
            for entry in fs::read_dir(path).with_context(|| path.display().to_string())? {
                let entry = entry.with_context(|| path.display().to_string())?.path();
                if is_image(&entry) || is_video(&entry) {
                    inside.push(entry);
                }
            }
            ensure!(
                !inside.is_empty(),
                "{}: found no image in it, expected JPEG or PNG files, or videos",
                path.display()
            );
            inside.sort();
            all.extend(inside);
        } else {
            all.push(path.clone());
        }
        ensure!(
            all.len() <= MAX_PICTURES,
            "found more than {MAX_PICTURES} images: thirty that reach every corner are enough"
        );
    }
    Ok(all)
}

/// The image size of an image or a video, without decoding it.
///
/// # Errors
/// An unreadable file.
pub(super) fn size_px(path: &Path) -> anyhow::Result<[u32; 2]> {
    let named = || path.display().to_string();
    if is_video(path) {
        let (info, _) = open_video_alone(path)?;
        return info.size_px.with_context(named);
    }
    let (width, height) = image::image_dimensions(path).with_context(named)?;
    Ok([width, height])
}

fn scan(path: &Path, board: &Board) -> anyhow::Result<ScannedImage> {
    let name = path.display().to_string();
    let picture = image::open(path)
        .with_context(|| name.clone())?
        .into_luma8();
    let view = board.detect(&name, &picture);
    Ok(ScannedImage {
        size_px: [picture.width(), picture.height()],
        name,
        view,
    })
}
