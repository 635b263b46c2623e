//! Intrinsics of a camera from boards in several pictures: Zhang 2000's closed form, then the least squares of
//! [`super::adjust`], and a check that the pictures determine the requested parameters.

use farfield_proto::order_statistics::upper_median;
use nalgebra::{DMatrix, Vector2};

use super::BoardView;
use super::adjust::{Sighting, State, adjust, reduced, residuals};
use super::carried::{check_determined, corner_sigma_px, remarks};
use super::outcome::{
    BoardCalibration, BoardError, Coverage, FEWEST_PICTURES, LeftOut, PictureFit,
};
use super::projection::Coefficients;
use super::start::{homography, start_fisheye, start_pinhole};
use super::turned::turned;

/// Least number of corners in a used picture.
const FEWEST_CORNERS: usize = 8;
/// A picture hurts if its RMS is this many times the median.
const HURTS: f64 = 2.0;
/// A picture with a smaller RMS never hurts, pixels.
const HARMLESS_PX: f64 = 0.3;

/// The intrinsics of a camera with pictures of `size_px` (width, height) from `views` of a flat board (z = 0).
///
/// # Errors
/// [`BoardError`] if the pictures do not determine the requested parameters: too few, parallel boards, coefficients without
/// bound, a lens that folds.
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
    let (used, mut left_out) = sort_out(views)?;
    if used.len() < FEWEST_PICTURES {
        return Err(BoardError::TooFewPictures {
            found: used.len(),
            left_out,
        });
    }
    let sightings: Vec<Sighting> = used.iter().map(|view| view.sighting()).collect();
    let state = fit(size_px, &sightings, coefficients)?;
    let (used, sightings, state) = match turned(size_px, &state, &sightings) {
        None => (used, sightings, state),
        Some(turned) => {
            let used = without_turned(used, &turned, &mut left_out)?;
            let sightings: Vec<Sighting> = used.iter().map(|view| view.sighting()).collect();
            let state = fit(size_px, &sightings, coefficients)?;
            (used, sightings, state)
        }
    };
    let corners: usize = sightings.iter().map(|s| s.pixels.len()).sum();
    let (pictures, sum) = judge_pictures(&state, &used, &sightings)?;
    let unknowns = coefficients.count() + 6 * used.len();
    let freedom = (2 * corners).saturating_sub(unknowns).max(1) as f64;
    let covariance = reduced(&state, &sightings)
        .and_then(|matrix| inverse(&matrix))
        .ok_or(BoardError::Parallel)?
        * (sum / freedom);
    check_determined(size_px, &state.optics, &covariance)?;
    let names = ["fx", "fy", "cx", "cy"];
    let coverage = Coverage::new(size_px, sightings.iter().flat_map(|s| &s.pixels));
    let corner_sigma_px = corner_sigma_px(size_px, &state.optics, &covariance);
    Ok(BoardCalibration {
        remarks: remarks(&coverage, corner_sigma_px, &pictures, &used),
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

/// Fits the camera and the poses of the boards without a start.
fn fit(
    size_px: [u32; 2],
    sightings: &[Sighting],
    coefficients: Coefficients,
) -> Result<State, BoardError> {
    let start = match coefficients {
        Coefficients::Fisheye => start_fisheye(size_px, sightings),
        _ => start_pinhole(size_px, sightings, coefficients),
    };
    let state = start.and_then(|start| adjust(start, sightings));
    state.ok_or(BoardError::Parallel)
}

/// The views that are not `turned`; the others are added to `left_out`. Too many of them are refused.
fn without_turned<'a>(
    used: Vec<&'a BoardView>,
    turned: &[bool],
    left_out: &mut Vec<LeftOut>,
) -> Result<Vec<&'a BoardView>, BoardError> {
    let of = used.len();
    let (away, left): (Vec<_>, Vec<_>) = used.into_iter().zip(turned).partition(|(_, is)| **is);
    let names: Vec<String> = away.iter().map(|(view, _)| view.name.clone()).collect();
    let left: Vec<&BoardView> = left.into_iter().map(|(view, _)| view).collect();
    if 3 * names.len() > of || left.len() < FEWEST_PICTURES {
        return Err(BoardError::Turned { turned: names, of });
    }
    let reason = "taken with the camera turned by half a turn relative to the others";
    left_out.extend(names.into_iter().map(|name| (name, reason.to_owned())));
    Ok(left)
}

/// Views with enough finite points, and the other views with the reason.
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
    let all = pictures.iter().map(|picture| picture.rms_px).collect();
    let median = upper_median(all).unwrap_or(0.0);
    for picture in &mut pictures {
        picture.hurts = picture.rms_px > HARMLESS_PX.max(HURTS * median);
    }
    Ok((pictures, sum))
}

/// The inverse with scaled parameters, whose sizes differ widely.
fn inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = matrix.diagonal().map(|d| 1.0 / d.max(1e-300).sqrt());
    let n = matrix.nrows();
    let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(n, n, |i, j| {
        inverse[(i, j)] * scale[i] * scale[j]
    }))
}
