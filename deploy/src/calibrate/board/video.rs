//! Detects a board in a video: the sharpest image of every third of a second is scanned, and of those with the board
//! the ones that differ the most are used.

use std::path::Path;

use anyhow::bail;
use farfield_calibration::board::{BoardView, DetectError};
use farfield_edge::source::{FrameContent, open_video_alone};
use image::GrayImage;
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

use crate::init::recordings;
use crate::recording_checks::print_format;

/// Scanned images per second.
const SCANS_HZ: f64 = 3.0;
/// Limit for used images: more cost time without more information.
const MOST_USED: usize = 40;
/// Images scanned at the same time.
const TOGETHER: usize = 8;
/// Corners closer than this to those of another image, in pixels, are the same view: the board was held still.
const SAME_PX: f64 = 8.0;
/// Number of stored images without the board, in which another one is tried.
const MOST_BLANK: usize = 3;
/// Step between rows and columns for the measure of sharpness.
const SPARSE: usize = 3;

/// Result of a video.
pub(super) struct Filmed {
    pub(super) size_px: [u32; 2],
    /// All images that show the board.
    pub(super) shown: Vec<BoardView>,
    /// Those that are used.
    pub(super) used: Vec<BoardView>,
    /// Corners along the sides of boards in it that are larger than the given one.
    pub(super) larger: Vec<[u32; 2]>,
    /// Some images that do not show the board.
    pub(super) blank: Vec<GrayImage>,
    /// Number of images.
    pub(super) pictures: usize,
    /// Number of scanned images.
    pub(super) scanned: usize,
}

/// Detects the board in a video with `detect` (name, image). Size and rate of the video may vary, as in phones.
///
/// # Errors
/// An unreadable video, and an invalid board.
pub(super) fn scan(
    path: &Path,
    detect: impl Fn(&str, &GrayImage) -> Result<BoardView, DetectError> + Sync,
) -> anyhow::Result<Filmed> {
    let (info, mut source) = open_video_alone(path)?;
    print_format(&path.display().to_string(), &info);
    let window = window(info.rate_hz);
    let mut images = ScannedVideo::default();
    let mut sharpest: Option<(f64, usize, GrayImage)> = None;
    let mut waiting: Vec<(String, GrayImage)> = Vec::new();
    let name = |picture: usize| format!("{}, image {picture}", path.display());
    let mut pictures = 0;
    let mut size_px = info.size_px.unwrap_or_default();
    while let Some(frame) = source.next_frame()? {
        let FrameContent::Image(picture) = frame.content else {
            bail!("{}: found no images", path.display());
        };
        size_px = picture.size_px();
        let picture = picture.to_grey();
        let sharpness = sharpness(&picture);
        if sharpest.as_ref().is_none_or(|(most, ..)| sharpness > *most) {
            sharpest = Some((sharpness, pictures, picture));
        }
        pictures += 1;
        if pictures % window == 0
            && let Some((_, number, picture)) = sharpest.take()
        {
            waiting.push((name(number), picture));
        }
        if waiting.len() >= TOGETHER {
            images.scan(&mut waiting, &detect)?;
        }
    }
    waiting.extend(sharpest.map(|(_, number, picture)| (name(number), picture)));
    images.scan(&mut waiting, &detect)?;
    Ok(Filmed {
        size_px,
        pictures,
        scanned: images.pictures,
        larger: images.larger,
        blank: images.blank,
        used: different(images.views.clone(), MOST_USED),
        shown: images.views,
    })
}

/// One of so many images of a video of `rate_hz` is scanned.
fn window(rate_hz: Option<f64>) -> usize {
    (recordings::rough_rate(rate_hz) / SCANS_HZ)
        .round()
        .max(1.0) as usize
}

/// Results so far.
#[derive(Default)]
struct ScannedVideo {
    pictures: usize,
    views: Vec<BoardView>,
    larger: Vec<[u32; 2]>,
    blank: Vec<GrayImage>,
}

impl ScannedVideo {
    /// Scans the waiting images, and empties the list.
    fn scan(
        &mut self,
        waiting: &mut Vec<(String, GrayImage)>,
        detect: &(impl Fn(&str, &GrayImage) -> Result<BoardView, DetectError> + Sync),
    ) -> anyhow::Result<()> {
        self.pictures += waiting.len();
        let found: Vec<Result<BoardView, DetectError>> = waiting
            .par_iter()
            .map(|(name, picture)| detect(name, picture))
            .collect();
        for (view, (_, picture)) in found.into_iter().zip(waiting.drain(..)) {
            match view {
                Ok(view) => self.views.push(view),
                Err(error @ (DetectError::Board(_) | DetectError::Bytes { .. })) => {
                    return Err(error.into());
                }
                Err(DetectError::OtherBoard { found, .. }) => self.larger.push(found),
                Err(DetectError::NotFound) if self.blank.len() < MOST_BLANK => {
                    self.blank.push(picture);
                }
                Err(DetectError::NotFound) => (),
            }
        }
        Ok(())
    }
}

/// Mean squared Laplacian of a sample of the pixels: motion blur and lack of focus lower it.
pub(in crate::calibrate) fn sharpness(picture: &GrayImage) -> f64 {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let pixels = picture.as_raw();
    let at = |x: usize, y: usize| {
        let pixel = pixels.get(y * width + x).copied().unwrap_or_default();
        f64::from(pixel)
    };
    let (mut total, mut count) = (0.0, 0.0);
    for y in (1..height.saturating_sub(1)).step_by(SPARSE) {
        for x in (1..width.saturating_sub(1)).step_by(SPARSE) {
            let around = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1);
            let bend = around - 4.0 * at(x, y);
            total += bend * bend;
            count += 1.0;
        }
    }
    total / f64::max(count, 1.0)
}

/// At most `most` of `views`, without duplicates: the first has the most corners, each next one is the farthest from
/// all before.
fn different(mut views: Vec<BoardView>, most: usize) -> Vec<BoardView> {
    let mut used: Vec<BoardView> = Vec::new();
    let first = views
        .iter()
        .enumerate()
        .max_by_key(|(_, it)| it.pixels.len());
    let mut next = first.map(|(index, _)| index);
    let mut distances = vec![f64::INFINITY; views.len()];
    while let Some(index) = next.filter(|_| used.len() < most) {
        let view = views.swap_remove(index);
        distances.swap_remove(index);
        for (distance, other) in distances.iter_mut().zip(&views) {
            *distance = distance.min(apart_px(&view, other));
        }
        used.push(view);
        let farthest = distances
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1));
        let farthest = farthest.filter(|(_, apart_px)| **apart_px > SAME_PX);
        next = farthest.map(|(index, _)| index);
    }
    used
}

/// Mean distance between the outermost corners of two views in the image.
fn apart_px(a: &BoardView, b: &BoardView) -> f64 {
    let (a, b) = (outermost(a), outermost(b));
    let each = a.iter().zip(&b);
    let square = |v: f64| v * v;
    let apart = each.map(|(a, b)| (square(a[0] - b[0]) + square(a[1] - b[1])).sqrt());
    apart.sum::<f64>() / 4.0
}

/// Image positions of the outermost corners of the board, in the direction of each of its four corners.
fn outermost(view: &BoardView) -> [[f64; 2]; 4] {
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| {
        let along = |at: &[f64; 2]| x * at[0] + y * at[1];
        let corners = view.board_m.iter().zip(&view.pixels);
        let farthest = corners.max_by(|a, b| along(a.0).total_cmp(&along(b.0)));
        farthest.map_or([0.0, 0.0], |(_, px)| *px)
    })
}

#[cfg(test)]
mod tests {
    use farfield_calibration::board::Print;

    use super::*;

    fn view(left: f64, size: f64) -> BoardView {
        let board_m = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let pixels = board_m.iter().map(|[x, y]| [left + size * x, size * y]);
        BoardView {
            name: format!("{left}"),
            pixels: pixels.collect(),
            board_m,
            print: Print::default(),
        }
    }

    #[test]
    fn only_different_views_are_used() {
        let mut views: Vec<BoardView> = (0..50).map(|i| view(0.01 * f64::from(i), 100.0)).collect();
        views.extend([view(500.0, 100.0), view(0.0, 400.0), view(900.0, 200.0)]);
        let used = different(views.clone(), 4);
        let has = |left: f64, size: f64| used.contains(&view(left, size));
        assert!(used.len() == 4 && has(500.0, 100.0) && has(0.0, 400.0) && has(900.0, 200.0));
        assert_eq!(different(views, 60).len(), 4);
        assert!(different(Vec::new(), 60).is_empty());
    }

    #[test]
    fn a_window_is_a_third_of_a_second() {
        let images = |rate_hz: f64| window(Some(rate_hz));
        assert_eq!(
            [images(30.0), images(59.94), images(2.0), images(0.0)],
            [10, 20, 1, 1]
        );
        // An invalid rate.
        assert_eq!((images(90_000.0), window(None)), (80, 10));
    }

    #[test]
    fn a_blurred_image_is_less_sharp() {
        let squares = GrayImage::from_fn(90, 60, |x, y| {
            image::Luma([255 * ((x / 10 + y / 10) % 2) as u8])
        });
        let blurred = image::imageops::fast_blur(&squares, 3.0);
        assert!(sharpness(&squares) > 10.0 * sharpness(&blurred));
        assert!(sharpness(&GrayImage::new(1, 1)) < 1e-9);
    }
}
