//! Whether lines of sight meet better if cameras that are calibrated as fisheyes have ordinary lenses with the same
//! coefficients.
//!
//! ```text
//!   y -> where the calibrated lens draws it -> y' by an ordinary lens with the same coefficients
//! ```
//!
//! Nothing is fitted: a lens is of one kind or of the other.

use farfield_proto::camera::{CameraModel, Distortion, LensModel};
use farfield_proto::frames::Pixel;
use nalgebra::Vector2;

use super::LensPoints;
use super::distortion::distortion;

/// Largest share of the cost that an ordinary lens may leave. If one or all cameras are calibrated as fisheyes by mistake, 0.78 to
/// 0.95 was left on the sample and the Shelf (0.99 for one camera of the Shelf); on valid cameras 1.01 or more.
const MAX_COST_RATIO: f64 = 0.95;
/// Largest share that it may leave of the cost with another distortion.
const MAX_RATIO_TO_DISTORTION: f64 = 0.97;
/// How many times as much as the next choice of cameras it must explain.
const MIN_MARGIN: f64 = 1.3;

/// The cameras, one or all of those that are calibrated as fisheyes, that surely have ordinary lenses.
pub(in crate::camera_agreement) fn false_fisheyes(
    points: &LensPoints,
    models: &[&CameraModel],
) -> Option<Vec<usize>> {
    let ordinary: Vec<Option<CameraModel>> = models.iter().map(|m| ordinary(m)).collect();
    let is_known = |&of: &usize| ordinary[of].is_some() && points.count(of) >= super::MIN_POINTS;
    let all: Vec<usize> = (0..models.len()).filter(is_known).collect();
    let alone = all.iter().map(|&camera| vec![camera]);
    let together = Some(all.clone()).filter(|all| all.len() > 1);
    let calibrated = points.lines_of_sight();
    let before = points.mean_cost(&calibrated, |_, _| None);
    let before = before.max(f64::MIN_POSITIVE);
    let fits = together.into_iter().chain(alone).map(|cameras| {
        let cost = points.mean_cost(&calibrated, |of, y| {
            let is_changed = cameras.contains(&of);
            is_changed.then(|| through(y, models[of], ordinary[of].as_ref()?))?
        });
        (cost / before, cameras)
    });
    let mut fits: Vec<(f64, Vec<usize>)> = fits.collect();
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (ratio, cameras) = fits.first()?;
    let next_gain = fits.get(1).map_or(0.0, |(next, _)| 1.0 - next);
    if *ratio >= MAX_COST_RATIO || 1.0 - ratio <= MIN_MARGIN * next_gain {
        return None;
    }
    // If another distortion explains more, the kind of the lens is right.
    let bent = distortion(points).map_or(f64::INFINITY, |bent| bent.ratio);
    (*ratio < MAX_RATIO_TO_DISTORTION * bent).then(|| cameras.clone())
}

/// An ordinary camera with the coefficients of a fisheye; `None` if the camera is no fisheye.
fn ordinary(model: &CameraModel) -> Option<CameraModel> {
    let LensModel::KannalaBrandt([k1, k2, p1, p2]) = *model.lens() else {
        return None;
    };
    let lens = LensModel::Rational(Distortion {
        k1,
        k2,
        p1,
        p2,
        ..Distortion::default()
    });
    CameraModel::new(
        model.name(),
        model.size_px(),
        *model.intrinsics(),
        lens,
        *model.camera_from_world(),
    )
    .ok()
}

/// Where the `other` lens shows the pixel that the calibrated `model` shows at `own`, both normalised and undistorted.
fn through(own: Vector2<f64>, model: &CameraModel, other: &CameraModel) -> Option<Vector2<f64>> {
    let lens = model.intrinsics();
    let px = Pixel::new(
        own.x * lens.fx_px + lens.cx_px,
        own.y * lens.fy_px + lens.cy_px,
    );
    let undistorted = other.undistort(model.distort(px)?)?;
    Some(Vector2::new(
        (undistorted.x() - lens.cx_px) / lens.fx_px,
        (undistorted.y() - lens.cy_px) / lens.fy_px,
    ))
}
