//! Corners of chessboards in grey pictures, by the crates `calib-targets-*` and `chess-corners`.

use calib_targets_chessboard::{
    ChessboardDetection, ChessboardDetector, ChessboardParams, DetectorConfig, GrayImageView,
    default_chess_config, detect_corners,
};
use chess_corners::UpscaleConfig;

use nalgebra::Vector2;

use super::BoardView;
use super::picture::GrayPicture;
use super::print::Print;
use super::refine::refined;

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

/// Why a picture gives no corners.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DetectError {
    /// The bytes are not those of the picture.
    #[error("found {found} bytes, expected {width} x {height}")]
    Bytes {
        /// How many.
        found: usize,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// The board cannot be one.
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
        /// What was given.
        expected: [u32; 2],
    },
}

/// `picture` as the crates have it.
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

/// How the picture is looked at, one after the other until the whole board is found: as it is, coarse to fine for large
/// squares out of focus, and enlarged for small ones.
pub(super) fn looks() -> [DetectorConfig; 3] {
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
/// Which corner is the first is not known: of two pictures the same corner may have different coordinates, and of a part of
/// the board the first is that part's. For [`super::calibrate`] any will do; for the pose of one board in two cameras not.
///
/// # Errors
/// [`DetectError`] where the bytes are not those of a picture, nothing is found, or a larger board than this.
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
    for look in looks() {
        let corners = detect_corners(&view, &look);
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
    // A part of a larger board is none of this size; a pattern beside a whole one is no larger board.
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

/// Share of a square's side around a corner that is looked at: the next corner is one side away.
const REACH: f64 = 0.35;

/// Where a corner is, distorted pixels.
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
