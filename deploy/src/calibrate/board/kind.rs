//! The board that is looked for: a chessboard or a `ChArUco` board, as the command line says it.

use anyhow::{Context as _, bail};
use clap::Args;
use farfield_calibration::board::{
    BoardError, BoardView, Charuco, Chessboard, Coefficients, DetectError, GrayPicture,
    OtherCharuco, check_size, detect_charuco, detect_chessboard, other_charuco,
};
use image::GrayImage;

use crate::calibrate::convert::size;

/// Side of a picture without anything in it, pixels.
const BLANK_PX: u32 = 16;

/// Which board it is, and what of the lens it tells.
#[derive(Debug, Args)]
pub(in crate::calibrate) struct BoardKindArgs {
    /// Inner corners of a chessboard: 4x7 of 5 x 8.
    ///
    /// Those between four squares: a board of 5 x 8 squares has 4x7.
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
    /// Numbers of the lens: 5, 8, fisheye.
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

/// A board that is looked for.
#[derive(Debug)]
pub(super) enum Board {
    Chess(Chessboard),
    Charuco(Charuco),
}

impl BoardKindArgs {
    /// Whether anything is said of a board.
    pub(super) fn says_something(&self) -> bool {
        let sides = self.chessboard.or(self.charuco);
        sides.is_some() || self.square_mm.or(self.marker_mm).is_some() || self.dictionary.is_some()
    }

    /// The board.
    ///
    /// # Errors
    /// Where it is not said, or cannot be one.
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
    /// Refuses a board that cannot be, before pictures are looked at.
    fn check(&self) -> anyhow::Result<()> {
        match self.detect("", &GrayImage::new(BLANK_PX, BLANK_PX)) {
            Err(error @ DetectError::Board(_)) => Err(error.into()),
            _ => Ok(()),
        }
    }

    /// Refuses a chessboard of another size than this.
    ///
    /// # Errors
    /// What was found, and what was said.
    pub(super) fn check_size(
        &self,
        views: &[BoardView],
        larger: &[[u32; 2]],
    ) -> Result<(), BoardError> {
        match self {
            Self::Chess(board) => check_size(board, views, larger),
            // Its corners have numbers.
            Self::Charuco(_) => Ok(()),
        }
    }

    /// What it may be instead, by pictures of it; `None` where nothing is found.
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
    /// [`DetectError`] where there are none, or the board cannot be.
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
