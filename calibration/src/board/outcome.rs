//! The result of a calibration from boards, and the reasons why it fails.

use std::collections::BTreeSet;

use farfield_proto::camera::Intrinsics;
use nalgebra::{DMatrix, Isometry3, Vector2};

use crate::formats::LensModel;

/// Least number of pictures.
pub(super) const FEWEST_PICTURES: usize = 3;
/// Coefficients of a lens below 120 degrees are smaller; larger ones cancel each other.
pub(super) const LARGEST_COEFFICIENT: f64 = 10.0;

/// A picture that was not used, and the reason.
pub(super) type LeftOut = (String, String);

/// The fit of one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureFit {
    /// Its name.
    pub name: String,
    /// Camera from board, metres.
    pub camera_from_board: Isometry3<f64>,
    /// Number of its corners.
    pub corners: usize,
    /// Root of the mean squared residual of the corners, pixels.
    pub rms_px: f64,
    /// Whether its residual is much larger than that of the others: inspect it, or leave it out.
    pub hurts: bool,
}

/// A camera's intrinsics with their uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardCalibration {
    /// Width and height of the pictures, pixels.
    pub size_px: [u32; 2],
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// The lens.
    pub lens: LensModel,
    /// Over all corners, pixels.
    pub rms_px: f64,
    /// The pictures that were used, in the given order.
    pub pictures: Vec<PictureFit>,
    /// Pictures that were not used, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Names of the parameters: fx, fy, cx, cy, then the coefficients.
    pub parameters: Vec<&'static str>,
    /// Covariance of the parameters in that order, with the variance of the residuals.
    pub covariance: DMatrix<f64>,
    /// The part of the picture with corners.
    pub coverage: Coverage,
    /// Standard deviation of the pixel of a given ray at the worst corner of the picture: an upper bound, because the poses of
    /// the boards compensate a part of it.
    pub corner_sigma_px: f64,
    /// Unusual properties of the board, and advice, in sentences.
    pub remarks: Vec<String>,
}

impl BoardCalibration {
    /// Standard deviations of [`Self::parameters`].
    pub fn sigmas(&self) -> Vec<f64> {
        self.covariance
            .diagonal()
            .iter()
            .map(|v| v.max(0.0).sqrt())
            .collect()
    }
}

/// The reason why pictures of a board give no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// Too few pictures with a board.
    #[error(
        "{found} pictures show enough of the board, expected at least {FEWEST_PICTURES}; take twenty, tilted by 30 degrees each way{}",
        reasons(left_out)
    )]
    TooFewPictures {
        /// The number of such pictures.
        found: usize,
        /// The other pictures, with the reason.
        left_out: Vec<(String, String)>,
    },
    /// The board has another size than stated.
    #[error(
        "at most {} x {} inner corners were found, in {pictures} pictures, expected {} x {}: count the corners between four \
         squares again, or take a picture with the whole board in it",
        found[0], found[1], expected[0], expected[1]
    )]
    OtherSize {
        /// The largest size found, the shorter side first.
        found: [u32; 2],
        /// The number of pictures that show it.
        pictures: usize,
        /// The stated size, the shorter side first.
        expected: [u32; 2],
    },
    /// Too many pictures are turned by half a turn to decide which orientation is right.
    #[error(
        "{} of {of} pictures were taken with the camera turned by half a turn relative to the others (`{}`): take all in the \
         orientation in which the camera will be mounted",
        turned.len(), turned.join("`, `")
    )]
    Turned {
        /// The pictures of the minority.
        turned: Vec<String>,
        /// All pictures.
        of: usize,
    },
    /// The boards are parallel, or the fit has no minimum.
    #[error(
        "the pictures do not carry a focal length: the boards are parallel to each other, expected some tilted by 30 degrees each way"
    )]
    Parallel,
    /// The focal length is too uncertain.
    #[error(
        "the focal length is {focal_px:.0} px with a standard deviation of {sigma_px:.0} px, expected at most 5 %: tilt the board more"
    )]
    FocalLength {
        /// The fitted value.
        focal_px: f64,
        /// Its standard deviation.
        sigma_px: f64,
    },
    /// Too many coefficients for the pictures.
    #[error(
        "the pictures do not carry {asked} coefficients: `{name}` came out as {value:.3} +- {sigma:.3}, expected at most \
             {LARGEST_COEFFICIENT} in size; {}take more pictures, some with the board in the corners", if *asked > 5 { "ask for five, or " } else { "" }
    )]
    Coefficient {
        /// The number of requested coefficients.
        asked: usize,
        /// The unusable coefficient.
        name: &'static str,
        /// The fitted value.
        value: f64,
        /// Its standard deviation.
        sigma: f64,
    },
    /// The lens folds inside the picture.
    #[error(
        "the best lens folds inside the picture, which no lens does: {0}; take pictures that reach the corners"
    )]
    Folds(String),
    /// A picture has no size, or the points of a view do not match its pixels.
    #[error("{0}")]
    Input(String),
}

fn reasons(left_out: &[(String, String)]) -> String {
    let reasons: Vec<String> = left_out
        .iter()
        .map(|(name, reason)| format!("; `{name}`: {reason}"))
        .collect();
    reasons.concat()
}

/// Cells along each side of the picture.
const CELLS: u32 = 8;

/// The part of the picture that the corners of all boards cover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Share of the cells of an 8 x 8 grid with a corner, 0 to 1.
    pub cells: f64,
    /// Distance of the farthest corner from the picture's middle, relative to that of the picture's corner. Beyond it the lens
    /// is extrapolated.
    pub radius: f64,
}

impl Coverage {
    pub(super) fn new<'a>(
        size_px: [u32; 2],
        pixels: impl Iterator<Item = &'a Vector2<f64>>,
    ) -> Self {
        let size = Vector2::from(size_px.map(f64::from));
        let middle = (size - Vector2::repeat(1.0)) / 2.0;
        let mut seen = BTreeSet::new();
        let mut farthest = 0.0_f64;
        for pixel in pixels {
            let cell = ((pixel + Vector2::repeat(0.5)).component_div(&size) * f64::from(CELLS))
                .map(f64::floor);
            let inside = cell.iter().all(|c| (0.0..f64::from(CELLS)).contains(c));
            if inside {
                seen.insert([cell.x as u32, cell.y as u32]);
            }
            farthest = farthest.max((pixel - middle).norm());
        }
        Self {
            cells: seen.len() as f64 / f64::from(CELLS * CELLS),
            radius: farthest / middle.norm().max(0.5),
        }
    }
}
