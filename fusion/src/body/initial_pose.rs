//! The first pose of a person: limb by limb, then inverse kinematics from there.

use farfield_proto::venue::parameters::IkParameters;
use nalgebra::Vector3;

use super::limbs::posed;
use super::observed::{ObservedJoints, ObservedPoint};
use crate::body::ik::{IkSolver, Priors, Target};
use crate::body::skeleton::{Joint, Kinematics, Pose, RangeOfMotion, Site, Skeleton};

/// Most steps of one solve: initiations are rare, and have no last pose.
const MAX_ITERATIONS: u32 = 40;

/// The last pose is unknown: as after this time, seconds, so that its prior has no effect.
const SINCE_LAST_POSE_S: f64 = 1.0;

/// How often the points are reweighted by their residuals.
const REWEIGHTINGS: usize = 3;

/// Distance of a point from its site at which it counts half, metres: points farther away were
/// triangulated wrongly.
const HALF_WEIGHT_M: f64 = 0.08;

/// Fits poses to bodies, without a last pose.
pub(crate) struct PoseFinder<'a> {
    parameters: &'a IkParameters,
    bounds: Option<&'a RangeOfMotion>,
    solver: IkSolver,
    kinematics: Kinematics,
}

impl<'a> PoseFinder<'a> {
    pub(crate) fn new(parameters: &'a IkParameters, bounds: Option<&'a RangeOfMotion>) -> Self {
        let solver = IkSolver::with_limits(MAX_ITERATIONS, parameters.tolerance_rad);
        Self {
            parameters,
            bounds,
            solver,
            kinematics: Kinematics::default(),
        }
    }

    /// The pose in which `skeleton` has its sites nearest to `body`'s points; robust against single
    /// wild points. `None` if the body's trunk is unknown (see [`posed`]).
    pub(crate) fn find(&mut self, skeleton: &Skeleton, body: &ObservedJoints) -> Option<Pose> {
        let mut pose = posed(skeleton, body)?;
        for _ in 0..REWEIGHTINGS {
            skeleton.forward(&pose, &mut self.kinematics);
            let targets: Vec<Target> = body
                .iter()
                .map(|(joint, point)| self.target(joint, point))
                .collect();
            let priors = Priors::new(self.parameters, &pose, SINCE_LAST_POSE_S);
            pose = self
                .solver
                .fit(skeleton, &pose, &targets, &priors, self.bounds);
        }
        Some(pose)
    }

    /// Cauchy's weight, w / (1 + (r / c)^2), keeps far points from pulling.
    fn target(&self, joint: Joint, point: &ObservedPoint) -> Target {
        let off_m = (self.site_m(joint, point) - point.position_m).norm();
        let trust = point.weight / (1.0 + (off_m / HALF_WEIGHT_M).powi(2));
        let site = Site {
            joint,
            offset_m: point.offset_m,
        };
        let weight = trust / self.parameters.keypoint_sigma_m.powi(2);
        Target::isotropic(&site, point.position_m, weight)
    }

    fn site_m(&self, joint: Joint, point: &ObservedPoint) -> Vector3<f64> {
        self.kinematics.site_m(&Site {
            joint,
            offset_m: point.offset_m,
        })
    }

    /// `body` with each point moved from its site to its joint, with the links as in `pose`.
    pub(crate) fn without_offsets(
        &mut self,
        skeleton: &Skeleton,
        pose: &Pose,
        body: &ObservedJoints,
    ) -> ObservedJoints {
        skeleton.forward(pose, &mut self.kinematics);
        let mut joints = ObservedJoints::default();
        for (joint, point) in body.iter() {
            let offset_w = self.kinematics.rotation(joint.link()) * point.offset_m;
            joints.set(joint, point.position_m - offset_w, point.weight);
        }
        joints
    }
}
