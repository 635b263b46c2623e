//! Foxglove's own messages: bodies, frames, cameras.

use farfield_fusion::body::skeleton::Joint;
use farfield_proto::camera::CameraModel;
use farfield_proto::message::PersonState;
use foxglove::Encode;
use foxglove::messages::line_primitive::Type as LineType;
use foxglove::messages::scene_entity_deletion::Type as DeletionType;
use foxglove::messages::{
    CameraCalibration, Color, Duration, FrameTransform, FrameTransforms, KeyValuePair,
    LinePrimitive, Point3, Pose, Quaternion, SceneEntity, SceneEntityDeletion, SceneUpdate,
    SpherePrimitive, TextPrimitive, Timestamp, Vector3 as FoxgloveVector,
};
use nalgebra::{UnitQuaternion, Vector3};

use super::{Body, Stamp, WORLD, camera_frame, person_frame};

/// How thick limbs are drawn, metres.
const LIMB_M: f64 = 0.05;
/// Diameter of the head that is drawn, metres.
const HEAD_M: f64 = 0.2;
/// Height of the letters, and how far they float above the head, metres.
const TEXT_M: f64 = 0.15;
const ABOVE_M: f64 = 0.3;
/// How solid somebody is drawn whom nobody saw at this moment, or who is not confirmed yet.
const FAINT: f64 = 0.4;
/// Colours that colour-blind people can tell apart (Okabe and Ito), without the black; by id.
const COLOURS: [[u8; 3]; 7] = [
    [86, 180, 233],
    [230, 159, 0],
    [0, 158, 115],
    [240, 228, 66],
    [204, 121, 167],
    [213, 94, 0],
    [0, 114, 178],
];

/// `foxglove.SceneUpdate`: who is there, and that those of `gone` are not any more. Who is not said again goes after
/// `lifetime_s`, seconds.
pub fn people(stamp: Stamp, bodies: &[Body<'_>], gone: &[u32], lifetime_s: f64) -> Vec<u8> {
    bytes_of(&SceneUpdate {
        deletions: gone
            .iter()
            .map(|person| SceneEntityDeletion {
                timestamp: Some(timestamp(stamp)),
                r#type: DeletionType::MatchingId as i32,
                id: person_frame(*person),
            })
            .collect(),
        entities: bodies
            .iter()
            .map(|body| entity(stamp, body, lifetime_s))
            .collect(),
    })
}

/// `foxglove.FrameTransforms`: where everybody's pelvis is, and how it is turned.
pub fn person_frames(stamp: Stamp, bodies: &[Body<'_>]) -> Vec<u8> {
    let frame = |body: &Body<'_>| {
        let at_m = &body.joints_m[Joint::Pelvis.index()];
        transform(stamp, person_frame(body.id), at_m, body.pelvis)
    };
    bytes_of(&FrameTransforms {
        transforms: bodies.iter().map(frame).collect(),
    })
}

/// `foxglove.FrameTransforms`: where the cameras stand.
pub fn camera_frames<'a>(
    stamp: Stamp,
    cameras: impl IntoIterator<Item = &'a CameraModel>,
) -> Vec<u8> {
    let frame = |camera: &CameraModel| {
        let world_from_camera = camera.camera_from_world().isometry().inverse();
        let at_m = world_from_camera.translation.vector;
        let frame = camera_frame(camera.name());
        transform(stamp, frame, &at_m, &world_from_camera.rotation)
    };
    bytes_of(&FrameTransforms {
        transforms: cameras.into_iter().map(frame).collect(),
    })
}

/// `foxglove.CameraCalibration`.
pub fn camera_calibration(stamp: Stamp, camera: &CameraModel) -> Vec<u8> {
    let i = camera.intrinsics();
    // ROS calls p1 and p2 what OpenCV does; the order of all three models is OpenCV's, too.
    let coefficients = camera.lens().coefficients();
    let distortion_model = match coefficients.len() {
        _ if camera.lens().is_fisheye() => "kannala_brandt",
        5 => "plumb_bob",
        _ => "rational_polynomial",
    };
    let [width, height] = camera.size_px();
    bytes_of(&CameraCalibration {
        timestamp: Some(timestamp(stamp)),
        frame_id: camera_frame(camera.name()),
        width,
        height,
        distortion_model: distortion_model.to_owned(),
        d: coefficients,
        k: [
            [i.fx_px, 0.0, i.cx_px],
            [0.0, i.fy_px, i.cy_px],
            [0.0, 0.0, 1.0],
        ]
        .concat(),
        r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].concat(),
        p: [
            [i.fx_px, 0.0, i.cx_px, 0.0],
            [0.0, i.fy_px, i.cy_px, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ]
        .concat(),
    })
}

fn entity(stamp: Stamp, body: &Body<'_>, lifetime_s: f64) -> SceneEntity {
    let colour = colour(body);
    let joints_m = body.joints_m;
    let limbs = Joint::ALL.iter().filter_map(|joint| {
        let parent = joint.parent()?;
        // There are 29.
        Some([parent, *joint].map(|end| end.index() as u32))
    });
    let head_m = joints_m[Joint::Head.index()];
    let state = match body.state {
        PersonState::Tentative => "tentative",
        PersonState::Tracked => "tracked",
        PersonState::Coasting => "coasting",
    };
    SceneEntity {
        timestamp: Some(timestamp(stamp)),
        frame_id: WORLD.to_owned(),
        id: person_frame(body.id),
        lifetime: Some(Duration::saturating_from_secs_f64(lifetime_s)),
        frame_locked: false,
        metadata: [
            ("name", body.name.to_owned()),
            ("state", state.to_owned()),
            ("views", body.views.to_string()),
        ]
        .map(|(key, value)| KeyValuePair {
            key: key.to_owned(),
            value,
        })
        .to_vec(),
        lines: vec![LinePrimitive {
            r#type: LineType::LineList as i32,
            pose: Some(pose(&Vector3::zeros())),
            thickness: LIMB_M,
            scale_invariant: false,
            points: joints_m
                .iter()
                .map(|at_m| Point3 {
                    x: at_m.x,
                    y: at_m.y,
                    z: at_m.z,
                })
                .collect(),
            color: Some(colour),
            colors: Vec::new(),
            indices: limbs.flatten().collect(),
        }],
        spheres: vec![SpherePrimitive {
            pose: Some(pose(&head_m)),
            size: Some(vector(&Vector3::repeat(HEAD_M))),
            color: Some(colour),
        }],
        texts: vec![TextPrimitive {
            pose: Some(pose(&(head_m + Vector3::z() * ABOVE_M))),
            billboard: true,
            font_size: TEXT_M,
            scale_invariant: false,
            color: Some(colour),
            text: body.name.to_owned(),
        }],
        ..SceneEntity::default()
    }
}

fn colour(body: &Body<'_>) -> Color {
    let i = body.id as usize % COLOURS.len();
    let [r, g, b] = COLOURS[i].map(|v| f64::from(v) / 255.0);
    let a = match body.state {
        PersonState::Tracked => 1.0,
        PersonState::Tentative | PersonState::Coasting => FAINT,
    };
    Color { r, g, b, a }
}

fn transform(
    stamp: Stamp,
    child_frame_id: String,
    at_m: &Vector3<f64>,
    turned: &UnitQuaternion<f64>,
) -> FrameTransform {
    FrameTransform {
        timestamp: Some(timestamp(stamp)),
        parent_frame_id: WORLD.to_owned(),
        child_frame_id,
        translation: Some(vector(at_m)),
        rotation: Some(Quaternion {
            x: turned.i,
            y: turned.j,
            z: turned.k,
            w: turned.w,
        }),
    }
}

fn timestamp(stamp: Stamp) -> Timestamp {
    let secs = stamp.nanos / 1_000_000_000;
    let nanos = stamp.nanos % 1_000_000_000;
    // Until 2106.
    let secs = u32::try_from(secs).unwrap_or(u32::MAX);
    Timestamp::new(secs, nanos as u32)
}

fn vector(v: &Vector3<f64>) -> FoxgloveVector {
    FoxgloveVector {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

/// There, not turned.
fn pose(at_m: &Vector3<f64>) -> Pose {
    Pose {
        position: Some(vector(at_m)),
        orientation: Some(Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }),
    }
}

fn bytes_of<M: Encode>(message: &M) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or_default());
    if message.encode(&mut bytes).is_err() {
        // Encoding fails where there is no room; here there always is.
        bytes.clear();
    }
    bytes
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::LensModel;

    use super::*;
    use crate::fixture::camera;

    #[test]
    fn every_lens_has_the_name_that_foxglove_has_for_its_model() {
        let plain = camera();
        let fisheye = CameraModel::new(
            "corner",
            [960, 600],
            *plain.intrinsics(),
            LensModel::KannalaBrandt([0.01, 0.0, 0.0, 0.0]),
            *plain.camera_from_world(),
        )
        .unwrap();
        for (camera, name) in [(plain, "plumb_bob"), (fisheye, "kannala_brandt")] {
            let bytes = camera_calibration(Stamp { nanos: 0 }, &camera);
            let has = |text: &str| bytes.windows(text.len()).any(|it| it == text.as_bytes());
            assert!(has(name), "{name}");
        }
    }
}
