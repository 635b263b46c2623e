//! Tests of occlusion and size of bodies.

use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector3;

use super::standing::standing;
use super::{Build, Volume};
use crate::scene::SITE_JOINTS;

const STATURE_M: f64 = 1.75;
/// COCO indices of keypoints.
const NOSE: usize = 0;
const LEFT_SHOULDER: usize = 5;
const LEFT_WRIST: usize = 9;

const FRONT: Vector3<f64> = Vector3::new(6.0, 0.0, 1.5);
const BACK: Vector3<f64> = Vector3::new(-6.0, 0.0, 1.5);
const LEFT: Vector3<f64> = Vector3::new(0.0, 6.0, 1.5);
const RIGHT: Vector3<f64> = Vector3::new(0.0, -6.0, 1.5);

fn person(seed: u64) -> (Volume, [Vector3<f64>; 17]) {
    let joints = standing(STATURE_M, [0.0, 0.0]);
    let volume = Volume::new(&joints, &Build::from_seed(STATURE_M, seed));
    (volume, SITE_JOINTS.map(|j| joints[j as usize]))
}

#[test]
fn a_person_does_not_hide_its_side_towards_the_camera() {
    for seed in 0..20 {
        let (body, keypoints) = person(seed);
        for (k, p) in keypoints.iter().enumerate() {
            assert!(
                !body.covers(&FRONT, p, Some(k)),
                "keypoint {k}, build {seed}"
            );
        }
    }
}

#[test]
fn the_head_hides_the_face_from_behind() {
    for seed in 0..20 {
        let (body, keypoints) = person(seed);
        for k in [0, 1, 2] {
            assert!(body.covers(&BACK, &keypoints[k], Some(k)));
        }
        assert!(!body.covers(&LEFT, &keypoints[NOSE], Some(NOSE)));
        assert!(!body.covers(&LEFT, &keypoints[3], Some(3)));
        assert!(body.covers(&RIGHT, &keypoints[3], Some(3)));
    }
}

#[test]
fn the_trunk_hides_the_far_arm_and_not_the_near_one() {
    let (body, keypoints) = person(3);
    for k in [LEFT_SHOULDER, 7, LEFT_WRIST] {
        assert!(body.covers(&RIGHT, &keypoints[k], Some(k)), "keypoint {k}");
        assert!(!body.covers(&LEFT, &keypoints[k], Some(k)), "keypoint {k}");
    }
}

#[test]
fn a_person_in_front_hides_a_person_behind() {
    let (front, _) = person(5);
    let behind = standing(STATURE_M, [-1.0, 0.0]);
    let chest = behind[Joint::Spine as usize];
    assert!(front.covers(&FRONT, &chest, None));
    assert!(!front.covers(&BACK, &chest, None));
    let aside = standing(STATURE_M, [-1.0, 1.2]);
    assert!(!front.covers(&FRONT, &aside[Joint::Spine as usize], None));
}

#[test]
fn a_body_reaches_from_the_floor_to_its_stature() {
    for seed in 0..20 {
        let (body, _) = person(seed);
        let from_above = Vector3::new(0.0, 0.0, 10.0);
        let top = body
            .cones
            .iter()
            .filter_map(|c| c.entry(&from_above, &-Vector3::z()))
            .fold(f64::MAX, f64::min);
        let height = 10.0 - top;
        assert!((height - STATURE_M).abs() < 0.05, "{height}");
        let lowest = body
            .cones
            .iter()
            .flat_map(|c| [c.origin_m.z - c.reach_m[0], c.tip_m.z - c.reach_m[1]])
            .fold(f64::MAX, f64::min);
        assert!(lowest > -0.04, "{lowest}");
    }
}

#[test]
fn degenerate_joints_still_make_a_finite_body() {
    let nothing = [Vector3::new(1.0, 2.0, 3.0); 29];
    let body = Volume::new(&nothing, &Build::from_seed(STATURE_M, 1));
    let sound = |c: &super::Cone| {
        c.to_local.iter().all(|v| v.is_finite()) && c.tip_m.iter().all(|v| v.is_finite())
    };
    assert!(body.cones.iter().all(sound));
    assert!(body.bound_m.1.is_finite());
}
