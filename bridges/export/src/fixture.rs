//! A moving person for tests: created with the body model, written as by a run.

use farfield_fusion::body::skeleton::dof::{DofGroup, first_of};
use farfield_fusion::body::skeleton::{
    ANGLE_NAMES, Joint, Kinematics, Pose, Proportions, Side, Skeleton, reported_angles,
};
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Transform;
use farfield_proto::message::PersonState;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::run::{PoseLine, Sample};
use crate::skeleton::RestPose;

/// Ticks per second of the synthetic run.
pub(crate) const RUN_HZ: f64 = 60.0;
/// Its keypoints.
pub(crate) const KEYPOINTS: [&str; 3] = ["nose", "left_knee", "right_wrist"];

/// Stature of a person, metres.
pub(crate) fn stature_m(person: u32) -> f64 {
    1.6 + 0.05 * f64::from(person % 8)
}

/// A person who walks, turns and swings arms and legs once per second.
pub(crate) fn pose_at(person: u32, t: f64) -> Pose {
    let swing = libm::sin(std::f64::consts::TAU * t);
    let root_m = Vector3::new(t, f64::from(person), 0.9 + 0.02 * swing);
    let mut pose = Pose::neutral(
        root_m,
        UnitQuaternion::from_scaled_axis(Vector3::z() * (0.5 * t)),
    );
    for (side, sign) in [(Side::Right, 1.0), (Side::Left, -1.0)] {
        pose.dof[first_of(side, DofGroup::Hip)] = 0.4 * sign * swing;
        pose.dof[first_of(side, DofGroup::Knee)] = 0.5 + 0.4 * sign * swing;
        pose.dof[first_of(side, DofGroup::Shoulder)] += 0.5 * sign * swing;
        pose.dof[first_of(side, DofGroup::Elbow)] = 0.6 + 0.3 * swing;
        pose.dof[first_of(side, DofGroup::Ankle)] = 0.1 * swing;
    }
    pose
}

/// The same as a line of `poses.jsonl`.
pub(crate) fn line_at(person: u32, tick: i64) -> PoseLine {
    line(person, tick, tick as f64 / RUN_HZ)
}

fn line(person: u32, tick: i64, t: f64) -> PoseLine {
    let pose = pose_at(person, t);
    let mut body = Kinematics::default();
    Skeleton::new(&Proportions::from_stature(stature_m(person))).forward(&pose, &mut body);
    let keypoint = |name: &str| {
        let joint = Joint::from_name(name).unwrap();
        (
            name.to_owned(),
            body.joint_m(joint) + body.rotation(joint.link()) * Vector3::new(0.01, 0.0, 0.0),
        )
    };
    PoseLine {
        tick,
        person,
        state: PersonState::Tracked,
        joints_m: body.joints_m,
        keypoints_m: KEYPOINTS.iter().map(|name| keypoint(name)).collect(),
        sigma_m: Some([0.012; 29]),
        angles: reported_angles(&pose),
        unobserved: 0,
        views: 4,
    }
}

/// The same as a sample.
pub(crate) fn sample_at(t: f64) -> Sample {
    let keypoints = KEYPOINTS.map(str::to_owned);
    Sample::from_line(&line(1, 0, t), RestPose::TPose, &keypoints)
}

/// `line` as written by a run, including the line end.
pub(crate) fn json(line: &PoseLine) -> String {
    let round = |v: f64, decimals: i32| (v * 10f64.powi(decimals)).round() / 10f64.powi(decimals);
    let point = |p: &Vector3<f64>| serde_json::json!([round(p.x, 5), round(p.y, 5), round(p.z, 5)]);
    let joints: serde_json::Map<_, _> = Joint::ALL
        .iter()
        .map(|j| (j.name().to_owned(), point(&line.joints_m[j.index()])))
        .collect();
    let keypoints: serde_json::Map<_, _> = line
        .keypoints_m
        .iter()
        .map(|(n, p)| (n.clone(), point(p)))
        .collect();
    let angles: serde_json::Map<_, _> = ANGLE_NAMES
        .iter()
        .zip(line.angles)
        .map(|(n, a)| ((*n).to_owned(), round(a, 6).into()))
        .collect();
    let sigmas: serde_json::Map<_, _> = Joint::ALL
        .iter()
        .map(|j| (j.name().to_owned(), 0.012.into()))
        .collect();
    let value = serde_json::json!({
        "tick": line.tick, "person": line.person, "state": "tracked", "joints": joints, "keypoints": keypoints,
        "sigma_m": sigmas, "angles": angles, "unobserved": [], "views": line.views,
    });
    format!("{value}\n")
}

/// `poses.jsonl` of these people; person 2 is absent between ticks 20 and 30.
pub(crate) fn poses_jsonl(people: &[u32], n_ticks: i64) -> String {
    let mut text = String::new();
    for tick in 0..n_ticks {
        for &person in people {
            if person != 2 || !(20..30).contains(&tick) {
                text += &json(&line_at(person, tick));
            }
        }
    }
    text
}

/// `summary.json` of the run.
pub(crate) fn summary_json(n_ticks: i64) -> String {
    format!(
        r#"{{"venue":"made-up","rate_hz":{RUN_HZ},"ticks":{{"first":0,"end":{n_ticks},"done":{n_ticks}}}}}"#
    )
}

/// A camera in the field's corner that looks along the world's y.
pub(crate) fn camera() -> CameraModel {
    let intrinsics = Intrinsics {
        fx_px: 900.0,
        fy_px: 910.0,
        cx_px: 480.0,
        cy_px: 300.0,
    };
    let distortion = Distortion {
        k1: -0.1,
        ..Distortion::default()
    };
    // Rows: right, down, forward.
    let turned =
        Rotation3::from_matrix(&Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0));
    let world_from_camera = Isometry3::from_parts(
        Translation3::new(2.0, -8.0, 3.0),
        UnitQuaternion::from_rotation_matrix(&turned.inverse()),
    );
    let camera_from_world = Transform::new(world_from_camera.inverse());
    CameraModel::new(
        "corner",
        [960, 600],
        intrinsics,
        distortion,
        camera_from_world,
    )
    .unwrap()
}
