//! Channels of a live stream: their ids, and the messages that advertise them.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use farfield_export::formats::foxglove::{
    CAMERA_FRAMES_TOPIC, Content, FRAMES_TOPIC, PEOPLE_TOPIC, angles_topic, calibration_topic,
};
use serde::Serialize;

use super::Venue;

/// A channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Channel {
    People,
    Frames,
    CameraFrames,
    /// Calibration of the camera with this index in the venue.
    Calibration(u32),
    /// Angles of the person with this id.
    Angles(u32),
}

/// First channel id of cameras.
const FIRST_CAMERA: u32 = 16;
/// First channel id of people; person ids wrap around beyond the range.
const FIRST_PERSON: u32 = 1 << 16;
/// Size of the range of people.
const PERSONS: u32 = 1 << 30;

impl Channel {
    /// The channel id on the wire.
    pub(super) fn id(self) -> u32 {
        match self {
            Self::People => 1,
            Self::Frames => 2,
            Self::CameraFrames => 3,
            Self::Calibration(camera) => FIRST_CAMERA + camera % (FIRST_PERSON - FIRST_CAMERA),
            Self::Angles(person) => FIRST_PERSON + person % PERSONS,
        }
    }

    /// The channel with this id.
    pub(super) fn from_id(id: u32) -> Option<Self> {
        match id {
            1 => Some(Self::People),
            2 => Some(Self::Frames),
            3 => Some(Self::CameraFrames),
            FIRST_CAMERA..FIRST_PERSON => Some(Self::Calibration(id - FIRST_CAMERA)),
            _ => {
                let person = id.checked_sub(FIRST_PERSON)?;
                (person < PERSONS).then_some(Self::Angles(person))
            }
        }
    }

    fn content(self) -> Content {
        match self {
            Self::People => Content::People,
            Self::Frames | Self::CameraFrames => Content::Frames,
            Self::Calibration(_) => Content::Calibration,
            Self::Angles(_) => Content::Angles,
        }
    }

    fn topic(self, venue: &Venue) -> Option<String> {
        Some(match self {
            Self::People => PEOPLE_TOPIC.to_owned(),
            Self::Frames => FRAMES_TOPIC.to_owned(),
            Self::CameraFrames => CAMERA_FRAMES_TOPIC.to_owned(),
            Self::Calibration(camera) => {
                calibration_topic(venue.cameras.get(camera as usize)?.name())
            }
            Self::Angles(person) => angles_topic(person),
        })
    }
}

/// Channels that do not depend on people: people, and cameras if known.
pub(super) fn lasting(venue: &Venue) -> Vec<Channel> {
    let mut channels = vec![Channel::People, Channel::Frames];
    if !venue.cameras.is_empty() {
        channels.push(Channel::CameraFrames);
    }
    let cameras = (0..FIRST_PERSON - FIRST_CAMERA).zip(&venue.cameras);
    channels.extend(cameras.map(|(camera, _)| Channel::Calibration(camera)));
    channels
}

#[derive(Serialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum ServerMessage<'a> {
    #[serde(rename_all = "camelCase")]
    ServerInfo {
        name: String,
        capabilities: [&'a str; 0],
        metadata: serde_json::Map<String, serde_json::Value>,
    },
    Advertise {
        channels: Vec<Advertised>,
    },
    #[serde(rename_all = "camelCase")]
    Unadvertise {
        channel_ids: Vec<u32>,
    },
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Advertised {
    id: u32,
    topic: String,
    encoding: &'static str,
    schema_name: String,
    schema: String,
    schema_encoding: String,
}

impl ServerMessage<'_> {
    fn text(&self) -> String {
        // Strings and numbers under string keys cannot fail.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// The first message to a client.
pub(super) fn server_info(venue: &Venue) -> String {
    let info = ServerMessage::ServerInfo {
        name: format!("Farfield: {}", venue.name),
        capabilities: [],
        metadata: serde_json::Map::new(),
    };
    info.text()
}

/// Advertises channels.
pub(super) fn advertise(venue: &Venue, channels: impl IntoIterator<Item = Channel>) -> String {
    let advertised = channels.into_iter().filter_map(|channel| {
        let content = channel.content();
        let schema = content.schema();
        Some(Advertised {
            id: channel.id(),
            topic: channel.topic(venue)?,
            encoding: content.encoding(),
            schema_name: schema.name,
            // Text is sent as it is, binary data as base64.
            schema: match content {
                Content::Angles => String::from_utf8_lossy(&schema.data).into_owned(),
                _ => STANDARD.encode(&schema.data),
            },
            schema_encoding: schema.encoding,
        })
    });
    let channels = advertised.collect();
    ServerMessage::Advertise { channels }.text()
}

/// Withdraws channels.
pub(super) fn unadvertise(channels: impl IntoIterator<Item = Channel>) -> String {
    let channel_ids = channels.into_iter().map(Channel::id).collect();
    ServerMessage::Unadvertise { channel_ids }.text()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channel_ids_round_trip() {
        for channel in [
            Channel::People,
            Channel::Frames,
            Channel::CameraFrames,
            Channel::Calibration(0),
            Channel::Calibration(99),
            Channel::Angles(0),
            Channel::Angles(1_000_000),
        ] {
            assert_eq!(Channel::from_id(channel.id()), Some(channel));
        }
        assert_eq!(
            [Channel::from_id(0), Channel::from_id(u32::MAX)],
            [None, None]
        );
    }
}
