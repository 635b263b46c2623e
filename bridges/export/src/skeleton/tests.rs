//! Tests: the export skeleton compared with the body model, for any person in any pose.

use farfield_fusion::body::skeleton::dof::{DofGroup, first_of};
use farfield_fusion::body::skeleton::{
    Joint, Kinematics, N_JOINT_DOF, Pose, Proportions, Side, Skeleton, reported_angles,
    shoulder_coordinates,
};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;

/// An arbitrary pose: any rotation, limbs within human limits.
pub(crate) fn any_pose() -> impl Strategy<Value = Pose> {
    (
        prop::array::uniform3(-60.0f64..60.0),
        prop::array::uniform3(-3.0f64..3.0),
        prop::collection::vec(-1.2f64..1.2, N_JOINT_DOF),
    )
        .prop_map(|(root, turn, dof)| {
            let mut pose = Pose::neutral(
                Vector3::from(root),
                UnitQuaternion::from_scaled_axis(Vector3::from(turn)),
            );
            pose.dof.copy_from_slice(&dof);
            pose
        })
}

fn any_rest() -> impl Strategy<Value = RestPose> {
    prop_oneof![Just(RestPose::TPose), Just(RestPose::APose)]
}

fn body_of(stature_m: f64, pose: &Pose) -> Kinematics {
    let mut body = Kinematics::default();
    Skeleton::new(&Proportions::from_stature(stature_m)).forward(pose, &mut body);
    body
}

/// Rounding of about twenty products of numbers below 100.
const EXACT_M: f64 = 1e-9;

proptest! {
    #[test]
    fn bones_begin_at_our_joints(pose in any_pose(), rest in any_rest(), stature_m in 1.0f64..2.2) {
        let body = body_of(stature_m, &pose);
        let offsets = Offsets::from_proportions(&Proportions::from_stature(stature_m));
        let rig = Rig::new(&offsets, rest);
        let motion = Motion::of_links(&body, rest);
        let heads_m = motion.heads_m(&rig);
        let world = motion.world_from_bones();
        for bone in Bone::ALL {
            let joint_m = body.joint_m(bone.joint());
            let head_m = heads_m[bone.index()];
            let reached_m = match bone {
                // The end of the toes is the joint.
                Bone::LeftToes | Bone::RightToes => head_m + world[bone.index()] * rig.tip_m[bone.index()].unwrap(),
                _ => head_m,
            };
            prop_assert!((reached_m - joint_m).norm() < EXACT_M, "{bone:?}");
        }
        for (bone, joint) in [(Bone::LeftHand, Joint::LeftHand), (Bone::RightHand, Joint::RightHand)] {
            let tip_m = heads_m[bone.index()] + world[bone.index()] * rig.tip_m[bone.index()].unwrap();
            prop_assert!((tip_m - body.joint_m(joint)).norm() < EXACT_M);
        }
        for (ours, joint) in motion.joints_m(rest, &offsets).iter().zip(&body.joints_m) {
            prop_assert!((ours - joint).norm() < EXACT_M);
        }
    }

    #[test]
    fn reported_angles_round_trip(pose in any_pose()) {
        let angles = reported_angles(&pose);
        let back = pose_of(&angles);
        let (body, again) = (body_of(1.7, &pose), body_of(1.7, &back));
        for (a, b) in body.joints_m.iter().zip(&again.joints_m) {
            prop_assert!((a - b).norm() < 1e-6);
        }
    }

    #[test]
    fn motions_reproduce_their_angles(pose in any_pose(), rest in any_rest()) {
        let body = body_of(1.7, &pose);
        let angles = reported_angles(&pose);
        let back = Motion::of_links(&body, rest).angles(rest, &angles);
        let again = body_of(1.7, &pose_of(&back));
        for (a, b) in body.rotations.iter().zip(&again.rotations) {
            prop_assert!((a - b).norm() < 1e-6);
        }
    }

    #[test]
    fn zxy_angles_round_trip(angles in prop::array::uniform3(-3.1f64..3.1)) {
        let rotation = zxy_rotation(angles);
        prop_assert!((zxy_rotation(zxy(&rotation)) - rotation).norm() < 1e-9);
    }
}

#[test]
fn rotations_at_the_pole_round_trip() {
    for b in [std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2] {
        let rotation = zxy_rotation([0.4, b, 0.9]);
        assert!((zxy_rotation(zxy(&rotation)) - rotation).norm() < 1e-9);
    }
}

/// A person in a T-pose with level arms.
pub(crate) fn t_pose() -> Pose {
    let mut pose = Pose::neutral(Vector3::new(0.0, 0.0, 0.9), UnitQuaternion::identity());
    for side in Side::BOTH {
        let first = first_of(side, DofGroup::Shoulder);
        let about_x = Rotation3::from_axis_angle(
            &Vector3::x_axis(),
            -side.mirror() * std::f64::consts::FRAC_PI_2,
        );
        let level = shoulder_coordinates(side, &about_x.into_inner());
        pose.dof[first..first + 3].copy_from_slice(&level);
    }
    pose
}

#[test]
fn a_t_pose_has_no_bone_rotations() {
    let motion = Motion::of_links(&body_of(1.75, &t_pose()), RestPose::TPose);
    for rotation in motion.rotations {
        assert!(rotation.angle() < 1e-9);
    }
}

#[test]
fn a_t_pose_has_level_arms_that_bend_forward() {
    let rig = Rig::new(
        &Offsets::from_proportions(&Proportions::from_stature(1.75)),
        RestPose::TPose,
    );
    let heads_m = rig.rest_heads_m();
    let head_of = |bone: Bone| heads_m[bone.index()];
    assert!((head_of(Bone::LeftHand).z - head_of(Bone::LeftUpperArm).z).abs() < 1e-12);
    assert!(head_of(Bone::LeftHand).y > 0.5 && head_of(Bone::RightHand).y < -0.5);
    assert!(head_of(Bone::LeftFoot).z < -0.8);
    let mut bent = t_pose();
    bent.dof[first_of(Side::Left, DofGroup::Elbow)] = 1.0;
    let body = body_of(1.75, &bent);
    assert!(body.joint_m(Joint::LeftWrist).x > body.joint_m(Joint::LeftElbow).x + 0.1);
}
