//! Corners of `ChArUco` boards in grey pictures, however they are printed.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use calib_targets_charuco::{
    CharucoBoardSpec, CharucoCorner, CharucoDetector, CharucoParams, Dictionary, resolve_dictionary,
};
use calib_targets_chessboard::{DetectorConfig, detect_corners};

use super::BoardView;
use super::detect::{DetectError, check_board, looks, place, view};
use super::picture::GrayPicture;
use super::print::Print;

/// A `ChArUco` board as `OpenCV` draws it; [`Print`] is found, not given.
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

/// The inner corners of a `ChArUco` board in a picture, each by its markers' numbers: the same corner has the same coordinates
/// in every picture.
///
/// Where not all of the board is found as `OpenCV` draws it now, the other ways to print it ([`Print`]) are tried; the one that
/// the most markers agree with wins.
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
    let layouts = layouts(board)?;
    let mut best = most_of(name, picture, board, &layouts, false, &looks())?;
    if !best.is_whole(board) {
        let negative: Vec<u8> = picture.pixels.iter().map(|level| !level).collect();
        let negative = GrayPicture {
            pixels: &negative,
            ..*picture
        };
        let other = most_of(name, &negative, board, &layouts, true, &looks())?;
        if other.rank() > best.rank() {
            best = other;
        }
    }
    if best.view.pixels.is_empty() {
        return Err(DetectError::NotFound);
    }
    Ok(best.view)
}

/// How many markers of `board` are found in a picture at first sight, black on white.
pub(super) fn markers_of(picture: &GrayPicture<'_>, board: &Charuco) -> usize {
    let seen = layouts(board).and_then(|layouts| {
        let first = &looks()[..1];
        most_of("", picture, board, &layouts, false, first)
    });
    seen.map_or(0, |part| part.markers)
}

/// A part of a board, and how many markers say that it is one.
struct Part {
    view: BoardView,
    markers: usize,
}

impl Part {
    fn rank(&self) -> (usize, usize) {
        (self.markers, self.view.pixels.len())
    }

    fn is_whole(&self, board: &Charuco) -> bool {
        let [columns, rows] = board.squares;
        self.view.pixels.len() >= ((columns - 1) * (rows - 1)) as usize
    }
}

/// Where the markers are on the board: the detector knows the layout since 4.6 only.
struct Layout {
    detector: CharucoDetector,
    is_legacy: bool,
}

/// The layouts that a board of this size can have.
fn layouts(board: &Charuco) -> Result<Vec<Layout>, DetectError> {
    let share = board.marker_m / board.square_m;
    if !(share > 0.0 && share < 1.0) {
        return Err(DetectError::Board(format!(
            "markers of {} m in squares of {} m: expected smaller ones",
            board.marker_m, board.square_m
        )));
    }
    let dictionary = resolve_dictionary(&board.dictionary).ok_or_else(|| {
        DetectError::Board(format!(
            "unknown dictionary `{}`, expected one of OpenCV's, for example DICT_4X4_50",
            board.dictionary
        ))
    })?;
    let [columns, rows] = board.squares;
    let layout = |rows: u32, dictionary: Dictionary, is_legacy: bool| {
        let spec = CharucoBoardSpec::new(
            rows,
            columns,
            board.square_m as f32,
            share as f32,
            dictionary,
        );
        let detector = CharucoDetector::new(CharucoParams::for_board(spec))
            .map_err(|error| DetectError::Board(error.to_string()))?;
        Ok(Layout {
            detector,
            is_legacy,
        })
    };
    let mut layouts = vec![layout(rows, dictionary, false)?];
    if rows.is_multiple_of(2) {
        // A board of before 4.6 is one of now without its first row, whose markers are counted from the second row on.
        let shifted = with_codes_before(&dictionary, columns / 2)?;
        layouts.push(layout(rows + 1, shifted, true)?);
    }
    Ok(layouts)
}

/// `dictionary` with `count` codes before its first one, which no marker of it has: the negatives of its own.
///
/// The detector wants codes that live as long as the program: one list is kept for each dictionary and count.
fn with_codes_before(dictionary: &Dictionary, count: u32) -> Result<Dictionary, DetectError> {
    static KEPT: Mutex<BTreeMap<(&str, u32), &[u64]>> = Mutex::new(BTreeMap::new());
    let all_bits = u64::MAX >> (64 - dictionary.bit_count());
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    let codes: &'static [u64] = kept.entry((dictionary.name(), count)).or_insert_with(|| {
        let own = dictionary.codes();
        let before = own.iter().cycle().take(count as usize);
        let all = before
            .map(|code| !code & all_bits)
            .chain(own.iter().copied());
        Box::leak(all.collect::<Box<[u64]>>())
    });
    let (bits, corrected) = (dictionary.marker_size(), dictionary.max_correction_bits());
    Dictionary::from_static_codes(dictionary.name(), bits, corrected, codes)
        .map_err(|error| DetectError::Board(error.to_string()))
}

/// As much of the board as one of the [`looks`] finds in one of `layouts`, perhaps nothing.
fn most_of(
    name: &str,
    picture: &GrayPicture<'_>,
    board: &Charuco,
    layouts: &[Layout],
    is_negative: bool,
    looks: &[DetectorConfig],
) -> Result<Part, DetectError> {
    let grey = view(picture)?;
    let mut best = Part {
        view: BoardView {
            name: name.to_owned(),
            board_m: Vec::new(),
            pixels: Vec::new(),
            print: Print::default(),
        },
        markers: 0,
    };
    for look in looks {
        let seen = detect_corners(&grey, look);
        for Layout {
            detector,
            is_legacy,
        } in layouts
        {
            let Ok(found) = detector.detect_with_corners(&grey, &seen) else {
                continue;
            };
            // Of a legacy board the detector counts a row that is not there.
            let first_row = i32::from(*is_legacy);
            let corners = found.corners.iter().filter(|it| it.grid.v > first_row);
            let corners: Vec<&CharucoCorner> = corners.collect();
            if (found.markers.len(), corners.len()) > best.rank() {
                best = Part {
                    markers: found.markers.len(),
                    view: BoardView {
                        name: name.to_owned(),
                        board_m: corners
                            .iter()
                            .map(|it| on_board(it, first_row, board))
                            .collect(),
                        pixels: places(picture, &corners, board),
                        print: Print {
                            is_negative,
                            is_legacy: *is_legacy,
                        },
                    },
                };
            }
        }
        if best.is_whole(board) {
            break;
        }
    }
    Ok(best)
}

/// Where a corner is on the board, metres.
fn on_board(corner: &CharucoCorner, first_row: i32, board: &Charuco) -> [f64; 2] {
    [corner.grid.u, corner.grid.v - first_row].map(|i| f64::from(i) * board.square_m)
}

/// Where corners are in the picture, distorted pixels.
fn places(picture: &GrayPicture<'_>, corners: &[&CharucoCorner], board: &Charuco) -> Vec<[f64; 2]> {
    let share = board.marker_m / board.square_m;
    let reach_px = 0.5 * (1.0 - share) * spacing(corners);
    let each = corners.iter();
    each.map(|it| place(picture, it.position, reach_px))
        .collect()
}

/// Distance of the two nearest corners, pixels.
fn spacing(corners: &[&CharucoCorner]) -> f64 {
    let pairs = corners.iter().enumerate().flat_map(|(i, a)| {
        let others = corners.iter().skip(i + 1);
        others.map(move |b| f64::from((a.position - b.position).norm()))
    });
    pairs.min_by(f64::total_cmp).unwrap_or(0.0)
}
