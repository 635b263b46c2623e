//! Tests: the tree of the model compared with our body model.

use std::collections::BTreeSet;

use farfield_fusion::body::skeleton::{
    ANGLE_NAMES, Kinematics, Link, Pose, Proportions, Skeleton, reported_angles,
};
use nalgebra::{Matrix3, Rotation3, Unit};
use proptest::prelude::*;

use super::*;
use crate::skeleton::tests::any_pose;

/// Positions of all markers at joints as in `OpenSim`: successive body-fixed rotations, in the
/// ground.
fn opensim_joints_m(pose: &Pose, offsets: &Offsets) -> Vec<Vector3<f64>> {
    let angles = reported_angles(pose);
    let value = |name: &str| angles[ANGLE_NAMES.iter().position(|known| *known == name).unwrap()];
    let axis = |text: &str| {
        let numbers: Vec<f64> = text.split(' ').map(|v| v.parse().unwrap()).collect();
        Vector3::new(numbers[0], numbers[1], numbers[2])
    };
    let to_opensim = |v: Vector3<f64>| Vector3::new(v.x, v.z, -v.y);
    let mut placed: Vec<(&str, Matrix3<f64>, Vector3<f64>)> = Vec::new();
    for segment in &SEGMENTS {
        let (mut rotation, mut at_m) = match segment.parent {
            None => (Matrix3::identity(), Vector3::zeros()),
            Some(parent) => {
                let (_, rotation, at_m) = placed.iter().find(|(name, ..)| *name == parent).unwrap();
                (
                    *rotation,
                    at_m + rotation * to_opensim(in_link_m(segment.origin, offsets)),
                )
            }
        };
        for moved in segment.translations {
            at_m += axis(moved.axis) * value(moved.name);
        }
        for turned in segment.rotations {
            let about = Unit::new_normalize(axis(turned.axis));
            rotation *= Rotation3::from_axis_angle(&about, value(turned.name)).into_inner();
        }
        placed.push((segment.name, rotation, at_m));
    }
    let place = |joint: &Joint| {
        let name = segment_of(joint.link()).unwrap().name;
        let (_, rotation, at_m) = placed.iter().find(|(known, ..)| *known == name).unwrap();
        at_m + rotation * to_opensim(in_link_m(*joint, offsets))
    };
    Joint::ALL.iter().map(place).collect()
}

proptest! {
    #[test]
    fn the_tree_moves_like_the_body_model(pose in any_pose(), stature_m in 1.0f64..2.2) {
        let proportions = Proportions::from_stature(stature_m);
        let mut body = Kinematics::default();
        Skeleton::new(&proportions).forward(&pose, &mut body);
        let theirs_m = opensim_joints_m(&pose, &Offsets::from_proportions(&proportions));
        for (ours_m, theirs_m) in body.joints_m.iter().zip(&theirs_m) {
            // The ground's (x, y, z) is the world's (y, z, x).
            let ours_m = Vector3::new(ours_m.y, ours_m.z, ours_m.x);
            prop_assert!((ours_m - theirs_m).norm() < 1e-6);
        }
    }
}

#[test]
fn every_angle_is_one_coordinate_and_every_link_one_body() {
    let coordinates = SEGMENTS
        .iter()
        .flat_map(|s| s.rotations.iter().chain(s.translations));
    let names: BTreeSet<&str> = coordinates.map(|c| c.name).collect();
    assert_eq!(names, ANGLE_NAMES.into_iter().collect());
    assert_eq!(
        SEGMENTS.each_ref().map(|segment| segment.link).len(),
        Link::ALL.len()
    );
    assert!(Link::ALL.iter().all(|link| segment_of(*link).is_some()));
    let mass: f64 = SEGMENTS.iter().map(|segment| segment.mass_share).sum();
    assert!((mass - 1.0).abs() < 1e-9);
}

#[test]
fn cylinders_have_the_known_inertia() {
    // 6 kg, radius 0.5 m, length 1 m: 6 * 0.25 / 2 about its axis, 6 (0.75 + 1) / 12 across.
    let [along, across] = cylinder_kg_m2(6.0, 0.5, 1.0);
    assert!((along - 0.75).abs() < 1e-12 && (across - 0.875).abs() < 1e-12);
    // A thin stick: zero about itself, m l^2 / 12 across.
    let [along, across] = cylinder_kg_m2(3.0, 0.0, 2.0);
    assert!(along.abs() < 1e-12 && (across - 1.0).abs() < 1e-12);
}
