//! Laws of the solver, and recovery of known poses.

use std::f64::consts::PI;

use farfield_proto::keypoints::COCO17;
use farfield_proto::venue::parameters::IkParameters;
use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;
use crate::body::skeleton::dof::{DofGroup, first_of};
use crate::body::skeleton::{
    ANGLE_NAMES, Joint, Kinematics, N_DOF, N_JOINT_DOF, Pose, Proportions, RangeOfMotion, Side,
    Site, Skeleton,
};

const TICK_S: f64 = 1.0 / 60.0;
/// A person at 60 Hz: no joint moves further from tick to tick, radians (12 rad/s).
const TICK_CHANGE_RAD: f64 = 0.2;
/// Sigmas of targets without error, metres: of all joints and of keypoints.
const EXACT_JOINTS_SIGMA_M: f64 = 0.001;
const EXACT_KEYPOINTS_SIGMA_M: f64 = 0.005;
/// Error from the priors in that case, metres.
const JOINTS_TOLERANCE_M: f64 = 0.001;
const KEYPOINTS_TOLERANCE_M: f64 = 0.005;
/// Noise of the keypoints of a standing person, metres.
const TREMBLE_M: f64 = 0.003;
/// Largest motion of the least determined DoF (the twist of a straight arm) by the noise, radians.
const TWIST_DRIFT_RAD: f64 = 0.3;
/// A clearly bent elbow, radians.
const BENT_RAD: f64 = 0.45;
/// Iterations until the hardest of random motions has converged.
const ITERATIONS: u32 = 20;

fn body() -> Skeleton {
    Skeleton::new(&Proportions::from_stature(1.78))
}

fn standing() -> Pose {
    Pose::neutral(Vector3::new(1.0, -2.0, 0.95), UnitQuaternion::identity())
}

pub(super) fn placed(pose: &Pose) -> Kinematics {
    let mut kinematics = Kinematics::default();
    body().forward(pose, &mut kinematics);
    kinematics
}

fn targets(pose: &Pose, joints: impl IntoIterator<Item = Joint>, sigma_m: f64) -> Vec<Target> {
    let at = placed(pose);
    joints
        .into_iter()
        .map(|joint| {
            let weight = 1.0 / (sigma_m * sigma_m);
            Target::isotropic(&Site::at(joint), at.joint_m(joint), weight)
        })
        .collect()
}

pub(super) fn all_joints(pose: &Pose) -> Vec<Target> {
    targets(pose, Joint::ALL, EXACT_JOINTS_SIGMA_M)
}

fn keypoints(pose: &Pose) -> Vec<Target> {
    let joints = COCO17.map(|name| Joint::from_name(name).unwrap());
    targets(pose, joints, IkParameters::default().keypoint_sigma_m)
}

fn exact_keypoints(pose: &Pose) -> Vec<Target> {
    let weight = EXACT_KEYPOINTS_SIGMA_M.powi(-2);
    keypoints(pose)
        .into_iter()
        .map(|t| Target {
            information: Matrix3::from_diagonal_element(weight),
            evidence: Matrix3::from_diagonal_element(weight),
            ..t
        })
        .collect()
}

fn solve(start: &Pose, targets: &[Target], bounds: Option<&RangeOfMotion>) -> Solution {
    let parameters = IkParameters {
        iterations: ITERATIONS,
        ..IkParameters::default()
    };
    let priors = Priors::new(&parameters, start, TICK_S);
    IkSolver::new(&parameters).solve(&body(), start, targets, &priors, bounds)
}

/// Two ticks with the same targets.
fn solve_twice(start: &Pose, targets: &[Target], bounds: Option<&RangeOfMotion>) -> Solution {
    let first = solve(start, targets, bounds);
    solve(&first.pose, targets, bounds)
}

fn worst_m(pose: &Pose, targets: &[Target]) -> f64 {
    let at = placed(pose);
    targets
        .iter()
        .map(|t| (at.joint_m(t.joint) - t.position_m).norm())
        .fold(0.0, f64::max)
}

fn is_unobserved(solution: &Solution, name: &str) -> bool {
    let i = ANGLE_NAMES.iter().position(|n| *n == name).unwrap();
    solution.unobserved >> i & 1 == 1
}

/// A pose inside the range of motion, in any orientation. Elbows are bent by at least 26 degrees:
/// at a straight elbow a twist that is wrong by half a turn is also a minimum, some millimetres
/// off.
pub(super) fn any_pose() -> impl Strategy<Value = Pose> {
    let range = RangeOfMotion::default();
    let inside = prop::collection::vec(0.02..0.98, N_JOINT_DOF);
    (prop::array::uniform3(-PI..PI), inside).prop_map(move |(turn, share)| {
        let mut pose = Pose {
            root_m: Vector3::new(1.0, -2.0, 0.95),
            root_rotation: UnitQuaternion::from_scaled_axis(Vector3::from(turn)),
            dof: std::array::from_fn(|i| {
                range.lo_rad(i) + share[i] * (range.hi_rad(i) - range.lo_rad(i))
            }),
        };
        for side in Side::BOTH {
            let elbow = first_of(side, DofGroup::Elbow);
            pose.dof[elbow] = pose.dof[elbow].max(BENT_RAD);
        }
        pose
    })
}

/// A pose and a possible pose of the previous tick.
fn any_motion() -> impl Strategy<Value = (Pose, Pose)> {
    (
        any_pose(),
        prop::array::uniform(-TICK_CHANGE_RAD..TICK_CHANGE_RAD),
    )
        .prop_map(|(pose, step): (_, [f64; N_DOF])| {
            let mut step = step;
            for d in &mut step[..3] {
                *d *= 0.5;
            }
            (RangeOfMotion::default().clamp(pose.moved(&step)), pose)
        })
}

proptest! {
    /// Usually in the first tick: in 28 of 200,000 motions it is up to 3 mm off.
    #[test]
    fn exact_joints_give_the_pose_back_within_two_ticks((start, truth) in any_motion()) {
        let targets = all_joints(&truth);
        let solution = solve_twice(&start, &targets, Some(&RangeOfMotion::default()));
        prop_assert!(worst_m(&solution.pose, &targets) < JOINTS_TOLERANCE_M, "{} m", worst_m(&solution.pose, &targets));
    }

    /// Usually in the first tick: in 10 of 200,000 motions it is 5 to 16 mm off, because keypoints
    /// hardly separate trunk and scapulas and priors keep them where they were.
    #[test]
    fn exact_keypoints_are_met_within_two_ticks((start, truth) in any_motion()) {
        let targets = exact_keypoints(&truth);
        let solution = solve_twice(&start, &targets, None);
        prop_assert!(worst_m(&solution.pose, &targets) < KEYPOINTS_TOLERANCE_M, "{} m", worst_m(&solution.pose, &targets));
    }

    #[test]
    fn bounds_hold_exactly_for_any_target(
        (start, truth) in any_motion(),
        far in prop::collection::vec(prop::array::uniform3(-3.0..3.0), 29),
        factor in 0.2..1.5,
    ) {
        let range = RangeOfMotion::new(factor);
        let mut targets = all_joints(&truth);
        for (target, far) in targets.iter_mut().zip(far) {
            target.position_m += Vector3::from(far);
        }
        let solution = solve(&start, &targets, Some(&range));
        prop_assert!(range.contains(&solution.pose));
        prop_assert!(solution.pose.is_finite());
    }
}

#[test]
fn a_bound_costs_no_more_than_necessary() {
    // The target extends the elbow 30 degrees beyond its bound. It stops at the bound, and the
    // wrist comes as near as an arm with that elbow can.
    let range = RangeOfMotion::default();
    let elbow = first_of(Side::Right, DofGroup::Elbow);
    let mut wanted = standing();
    wanted.dof[elbow] = range.lo_rad(elbow) - 0.5;
    let mut start = standing();
    start.dof[elbow] = 0.4;
    let targets = all_joints(&wanted);
    let solution = solve(&start, &targets, Some(&range));
    assert!((solution.pose.dof[elbow] - range.lo_rad(elbow)).abs() < 1e-12);
    let at_bound = range.clamp(wanted);
    assert!(worst_m(&solution.pose, &targets) < worst_m(&at_bound, &targets));
}

#[test]
fn invalid_targets_are_ignored() {
    let mut targets = all_joints(&standing());
    let good = solve(&standing(), &targets[3..], None);
    targets[0].position_m.x = f64::NAN;
    targets[1].information *= f64::INFINITY;
    targets[2].information *= -1.0;
    assert_eq!(solve(&standing(), &targets, None), good);
}

#[test]
fn huge_targets_leave_a_finite_pose() {
    let mut targets = all_joints(&standing());
    for target in &mut targets {
        target.position_m *= 1e160;
    }
    assert!(solve(&standing(), &targets, None).pose.is_finite());
    assert!(
        solve(&standing(), &targets, Some(&RangeOfMotion::default()))
            .pose
            .is_finite()
    );
}

#[test]
fn without_targets_the_pose_stays_unobserved() {
    let solution = solve(&standing(), &[], None);
    assert!((solution.pose.root_m - standing().root_m).norm() < 1e-9);
    assert_eq!(solution.unobserved, (1 << 40) - 1);
}

#[test]
fn a_cartwheel_is_followed_from_pose_to_pose() {
    let turn = |tick: u32| UnitQuaternion::from_scaled_axis(Vector3::x() * (f64::from(tick) * 0.1));
    let mut pose = standing();
    let mut solver = IkSolver::new(&IkParameters::default());
    for tick in 0..=63 {
        let truth = Pose {
            root_rotation: turn(tick),
            ..standing()
        };
        let targets = keypoints(&truth);
        let priors = Priors::new(&IkParameters::default(), &pose, TICK_S);
        let solution = solver.solve(
            &body(),
            &pose,
            &targets,
            &priors,
            Some(&RangeOfMotion::default()),
        );
        pose = solution.pose;
        assert!(
            worst_m(&pose, &targets) < KEYPOINTS_TOLERANCE_M,
            "{tick}: {}",
            worst_m(&pose, &targets)
        );
    }
}

#[test]
fn a_lying_person_is_found_from_a_standing_pose() {
    let lying = Pose {
        root_rotation: UnitQuaternion::from_scaled_axis(Vector3::y() * 1.4),
        ..standing()
    };
    let targets = keypoints(&lying);
    let parameters = IkParameters {
        iterations: 30,
        ..IkParameters::default()
    };
    let priors = Priors::new(&parameters, &standing(), 1.0);
    let solution = IkSolver::new(&parameters).solve(&body(), &standing(), &targets, &priors, None);
    assert!(
        worst_m(&solution.pose, &targets) < KEYPOINTS_TOLERANCE_M,
        "{}",
        worst_m(&solution.pose, &targets)
    );
}

#[test]
fn twists_do_not_drift() {
    // Both solves of a tick on straight limbs, with keypoints that tremble by some millimetres.
    let parameters = IkParameters::default();
    let mut solver = IkSolver::new(&parameters);
    let mut pose = standing();
    let mut settled = pose;
    for tick in 0..1200 {
        let mut seen = keypoints(&standing());
        for (k, target) in seen.iter_mut().enumerate() {
            let phase = f64::from(tick) * (1.0 + k as f64);
            target.position_m +=
                Vector3::new(phase.sin(), (1.3 * phase).cos(), (1.7 * phase).sin()) * TREMBLE_M;
        }
        let priors = Priors::new(&parameters, &pose, TICK_S);
        let first = solver.solve(&body(), &pose, &seen, &priors, None).pose;
        let joints = targets(&first, Joint::ALL, EXACT_JOINTS_SIGMA_M);
        pose = solver
            .solve(
                &body(),
                &pose,
                &joints,
                &priors,
                Some(&RangeOfMotion::default()),
            )
            .pose;
        if tick == 199 {
            settled = pose;
        }
    }
    for (i, (a, b)) in settled.dof.iter().zip(&pose.dof).enumerate() {
        assert!((a - b).abs() < TWIST_DRIFT_RAD, "dof {i}: {a} -> {b}");
    }
}

#[test]
fn angles_that_17_keypoints_do_not_determine_are_flagged() {
    let mut pose = standing();
    for side in Side::BOTH {
        pose.dof[first_of(side, DofGroup::Elbow)] = 0.02;
        pose.dof[first_of(side, DofGroup::Knee)] = 0.02;
    }
    let straight = solve(&pose, &keypoints(&pose), None);
    for name in [
        "pelvis_tilt",
        "lumbar_extension",
        "ankle_angle_l",
        "subtalar_angle_r",
        "foot_rotation_l",
        "scapula_tilt_r",
        "hip_rotation_l",
        "hip_rotation_r",
        "arm_rot_l",
    ] {
        assert!(is_unobserved(&straight, name), "{name}");
    }
    for name in [
        "pelvis_list",
        "pelvis_rotation",
        "pelvis_tx",
        "pelvis_ty",
        "pelvis_tz",
        "lumbar_bending",
        "lumbar_rotation",
        "knee_angle_l",
        "elbow_flex_r",
        "hip_adduction_l",
        "neck_rotation",
        "arm_flex_l",
        "arm_add_r",
    ] {
        assert!(!is_unobserved(&straight, name), "{name}");
    }
    for side in Side::BOTH {
        pose.dof[first_of(side, DofGroup::Elbow)] = 1.0;
        pose.dof[first_of(side, DofGroup::Knee)] = 1.0;
    }
    let bent = solve(&pose, &keypoints(&pose), None);
    for name in ["hip_rotation_l", "hip_rotation_r", "arm_rot_l", "arm_rot_r"] {
        assert!(!is_unobserved(&bent, name), "{name}");
    }
}

#[test]
fn an_unseen_face_leaves_the_neck_unobserved() {
    let targets: Vec<_> = keypoints(&standing())
        .into_iter()
        .filter(|t| t.joint.parent() != Some(Joint::Head))
        .collect();
    let solution = solve(&standing(), &targets, None);
    for name in ["neck_flexion", "neck_bending", "neck_rotation"] {
        assert!(is_unobserved(&solution, name), "{name}");
    }
}

/// A left forearm that hangs forward, and its wrist as seen by one viewpoint at the person's side:
/// the place along the ray, here the prediction's, is 30 cm off.
fn wrist_seen_from_one_side() -> (Pose, Vec<Target>) {
    let mut pose = standing();
    pose.dof[first_of(Side::Left, DofGroup::Elbow)] = 1.0;
    let mut targets = keypoints(&pose);
    let wrist = targets
        .iter_mut()
        .find(|t| t.joint == Joint::LeftWrist)
        .unwrap();
    let ray = Unit::new_normalize(Vector3::new(0.3, 1.0, -0.1));
    wrist.position_m += ray.as_ref() * 0.3;
    wrist.information -= ray.as_ref() * ray.transpose() * wrist.information.m11;
    (pose, targets)
}

#[test]
fn a_keypoint_in_one_view_does_not_pull_along_its_ray() {
    let (truth, targets) = wrist_seen_from_one_side();
    let found = solve(&truth, &targets, None).pose;
    let wrist_m = |pose: &Pose| placed(pose).joint_m(Joint::LeftWrist);
    assert!((wrist_m(&found) - wrist_m(&truth)).norm() < KEYPOINTS_TOLERANCE_M);
    // With information along it, it would.
    let everywhere: Vec<_> = targets
        .iter()
        .map(|t| Target {
            information: Matrix3::from_diagonal_element(t.information.m33.max(t.information.m11)),
            ..*t
        })
        .collect();
    let pulled = solve(&truth, &everywhere, None).pose;
    assert!((wrist_m(&pulled) - wrist_m(&truth)).norm() > 0.1);
}

#[test]
fn a_keypoint_in_one_view_is_met_across_its_ray() {
    let (truth, targets) = wrist_seen_from_one_side();
    let mut start = truth;
    start.dof[first_of(Side::Left, DofGroup::Elbow)] = 0.7;
    let found = solve(&start, &targets, None).pose;
    let off_m = placed(&found).joint_m(Joint::LeftWrist) - placed(&truth).joint_m(Joint::LeftWrist);
    let ray = Unit::new_normalize(Vector3::new(0.3, 1.0, -0.1));
    let across_m = (off_m - ray.as_ref() * ray.dot(&off_m)).norm();
    assert!(across_m < KEYPOINTS_TOLERANCE_M, "{across_m} m");
}

#[test]
fn an_angle_can_pass_a_half_turn() {
    // Without bounds angles are wrapped: from 179 degrees to -179 is a step of two, not of 358, and
    // no prior may see anything else. The lower legs of a wrongly fitted body fold up like this.
    let knee = first_of(Side::Left, DofGroup::Knee);
    let mut start = standing();
    start.dof[knee] = PI - 0.02;
    for past in [0.02, 0.1] {
        let mut truth = start;
        truth.dof[knee] = PI + past;
        let targets = keypoints(&truth);
        let found = solve(&start, &targets, None).pose;
        assert!(found.dof[knee] < 0.0, "wrapped: {}", found.dof[knee]);
        assert!(worst_m(&found, &targets) < KEYPOINTS_TOLERANCE_M);
    }
    // And the same back.
    let mut start = standing();
    start.dof[knee] = 0.02 - PI;
    let mut truth = start;
    truth.dof[knee] = -PI - 0.02;
    let targets = keypoints(&truth);
    let found = solve(&start, &targets, None).pose;
    assert!(found.dof[knee] > 0.0, "wrapped: {}", found.dof[knee]);
    assert!(worst_m(&found, &targets) < KEYPOINTS_TOLERANCE_M);
}
