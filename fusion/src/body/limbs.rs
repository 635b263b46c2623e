//! Keypoints in space -> joint angles, limb by limb, without iteration.
//!
//! The trunk is a stiff board between hips and shoulders (unbent spine, level scapulas: paper,
//! appendix B). Each limb follows from the directions of its two bones, and the bend between them
//! gives the twist of the upper one. Nothing here depends on gravity, so lying and upside-down
//! people are handled like all others.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::observed::ObservedJoints;
use crate::body::skeleton::dof::{DofGroup, first_of};
use crate::body::skeleton::{Joint, Pose, Side, Skeleton, shoulder_coordinates};

/// Sine of the bend of an elbow or knee, below which (15 degrees) it does not give the twist of the
/// bone above: 2 cm of noise are as much.
const STRAIGHT_SINE: f64 = 0.26;

/// Sine of the angle between a trunk and the line across it, below which (15 degrees) they are one
/// line: shoulders of 40 cm then leave 10 across the trunk, and noise is 2.
const TRUNK_IN_LINE_SINE: f64 = 0.26;

/// Least length of the sum of the lines across shoulders and hips: twisted further relative to each
/// other (165 degrees) they do not give the left side.
const MIN_SHARED_ACROSS: f64 = 0.26;

/// Shortest distance that gives a direction, metres.
const MIN_LENGTH_M: f64 = 0.02;

const SHOULDERS: [Joint; 2] = [Joint::LeftShoulder, Joint::RightShoulder];
const HIPS: [Joint; 2] = [Joint::LeftHip, Joint::RightHip];
const EARS: [Joint; 2] = [Joint::LeftEar, Joint::RightEar];
const EYES: [Joint; 2] = [Joint::LeftEye, Joint::RightEye];
const KNEES: [Joint; 2] = [Joint::LeftKnee, Joint::RightKnee];

/// A pose near that of `body`: root, arms and legs; spine, neck, scapulas and feet neutral, and
/// unseen limbs hanging.
///
/// `None` if neither both shoulders nor both hips are known, or they lie in one line with the
/// trunk.
pub(crate) fn posed(skeleton: &Skeleton, body: &ObservedJoints) -> Option<Pose> {
    let world_from_trunk = trunk_axes(body)?;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(world_from_trunk));
    let mut pose = Pose::neutral(pelvis_m(skeleton, body, &world_from_trunk)?, rotation);
    for side in Side::BOTH {
        set_arm(&mut pose, side, body, &world_from_trunk);
        set_leg(&mut pose, side, body, &world_from_trunk);
    }
    Some(pose)
}

/// Columns: forward, left and up of the trunk in the world.
fn trunk_axes(body: &ObservedJoints) -> Option<Matrix3<f64>> {
    let across =
        |[left, right]: [Joint; 2]| direction(body.position_m(right)?, body.position_m(left)?);
    // Hips and shoulders are turned against each other; the trunk is between them.
    let lines = [across(SHOULDERS), across(HIPS)];
    let sum: Vector3<f64> = lines.iter().flatten().sum();
    let left = sum.try_normalize(MIN_SHARED_ACROSS)?;
    let up = trunk_up(body)?;
    let left = (left - up * left.dot(&up)).try_normalize(TRUNK_IN_LINE_SINE)?;
    Some(Matrix3::from_columns(&[left.cross(&up), left, up]))
}

/// From the hips to the shoulders, or the nearest known direction, unit.
fn trunk_up(body: &ObservedJoints) -> Option<Vector3<f64>> {
    let (shoulders, hips) = (body.middle_m(SHOULDERS), body.middle_m(HIPS));
    let head = body
        .middle_m(EARS)
        .or_else(|| body.middle_m(EYES))
        .or_else(|| body.position_m(Joint::Nose));
    match (shoulders, hips) {
        (Some(shoulders), Some(hips)) => direction(hips, shoulders),
        (Some(shoulders), None) => {
            let hip = HIPS.iter().find_map(|&joint| body.position_m(joint));
            hip.and_then(|hip| direction(hip, shoulders))
                .or_else(|| direction(shoulders, head?))
        }
        (None, Some(hips)) => {
            let shoulder = SHOULDERS.iter().find_map(|&joint| body.position_m(joint));
            shoulder
                .or(head)
                .and_then(|upper| direction(hips, upper))
                .or_else(|| direction(body.middle_m(KNEES)?, hips))
        }
        (None, None) => None,
    }
}

/// The pelvis: between the hips, or a trunk's length below the shoulders.
fn pelvis_m(
    skeleton: &Skeleton,
    body: &ObservedJoints,
    axes: &Matrix3<f64>,
) -> Option<Vector3<f64>> {
    let lengths = skeleton.proportions();
    let trunk_m = lengths.lumbar_m + lengths.scapula_up_m;
    let below = |shoulders: Vector3<f64>| shoulders - axes.column(2) * trunk_m;
    body.middle_m(HIPS)
        .or_else(|| body.middle_m(SHOULDERS).map(below))
}

fn set_arm(pose: &mut Pose, side: Side, body: &ObservedJoints, world_from_trunk: &Matrix3<f64>) {
    let [shoulder, elbow, wrist] = match side {
        Side::Left => [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist],
        Side::Right => [Joint::RightShoulder, Joint::RightElbow, Joint::RightWrist],
    };
    let Some(limb) = ObservedLimb::seen(body, [shoulder, elbow, wrist]) else {
        return;
    };
    let first = first_of(side, DofGroup::Shoulder);
    pose.dof[first_of(side, DofGroup::Elbow)] = limb.bend_rad();
    // The forearm bends forward, so it shows the upper arm's x.
    if let Some(upper_arm) = limb.axes(limb.bend) {
        pose.dof[first..first + 3].copy_from_slice(&shoulder_coordinates(
            side,
            &world_from_trunk.tr_mul(&upper_arm),
        ));
    } else if let Some(any) = limb
        .axes(Some(world_from_trunk.column(0).into()))
        .or_else(|| limb.axes(Some(limb.aside())))
    {
        let [raise, inward, _] = shoulder_coordinates(side, &world_from_trunk.tr_mul(&any));
        pose.dof[first..first + 2].copy_from_slice(&[raise, inward]);
    }
}

fn set_leg(pose: &mut Pose, side: Side, body: &ObservedJoints, world_from_trunk: &Matrix3<f64>) {
    let [hip, knee, ankle] = match side {
        Side::Left => [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle],
        Side::Right => [Joint::RightHip, Joint::RightKnee, Joint::RightAnkle],
    };
    let Some(limb) = ObservedLimb::seen(body, [hip, knee, ankle]) else {
        return;
    };
    pose.dof[first_of(side, DofGroup::Knee)] = limb.bend_rad();
    // The shank bends backward. For a straight leg the bend is unknown: its knee points where the
    // trunk's front is when the hip flexes.
    let ahead = limb.bend.map(|bend| -bend).or_else(|| {
        let flexed = limb.upper.dot(&world_from_trunk.column(0));
        let front = if flexed.abs() < 0.7 {
            world_from_trunk.column(0)
        } else {
            world_from_trunk.column(2)
        };
        Some(front * if flexed < -0.7 { -1.0 } else { 1.0 })
    });
    if let Some(thigh) = limb.axes(ahead) {
        let first = first_of(side, DofGroup::Hip);
        pose.dof[first..first + 3]
            .copy_from_slice(&hip_angles(side, &world_from_trunk.tr_mul(&thigh)));
    }
}

/// Flexion, adduction and internal rotation of a hip whose thigh has the rotation `r` in the
/// pelvis.
///
/// ```text
///   R = Ry(-flexion) Rx(m adduction) Rz(m rotation),   m = 1 right, -1 left
/// ```
fn hip_angles(side: Side, r: &Matrix3<f64>) -> [f64; 3] {
    let m = side.mirror();
    let adduction = libm::asin((-r[(1, 2)]).clamp(-1.0, 1.0));
    [
        -libm::atan2(r[(0, 2)], r[(2, 2)]),
        m * adduction,
        m * libm::atan2(r[(1, 0)], r[(1, 1)]),
    ]
}

/// Two bones of an arm or leg, in the world.
struct ObservedLimb {
    /// Along the upper bone, away from the trunk, unit.
    upper: Vector3<f64>,
    /// Along the lower bone, unit, if it is seen.
    lower: Option<Vector3<f64>>,
    /// Direction in which the lower bone bends, across the upper one; unless the limb is straight.
    bend: Option<Vector3<f64>>,
}

impl ObservedLimb {
    fn seen(body: &ObservedJoints, [root, middle, end]: [Joint; 3]) -> Option<Self> {
        let middle_m = body.position_m(middle)?;
        let upper = direction(body.position_m(root)?, middle_m)?;
        let lower = body
            .position_m(end)
            .and_then(|end| direction(middle_m, end));
        let bend = lower
            .and_then(|lower| (lower - upper * lower.dot(&upper)).try_normalize(STRAIGHT_SINE));
        Some(Self { upper, lower, bend })
    }

    fn bend_rad(&self) -> f64 {
        self.lower.map_or(0.0, |lower| lower.angle(&self.upper))
    }

    /// Columns: x, y, z of the upper link: z against the bone, x as near to `ahead` as possible.
    fn axes(&self, ahead: Option<Vector3<f64>>) -> Option<Matrix3<f64>> {
        let z = -self.upper;
        let ahead = ahead?;
        let x = (ahead - z * ahead.dot(&z)).try_normalize(MIN_AXIS_SINE)?;
        Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
    }

    /// Some direction across the bone.
    fn aside(&self) -> Vector3<f64> {
        let smallest = self.upper.iamin();
        Vector3::from_fn(|i, _| if i == smallest { 1.0 } else { 0.0 })
    }
}

/// Sine of an angle that is enough to span a plane without noise.
const MIN_AXIS_SINE: f64 = 1e-3;

fn direction(from: Vector3<f64>, to: Vector3<f64>) -> Option<Vector3<f64>> {
    (to - from).try_normalize(MIN_LENGTH_M)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::body::fixture::{Noise, coco_only, joints, postures};
    use crate::body::skeleton::Proportions;

    /// Error of straight limbs: a twist that does not move any keypoint.
    const TOLERANCE_M: f64 = 1e-9;

    proptest! {
        #[test]
        fn exact_limbs_are_posed_exactly_in_any_orientation(
            seed in any::<u64>(),
            turn in prop::array::uniform3(-3.0f64..3.0),
        ) {
            let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
            let mut truth = postures(1, &mut Noise(seed)).remove(0);
            truth.root_rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            let seen = coco_only(&joints(&skeleton, &truth), |p| p);
            let found = joints(&skeleton, &posed(&skeleton, &seen).unwrap());
            for (joint, point) in seen.iter() {
                let error_m = (found.position_m(joint).unwrap() - point.position_m).norm();
                prop_assert!(error_m < TOLERANCE_M, "{}: {error_m} m", joint.name());
            }
        }
    }

    #[test]
    fn a_neutral_pose_is_found() {
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let truth = Pose::neutral(Vector3::new(1.0, 2.0, 0.93), UnitQuaternion::identity());
        let found = posed(&skeleton, &coco_only(&joints(&skeleton, &truth), |p| p)).unwrap();
        assert!(
            truth.step_to(&found).iter().all(|q| q.abs() < 1e-6),
            "{:?}",
            truth.step_to(&found)
        );
    }

    #[test]
    fn a_trunk_in_line_with_its_cross_line_has_no_pose() {
        // Hips at the origin and shoulders half a metre above, or shoulders and a nose. The lines
        // from right to left are tilted relative to the trunk's, one or both.
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let seen = |angle_deg: f64, both: bool| {
            let across = Rotation3::from_axis_angle(&Vector3::x_axis(), angle_deg.to_radians())
                * Vector3::new(0.0, 0.0, -0.2);
            let shoulders_m = Vector3::new(0.0, 0.0, 0.5);
            let mut body = ObservedJoints::default();
            body.set(Joint::LeftShoulder, shoulders_m + across, 1.0);
            body.set(Joint::RightShoulder, shoulders_m - across, 1.0);
            if both {
                body.set(Joint::LeftHip, across, 1.0);
                body.set(Joint::RightHip, -across, 1.0);
            } else {
                body.set(Joint::Nose, Vector3::new(0.0, 0.0, 0.7), 1.0);
            }
            posed(&skeleton, &body)
        };
        for both in [true, false] {
            assert!(seen(10.0, both).is_none());
            assert!(seen(20.0, both).is_some());
        }
    }

    #[test]
    fn without_a_line_across_the_trunk_there_is_no_pose() {
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let truth = Pose::neutral(Vector3::zeros(), UnitQuaternion::identity());
        let mut seen = coco_only(&joints(&skeleton, &truth), |p| p);
        seen.remove(Joint::LeftHip);
        assert!(posed(&skeleton, &seen).is_some());
        seen.remove(Joint::RightShoulder);
        assert!(posed(&skeleton, &seen).is_none());
    }
}
