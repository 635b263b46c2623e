//! How a camera sees, from boards in several pictures: Zhang 2000's closed form, then the least squares of [`super::adjust`];
//! and whether the pictures carry what was asked of them.

use farfield_proto::camera::Intrinsics;
use nalgebra::{DMatrix, Isometry3, Vector2};

use super::adjust::{Sighting, State, adjust, reduced, residuals};
use super::carried::{LARGEST_COEFFICIENT, corner_sigma_px, refuse_what_is_not_carried, remarks};
use super::homography::homography;
use super::projection::Coefficients;
use super::start::{start_fisheye, start_pinhole};
use super::{BoardView, Coverage};
use crate::formats::LensModel;

/// Fewest corners of a picture that is used.
const FEWEST_CORNERS: usize = 8;
/// Fewest pictures.
const FEWEST_PICTURES: usize = 3;
/// A picture whose RMS is so many times the median of all hurts.
const HURTS: f64 = 2.0;
/// No picture hurts below this RMS, pixels.
const HARMLESS_PX: f64 = 0.3;

/// A picture that was not used, and why.
type LeftOut = (String, String);

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
    /// What to do next, in sentences; empty where nothing is to be said.
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
             {LARGEST_COEFFICIENT} in size; ask for five, or take more pictures that reach the corners"
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

/// The intrinsics of a camera with pictures of `size_px` (width, height) from `views` of a flat board (z = 0).
///
/// # Errors
/// [`BoardError`] where the pictures cannot carry what was asked: too few, boards all parallel, coefficients without bound,
/// a lens that folds.
pub fn calibrate(
    size_px: [u32; 2],
    views: &[BoardView],
    coefficients: Coefficients,
) -> Result<BoardCalibration, BoardError> {
    if size_px.contains(&0) {
        return Err(BoardError::Input(format!(
            "pictures of {size_px:?} pixels: expected both above 0"
        )));
    }
    let (used, left_out) = sort_out(views)?;
    if used.len() < FEWEST_PICTURES {
        return Err(BoardError::TooFewPictures {
            found: used.len(),
            left_out,
        });
    }
    let sightings: Vec<Sighting> = used.iter().map(|view| view.sighting()).collect();
    let start = match coefficients {
        Coefficients::Fisheye => start_fisheye(size_px, &sightings),
        _ => start_pinhole(size_px, &sightings, coefficients),
    };
    let state = start
        .and_then(|start| adjust(start, &sightings))
        .ok_or(BoardError::Parallel)?;
    let corners: usize = sightings.iter().map(|s| s.pixels.len()).sum();
    let (pictures, sum) = judge_pictures(&state, &used, &sightings)?;
    let unknowns = coefficients.count() + 6 * used.len();
    let freedom = (2 * corners).saturating_sub(unknowns).max(1) as f64;
    let covariance = reduced(&state, &sightings)
        .and_then(|matrix| inverse(&matrix))
        .ok_or(BoardError::Parallel)?
        * (sum / freedom);
    refuse_what_is_not_carried(size_px, &state.optics, &covariance)?;
    let names = ["fx", "fy", "cx", "cy"];
    let coverage = Coverage::of(size_px, sightings.iter().flat_map(|s| &s.pixels));
    let corner_sigma_px = corner_sigma_px(size_px, &state.optics, &covariance);
    Ok(BoardCalibration {
        remarks: remarks(&coverage, corner_sigma_px, &pictures),
        corner_sigma_px,
        size_px,
        intrinsics: state.optics.intrinsics(),
        lens: state.optics.lens(),
        rms_px: (sum / corners as f64).sqrt(),
        pictures,
        left_out,
        parameters: names.iter().chain(coefficients.names()).copied().collect(),
        covariance,
        coverage,
    })
}

/// Views with enough finite points, and the others with the reason.
fn sort_out(views: &[BoardView]) -> Result<(Vec<&BoardView>, Vec<LeftOut>), BoardError> {
    let mut used = Vec::new();
    let mut left_out = Vec::new();
    for view in views {
        if view.board_m.len() != view.pixels.len() {
            return Err(BoardError::Input(format!(
                "`{}`: {} points of the board and {} pixels, expected as many",
                view.name,
                view.board_m.len(),
                view.pixels.len()
            )));
        }
        let numbers = view.board_m.iter().chain(&view.pixels).flatten();
        if !numbers.clone().all(|v| v.is_finite()) {
            return Err(BoardError::Input(format!(
                "`{}`: a coordinate is not finite",
                view.name
            )));
        }
        let sighting = view.sighting();
        let plane: Vec<Vector2<f64>> = sighting.board.iter().map(nalgebra::Matrix::xy).collect();
        if view.pixels.len() < FEWEST_CORNERS {
            let reason = format!(
                "{} corners, expected at least {FEWEST_CORNERS}",
                view.pixels.len()
            );
            left_out.push((view.name.clone(), reason));
        } else if homography(&plane, &sighting.pixels).is_none() {
            left_out.push((view.name.clone(), "its corners lie on a line".to_owned()));
        } else {
            used.push(view);
        }
    }
    Ok((used, left_out))
}

fn judge_pictures(
    state: &State,
    used: &[&BoardView],
    sightings: &[Sighting],
) -> Result<(Vec<PictureFit>, f64), BoardError> {
    let mut sum = 0.0;
    let mut pictures = Vec::new();
    for ((view, sighting), camera_from_board) in used.iter().zip(sightings).zip(&state.poses) {
        let all =
            residuals(&state.optics, camera_from_board, sighting).ok_or(BoardError::Parallel)?;
        let squares: f64 = all.iter().map(Vector2::norm_squared).sum();
        sum += squares;
        pictures.push(PictureFit {
            name: view.name.clone(),
            camera_from_board: *camera_from_board,
            corners: all.len(),
            rms_px: (squares / all.len() as f64).sqrt(),
            hurts: false,
        });
    }
    let mut sorted: Vec<f64> = pictures.iter().map(|picture| picture.rms_px).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    for picture in &mut pictures {
        picture.hurts = picture.rms_px > HARMLESS_PX.max(HURTS * median);
    }
    Ok((pictures, sum))
}

/// By equal scales, for parameters of very different size.
fn inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = matrix.diagonal().map(|d| 1.0 / d.max(1e-300).sqrt());
    let n = matrix.nrows();
    let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(n, n, |i, j| {
        inverse[(i, j)] * scale[i] * scale[j]
    }))
}
