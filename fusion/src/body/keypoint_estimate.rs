//! Where a keypoint of a body is in space at a tick, and what says so.

use nalgebra::{Matrix3, Unit, Vector3};

/// What the views say about one keypoint.
#[derive(Debug, Clone, PartialEq)]
pub struct KeypointEstimate {
    /// Most probable position at the tick, world, metres; the prediction when unsupported.
    pub position_m: Vector3<f64>,
    /// S at the position: weighted mean of the maps, 0 to 1.
    pub support: f64,
    /// W of eq. (12), 0 to 1: the support times the share of the views' weight that occlusion left.
    /// 0 when the keypoint is unsupported.
    pub weight: f64,
    /// Independent viewpoints whose map supports the position: those whose rays are nearly one line
    /// count as one, also when they look from opposite sides.
    pub views: u16,
    /// Set when one independent viewpoint alone supports the position: it is then known across this
    /// ray (from the camera, world axes), and along it the prediction was kept.
    pub ray: Option<Unit<Vector3<f64>>>,
    /// Inverse covariance of the position, 1/m², zero until the views were asked: how sure the position is, not what it weighs.
    pub information: Matrix3<f64>,
    /// By what the variance per axis is larger because views show the keypoint elsewhere, m²: of its sigma alone, poses are fitted by `information`.
    pub split_m2: f64,
}

impl KeypointEstimate {
    /// A keypoint that nothing supports.
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
