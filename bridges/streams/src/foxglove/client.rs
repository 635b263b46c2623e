//! State of one client: its subscriptions and advertised channels. Pure.

use std::collections::{BTreeMap, BTreeSet};

use farfield_export::formats::foxglove::{Stamp, camera_calibration, camera_frames};
use serde::Deserialize;
use tokio_tungstenite::tungstenite::Message;

use super::Venue;
use super::channels::{Channel, advertise, lasting, server_info, unadvertise};
use super::encoded::Encoded;
use crate::frame::{Frame, Roster};

/// Maximum number of subscriptions per client.
const MAX_SUBSCRIPTIONS: usize = 4096;
/// First byte of a message on a channel.
const MESSAGE_DATA: u8 = 1;

/// Supported requests of clients; all others are ignored.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
pub enum Request {
    /// Subscribe to channels.
    Subscribe {
        /// The subscriptions.
        subscriptions: Vec<Subscription>,
    },
    /// Remove subscriptions.
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        /// Ids of the subscriptions.
        subscription_ids: Vec<u32>,
    },
}

/// A subscription of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Subscription {
    /// The client's id of the subscription.
    pub id: u32,
    /// Id of the channel.
    pub channel_id: u32,
}

impl Request {
    /// Parses a request; `None` if it is not supported.
    pub fn parse(text: &str) -> Option<Self> {
        serde_json::from_str(text).ok()
    }
}

/// A client.
#[derive(Debug, Default)]
pub(super) struct Client {
    /// Channels by the client's subscription ids.
    subscriptions: BTreeMap<u32, Channel>,
    /// Version of the roster whose people were advertised, and their ids.
    advertised: (Option<u64>, BTreeSet<u32>),
}

impl Client {
    pub(super) fn has_subscribed(&self) -> bool {
        !self.subscriptions.is_empty()
    }

    /// Messages for a new client: server information and channels.
    pub(super) fn welcome(&mut self, venue: &Venue, newest: Option<&Frame>) -> Vec<Message> {
        let channels = advertise(venue, lasting(venue));
        let mut messages = vec![Message::text(server_info(venue)), Message::text(channels)];
        if let Some(frame) = newest {
            messages.extend(self.advertise_people(venue, &frame.roster));
        }
        messages
    }

    /// Handles a request; returns the messages of constant channels that were just subscribed.
    pub(super) fn answer(&mut self, text: &str, venue: &Venue, now: Stamp) -> Vec<Message> {
        match Request::parse(text) {
            Some(Request::Subscribe { subscriptions }) => subscriptions
                .into_iter()
                .filter_map(|requested| {
                    let channel = Channel::from_id(requested.channel_id)?;
                    // One subscription per channel, so that a client cannot request the same data a
                    // thousand times.
                    let is_new = !self.subscriptions.contains_key(&requested.id)
                        && !self.subscriptions.values().any(|it| *it == channel);
                    if !is_new || self.subscriptions.len() >= MAX_SUBSCRIPTIONS {
                        return None;
                    }
                    self.subscriptions.insert(requested.id, channel);
                    let message = match channel {
                        Channel::CameraFrames => camera_frames(now, &venue.cameras),
                        Channel::Calibration(camera) => {
                            camera_calibration(now, venue.cameras.get(camera as usize)?)
                        }
                        _ => return None,
                    };
                    Some(data(requested.id, now, &message))
                })
                .collect(),
            Some(Request::Unsubscribe { subscription_ids }) => {
                for id in subscription_ids {
                    self.subscriptions.remove(&id);
                }
                Vec::new()
            }
            None => Vec::new(),
        }
    }

    /// The messages for a frame, and whether they contain data of people.
    pub(super) fn frame(&mut self, venue: &Venue, encoded: &Encoded) -> (Vec<Message>, bool) {
        let mut messages = self.advertise_people(venue, &encoded.frame.roster);
        let before = messages.len();
        for (id, channel) in &self.subscriptions {
            let message = match channel {
                Channel::People => Some(encoded.people()),
                Channel::Frames => Some(encoded.frames()),
                Channel::Angles(person) => encoded.angles(*person),
                Channel::CameraFrames | Channel::Calibration(_) => None,
            };
            messages.extend(message.map(|message| data(*id, encoded.stamp, message)));
        }
        let is_data = messages.len() > before;
        (messages, is_data)
    }

    /// Advertises changes of the people's channels since the last call.
    fn advertise_people(&mut self, venue: &Venue, roster: &Roster) -> Vec<Message> {
        let (version, advertised) = &mut self.advertised;
        if version.replace(roster.version) == Some(roster.version) {
            return Vec::new();
        }
        let there: BTreeSet<u32> = roster.people.iter().map(|entry| entry.id.0).collect();
        let before = std::mem::replace(advertised, there);
        let come = advertised
            .difference(&before)
            .map(|id| Channel::Angles(*id));
        let gone = before.difference(advertised).map(|id| Channel::Angles(*id));
        let (come, gone): (Vec<Channel>, Vec<Channel>) = (come.collect(), gone.collect());
        let mut messages = Vec::new();
        if !gone.is_empty() {
            self.subscriptions
                .retain(|_, channel| !gone.contains(channel));
            messages.push(Message::text(unadvertise(gone)));
        }
        if !come.is_empty() {
            messages.push(Message::text(advertise(venue, come)));
        }
        messages
    }
}

/// A data message: type, subscription id, Unix time in nanoseconds, content.
fn data(subscription: u32, stamp: Stamp, message: &[u8]) -> Message {
    let mut bytes = Vec::with_capacity(13 + message.len());
    bytes.push(MESSAGE_DATA);
    bytes.extend_from_slice(&subscription.to_le_bytes());
    bytes.extend_from_slice(&stamp.nanos.to_le_bytes());
    bytes.extend_from_slice(message);
    Message::binary(bytes)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::encoded::Encoder;
    use super::*;
    use crate::frame::FrameMaker;
    use crate::synthetic;

    fn venue() -> Venue {
        Venue {
            name: "hall".to_owned(),
            cameras: synthetic::facts().cameras,
        }
    }

    fn texts(messages: &[Message]) -> Vec<serde_json::Value> {
        let texts = messages.iter().filter_map(|message| message.to_text().ok());
        texts
            .filter_map(|text| serde_json::from_str(text).ok())
            .collect()
    }

    #[test]
    fn clients_receive_subscribed_data_and_new_channels() {
        let (venue, encoder, mut client) = (venue(), Encoder::default(), Client::default());
        let mut maker = FrameMaker::new(synthetic::facts());
        let welcome = texts(&client.welcome(&venue, None));
        assert_eq!(welcome[0]["op"], "serverInfo");
        let channels = welcome[1]["channels"].as_array().unwrap();
        let topics: Vec<&str> = channels
            .iter()
            .filter_map(|channel| channel["topic"].as_str())
            .collect();
        assert_eq!(topics[0], "/people");
        assert_eq!(topics.len(), 3 + synthetic::CAMERAS.len(), "{topics:?}");
        // Constant messages are sent immediately on subscription.
        let request = r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":3}]}"#;
        let cameras = client.answer(request, &venue, encoder.now());
        let [cameras] = &cameras[..] else {
            panic!("{cameras:?}")
        };
        let cameras = cameras.clone().into_data();
        for (name, _) in synthetic::CAMERAS {
            let is_there = cameras
                .windows(name.len())
                .any(|part| part == name.as_bytes());
            assert!(is_there, "{name}");
        }
        client.answer(
            r#"{"op":"unsubscribe","subscriptionIds":[1]}"#,
            &venue,
            encoder.now(),
        );
        let request = r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":1},{"id":8,"channelId":65537}]}"#;
        assert!(client.answer(request, &venue, encoder.now()).is_empty());
        let frame = Arc::new(maker.frame(&synthetic::poses_at(1, 0)));
        let (messages, is_data) = client.frame(&venue, &encoder.encode(&frame));
        assert!(is_data);
        assert_eq!(
            texts(&messages)[0]["channels"][0]["topic"],
            "/person_1/angles"
        );
        let numbers: Vec<u8> = messages[1..]
            .iter()
            .map(|message| message.clone().into_data()[1])
            .collect();
        assert_eq!(numbers, [7, 8]);
        // No new people, so nothing is advertised.
        let frame = Arc::new(maker.frame(&synthetic::poses_at(1, 1)));
        let (messages, _) = client.frame(&venue, &encoder.encode(&frame));
        assert!(texts(&messages).is_empty());
        client.answer(
            r#"{"op":"unsubscribe","subscriptionIds":[7,8]}"#,
            &venue,
            encoder.now(),
        );
        let frame = Arc::new(maker.frame(&synthetic::poses_at(1, 2)));
        assert!(!client.frame(&venue, &encoder.encode(&frame)).1);
    }

    #[test]
    fn unsupported_requests_are_ignored() {
        for text in [
            "",
            "{}",
            r#"{"op":"advertise","channels":[]}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}"#,
        ] {
            assert_eq!(Request::parse(text), None, "{text}");
        }
    }

    /// Number of subscriptions kept of 10,000, where `channel_of` gives the channel of each.
    fn subscriptions_of_many(channel_of: impl Fn(u32) -> u32) -> usize {
        let (venue, encoder, mut client) = (venue(), Encoder::default(), Client::default());
        for first in (0..10_000).step_by(100) {
            let requested: Vec<_> = (first..first + 100)
                .map(|id| serde_json::json!({"id": id, "channelId": channel_of(id)}))
                .collect();
            let text =
                serde_json::json!({"op": "subscribe", "subscriptions": requested}).to_string();
            client.answer(&text, &venue, encoder.now());
        }
        client.subscriptions.len()
    }

    #[test]
    fn subscriptions_are_limited_and_unique_per_channel() {
        assert_eq!(subscriptions_of_many(|_| 1), 1);
        assert_eq!(subscriptions_of_many(|id| 65_537 + id), MAX_SUBSCRIPTIONS);
    }
}
