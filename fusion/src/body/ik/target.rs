//! Targets and solution of a solve.

use std::collections::BTreeMap;

use farfield_proto::keypoints::KeypointSet;
use nalgebra::{Matrix3, Vector3};

use super::normal::NormalEquations;
use crate::body::skeleton::{Joint, Kinematics, Pose, Site};

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

/// A target, and the point of the body that belongs to it.
#[derive(Debug, Clone)]
struct AimedPoint {
    target: Target,
    /// In the last placed pose, world, metres.
    point_m: Vector3<f64>,
    /// Information times residual there: gradient of the cost by the point.
    pull: Vector3<f64>,
}

/// Valid targets. Allocates only for more than ever before.
#[derive(Debug, Clone, Default)]
pub(super) struct Aims {
    points: Vec<AimedPoint>,
}

impl Aims {
    /// Selects the valid ones of `targets`.
    pub(super) fn set(&mut self, targets: &[Target]) {
        self.points.clear();
        let counting = targets.iter().filter(|target| target.counts());
        self.points.extend(counting.map(|&target| AimedPoint {
            target,
            point_m: Vector3::zeros(),
            pull: Vector3::zeros(),
        }));
    }

    /// Updates the points of `body`; returns the targets' part of the cost.
    pub(super) fn place(&mut self, body: &Kinematics) -> f64 {
        let mut cost = 0.0;
        for aimed in &mut self.points {
            let target = &aimed.target;
            aimed.point_m = body.site_m(&target.site());
            let residual_m = aimed.point_m - target.position_m;
            aimed.pull = target.information * residual_m;
            cost += residual_m.dot(&aimed.pull);
        }
        0.5 * cost
    }

    /// Builds the normal equations of the targets as evidence for `body`, the last placed one;
    /// their gradient is unused.
    pub(super) fn gather_evidence(&self, body: &Kinematics, normal: &mut NormalEquations) {
        normal.begin(body);
        let pull = Vector3::zeros();
        for AimedPoint {
            target, point_m, ..
        } in &self.points
        {
            normal.add(target.joint.link(), point_m, &target.evidence, &pull);
        }
        normal.gather(body, false);
    }

    /// Builds the normal equations for `body`, the last placed one; see
    /// [`NormalEquations::gather`].
    pub(super) fn linearise(
        &self,
        body: &Kinematics,
        is_curved: bool,
        normal: &mut NormalEquations,
    ) {
        normal.begin(body);
        for AimedPoint {
            target,
            point_m,
            pull,
        } in &self.points
        {
            normal.add(target.joint.link(), point_m, &target.information, pull);
        }
        normal.gather(body, is_curved);
    }
}

/// Standard deviations of human annotators, as shares of the object's scale: the constants
/// `sigma_k` of COCO's object keypoint similarity (cocoeval.py), by the end of the keypoint's name.
const OKS_SIGMAS: [(&str, f64); 9] = [
    ("nose", 0.026),
    ("eye", 0.025),
    ("ear", 0.035),
    ("shoulder", 0.079),
    ("elbow", 0.072),
    ("wrist", 0.062),
    ("hip", 0.107),
    ("knee", 0.087),
    ("ankle", 0.089),
];

/// Root mean square of the twelve limb keypoints' constants: the reference of
/// `ik.keypoint_sigma_m`.
const LIMB_SIGMA: f64 = 0.084;

/// Bounds of the ratio: a model's face is not a person's face, whatever a network sees.
const RATIOS: [f64; 2] = [0.5, 1.5];

/// Per keypoint of the network: its expected error over that of the average limb keypoint. Names
/// that COCO does not have count as average. `factors` are those of the network's card.
pub fn relative_sigmas(keypoints: &KeypointSet, factors: &BTreeMap<String, f64>) -> Vec<f64> {
    let of = |name: &String| {
        let known = OKS_SIGMAS.iter().find(|(part, _)| name.ends_with(part));
        let usual = known.map_or(1.0, |(_, sigma)| {
            (sigma / LIMB_SIGMA).clamp(RATIOS[0], RATIOS[1])
        });
        usual * factors.get(name).copied().unwrap_or(1.0)
    };
    keypoints.names().iter().map(of).collect()
}

#[cfg(test)]
mod relative_sigma_tests {
    use super::*;

    #[test]
    fn eyes_are_better_than_hips_and_unknown_names_average() {
        let names = ["left_eye", "left_wrist", "left_hip", "mid_spine"];
        let sigmas = relative_sigmas(
            &KeypointSet::new(names.map(str::to_owned).to_vec()),
            &[("left_hip".to_owned(), 2.0)].into(),
        );
        assert!(sigmas[2] > 2.0, "{sigmas:?}");
        assert!(sigmas[..3].is_sorted_by(|a, b| a < b), "{sigmas:?}");
        assert!((sigmas[3] - 1.0).abs() < 1e-12, "{sigmas:?}");
    }
}
