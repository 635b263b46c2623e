//! What pictures of boards give: a calibration, or the reason why not.

use farfield_proto::camera::Intrinsics;
use nalgebra::{DMatrix, Isometry3};

use super::coverage::Coverage;
use crate::formats::LensModel;

/// Fewest pictures.
pub(super) const FEWEST_PICTURES: usize = 3;
/// No coefficient of a lens below 120 degrees is larger; what is is a sum of two that cancel.
pub(super) const LARGEST_COEFFICIENT: f64 = 10.0;

/// A picture that was not used, and why.
pub(super) type LeftOut = (String, String);

/// One picture's part in a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureFit {
    /// Its name.
    pub name: String,
    /// Camera from board, metres.
    pub camera_from_board: Isometry3<f64>,
    /// Corners that were seen.
    pub corners: usize,
    /// Root of the mean squared distance between drawn and seen corners, pixels.
    pub rms_px: f64,
    /// Whether its residual stands out from the others': look at it, or leave it out.
    pub hurts: bool,
}

/// A camera's intrinsics and how far they can be believed.
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
    /// The pictures that were used, in the order given.
    pub pictures: Vec<PictureFit>,
    /// Pictures that were not, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Names of the parameters: fx, fy, cx, cy, then the coefficients.
    pub parameters: Vec<&'static str>,
    /// Covariance of the parameters in that order, by the residuals' own variance.
    pub covariance: DMatrix<f64>,
    /// Which part of the picture had corners.
    pub coverage: Coverage,
    /// How far off the lens may draw a given ray at the worst corner of the picture, standard deviation, pixels: an upper
    /// bound, as the cameras' poses make up for a part of it.
    pub corner_sigma_px: f64,
    /// What is unusual about the board, and what to do next, in sentences.
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

/// Why pictures of a board give no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// Too few pictures with a board.
    #[error(
        "{found} pictures show enough of the board, expected at least {FEWEST_PICTURES}; take twenty, tilted by 30 degrees each way{}",
        reasons(left_out)
    )]
    TooFewPictures {
        /// How many do.
        found: usize,
        /// The others, and why not.
        left_out: Vec<(String, String)>,
    },
    /// The board has another size than was said.
    #[error(
        "at most {} x {} inner corners were found, in {pictures} pictures, expected {} x {}: count the corners between four \
         squares again, or take a picture with the whole board in it",
        found[0], found[1], expected[0], expected[1]
    )]
    OtherSize {
        /// The most along both sides, the shorter first.
        found: [u32; 2],
        /// Pictures that show so many.
        pictures: usize,
        /// What was said, the shorter first.
        expected: [u32; 2],
    },
    /// Too many pictures are turned by half a turn to say which way is right.
    #[error(
        "{} of {of} pictures were taken with the camera turned by half a turn against the others (`{}`): take all as the camera \
         will stand",
        turned.len(), turned.join("`, `")
    )]
    Turned {
        /// The lesser part.
        turned: Vec<String>,
        /// All pictures.
        of: usize,
    },
    /// The boards stand parallel, or the fit has no minimum.
    #[error(
        "the pictures do not carry a focal length: the boards stand parallel to each other, expected some tilted by 30 degrees each way"
    )]
    Parallel,
    /// The focal length can be many.
    #[error(
        "the focal length is {focal_px:.0} px with a standard deviation of {sigma_px:.0} px, expected at most 5 %: tilt the board more"
    )]
    FocalLength {
        /// What the fit says.
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
        /// How many were asked for.
        asked: usize,
        /// The one that shows it.
        name: &'static str,
        /// What the fit says.
        value: f64,
        /// Its standard deviation.
        sigma: f64,
    },
    /// The lens turns back inside the picture.
    #[error(
        "the lens that fits best turns back inside the picture, which no lens does: {0}; take pictures that reach the corners"
    )]
    Folds(String),
    /// A picture has no size, or a view's points have no partners.
    #[error("{0}")]
    Input(String),
}

fn reasons(left_out: &[(String, String)]) -> String {
    let said: Vec<String> = left_out
        .iter()
        .map(|(name, reason)| format!("; `{name}`: {reason}"))
        .collect();
    said.concat()
}
