//! Synthetic people who walk in circles, created with the body model; for tests and the example.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Arc;

use farfield_fusion::body::skeleton::dof::{DofGroup, first_of};
use farfield_fusion::body::skeleton::{
    Kinematics, Pose, Proportions, Side, Skeleton, reported_angles,
};
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Transform;
use farfield_proto::id::{PersonId, SessionId};
use farfield_proto::message::{PersonPose, PersonState, PoseSet};
use farfield_proto::tick::Tick;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::frame::{Frame, FrameMaker, VenueFacts};

/// Ticks per second of the synthetic venue.
pub const RATE_HZ: f64 = 60.0;
/// Number of ticks after which the motion repeats.
pub const PERIOD: i64 = 240;

/// The synthetic venue. Person 2 has a name that every format must escape.
pub fn facts() -> VenueFacts {
    VenueFacts {
        venue: "synthetic".to_owned(),
        rate_hz: RATE_HZ,
        names: BTreeMap::from([(PersonId(2), "Ada <& \"Zoë\">".to_owned())]),
        cameras: CAMERAS
            .iter()
            .filter_map(|(name, at_m)| camera(name, *at_m))
            .collect(),
    }
}

/// Cameras of the synthetic venue: names and positions, metres.
pub const CAMERAS: [(&str, [f64; 3]); 2] = [("south", [1.0, -8.0, 2.5]), ("east", [9.0, 2.0, 3.0])];

/// A camera at that position, without rotation or distortion.
fn camera(name: &str, at_m: [f64; 3]) -> Option<CameraModel> {
    let intrinsics = Intrinsics {
        fx_px: 900.0,
        fy_px: 900.0,
        cx_px: 640.0,
        cy_px: 360.0,
    };
    let camera_from_world = Isometry3::new(-Vector3::from(at_m), Vector3::zeros());
    let place = Transform::new(camera_from_world);
    CameraModel::new(name, [1280, 720], intrinsics, Distortion::default(), place).ok()
}

/// Pose at a tick: a circle of 2 m in four seconds, with arms and legs swinging once per second.
fn pose_at(person: u32, tick: i64) -> Pose {
    let t = tick.rem_euclid(PERIOD) as f64 / RATE_HZ;
    let swing = libm::sin(TAU * t);
    let turn_rad = TAU * t / 4.0 + 0.3 * f64::from(person);
    let (sin, cos) = libm::sincos(turn_rad);
    let centre_m = Vector3::new(
        3.0 * f64::from(person % 4),
        3.0 * f64::from(person / 4),
        0.9,
    );
    let root_m = centre_m + Vector3::new(sin, -cos, 0.02 * swing);
    let turned = UnitQuaternion::from_scaled_axis(Vector3::z() * turn_rad);
    let mut pose = Pose::neutral(root_m, turned);
    for (side, sign) in [(Side::Right, 1.0), (Side::Left, -1.0)] {
        pose.dof[first_of(side, DofGroup::Hip)] = 0.4 * sign * swing;
        pose.dof[first_of(side, DofGroup::Hip) + 1] = 0.05 * swing;
        pose.dof[first_of(side, DofGroup::Knee)] = 0.5 + 0.4 * sign * swing;
        pose.dof[first_of(side, DofGroup::Shoulder)] += 0.5 * sign * swing;
        pose.dof[first_of(side, DofGroup::Elbow)] = 0.6 + 0.3 * swing;
        pose.dof[first_of(side, DofGroup::Ankle)] = 0.1 * swing;
    }
    pose.dof[1] = 0.1 * swing;
    pose.dof[5] = 0.3 * swing;
    pose
}

/// A person as published by fusion.
pub fn person_at(person: u32, tick: i64) -> PersonPose {
    let pose = pose_at(person, tick);
    let stature_m = 1.6 + 0.05 * f64::from(person % 8);
    let mut body = Kinematics::default();
    Skeleton::new(&Proportions::from_stature(stature_m)).forward(&pose, &mut body);
    let single = |at_m: &Vector3<f64>| [at_m.x as f32, at_m.y as f32, at_m.z as f32];
    PersonPose {
        person: PersonId(person),
        state: PersonState::Tracked,
        joints_m: body.joints_m.iter().map(single).collect(),
        keypoints_m: Vec::new(),
        sigma_m: vec![0.012; body.joints_m.len()],
        angles: reported_angles(&pose).iter().map(|v| *v as f32).collect(),
        unobserved: 1 << 12,
        views: 4,
    }
}

/// `n` people at a tick, with ids from 1.
pub fn poses_at(n: u32, tick: i64) -> PoseSet {
    PoseSet {
        session: SessionId(7),
        tick: Tick(tick),
        persons: (1..=n).map(|person| person_at(person, tick)).collect(),
    }
}

/// The frame of two people at a tick, in a session that began one second earlier.
pub fn frame(tick: i64) -> Arc<Frame> {
    let mut maker = FrameMaker::new(facts());
    maker.frame(&poses_at(2, tick - 60));
    Arc::new(maker.frame(&poses_at(2, tick)))
}
