//! Corners of chessboards in grey pictures, by the crates `calib-targets-*` and `chess-corners`, and their refinement to a few
//! hundredths of a pixel.

use calib_targets_chessboard::{
    ChessboardDetection, ChessboardDetector, ChessboardParams, DetectorConfig, GrayImageView,
    default_chess_config, detect_corners,
};
use chess_corners::UpscaleConfig;
use nalgebra::{Matrix2, Vector2};

use super::BoardView;

/// Most pixels of a picture.
const MOST_PIXELS: usize = 1 << 28;
/// Most squares along a side of a board.
const MOST_SQUARES: u32 = 200;

/// A chessboard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chessboard {
    /// *Inner* corners along both sides, in any order: a board of 5 x 8 squares has 4 x 7.
    pub corners: [u32; 2],
    /// Side of a square, metres.
    pub square_m: f64,
}

/// The reason why a picture gives no corners.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DetectError {
    /// The bytes do not match the picture.
    #[error("found {found} bytes, expected {width} x {height}")]
    Bytes {
        /// The number of bytes.
        found: usize,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// The board is impossible.
    #[error("{0}")]
    Board(String),
    /// There is no board in the picture.
    #[error("no board was found")]
    NotFound,
    /// There is another board in the picture.
    #[error("found a board of {} x {} inner corners, expected at most {} x {}", found[0], found[1], expected[0], expected[1])]
    OtherBoard {
        /// Corners along its sides.
        found: [u32; 2],
        /// The stated size.
        expected: [u32; 2],
    },
}

/// `picture` as a view of the detector crates.
pub(super) fn view<'a>(picture: &GrayPicture<'a>) -> Result<GrayImageView<'a>, DetectError> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let count = width
        .checked_mul(height)
        .filter(|count| (1..=MOST_PIXELS).contains(count));
    if count != Some(picture.pixels.len()) {
        return Err(DetectError::Bytes {
            found: picture.pixels.len(),
            width: picture.width,
            height: picture.height,
        });
    }
    Ok(GrayImageView {
        width,
        height,
        data: picture.pixels,
    })
}

/// The searches, one after the other until the whole board is found: the picture as it is, coarse to fine for large squares out
/// of focus, and enlarged for small squares.
pub(super) fn searches() -> [DetectorConfig; 3] {
    let usual = default_chess_config();
    let coarse = usual.with_multiscale(DetectorConfig::chess_multiscale().multiscale);
    [usual, coarse, usual.with_upscale(UpscaleConfig::fixed(2))]
}

pub(super) fn check_board(squares: [u32; 2], square_m: f64) -> Result<(), DetectError> {
    if squares.iter().any(|s| !(2..=MOST_SQUARES).contains(s)) {
        return Err(DetectError::Board(format!(
            "a board of {squares:?}: expected 2 to {MOST_SQUARES} each way"
        )));
    }
    if !(square_m.is_finite() && square_m > 0.0) {
        return Err(DetectError::Board(format!(
            "squares of {square_m} m: expected a number above 0"
        )));
    }
    Ok(())
}

/// The corners of a chessboard, or of a part of it, in a picture.
///
/// The first corner is arbitrary: the same corner can have different coordinates in two pictures, and the first corner of a
/// visible part is that part's. This does not matter for [`super::calibrate`], but for the pose of one board in two cameras.
///
/// # Errors
/// [`DetectError`] if the bytes do not match the picture, nothing is found, or the board is larger than stated.
pub fn detect_chessboard(
    name: &str,
    picture: &GrayPicture<'_>,
    board: &Chessboard,
) -> Result<BoardView, DetectError> {
    check_board(board.corners, board.square_m)?;
    let view = view(picture)?;
    let full = (board.corners[0] * board.corners[1]) as usize;
    let mut best: Option<ChessboardDetection> = None;
    let mut other: Option<([u32; 2], usize)> = None;
    for search in searches() {
        let corners = detect_corners(&view, &search);
        for params in ChessboardParams::sweep_default() {
            let Ok(detector) = ChessboardDetector::new(params) else {
                continue;
            };
            let Some(found) = detector.detect(&corners) else {
                continue;
            };
            let extent = extent(&found);
            if !fits(extent, board.corners) {
                let count = found.corners.len();
                if other.is_none_or(|(_, most)| count > most) {
                    other = Some((extent, count));
                }
            } else if best
                .as_ref()
                .is_none_or(|best| found.corners.len() > best.corners.len())
            {
                best = Some(found);
            }
        }
        if best.as_ref().is_some_and(|best| best.corners.len() >= full) {
            break;
        }
    }
    // A part of a larger board is not the stated board; a pattern next to a whole board is not a larger board.
    let seen = best.as_ref().map_or(0, |best| best.corners.len());
    let other = other.filter(|(_, count)| seen < full && *count > seen);
    match (best.filter(|_| other.is_none()), other) {
        (Some(found), _) => {
            let reach_px = REACH * f64::from(found.cell_size.unwrap_or(0.0));
            let corners = found.corners.iter();
            let on_board = |along: i32| f64::from(along) * board.square_m;
            Ok(BoardView {
                name: name.to_owned(),
                board_m: corners
                    .clone()
                    .map(|corner| [on_board(corner.grid.u), on_board(corner.grid.v)])
                    .collect(),
                pixels: corners
                    .map(|corner| place(picture, corner.position, reach_px))
                    .collect(),
                print: Print::default(),
            })
        }
        (None, Some((found, _))) => Err(DetectError::OtherBoard {
            found,
            expected: board.corners,
        }),
        (None, None) => Err(DetectError::NotFound),
    }
}

/// Radius of the inspected area around a corner, relative to a square's side: the next corner is one side away.
const REACH: f64 = 0.35;

/// The refined position of a corner, distorted pixels.
pub(super) fn place(
    picture: &GrayPicture<'_>,
    found: nalgebra::Point2<f32>,
    reach_px: f64,
) -> [f64; 2] {
    let start = Vector2::new(f64::from(found.x), f64::from(found.y));
    refined(picture, start, reach_px).into()
}

/// Corners along both sides.
fn extent(found: &ChessboardDetection) -> [u32; 2] {
    let side = |along: &dyn Fn(&calib_targets_chessboard::ChessboardCorner) -> i32| {
        let all = || found.corners.iter().map(along);
        let span = all().max().unwrap_or(0) - all().min().unwrap_or(0);
        u32::try_from(span).unwrap_or(u32::MAX).saturating_add(1)
    };
    [side(&|corner| corner.grid.u), side(&|corner| corner.grid.v)]
}

fn fits(found: [u32; 2], board: [u32; 2]) -> bool {
    let [a, b] = board;
    (found[0] <= a && found[1] <= b) || (found[0] <= b && found[1] <= a)
}

/// The print of a `ChArUco` board.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Print {
    /// White on black (Caliscope's `inverted`).
    pub is_negative: bool,
    /// The layout of `OpenCV` before 4.6: with an even number of rows the first square is white. Odd numbers do not differ.
    pub is_legacy: bool,
}

impl Print {
    /// Describes an unusual print.
    pub(super) fn in_words(self) -> Option<&'static str> {
        match (self.is_negative, self.is_legacy) {
            (false, false) => None,
            (true, false) => Some("white on black"),
            (false, true) => Some("as OpenCV drew boards before 4.6 (its first square is white)"),
            (true, true) => Some("as OpenCV drew boards before 4.6, and white on black"),
        }
    }
}

/// A grey picture: one byte per pixel, by rows from the upper left.
#[derive(Debug, Clone, Copy)]
pub struct GrayPicture<'a> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width` x `height` bytes.
    pub pixels: &'a [u8],
}

/// Most rounds.
const MOST_ROUNDS: usize = 20;
/// A round with a smaller step is the last, pixels.
const STILL_PX: f64 = 1e-3;
/// Least and largest half side of the window, pixels: smaller ones have too few gradients, in larger ones the lens bends lines.
const WINDOW_PX: [f64; 2] = [2.0, 10.0];

/// The corner near `start`: the point to which all gradients around it are perpendicular (Foerstner and Guelch 1987; `OpenCV`'s
/// `cornerSubPix` is the same); `start` itself if there is none within half the window. Within `reach_px` of the corner there is
/// nothing but its four squares.
pub(super) fn refined(
    picture: &GrayPicture<'_>,
    start: Vector2<f64>,
    reach_px: f64,
) -> Vector2<f64> {
    let half = reach_px.clamp(WINDOW_PX[0], WINDOW_PX[1]).floor();
    let mut at = start;
    for _ in 0..MOST_ROUNDS {
        let Some(next) = round(picture, at, half) else {
            return start;
        };
        let step = (next - at).norm();
        at = next;
        if (at - start).norm() > 0.5 * half + 1.0 {
            return start;
        }
        if step < STILL_PX {
            break;
        }
    }
    at
}

/// Least squares of g . (p - corner) = 0 over the window around `at`, with a Gaussian weight.
fn round(picture: &GrayPicture<'_>, at: Vector2<f64>, half: f64) -> Option<Vector2<f64>> {
    let side = half as i32;
    let mut matrix = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for (dy, dx) in (-side..=side).flat_map(|dy| (-side..=side).map(move |dx| (dy, dx))) {
        let offset = Vector2::new(f64::from(dx), f64::from(dy));
        let p = at + offset;
        let value = |dx: f64, dy: f64| bilinear(picture, p.x + dx, p.y + dy);
        let gradient = Vector2::new(
            value(1.0, 0.0)? - value(-1.0, 0.0)?,
            value(0.0, 1.0)? - value(0.0, -1.0)?,
        );
        let weight = libm::exp(-offset.norm_squared() / (half * half));
        let outer = weight * gradient * gradient.transpose();
        matrix += outer;
        right += outer * offset;
    }
    // A single edge determines one direction only.
    let eigenvalues = matrix.symmetric_eigenvalues();
    if eigenvalues.min() < 0.02 * eigenvalues.max() {
        return None;
    }
    Some(at + matrix.cholesky()?.solve(&right))
}

fn bilinear(picture: &GrayPicture<'_>, x: f64, y: f64) -> Option<f64> {
    let (left, top) = (x.floor(), y.floor());
    let inside = left >= 0.0
        && top >= 0.0
        && left + 1.0 < f64::from(picture.width)
        && top + 1.0 < f64::from(picture.height);
    if !inside {
        return None;
    }
    let first = top as usize * picture.width as usize + left as usize;
    let at = |offset: usize| picture.pixels.get(first + offset).map(|v| f64::from(*v));
    let below = picture.width as usize;
    let (fx, fy) = (x - left, y - top);
    let upper = at(0)? * (1.0 - fx) + at(1)? * fx;
    let lower = at(below)? * (1.0 - fx) + at(below + 1)? * fx;
    Some(upper * (1.0 - fy) + lower * fy)
}
