//! What a `ChArUco` board that is not found may be instead: one number of its description is changed at a time, and what then
//! is found in the pictures decides.

use std::fmt;

use calib_targets_charuco::resolve_dictionary;

use super::charuco::{Charuco, markers_of};
use super::picture::GrayPicture;

/// Dictionaries with all markers of their kind: those with fewer begin alike.
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
/// Sides of markers, shares of a square's.
const MARKER_SHARES: [f64; 5] = [0.5, 0.6, 0.7, 0.78, 0.87];
/// Markers of a picture from which a board is another one: by chance hardly two agree.
const LEAST_MARKERS: usize = 6;

/// Another board, or another way to take its picture.
#[derive(Debug, Clone, PartialEq)]
pub enum OtherCharuco {
    /// Another number of squares.
    Squares([u32; 2]),
    /// Another dictionary.
    Dictionary(String),
    /// Another side of the markers, about, metres.
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
                "markers of about {:.0} mm are found: measure the side of one, and give it by --marker-mm",
                1000.0 * side_m
            ),
            Self::Mirrored => {
                write!(
                    f,
                    "the board is found in their mirror image: turn off mirroring in the camera, or flip the pictures"
                )
            }
        }
    }
}

/// The one change with which `board` is found in the most of `pictures`; `None` where none finds it.
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
    // Markers are found with sides around the right one, too: of equal counts the middle one is the nearest.
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
