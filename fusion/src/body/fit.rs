//! Keypoints in space -> a person's skeleton and its first pose.
//!
//! The first pose is found limb by limb, then by inverse kinematics from there.

use farfield_proto::venue::parameters::IkParameters;
use nalgebra::Vector3;

use super::ik::{IkSolver, Priors, Target};
use super::limbs::posed;
use super::observed::{ObservedJoints, ObservedPoint};
pub use super::proportions::KnownBody;
use super::proportions::proportions;
use super::skeleton::{Joint, Kinematics, Pose, RangeOfMotion, Site, Skeleton};

/// Least points for a skeleton: two of the trunk and one of a limb.
const MIN_POINTS: usize = 5;

/// How often lengths and poses are fitted in turn if keypoints have offsets from their joints: the
/// second time changes lengths by less than a millimetre.
const OFFSET_ROUNDS: usize = 2;

/// Why there is no skeleton.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    /// The last tick shows too little.
    #[error("{got} keypoints are known, {MIN_POINTS} are needed")]
    TooFewPoints {
        /// How many there are.
        got: usize,
    },
    /// No segment has both end points.
    #[error("no segment of the body has both of its ends")]
    NoSegment,
    /// The heading of the body is unknown.
    #[error("neither both shoulders nor both hips are known, or nothing above or below them")]
    NoTrunk,
}

/// A body and a pose fitted to the keypoints of some ticks: the start of a track.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The body; left and right are equal.
    pub skeleton: Skeleton,
    /// Its pose at the last of the ticks.
    pub pose: Pose,
}

/// Fits lengths to all `ticks` of one person, in time order, and a pose to the last. Points with an
/// offset are sites with that offset from their joints.
///
/// # Errors
/// [`FitError`] if the last tick shows too little of the body.
pub fn fit(
    ticks: &[ObservedJoints],
    parameters: &IkParameters,
    bounds: Option<&RangeOfMotion>,
) -> Result<Fitted, FitError> {
    fit_known(ticks, None, parameters, bounds)
}

/// As [`fit`], with a prior of the body, `known`.
///
/// # Errors
/// As [`fit`].
pub fn fit_known(
    ticks: &[ObservedJoints],
    known: Option<KnownBody<'_>>,
    parameters: &IkParameters,
    bounds: Option<&RangeOfMotion>,
) -> Result<Fitted, FitError> {
    let last = ticks.last().ok_or(FitError::TooFewPoints { got: 0 })?;
    if last.count() < MIN_POINTS {
        return Err(FitError::TooFewPoints { got: last.count() });
    }
    let mut finder = PoseFinder::new(parameters, bounds);
    let mut lengths = proportions(ticks, known).ok_or(FitError::NoSegment)?;
    if ticks.iter().any(ObservedJoints::has_offsets) {
        for _ in 0..OFFSET_ROUNDS {
            let skeleton = Skeleton::new(&lengths);
            let joints: Vec<ObservedJoints> = ticks
                .iter()
                .filter_map(|body| {
                    let pose = finder.find(&skeleton, body)?;
                    Some(finder.without_offsets(&skeleton, &pose, body))
                })
                .collect();
            lengths = proportions(&joints, known).ok_or(FitError::NoTrunk)?;
        }
    }
    let skeleton = Skeleton::new(&lengths);
    let pose = finder.find(&skeleton, last).ok_or(FitError::NoTrunk)?;
    Ok(Fitted { skeleton, pose })
}

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

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::super::observed::ObservedPoint;
    use super::*;
    use crate::body::fixture::{Noise, coco_only, joints, postures};
    use crate::body::skeleton::dof::{DofGroup, first_of};
    use crate::body::skeleton::{Joint, Kinematics, Proportions, Side, Site};

    /// Error of exact keypoints from the pull of the priors, metres.
    const EXACT_M: f64 = 0.005;

    fn average() -> Skeleton {
        Skeleton::new(&Proportions::from_stature(1.75))
    }

    fn fitted(ticks: &[ObservedJoints]) -> Result<Fitted, FitError> {
        fit(ticks, &IkParameters::default(), None)
    }

    /// Mean distance of `body`'s points from their sites on the fitted body, metres.
    fn residual_m(found: &Fitted, body: &ObservedJoints) -> f64 {
        let mut kinematics = Kinematics::default();
        found.skeleton.forward(&found.pose, &mut kinematics);
        let off_m = |(joint, point): (Joint, &ObservedPoint)| {
            let offset_m = point.offset_m;
            (kinematics.site_m(&Site { joint, offset_m }) - point.position_m).norm()
        };
        body.iter().map(off_m).sum::<f64>() / body.count() as f64
    }

    /// Fits the keypoints of `pose` and compares them with those of the fitted body.
    fn check(pose: &Pose) -> Result<(), TestCaseError> {
        let seen = coco_only(&joints(&average(), pose), |p| p);
        let found = fitted(std::slice::from_ref(&seen)).unwrap();
        let residual_m = residual_m(&found, &seen);
        prop_assert!(residual_m < EXACT_M, "{residual_m} m");
        let body = joints(&found.skeleton, &found.pose);
        for (joint, point) in seen.iter() {
            let off_m = (body.position_m(joint).unwrap() - point.position_m).norm();
            prop_assert!(off_m < 4.0 * EXACT_M, "{}: {off_m} m", joint.name());
        }
        Ok(())
    }

    fn crouching() -> Pose {
        let mut pose = Pose::neutral(Vector3::new(1.0, 1.0, 0.4), UnitQuaternion::identity());
        for side in Side::BOTH {
            pose.dof[first_of(side, DofGroup::Hip)] = 2.0;
            pose.dof[first_of(side, DofGroup::Knee)] = 2.3;
            pose.dof[first_of(side, DofGroup::Elbow)] = 1.2;
        }
        pose
    }

    #[test]
    fn a_crouching_person_is_fitted() {
        check(&crouching()).unwrap();
    }

    #[test]
    fn a_lying_person_is_fitted() {
        for turn in [-1.57, 1.57] {
            let rotation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn);
            check(&Pose::neutral(Vector3::new(0.0, 0.0, 0.15), rotation)).unwrap();
        }
    }

    #[test]
    fn a_person_on_its_hands_is_fitted() {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let mut pose = Pose::neutral(Vector3::new(0.0, 0.0, 1.1), rotation);
        for side in Side::BOTH {
            // Both arms stretched past the head.
            pose.dof[first_of(side, DofGroup::Shoulder)] = 1.7;
        }
        check(&pose).unwrap();
    }

    proptest! {
        #[test]
        fn any_posture_is_fitted_in_any_orientation(
            seed in any::<u64>(), turn in prop::array::uniform3(-3.0f64..3.0),
        ) {
            let mut pose = postures(1, &mut Noise(seed)).remove(0);
            pose.root_rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            check(&pose)?;
        }
    }

    #[test]
    fn a_wild_wrist_does_not_move_the_body() {
        let mut seen = coco_only(&joints(&average(), &crouching()), |p| p);
        let knee = seen.position_m(Joint::LeftKnee).unwrap();
        seen.set(Joint::LeftWrist, Vector3::new(1.0, 1.0, 3.0), 1.0);
        let found = fitted(&[seen]).unwrap();
        let body = joints(&found.skeleton, &found.pose);
        assert!((body.position_m(Joint::LeftKnee).unwrap() - knee).norm() < 0.02);
    }

    #[test]
    fn keypoints_with_offsets_give_the_joints() {
        let hip_offset_m = Vector3::new(0.0, 0.04, 0.02);
        let ticks: Vec<ObservedJoints> = postures(15, &mut Noise(3))
            .iter()
            .map(|pose| {
                let mut kinematics = crate::body::skeleton::Kinematics::default();
                average().forward(pose, &mut kinematics);
                let mut seen = coco_only(&joints(&average(), pose), |p| p);
                for (joint, side) in [(Joint::LeftHip, 1.0), (Joint::RightHip, -1.0)] {
                    let offset_m = hip_offset_m.component_mul(&Vector3::new(1.0, side, 1.0));
                    let site = Site { joint, offset_m };
                    seen.set_site(&site, kinematics.site_m(&site), 1.0);
                }
                seen
            })
            .collect();
        let found = fitted(&ticks).unwrap();
        let truth = *average().proportions();
        let lengths = found.skeleton.proportions();
        assert!((lengths.hip_side_m - truth.hip_side_m).abs() < 0.005);
        assert!((lengths.thigh_m - truth.thigh_m).abs() < 0.01 * truth.thigh_m);
        assert!(residual_m(&found, ticks.last().unwrap()) < EXACT_M);
    }

    #[test]
    fn a_person_given_by_hand_needs_only_some_points() {
        let given = [
            ("left_shoulder", [0.0, 0.2, 1.4]),
            ("right_shoulder", [0.0, -0.2, 1.4]),
            ("left_hip", [0.0, 0.1, 0.9]),
            ("right_hip", [0.0, -0.1, 0.9]),
            ("left_knee", [0.05, 0.1, 0.5]),
            ("tail", [0.0, 0.0, 0.9]),
        ];
        let seen = ObservedJoints::from_named(given);
        let found = fitted(std::slice::from_ref(&seen)).unwrap();
        assert!(residual_m(&found, &seen) < 0.05);
        let forward = found.pose.root_rotation * Vector3::x();
        assert!(forward.x > 0.99);
    }

    #[test]
    fn too_little_of_a_body_is_refused() {
        let mut seen = coco_only(&joints(&average(), &crouching()), |p| p);
        seen.remove(Joint::LeftShoulder);
        seen.remove(Joint::RightHip);
        assert_eq!(fitted(&[seen]).unwrap_err(), FitError::NoTrunk);
        let few =
            ObservedJoints::from_named([("left_hip", [0.0; 3]), ("right_hip", [0.0, 0.2, 0.0])]);
        assert_eq!(
            fitted(&[few]).unwrap_err(),
            FitError::TooFewPoints { got: 2 }
        );
        assert_eq!(fitted(&[]).unwrap_err(), FitError::TooFewPoints { got: 0 });
    }
}
