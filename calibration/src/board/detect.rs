//! Corners of chessboards and `ChArUco` boards in grey pictures, by the crates `calib-targets-*` and `chess-corners`.

use calib_targets_charuco::{
    CharucoBoardSpec, CharucoCorner, CharucoDetector, CharucoParams, Dictionary, MarkerLayout,
    resolve_dictionary,
};
use calib_targets_chessboard::{
    ChessboardDetection, ChessboardDetector, ChessboardParams, DetectorConfig, GrayImageView,
    default_chess_config, detect_corners,
};
use chess_corners::UpscaleConfig;

use nalgebra::Vector2;

use super::BoardView;
use super::picture::GrayPicture;
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

/// A `ChArUco` board with `OpenCV`'s layout since 4.6: a marker in every white square, the first square black; or its
/// negative.
#[derive(Debug, Clone, PartialEq)]
pub struct Charuco {
    /// Squares along a row and along a column.
    pub squares: [u32; 2],
    /// Side of a square, metres.
    pub square_m: f64,
    /// Side of a marker, metres.
    pub marker_m: f64,
    /// Its dictionary as `OpenCV` calls it: `DICT_4X4_50`.
    pub dictionary: String,
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
fn view<'a>(picture: &GrayPicture<'a>) -> Result<GrayImageView<'a>, DetectError> {
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
fn looks() -> [DetectorConfig; 3] {
    let usual = default_chess_config();
    let coarse = usual.with_multiscale(DetectorConfig::chess_multiscale().multiscale);
    [usual, coarse, usual.with_upscale(UpscaleConfig::fixed(2))]
}

fn check_board(squares: [u32; 2], square_m: f64) -> Result<(), DetectError> {
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
fn place(picture: &GrayPicture<'_>, found: nalgebra::Point2<f32>, reach_px: f64) -> [f64; 2] {
    let start = Vector2::new(f64::from(found.x), f64::from(found.y));
    refined(picture, start, reach_px).into()
}

/// Distance of the two nearest corners, pixels.
fn spacing(corners: &[CharucoCorner]) -> f64 {
    let pairs = corners.iter().enumerate().flat_map(|(i, a)| {
        let others = corners.iter().skip(i + 1);
        others.map(move |b| f64::from((a.position - b.position).norm()))
    });
    pairs.min_by(f64::total_cmp).unwrap_or(0.0)
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

/// The inner corners of a `ChArUco` board in a picture, each by its markers' numbers: the same corner has the same coordinates
/// in every picture.
///
/// The board may be printed white on black (Caliscope's `inverted`): where not all of it is found as it is, the negative is
/// looked at, too, and whichever shows more of it is taken.
///
/// # Errors
/// [`DetectError`] where the bytes are not those of a picture, the board or its dictionary cannot be, or nothing is found.
pub fn detect_charuco(
    name: &str,
    picture: &GrayPicture<'_>,
    board: &Charuco,
) -> Result<BoardView, DetectError> {
    check_board(board.squares, board.square_m)?;
    view(picture)?;
    let share = board.marker_m / board.square_m;
    if !(share > 0.0 && share < 1.0) {
        return Err(DetectError::Board(format!(
            "markers of {} m in squares of {} m: expected smaller ones",
            board.marker_m, board.square_m
        )));
    }
    let dictionary: Dictionary = resolve_dictionary(&board.dictionary).ok_or_else(|| {
        DetectError::Board(format!(
            "unknown dictionary `{}`, expected one of OpenCV's, for example DICT_4X4_50",
            board.dictionary
        ))
    })?;
    let [columns, rows] = board.squares;
    let spec = CharucoBoardSpec::new(
        rows,
        columns,
        board.square_m as f32,
        share as f32,
        dictionary,
    )
    .with_marker_layout(MarkerLayout::OpenCvCharuco);
    let detector = CharucoDetector::new(CharucoParams::for_board(spec))
        .map_err(|error| DetectError::Board(error.to_string()))?;
    let best = most_of_charuco(name, picture, board, &detector)?;
    let full = ((columns - 1) * (rows - 1)) as usize;
    if best.pixels.len() >= full {
        return Ok(best);
    }
    let negative: Vec<u8> = picture.pixels.iter().map(|level| !level).collect();
    let negative = GrayPicture {
        pixels: &negative,
        ..*picture
    };
    let other = most_of_charuco(name, &negative, board, &detector)?;
    let best = if other.pixels.len() > best.pixels.len() {
        other
    } else {
        best
    };
    if best.pixels.is_empty() {
        return Err(DetectError::NotFound);
    }
    Ok(best)
}

/// As much of the board as one of the [`looks`] finds, perhaps nothing.
fn most_of_charuco(
    name: &str,
    picture: &GrayPicture<'_>,
    board: &Charuco,
    detector: &CharucoDetector,
) -> Result<BoardView, DetectError> {
    let view = view(picture)?;
    let [columns, rows] = board.squares;
    let share = board.marker_m / board.square_m;
    let full = ((columns - 1) * (rows - 1)) as usize;
    let mut best = BoardView {
        name: name.to_owned(),
        board_m: Vec::new(),
        pixels: Vec::new(),
    };
    for look in looks() {
        let corners = detect_corners(&view, &look);
        let Ok(found) = detector.detect_with_corners(&view, &corners) else {
            continue;
        };
        if found.corners.len() > best.pixels.len() {
            let inner = columns - 1;
            // OpenCV numbers inner corners row by row, from the board's upper left.
            let on_board =
                |id: u32| [id % inner + 1, id / inner + 1].map(|i| f64::from(i) * board.square_m);
            best.board_m = found
                .corners
                .iter()
                .map(|corner| on_board(corner.id))
                .collect();
            let reach_px = 0.5 * (1.0 - share) * spacing(&found.corners);
            let corners = found.corners.iter();
            best.pixels = corners
                .map(|corner| place(picture, corner.position, reach_px))
                .collect();
        }
        if best.pixels.len() >= full {
            break;
        }
    }
    Ok(best)
}
