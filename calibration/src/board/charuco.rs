//! Corners of `ChArUco` boards in grey pictures, in all prints, and the correction of wrong descriptions.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Mutex, PoisonError};

use calib_targets_charuco::{
    CharucoBoardSpec, CharucoCorner, CharucoDetector, CharucoParams, Dictionary, resolve_dictionary,
};
use calib_targets_chessboard::{DetectorConfig, detect_corners};

use super::BoardView;
use super::detect::{DetectError, GrayPicture, Print, check_board, place, searches, view};

/// A `ChArUco` board as `OpenCV` draws it; the [`Print`] is detected.
#[derive(Debug, Clone, PartialEq)]
pub struct Charuco {
    /// Squares along a row and along a column.
    pub squares: [u32; 2],
    /// Side of a square, metres.
    pub square_m: f64,
    /// Side of a marker, metres.
    pub marker_m: f64,
    /// Its dictionary by `OpenCV`'s name: `DICT_4X4_50`.
    pub dictionary: String,
}

/// The inner corners of a `ChArUco` board in a picture, identified by their markers: the same corner has the same coordinates
/// in every picture.
///
/// If the board in `OpenCV`'s current layout is not found as a whole, the other prints ([`Print`]) are tried; the one with the
/// most markers wins.
///
/// # Errors
/// [`DetectError`] if the bytes do not match the picture, the board or its dictionary is impossible, or nothing is found.
pub fn detect_charuco(
    name: &str,
    picture: &GrayPicture<'_>,
    board: &Charuco,
) -> Result<BoardView, DetectError> {
    check_board(board.squares, board.square_m)?;
    view(picture)?;
    let layouts = layouts(board)?;
    let mut best = most_of(name, picture, board, &layouts, false, &searches())?;
    if !best.is_whole(board) {
        let negative: Vec<u8> = picture.pixels.iter().map(|level| !level).collect();
        let negative = GrayPicture {
            pixels: &negative,
            ..*picture
        };
        let other = most_of(name, &negative, board, &layouts, true, &searches())?;
        if other.rank() > best.rank() {
            best = other;
        }
    }
    if best.view.pixels.is_empty() {
        return Err(DetectError::NotFound);
    }
    Ok(best.view)
}

/// The number of markers of `board` that the first search finds in a picture, black on white.
pub(super) fn markers_of(picture: &GrayPicture<'_>, board: &Charuco) -> usize {
    let seen = layouts(board).and_then(|layouts| {
        let first = &searches()[..1];
        most_of("", picture, board, &layouts, false, first)
    });
    seen.map_or(0, |part| part.markers)
}

/// A part of a board, and the number of its markers.
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

/// The layout of the markers: the detector knows only that since 4.6.
struct Layout {
    detector: CharucoDetector,
    is_legacy: bool,
}

/// The possible layouts of a board of this size.
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
        // A legacy board is a current one without its first row, with markers counted from the second row on.
        let shifted = with_codes_before(&dictionary, columns / 2)?;
        layouts.push(layout(rows + 1, shifted, true)?);
    }
    Ok(layouts)
}

/// `dictionary` with `count` codes before its first one that no marker has: the negatives of its own.
///
/// The detector needs static codes: one list per dictionary and count is cached.
fn with_codes_before(dictionary: &Dictionary, count: u32) -> Result<Dictionary, DetectError> {
    static CACHED: Mutex<BTreeMap<(&str, u32), &[u64]>> = Mutex::new(BTreeMap::new());
    let all_bits = u64::MAX >> (64 - dictionary.bit_count());
    let mut cached = CACHED.lock().unwrap_or_else(PoisonError::into_inner);
    let codes: &'static [u64] = cached.entry((dictionary.name(), count)).or_insert_with(|| {
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

/// The largest part of the board that one of the `searches` finds in one of `layouts`; it can be empty.
fn most_of(
    name: &str,
    picture: &GrayPicture<'_>,
    board: &Charuco,
    layouts: &[Layout],
    is_negative: bool,
    searches: &[DetectorConfig],
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
    for search in searches {
        let seen = detect_corners(&grey, search);
        for Layout {
            detector,
            is_legacy,
        } in layouts
        {
            let Ok(found) = detector.detect_with_corners(&grey, &seen) else {
                continue;
            };
            // For a legacy board the detector counts a row that does not exist.
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

/// The position of a corner on the board, metres.
fn on_board(corner: &CharucoCorner, first_row: i32, board: &Charuco) -> [f64; 2] {
    [corner.grid.u, corner.grid.v - first_row].map(|i| f64::from(i) * board.square_m)
}

/// The positions of corners in the picture, distorted pixels.
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

/// Dictionaries with all markers of their kind: smaller ones begin alike.
const DICTIONARIES: [&str; 8] = [
    "DICT_4X4_1000",
    "DICT_5X5_1000",
    "DICT_6X6_1000",
    "DICT_7X7_1000",
    "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h11",
];
/// Sides of markers relative to those of squares.
const MARKER_SHARES: [f64; 5] = [0.5, 0.6, 0.7, 0.78, 0.87];
/// Least number of markers in a picture that count: fewer are found by chance.
const LEAST_MARKERS: usize = 6;

/// Another board, or another kind of picture.
#[derive(Debug, Clone, PartialEq)]
pub enum OtherCharuco {
    /// Another number of squares.
    Squares([u32; 2]),
    /// Another dictionary.
    Dictionary(String),
    /// Another approximate side of the markers, metres.
    Marker(f64),
    /// The pictures are mirrored.
    Mirrored,
}

impl fmt::Display for OtherCharuco {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Squares([columns, rows]) => {
                write!(
                    f,
                    "a board of {columns} x {rows} squares is found: give --charuco {columns}x{rows}, squares and not inner corners"
                )
            }
            Self::Dictionary(name) => {
                write!(
                    f,
                    "markers of another dictionary are found: give --dictionary {name}"
                )
            }
            Self::Marker(side_m) => write!(
                f,
                "markers of about {:.0} mm are found: measure the side of one, and give it with --marker-mm",
                1000.0 * side_m
            ),
            Self::Mirrored => {
                write!(
                    f,
                    "the board is found in the mirror image of the pictures: turn off mirroring in the camera, or flip the pictures"
                )
            }
        }
    }
}

/// The change with which most markers of `board` are found in `pictures`; `None` if none helps.
pub fn other_charuco(pictures: &[GrayPicture<'_>], board: &Charuco) -> Option<OtherCharuco> {
    let mirrored: Vec<Vec<u8>> = pictures.iter().map(mirrored).collect();
    let flipped = pictures.iter().zip(&mirrored);
    let flipped: Vec<GrayPicture<'_>> = flipped
        .map(|(picture, pixels)| GrayPicture { pixels, ..*picture })
        .collect();
    let mut found: Vec<(usize, OtherCharuco)> = Vec::new();
    for (change, other) in changes(board) {
        let pictures = match change {
            OtherCharuco::Mirrored => &flipped[..],
            _ => pictures,
        };
        let counts = pictures.iter().map(|it| markers_of(it, &other));
        let counts = counts.filter(|count| *count >= LEAST_MARKERS);
        let count: usize = counts.sum();
        let most = found.first().map_or(1, |(most, _)| *most);
        if count > most {
            found.clear();
        }
        if count >= most {
            found.push((count, change));
        }
    }
    // Markers are also found with sides near the right one: among equal counts the middle is the nearest.
    let middle = found.len() / 2;
    found.into_iter().nth(middle).map(|(_, change)| change)
}

/// The boards that differ in one number.
fn changes(board: &Charuco) -> Vec<(OtherCharuco, Charuco)> {
    let [columns, rows] = board.squares;
    let more = [columns.saturating_add(1), rows.saturating_add(1)];
    let sizes = [[rows, columns], more, [more[1], more[0]]];
    let sizes = sizes.into_iter().filter(|it| *it != board.squares);
    let mut changes: Vec<(OtherCharuco, Charuco)> = sizes
        .map(|squares| {
            let other = Charuco {
                squares,
                ..board.clone()
            };
            (OtherCharuco::Squares(squares), other)
        })
        .collect();
    for name in DICTIONARIES {
        let kind = |name: &str| resolve_dictionary(name).map(|it| it.codes().first().copied());
        if kind(name) == kind(&board.dictionary) {
            continue;
        }
        let other = Charuco {
            dictionary: name.to_owned(),
            ..board.clone()
        };
        changes.push((OtherCharuco::Dictionary(name.to_owned()), other));
    }
    for share in MARKER_SHARES {
        let marker_m = share * board.square_m;
        let other = Charuco {
            marker_m,
            ..board.clone()
        };
        changes.push((OtherCharuco::Marker(marker_m), other));
    }
    changes.push((OtherCharuco::Mirrored, board.clone()));
    changes
}

fn mirrored(picture: &GrayPicture<'_>) -> Vec<u8> {
    let rows = picture.pixels.chunks(picture.width.max(1) as usize);
    rows.flat_map(|row| row.iter().rev().copied()).collect()
}
