//! What a solve is asked for, and what it answers.

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
    /// Inverse covariance, world axes, 1/m²: symmetric, without negative eigenvalues. It may be singular: of a
    /// keypoint that one viewpoint sees, nothing is known along its ray. A target whose information is zero,
    /// or not finite, is left out.
    pub information: Matrix3<f64>,
    /// The same as evidence: what is known of the place when errors that last are counted as well. It says which
    /// angles are determined, and moves nothing.
    pub evidence: Matrix3<f64>,
}

impl Target {
    /// A target that is known equally well along all axes, with the inverse variance `weight` per axis, 1/m².
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

    /// Whether it says anything.
    pub(super) fn counts(&self) -> bool {
        self.information.trace() > 0.0
            && self.information.iter().all(|v| v.is_finite())
            && self.position_m.iter().all(|v| v.is_finite())
    }
}

/// What a solve found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The pose; inside the bounds exactly, if there were any.
    pub pose: Pose,
    /// Bit `i` is set where the targets did not determine reported angle `i` (see [`super`]). Only
    /// keypoints are evidence: the joints of a pose that priors made (the targets of the second
    /// IK) determine everything and say nothing.
    pub unobserved: u64,
}
