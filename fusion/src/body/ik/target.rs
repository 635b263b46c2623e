//! Targets and solution of a solve.

use nalgebra::{Matrix3, Vector3};

use crate::body::skeleton::{Joint, Pose, Site};

/// Where a point of the body should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// The joint that the point belongs to.
    pub joint: Joint,
    /// Offset of the point from the joint in the frame of [`Joint::link`], metres.
    pub offset_m: Vector3<f64>,
    /// Where it should be in the world, metres.
    pub position_m: Vector3<f64>,
    /// Inverse covariance, world axes, 1/m²: symmetric, without negative eigenvalues. It may be
    /// singular: one viewpoint gives no information along its ray. A target whose information is
    /// zero or not finite is ignored.
    pub information: Matrix3<f64>,
    /// The same as evidence: the information about the place including lasting errors. It
    /// determines which angles are observed, and moves nothing.
    pub evidence: Matrix3<f64>,
}

impl Target {
    /// A target with the inverse variance `weight` along all axes, 1/m².
    pub fn isotropic(site: &Site, position_m: Vector3<f64>, weight: f64) -> Self {
        let information = Matrix3::from_diagonal_element(weight);
        Self {
            joint: site.joint,
            offset_m: site.offset_m,
            position_m,
            information,
            evidence: information,
        }
    }

    /// The point on the body.
    pub(super) fn site(&self) -> Site {
        Site {
            joint: self.joint,
            offset_m: self.offset_m,
        }
    }

    /// Whether its information is nonzero and finite.
    pub(super) fn counts(&self) -> bool {
        self.information.trace() > 0.0
            && self.information.iter().all(|v| v.is_finite())
            && self.position_m.iter().all(|v| v.is_finite())
    }
}

/// Result of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The pose; exactly inside the bounds, if there were any.
    pub pose: Pose,
    /// Bit `i` is set if the targets did not determine reported angle `i` (see [`super`]). Only
    /// keypoints are evidence: joints of a pose with priors (the targets of the second IK)
    /// determine all angles and give no information.
    pub unobserved: u64,
}
