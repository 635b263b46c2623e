//! Messages: bodies, frames and cameras in Foxglove's schemas; angles as JSON, so that a plot can
//! select a field: `/person_1/angles.angles_deg.knee_angle_l`.

use std::fmt::Write as _;

use farfield_fusion::body::skeleton::ANGLE_NAMES;
use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::angles::is_translation;
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
use serde::ser::SerializeMap as _;
use serde::{Serialize, Serializer};

use super::{Body, Stamp, WORLD, camera_frame, person_frame};

/// Width of drawn limbs, metres.
const LIMB_M: f64 = 0.05;
/// Diameter of the drawn head, metres.
const HEAD_M: f64 = 0.2;
/// Height of the text, and its distance above the head, metres.
const TEXT_M: f64 = 0.15;
const ABOVE_M: f64 = 0.3;
/// Opacity of people who are unseen at this moment or not confirmed yet.
const FAINT: f64 = 0.4;
/// Colours that colour-blind people can distinguish (Okabe and Ito), without black; by id.
const COLOURS: [[u8; 3]; 7] = [
    [86, 180, 233],
    [230, 159, 0],
    [0, 158, 115],
    [240, 228, 66],
    [204, 121, 167],
    [213, 94, 0],
    [0, 114, 178],
];

/// `foxglove.SceneUpdate`: the present people, and deletions for those in `gone`. People that are
/// not updated disappear after `lifetime_s`, seconds.
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

/// `foxglove.FrameTransforms`: position and rotation of every pelvis.
pub fn person_frames(stamp: Stamp, bodies: &[Body<'_>]) -> Vec<u8> {
    let frame = |body: &Body<'_>| {
        let at_m = &body.joints_m[Joint::Pelvis.index()];
        transform(stamp, person_frame(body.id), at_m, body.pelvis)
    };
    bytes_of(&FrameTransforms {
        transforms: bodies.iter().map(frame).collect(),
    })
}

/// `foxglove.FrameTransforms`: positions and rotations of the cameras.
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
    // In ROS, p1 and p2 mean the same as in OpenCV; all three models use OpenCV's order too.
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
    // Valid until 2106.
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

/// At that position, without rotation.
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
        // Encoding only fails without room, and there always is.
        bytes.clear();
    }
    bytes
}

pub(super) const SCHEMA_NAME: &str = "farfield.Angles";

/// Schema of the messages of [`angles`]. Foxglove supports only plain types: no unions, no
/// references.
pub(super) fn schema() -> String {
    let mut degrees = String::new();
    for (i, name) in ANGLE_NAMES.iter().enumerate() {
        if !is_translation(i) {
            let comma = if degrees.is_empty() { "" } else { "," };
            // Writing to a string cannot fail.
            write!(degrees, r#"{comma}"{name}":{{"type":"number"}}"#).ok();
        }
    }
    format!(
        r#"{{"title":"{SCHEMA_NAME}","type":"object","properties":{{
"tick":{{"type":"integer","description":"Tick of the venue's clock"}},
"name":{{"type":"string","description":"What the person is called"}},
"state":{{"type":"string","description":"tentative, tracked or coasting"}},
"views":{{"type":"integer","description":"Viewpoints that gave evidence"}},
"pelvis_m":{{"type":"object","description":"Pelvis in the world, metres, z up","properties":{{"x":{{"type":"number"}},"y":{{"type":"number"}},"z":{{"type":"number"}}}}}},
"angles_deg":{{"type":"object","description":"Degrees in OpenSim's sense; what only a prior tells is left out","properties":{{{degrees}}}}}
}}}}"#
    )
}

#[derive(Serialize)]
struct Message<'a> {
    tick: i64,
    name: &'a str,
    state: farfield_proto::message::PersonState,
    views: u32,
    pelvis_m: Place,
    angles_deg: Degrees<'a>,
}

#[derive(Serialize)]
struct Place {
    x: Rounded<100_000>,
    y: Rounded<100_000>,
    z: Rounded<100_000>,
}

/// A number rounded to 1/`PARTS`.
struct Rounded<const PARTS: u32>(f64);

impl<const PARTS: u32> Serialize for Rounded<PARTS> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let parts = f64::from(PARTS);
        to.serialize_f64((self.0 * parts).round() / parts)
    }
}

struct Degrees<'a>(&'a Body<'a>);

impl Serialize for Degrees<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let Self(body) = self;
        let mut map = to.serialize_map(None)?;
        for (i, (name, angle)) in ANGLE_NAMES.iter().zip(body.angles).enumerate() {
            if !is_translation(i) && body.unobserved >> i & 1 == 0 {
                map.serialize_entry(name, &Rounded::<10_000>(angle.to_degrees()))?;
            }
        }
        map.end()
    }
}

/// A person's angles at a tick.
pub fn angles(tick: i64, body: &Body<'_>) -> Vec<u8> {
    let at_m = body.joints_m[Joint::Pelvis.index()];
    let message = Message {
        tick,
        name: body.name,
        state: body.state,
        views: body.views,
        pelvis_m: Place {
            x: Rounded(at_m.x),
            y: Rounded(at_m.y),
            z: Rounded(at_m.z),
        },
        angles_deg: Degrees(body),
    };
    // Numbers and strings under string keys cannot fail.
    serde_json::to_vec(&message).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::LensModel;

    use super::*;
    use crate::fixture::camera;

    #[test]
    fn lens_models_have_foxglove_names() {
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
