//! The board to detect: a chessboard or a `ChArUco` board, from the command line.

use anyhow::{Context as _, bail};
use clap::Args;
use farfield_calibration::board::{
    BoardError, BoardView, Charuco, Chessboard, Coefficients, DetectError, GrayPicture,
    OtherCharuco, check_size, detect_charuco, detect_chessboard, other_charuco,
};
use image::GrayImage;

use crate::calibrate::convert::size;

/// Side of an empty image, pixels.
const BLANK_PX: u32 = 16;

/// The board, and the lens model to fit.
#[derive(Debug, Args)]
pub(in crate::calibrate) struct BoardKindArgs {
    /// Inner corners of a chessboard: 4x7 of 5 x 8.
    ///
    /// Corners between four squares: a board of 5 x 8 squares has 4x7.
    #[arg(long, value_name = "AxB", value_parser = size, conflicts_with = "charuco")]
    chessboard: Option<[u32; 2]>,
    /// A Charuco board: squares across and down.
    #[arg(long, value_name = "AxB", value_parser = size, requires_all = ["marker_mm", "dictionary"])]
    charuco: Option<[u32; 2]>,
    /// Side of a square, millimetres.
    #[arg(long, value_name = "MM")]
    square_mm: Option<f64>,
    /// Side of a Charuco marker, millimetres.
    #[arg(long, value_name = "MM")]
    marker_mm: Option<f64>,
    /// Its dictionary, for example `DICT_4X4_50`.
    #[arg(long, value_name = "NAME")]
    dictionary: Option<String>,
    /// Lens coefficients: 5, 8, fisheye.
    #[arg(long, value_name = "N", default_value = "5", value_parser = coefficients)]
    pub(super) coefficients: Coefficients,
}

fn coefficients(word: &str) -> Result<Coefficients, String> {
    match word {
        "5" => Ok(Coefficients::Five),
        "8" => Ok(Coefficients::Eight),
        "fisheye" => Ok(Coefficients::Fisheye),
        _ => Err(format!("`{word}` is not one of 5, 8, fisheye")),
    }
}

/// A board to detect.
#[derive(Debug)]
pub(super) enum Board {
    Chess(Chessboard),
    Charuco(Charuco),
}

impl BoardKindArgs {
    /// Whether any option on a board is given.
    pub(super) fn is_given(&self) -> bool {
        let sides = self.chessboard.or(self.charuco);
        sides.is_some() || self.square_mm.or(self.marker_mm).is_some() || self.dictionary.is_some()
    }

    /// The board.
    ///
    /// # Errors
    /// When it is not given, or invalid.
    pub(super) fn board(&self) -> anyhow::Result<Board> {
        let square_m = || {
            let square_mm = self.square_mm;
            let square_mm = square_mm.context("expected --square-mm MM, the side of a square")?;
            anyhow::Ok(square_mm / 1000.0)
        };
        let board = match (
            self.chessboard,
            self.charuco,
            self.marker_mm,
            &self.dictionary,
        ) {
            (Some(corners), ..) => Board::Chess(Chessboard {
                corners,
                square_m: square_m()?,
            }),
            (None, Some(squares), Some(marker_mm), Some(dictionary)) => Board::Charuco(Charuco {
                squares,
                square_m: square_m()?,
                marker_m: marker_mm / 1000.0,
                dictionary: dictionary.clone(),
            }),
            _ => bail!(
                "expected --chessboard AxB, or --charuco AxB with --marker-mm and --dictionary"
            ),
        };
        board.check()?;
        Ok(board)
    }
}

impl Board {
    /// Refuses an invalid board before images are scanned.
    fn check(&self) -> anyhow::Result<()> {
        match self.detect("", &GrayImage::new(BLANK_PX, BLANK_PX)) {
            Err(error @ DetectError::Board(_)) => Err(error.into()),
            _ => Ok(()),
        }
    }

    /// Refuses a chessboard whose images show another size.
    ///
    /// # Errors
    /// The detected and the given size.
    pub(super) fn check_size(
        &self,
        views: &[BoardView],
        larger: &[[u32; 2]],
    ) -> Result<(), BoardError> {
        match self {
            Self::Chess(board) => check_size(board, views, larger),
            // Its corners are numbered.
            Self::Charuco(_) => Ok(()),
        }
    }

    /// Another board that fits the images; `None` if none is detected.
    pub(super) fn other(&self, pictures: &[GrayImage]) -> Option<OtherCharuco> {
        let Self::Charuco(board) = self else {
            return None;
        };
        let pictures: Vec<GrayPicture<'_>> = pictures.iter().map(grey).collect();
        other_charuco(&pictures, board)
    }

    /// Its corners in a picture.
    ///
    /// # Errors
    /// [`DetectError`] where there are none, or the board is invalid.
    pub(super) fn detect(&self, name: &str, picture: &GrayImage) -> Result<BoardView, DetectError> {
        let grey = grey(picture);
        match self {
            Self::Chess(board) => detect_chessboard(name, &grey, board),
            Self::Charuco(board) => detect_charuco(name, &grey, board),
        }
    }
}

fn grey(picture: &GrayImage) -> GrayPicture<'_> {
    GrayPicture {
        width: picture.width(),
        height: picture.height(),
        pixels: picture.as_raw(),
    }
}
