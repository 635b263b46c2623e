//! Information of the views of a tick about each keypoint.
//!
//! ```text
//!   I = Σⱼ (1 - dⱼ dⱼᵀ) / ((b rₖ/hⱼ)² + (e aⱼ)²)
//! ```
//!
//! A view j locates a keypoint across its ray dⱼ. Its error there has two parts. One is the
//! network's, b rₖ (rₖ as in [`crate::body::ik::relative_sigmas`]), larger if its map is low at the
//! common place (hⱼ: the keypoint is hidden, or this view's peak is elsewhere). The other is e
//! native pixels, each aⱼ wide there. Errors of different views count as independent, those of one
//! view from tick to tick as equal: a network repeats its error for seconds, so nothing averages
//! out.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::estimate::evidence::View;

/// b: error of a network's limb keypoint in one view per axis of the image, metres at the person,
/// if seen well. Networks err by some 0.4 of COCO's annotators in two dimensions (0.084 of a scale
/// of 0.71 m for the mean limb keypoint: 0.017 m per axis); the last millimetre is fitted.
const NETWORK_M: f64 = 0.018;
/// e: error of any view, native pixels.
const PIXEL_ERROR: f64 = 0.5;
/// Least h that counts: a lower map does not show the keypoint there.
const LEAST_HEIGHT: f64 = 0.1;
/// Least depth in front of a camera, metres.
const LEAST_DEPTH_M: f64 = 0.05;

/// Variance of a view per axis of its picture if its map is `height` and a native pixel `pixel_m`
/// wide, m².
pub(super) fn variance_m2(relative_sigma: f64, height: f64, pixel_m: f64) -> f64 {
    (NETWORK_M * relative_sigma / height).powi(2) + (PIXEL_ERROR * pixel_m).powi(2)
}

/// The information of one view about keypoint `k` at `offset_m` from the prediction.
pub(super) fn information_of_view(
    view: &View,
    k: usize,
    offset_m: Vector3<f64>,
    relative: f64,
) -> Matrix3<f64> {
    let none = Matrix3::zeros();
    let Some(expected) = view.expected(k) else {
        return none;
    };
    let place_m = expected.position_m + offset_m;
    let cell_from_world = view.cell_from_world(k);
    let h = cell_from_world * place_m.push(1.0);
    let cell = Vector2::new(h.x, h.y) / h.z;
    if h.z < LEAST_DEPTH_M || !view.knows(k, cell) {
        return none;
    }
    let height = view.map(k).bilinear(cell);
    if height < LEAST_HEIGHT {
        return none;
    }
    // Mean of the two axes' cells per metre, as in the lattice.
    let cells_per_m = (cell_from_world.fixed_view::<2, 3>(0, 0)
        - cell * cell_from_world.fixed_view::<1, 3>(2, 0))
    .norm()
        / (2.0f64.sqrt() * h.z);
    let pixel_m = 1.0 / (cells_per_m * view.grid(k).pixels_per_cell());
    let variance_m2 = variance_m2(relative, height, pixel_m);
    let ray = (place_m - view.center_m()).normalize();
    (Matrix3::identity() - ray * ray.transpose()) / variance_m2
}
