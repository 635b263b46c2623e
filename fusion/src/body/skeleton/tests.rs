//! Laws of the model and hand-checked poses.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use farfield_proto::keypoints::KeypointSet;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::dof::{DofGroup, LUMBAR, NECK, first_of};
use super::*;

const STATURE_M: f64 = 1.75;
/// Rounding of a chain of seven rotations.
const EXACT: f64 = 1e-9;
/// Central differences with a step of 1e-5: the truncation is 1e-10 times the third derivative, the
/// rounding 1e-11.
const DIFFERENCE_STEP: f64 = 1e-5;
const DIFFERENCE_TOLERANCE: f64 = 1e-7;

fn body() -> Skeleton {
    Skeleton::new(&Proportions::from_stature(STATURE_M))
}

fn standing() -> Pose {
    Pose::neutral(
        Vector3::new(0.0, 0.0, 0.53 * STATURE_M),
        UnitQuaternion::identity(),
    )
}

fn placed(pose: &Pose) -> Kinematics {
    let mut kinematics = Kinematics::default();
    body().forward(pose, &mut kinematics);
    kinematics
}

fn angle(pose: &Pose, name: &str) -> f64 {
    reported_angles(pose)[ANGLE_NAMES.iter().position(|n| *n == name).unwrap()]
}

/// Sets a shoulder to a rotation about an axis of the scapula's frame.
fn with_arm(mut pose: Pose, side: Side, axis: Vector3<f64>, angle_rad: f64) -> Pose {
    let rotation = UnitQuaternion::from_scaled_axis(axis * angle_rad).to_rotation_matrix();
    let first = first_of(side, DofGroup::Shoulder);
    pose.dof[first..first + 3].copy_from_slice(&shoulder_coordinates(side, rotation.matrix()));
    pose
}

/// Any orientation of the root and any joint angles up to a half turn (the shoulder's swing short of
/// its singularity).
fn any_pose() -> impl Strategy<Value = Pose> {
    (
        prop::array::uniform3(-5.0..5.0),
        prop::array::uniform3(-PI..PI),
        prop::collection::vec(-2.0..2.0, N_JOINT_DOF),
    )
        .prop_map(|(root, turn, dof)| Pose {
            root_m: Vector3::from(root),
            root_rotation: UnitQuaternion::from_scaled_axis(Vector3::from(turn)),
            dof: dof.try_into().unwrap(),
        })
}

proptest! {
    #[test]
    fn the_jacobian_is_the_derivative_of_the_joints(pose in any_pose(), offset in prop::array::uniform3(-0.1..0.1)) {
        let at = placed(&pose);
        for dof in 0..N_DOF {
            let mut step = [0.0; N_DOF];
            step[dof] = DIFFERENCE_STEP;
            let ahead = placed(&pose.moved(&step));
            step[dof] = -DIFFERENCE_STEP;
            let behind = placed(&pose.moved(&step));
            for joint in Joint::ALL {
                let site = Site { joint, offset_m: Vector3::from(offset) };
                let numeric = (ahead.site_m(&site) - behind.site_m(&site)) / (2.0 * DIFFERENCE_STEP);
                let analytic = at.column(dof, joint.link(), &at.site_m(&site));
                prop_assert!((numeric - analytic).norm() < DIFFERENCE_TOLERANCE, "{dof} {joint:?} {numeric} {analytic}");
            }
        }
    }

    #[test]
    fn link_lengths_are_constant(pose in any_pose()) {
        let neutral = placed(&Pose::neutral(Vector3::zeros(), UnitQuaternion::identity()));
        let at = placed(&pose);
        for joint in Joint::ALL {
            if let Some(parent) = joint.parent() {
                let length = |at: &Kinematics| (at.joint_m(joint) - at.joint_m(parent)).norm();
                prop_assert!((length(&at) - length(&neutral)).abs() < EXACT);
            }
        }
    }

    #[test]
    fn a_step_leads_where_it_was_measured_to(from in any_pose(), to in any_pose()) {
        let there = from.moved(&from.step_to(&to));
        prop_assert!((there.root_m - to.root_m).norm() < EXACT);
        prop_assert!(there.root_rotation.angle_to(&to.root_rotation) < 1e-7);
        for (a, b) in there.dof.iter().zip(&to.dof) {
            prop_assert!((a - b).abs() < EXACT);
        }
    }

    #[test]
    fn wrapping_does_not_move_the_body(pose in any_pose(), turns in prop::collection::vec(-2_i32..3, N_JOINT_DOF)) {
        let mut wound = pose;
        for (q, n) in wound.dof.iter_mut().zip(turns) {
            *q += 2.0 * PI * f64::from(n);
        }
        // A swing of whole turns more is another rotation: wind it along its own direction.
        for side in Side::BOTH {
            let first = first_of(side, DofGroup::Shoulder);
            let (s1, s2) = (pose.dof[first], pose.dof[first + 1]);
            let longer = 1.0 + 2.0 * PI / s1.hypot(s2);
            (wound.dof[first], wound.dof[first + 1]) = (s1 * longer, s2 * longer);
        }
        let (there, here) = (placed(&wound.wrapped()), placed(&pose));
        for (a, b) in there.joints_m.iter().zip(&here.joints_m) {
            prop_assert!((a - b).norm() < EXACT);
        }
        prop_assert!(wound.wrapped().dof.iter().all(|q| q.abs() <= PI));
    }

    #[test]
    fn shoulder_coordinates_give_the_rotation_back(turn in prop::array::uniform3(-2.0..2.0), left in any::<bool>()) {
        let side = if left { Side::Left } else { Side::Right };
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn)).to_rotation_matrix().into_inner();
        let q = shoulder_coordinates(side, &rotation);
        let back = shoulder::SwingTwist::for_side(side).evaluate(&q).rotation;
        prop_assert!((back - rotation).norm() < EXACT);
    }

    #[test]
    fn reported_angles_stay_in_their_range(share in prop::collection::vec(0.0..=1.0, N_JOINT_DOF), factor in 0.5..2.0) {
        let range = RangeOfMotion::new(factor);
        let mut pose = standing();
        for (i, t) in share.iter().enumerate() {
            pose.dof[i] = range.lo_rad(i) + t * (range.hi_rad(i) - range.lo_rad(i));
        }
        let pose = range.clamp(pose);
        prop_assert!(range.contains(&pose));
        for (i, value) in reported_angles(&pose).into_iter().enumerate() {
            let (lo, hi) = range.reported_range(i);
            prop_assert!((lo..=hi).contains(&value), "{} {value} {lo} {hi}", ANGLE_NAMES[i]);
        }
    }

    #[test]
    fn arm_angles_rebuild_the_arm(turn in prop::array::uniform3(-2.0..2.0), left in any::<bool>()) {
        let side = if left { Side::Left } else { Side::Right };
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn)).to_rotation_matrix().into_inner();
        let pose = with_arm(standing(), side, Vector3::from(turn), 1.0);
        let suffix = if left { "l" } else { "r" };
        let m = side.mirror();
        let about = |axis: Vector3<f64>, q: f64| UnitQuaternion::from_scaled_axis(axis * q);
        let rebuilt = about(-Vector3::y(), angle(&pose, &format!("arm_flex_{suffix}")))
            * about(Vector3::x() * m, angle(&pose, &format!("arm_add_{suffix}")))
            * about(Vector3::z() * m, angle(&pose, &format!("arm_rot_{suffix}")));
        prop_assert!((rebuilt.to_rotation_matrix().into_inner() - rotation).norm() < 1e-7);
    }
}

#[test]
fn the_neutral_pose_is_the_table_of_the_formats() {
    let at = placed(&standing());
    let check = |joint: Joint, x: f64, y: f64, z: f64| {
        let expected = Vector3::new(x, y, z) * STATURE_M;
        assert!((at.joint_m(joint) - expected).norm() < EXACT, "{joint:?}");
    };
    check(Joint::Neck, 0.0, 0.0, 0.82);
    check(Joint::Nose, 0.06, 0.0, 0.92);
    check(Joint::LeftEye, 0.05, 0.019, 0.935);
    check(Joint::RightEar, 0.0, -0.042, 0.92);
    check(Joint::RightShoulder, 0.0, -0.11, 0.80);
    check(Joint::LeftWrist, 0.0, 0.11, 0.80 - 0.172 - 0.157);
    check(Joint::LeftHand, 0.0, 0.11, 0.80 - 0.172 - 0.157 - 0.05);
    check(Joint::RightToe, 0.12, -0.05, 0.53 - 0.245 - 0.246 - 0.035);
    check(Joint::LeftHeel, -0.03, 0.05, 0.53 - 0.245 - 0.246 - 0.035);
    for name in &ANGLE_NAMES[6..] {
        assert!(angle(&standing(), name).abs() < EXACT, "{name}");
    }
}

#[test]
fn an_arm_raised_forward_has_positive_flexion() {
    for (side, wrist, name) in [
        (Side::Right, Joint::RightWrist, "arm_flex_r"),
        (Side::Left, Joint::LeftWrist, "arm_flex_l"),
    ] {
        let pose = with_arm(standing(), side, -Vector3::y(), PI / 2.0);
        assert!((angle(&pose, name) - PI / 2.0).abs() < EXACT);
        assert!(placed(&pose).joint_m(wrist).x > 0.3 * STATURE_M);
    }
}

#[test]
fn arms_of_a_t_pose_have_an_adduction_of_minus_ninety() {
    let pose = with_arm(standing(), Side::Right, -Vector3::x(), PI / 2.0);
    let pose = with_arm(pose, Side::Left, Vector3::x(), PI / 2.0);
    for name in ["arm_add_r", "arm_add_l"] {
        assert!((angle(&pose, name) + PI / 2.0).abs() < 1e-6);
    }
    assert!(placed(&pose).joint_m(Joint::LeftWrist).y > 0.4 * STATURE_M);
    assert!(RangeOfMotion::default().contains(&pose));
}

#[test]
fn arms_turned_inward_have_positive_rotation() {
    let mut pose = standing();
    for side in Side::BOTH {
        pose.dof[first_of(side, DofGroup::Shoulder) + 2] = 0.5;
        pose.dof[first_of(side, DofGroup::Elbow)] = PI / 2.0;
    }
    assert!((angle(&pose, "arm_rot_r") - 0.5).abs() < EXACT);
    assert!((angle(&pose, "arm_rot_l") - 0.5).abs() < EXACT);
    let at = placed(&pose);
    // Forearms forward, hands toward each other.
    assert!(at.joint_m(Joint::LeftWrist).y < at.joint_m(Joint::LeftElbow).y);
    assert!(at.joint_m(Joint::RightWrist).y > at.joint_m(Joint::RightElbow).y);
    assert!(at.joint_m(Joint::RightWrist).x > 0.1 * STATURE_M);
}

/// Turning DoF `index` by 0.3 adds 0.3 to the angle of that name and moves the joint that way.
fn check_direction(index: usize, name: &str, joint: Joint, direction: Vector3<f64>) {
    let mut pose = standing();
    pose.dof[index] += 0.3;
    assert!((angle(&pose, name) - 0.3).abs() < EXACT, "{name}");
    let moved = placed(&pose).joint_m(joint) - placed(&standing()).joint_m(joint);
    assert!(moved.dot(&direction) > 0.005, "{name} {moved}");
}

#[test]
fn every_dof_of_the_trunk_moves_as_named() {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    check_direction(LUMBAR, "lumbar_extension", Joint::Neck, -x);
    check_direction(LUMBAR + 1, "lumbar_bending", Joint::Neck, -y);
    check_direction(LUMBAR + 2, "lumbar_rotation", Joint::RightShoulder, x);
    check_direction(NECK, "neck_flexion", Joint::Nose, x - z);
    check_direction(NECK + 1, "neck_bending", Joint::Head, -y);
    check_direction(NECK + 2, "neck_rotation", Joint::Nose, y);
}

#[test]
fn every_dof_of_a_side_moves_as_named() {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let at = |side, part, k| first_of(side, part) + k;
    for (side, prefix, s, out) in [
        (Side::Right, "right", "r", -y),
        (Side::Left, "left", "l", y),
    ] {
        let joints = ["shoulder", "elbow", "wrist", "knee", "ankle", "toe"]
            .map(|name| Joint::from_name(&format!("{prefix}_{name}")).unwrap());
        let [shoulder, elbow, wrist, knee, ankle, toe] = joints;
        check_direction(
            at(side, DofGroup::Scapula, 0),
            &format!("scapula_elevation_{s}"),
            shoulder,
            z,
        );
        check_direction(
            at(side, DofGroup::Scapula, 1),
            &format!("scapula_protraction_{s}"),
            shoulder,
            x,
        );
        // The top forward swings a hanging arm back.
        check_direction(
            at(side, DofGroup::Scapula, 2),
            &format!("scapula_tilt_{s}"),
            elbow,
            -x,
        );
        check_direction(
            at(side, DofGroup::Elbow, 0),
            &format!("elbow_flex_{s}"),
            wrist,
            x + z,
        );
        check_direction(
            at(side, DofGroup::Hip, 0),
            &format!("hip_flexion_{s}"),
            knee,
            x,
        );
        check_direction(
            at(side, DofGroup::Hip, 1),
            &format!("hip_adduction_{s}"),
            knee,
            -out,
        );
        check_direction(
            at(side, DofGroup::Hip, 2),
            &format!("hip_rotation_{s}"),
            toe,
            -out,
        );
        check_direction(
            at(side, DofGroup::Knee, 0),
            &format!("knee_angle_{s}"),
            ankle,
            -x + z,
        );
        check_direction(
            at(side, DofGroup::Ankle, 0),
            &format!("ankle_angle_{s}"),
            toe,
            z,
        );
        // The sole to the midline.
        check_direction(
            at(side, DofGroup::Ankle, 1),
            &format!("subtalar_angle_{s}"),
            toe,
            -out,
        );
        check_direction(
            at(side, DofGroup::Ankle, 2),
            &format!("foot_rotation_{s}"),
            toe,
            -out,
        );
    }
}

#[test]
fn the_root_is_reported_in_the_ground_frame_of_opensim() {
    let about = |axis: Vector3<f64>, a: f64| UnitQuaternion::from_scaled_axis(axis * a);
    // Facing the world's +y is facing the ground's +x.
    let forward = about(Vector3::z(), PI / 2.0);
    let pose = |turn| Pose::neutral(Vector3::new(1.0, 2.0, 3.0), turn);
    let check = |turn, expected: [f64; 6]| {
        for (found, expected) in reported_angles(&pose(turn)).into_iter().zip(expected) {
            assert!((found - expected).abs() < EXACT, "{found} {expected}");
        }
    };
    check(forward, [0.0, 0.0, 0.0, 2.0, 3.0, 1.0]);
    check(
        UnitQuaternion::identity(),
        [0.0, 0.0, -PI / 2.0, 2.0, 3.0, 1.0],
    );
    // Leaning back, to the right, turning left: in the pelvis' own frame.
    check(
        forward * about(-Vector3::y(), 0.3),
        [0.3, 0.0, 0.0, 2.0, 3.0, 1.0],
    );
    check(
        forward * about(Vector3::x(), 0.3),
        [0.0, 0.3, 0.0, 2.0, 3.0, 1.0],
    );
    check(
        forward * about(Vector3::z(), 0.3),
        [0.0, 0.0, 0.3, 2.0, 3.0, 1.0],
    );
}

#[test]
fn an_arm_points_up_when_its_elevation_is_a_half_turn() {
    let pose = with_arm(standing(), Side::Left, -Vector3::y(), PI);
    assert!((pose.arm_elevation_rad(Side::Left) - PI).abs() < EXACT);
    assert!(pose.arm_elevation_rad(Side::Right) < 1e-7);
}

#[test]
fn the_clinical_reach_of_the_arm_fits_in_the_box_of_its_swing() {
    let range = RangeOfMotion::default();
    for (plane_deg, most_deg) in [
        (-90, 50),
        (-30, 120),
        (0, 150),
        (45, 150),
        (90, 150),
        (115, 150),
        (135, 100),
    ] {
        for elevation_deg in (0..=most_deg).step_by(5) {
            let (plane, elevation) = (
                f64::from(plane_deg).to_radians(),
                f64::from(elevation_deg).to_radians(),
            );
            // From the side (0) to the front (90); the axis lifts the hanging arm in that plane.
            let axis = Vector3::new(-plane.cos(), -plane.sin(), 0.0);
            let rotation = UnitQuaternion::from_scaled_axis(axis * elevation).to_rotation_matrix();
            let [s1, s2, _] = shoulder_coordinates(Side::Right, rotation.matrix());
            let first = first_of(Side::Right, DofGroup::Shoulder);
            for (dof, s) in [(first, s1), (first + 1, s2)] {
                assert!(
                    (range.lo_rad(dof)..=range.hi_rad(dof)).contains(&s),
                    "{plane_deg} {elevation_deg}: {}",
                    s.to_degrees()
                );
            }
        }
    }
}

#[test]
fn the_two_sides_mirror_each_other() {
    let mut pose = standing();
    for i in 0..14 {
        pose.dof[6 + i] += 0.1 * i as f64;
        pose.dof[20 + i] += 0.1 * i as f64;
    }
    let at = placed(&pose);
    for joint in Joint::ALL {
        if let Some(right) = joint
            .name()
            .strip_prefix("left_")
            .and_then(|n| Joint::from_name(&format!("right_{n}")))
        {
            let mirrored =
                Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0)) * at.joint_m(right);
            assert!((at.joint_m(joint) - mirrored).norm() < EXACT, "{joint:?}");
        }
    }
}

#[test]
fn coco_keypoints_sit_on_joints_of_their_name_and_offsets_are_added() {
    let offsets = BTreeMap::from([("left_hip".to_owned(), [0.0, 0.03, 0.02])]);
    let sites = sites_of(&KeypointSet::coco17(), &offsets);
    assert_eq!(sites.len(), 17);
    for (name, site) in KeypointSet::coco17().names().iter().zip(&sites) {
        let site = site.unwrap();
        assert_eq!(site.joint.name(), name);
        let expected = if name == "left_hip" {
            Vector3::new(0.0, 0.03, 0.02)
        } else {
            Vector3::zeros()
        };
        assert_eq!(site.offset_m, expected);
    }
}

#[test]
fn feet_of_larger_networks_have_sites_and_unknown_names_have_none() {
    let names = ["left_big_toe", "right_heel", "left_ring_finger"]
        .map(str::to_owned)
        .to_vec();
    let joints: Vec<_> = sites_of(&KeypointSet::new(names), &BTreeMap::new())
        .iter()
        .map(|s| s.map(|s| s.joint))
        .collect();
    assert_eq!(joints, [Some(Joint::LeftToe), Some(Joint::RightHeel), None]);
}

#[test]
fn an_elbow_that_is_bent_backwards_has_a_forward_twin_with_the_same_wrist() {
    for side in Side::BOTH {
        let mut pose = standing();
        let (arm, elbow) = (
            first_of(side, DofGroup::Shoulder),
            first_of(side, DofGroup::Elbow),
        );
        pose.dof[arm + 2] = -2.0;
        pose.dof[elbow] = -1.4;
        let twin = pose.with_elbows_forward();
        assert!(twin.dof[elbow] > 0.0 && twin.dof[arm + 2].abs() < PI);
        let wrist = [Joint::RightWrist, Joint::LeftWrist][usize::from(side == Side::Left)];
        let apart_m = (placed(&pose).joint_m(wrist) - placed(&twin).joint_m(wrist)).norm();
        assert!(apart_m < EXACT, "{apart_m} m");
    }
}
