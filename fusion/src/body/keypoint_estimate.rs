//! The position of a body's keypoint in space at a tick, and its evidence.

use nalgebra::{Matrix3, Unit, Vector3};

/// The estimate of one keypoint from the views.
#[derive(Debug, Clone, PartialEq)]
pub struct KeypointEstimate {
    /// Most probable position at the tick, world, metres; the prediction if unsupported.
    pub position_m: Vector3<f64>,
    /// S at the position: weighted mean of the maps, 0 to 1.
    pub support: f64,
    /// W of eq. (12), 0 to 1: the support times the share of the views' weight after occlusion. 0
    /// if the keypoint is unsupported.
    pub weight: f64,
    /// Independent viewpoints whose map supports the position. Views whose rays are nearly one line
    /// count as one, also from opposite sides.
    pub views: u16,
    /// Set if only one independent viewpoint supports the position. The position is then known
    /// across this ray (from the camera, world axes), and along it the prediction was kept.
    pub ray: Option<Unit<Vector3<f64>>>,
    /// Inverse covariance of the position, 1/m²; zero before the views are weighted. It is the
    /// uncertainty of the position, not its weight.
    pub information: Matrix3<f64>,
    /// Additional variance per axis because views show the keypoint elsewhere, m². It affects only
    /// the sigma: poses are fitted by `information`.
    pub split_m2: f64,
}

impl KeypointEstimate {
    /// A keypoint without support.
    pub(crate) fn unsupported(predicted_m: Vector3<f64>, support: f64) -> Self {
        Self {
            position_m: predicted_m,
            support,
            weight: 0.0,
            views: 0,
            ray: None,
            information: Matrix3::zeros(),
            split_m2: 0.0,
        }
    }
}
