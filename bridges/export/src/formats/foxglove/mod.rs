//! Foxglove and Lichtblick without a plug-in; the same messages for files and live streams.
//!
//! | topic | schema | content |
//! | --- | --- | --- |
//! | [`PEOPLE_TOPIC`] | `foxglove.SceneUpdate` | all people as lines between joints, a head, a name |
//! | [`FRAMES_TOPIC`] | `foxglove.FrameTransforms` | `world` to `person_<id>`: the pelvis of every person |
//! | [`CAMERA_FRAMES_TOPIC`] | `foxglove.FrameTransforms` | `world` to `camera_<name>` |
//! | [`calibration_topic`] | `foxglove.CameraCalibration` | lens and size of a camera |
//! | [`angles_topic`] | `farfield.Angles`, JSON | a person's angles, for plots |
//!
//! Foxglove's own messages are protobuf with its published schemas (crate `foxglove`); a body takes
//! about half the size of JSON. Angles are JSON, so that plots can select fields. Metres, z up,
//! right-handed; degrees in plots, quaternions in messages.
//!
//! Source: <https://docs.foxglove.dev/docs/sdk/schemas>, <https://mcap.dev/spec/registry>.

mod mcap;
mod messages;

use std::borrow::Cow;

use farfield_fusion::body::skeleton::N_JOINTS;
use farfield_proto::message::PersonState;
use foxglove::Encode;
use foxglove::messages::{CameraCalibration, FrameTransforms, SceneUpdate};
use nalgebra::{UnitQuaternion, Vector3};

pub use mcap::FoxgloveWriter;
pub use messages::{angles, camera_calibration, camera_frames, people, person_frames};

use crate::skeleton::Angles;

/// Topic of bodies.
pub const PEOPLE_TOPIC: &str = "/people";
/// Topic of the frames of persons.
pub const FRAMES_TOPIC: &str = "/tf";
/// Topic of the frames of cameras, which do not move.
pub const CAMERA_FRAMES_TOPIC: &str = "/tf_static";
/// The frame of the venue's world.
pub const WORLD: &str = "world";

/// Topic of a camera's calibration.
pub fn calibration_topic(camera: &str) -> String {
    format!("/{}/calibration", camera_frame(camera))
}

/// Topic of a person's angles.
pub fn angles_topic(person: u32) -> String {
    format!("/{}/angles", person_frame(person))
}

/// The frame of a person: the pelvis, x forward, y left, z up.
pub fn person_frame(person: u32) -> String {
    format!("person_{person}")
}

/// The frame of a camera: x right, y down, z forward.
pub fn camera_frame(camera: &str) -> String {
    format!("camera_{camera}")
}

/// A time since 1970, or since the beginning of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Nanoseconds.
    pub nanos: u64,
}

impl Stamp {
    /// The time `seconds` after zero; negative times become zero.
    pub fn from_seconds(seconds: f64) -> Self {
        // The cast saturates.
        Self {
            nanos: (seconds * 1e9).round() as u64,
        }
    }
}

/// A person at a moment.
#[derive(Debug, Clone, Copy)]
pub struct Body<'a> {
    /// The id.
    pub id: u32,
    /// The name.
    pub name: &'a str,
    /// Phase of the track.
    pub state: PersonState,
    /// Number of viewpoints with evidence.
    pub views: u32,
    /// The 29 joints in the world, metres.
    pub joints_m: &'a [Vector3<f64>; N_JOINTS],
    /// Rotation of the pelvis in the world.
    pub pelvis: &'a UnitQuaternion<f64>,
    /// The 40 reported angles, radians (metres for root translations).
    pub angles: &'a Angles,
    /// Bit i: angle i comes from a prior only.
    pub unobserved: u64,
}

/// Content of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// [`people`].
    People,
    /// [`person_frames`], [`camera_frames`].
    Frames,
    /// [`camera_calibration`].
    Calibration,
    /// [`angles()`].
    Angles,
}

/// A schema for readers.
#[derive(Debug, Clone)]
pub struct Schema {
    /// Its name.
    pub name: String,
    /// `protobuf` or `jsonschema`.
    pub encoding: String,
    /// A set of file descriptors, or text.
    pub data: Cow<'static, [u8]>,
}

impl Content {
    /// Encoding of the messages.
    pub const fn encoding(self) -> &'static str {
        match self {
            Self::Angles => "json",
            _ => "protobuf",
        }
    }

    /// Schema of the messages.
    pub fn schema(self) -> Schema {
        match self {
            Self::People => published::<SceneUpdate>(),
            Self::Frames => published::<FrameTransforms>(),
            Self::Calibration => published::<CameraCalibration>(),
            Self::Angles => Schema {
                name: messages::SCHEMA_NAME.to_owned(),
                encoding: "jsonschema".to_owned(),
                data: messages::schema().into_bytes().into(),
            },
        }
    }
}

fn published<M: Encode>() -> Schema {
    // All of Foxglove's own messages have a schema.
    let schema = M::get_schema().unwrap_or_else(|| foxglove::Schema::new("", "", &[]));
    Schema {
        name: schema.name,
        encoding: schema.encoding,
        data: schema.data,
    }
}
