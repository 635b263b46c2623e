//! JSON over WebSocket: one text message per tick, the newest first, complete in itself.
//!
//! ```json
//! {"format": "farfield-poses", "version": 1, "venue": "hall", "session": "7", "tick": 120, "rate_hz": 60, "time_s": 2.0,
//!  "persons": [{"id": 1, "name": "person_1", "state": "tracked", "views": 4,
//!    "joints_m": {"pelvis": [0.1, 2.0, 0.93], ...}, "sigma_m": {"pelvis": 0.012, ...},
//!    "angles": {"pelvis_tilt": 0.02, ...}, "unobserved": ["scapula_tilt_r"]}]}
//! ```
//!
//! Metres, z up, right-handed; radians (metres for the three translations among the angles).
//! `time_s` is the time of the tick since the first one. `sigma_m` is one standard deviation of
//! each joint per axis, or `null` if unknown. States are `tentative`, `tracked` and `coasting`.
//! Messages from clients are ignored. New fields may be added; an incompatible change increments
//! `version`.
//!
//! Browsers send the page's `Origin`. Only pages of this machine and requests without an origin are
//! accepted. Otherwise any website could read the stream through a browser on this machine.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};

use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint};
use farfield_proto::message::PersonState;
use serde::ser::{SerializeMap as _, SerializeSeq as _};
use serde::{Serialize, Serializer};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message as WebSocketMessage;

use crate::connection::{Connection, ConnectionRules, Received, accept_connection};
use crate::frame::{Frame, PersonFrame};
use crate::server::{listen, take_clients};
use crate::slot::{Feed, Shell};

/// All client messages are ignored.
const RULES: ConnectionRules = ConnectionRules {
    max_incoming: 4096,
    protocols: &[],
    origins: &[],
};

/// The message of a frame.
pub fn message(frame: &Frame) -> String {
    // Strings and finite numbers under string keys cannot fail.
    serde_json::to_string(&Message::new(frame)).unwrap_or_default()
}

/// The message of one person: the fields of [`message`] with `person` instead of `persons`.
#[cfg(feature = "zenoh")]
pub(crate) fn message_of_person(frame: &Frame, person: &PersonFrame) -> String {
    let Message {
        version,
        venue,
        session,
        tick,
        rate_hz,
        time_s,
        ..
    } = Message::head(frame);
    let message = PersonMessage {
        format: "farfield-pose",
        version,
        venue,
        session,
        tick,
        rate_hz,
        time_s,
        person: Person::new(person),
    };
    serde_json::to_string(&message).unwrap_or_default()
}

#[cfg(feature = "zenoh")]
#[derive(Serialize)]
struct PersonMessage<'a> {
    format: &'static str,
    version: u32,
    venue: &'a str,
    session: String,
    tick: i64,
    rate_hz: f64,
    time_s: Rounded,
    person: Person<'a>,
}

#[derive(Serialize)]
struct Message<'a> {
    format: &'static str,
    version: u32,
    venue: &'a str,
    /// A string, since JavaScript's integers have 53 bits.
    session: String,
    tick: i64,
    rate_hz: f64,
    time_s: Rounded,
    persons: Vec<Person<'a>>,
}

#[derive(Serialize)]
struct Person<'a> {
    id: u32,
    name: &'a str,
    state: PersonState,
    views: u16,
    joints_m: Joints<'a>,
    sigma_m: Option<Sigmas<'a>>,
    angles: Angles<'a>,
    unobserved: Unobserved,
}

impl<'a> Person<'a> {
    fn new(person: &'a PersonFrame) -> Self {
        Self {
            id: person.id.0,
            name: &person.name,
            state: person.state,
            views: person.views,
            joints_m: Joints(person),
            sigma_m: person.sigma_m.as_ref().map(Sigmas),
            angles: Angles(&person.angles),
            unobserved: Unobserved(person.unobserved),
        }
    }
}

impl<'a> Message<'a> {
    fn new(frame: &'a Frame) -> Self {
        Self {
            persons: frame.persons.iter().map(Person::new).collect(),
            ..Self::head(frame)
        }
    }

    /// Without people.
    fn head(frame: &'a Frame) -> Self {
        Self {
            format: "farfield-poses",
            version: 1,
            venue: &frame.venue,
            session: frame.session.0.to_string(),
            tick: frame.tick.0,
            rate_hz: frame.rate_hz,
            time_s: Rounded(frame.elapsed_s),
            persons: Vec::new(),
        }
    }
}

/// A number with six decimals: micrometres, microseconds.
struct Rounded(f64);

impl Serialize for Rounded {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_f64((self.0 * 1e6).round() / 1e6)
    }
}

struct Joints<'a>(&'a PersonFrame);

impl Serialize for Joints<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let mut map = to.serialize_map(Some(Joint::ALL.len()))?;
        for (joint, at_m) in Joint::ALL.iter().zip(&self.0.joints_m) {
            map.serialize_entry(joint.name(), &[at_m.x, at_m.y, at_m.z].map(Rounded))?;
        }
        map.end()
    }
}

struct Sigmas<'a>(&'a [f64; Joint::ALL.len()]);

impl Serialize for Sigmas<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_map(
            Joint::ALL
                .iter()
                .zip(self.0)
                .map(|(joint, sigma_m)| (joint.name(), Rounded(*sigma_m))),
        )
    }
}

struct Angles<'a>(&'a [f64]);

impl Serialize for Angles<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_map(
            ANGLE_NAMES
                .iter()
                .zip(self.0)
                .map(|(name, angle)| (*name, Rounded(*angle))),
        )
    }
}

struct Unobserved(u64);

impl Serialize for Unobserved {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let mut list = to.serialize_seq(None)?;
        for (i, name) in ANGLE_NAMES.iter().enumerate() {
            if self.0 >> i & 1 == 1 {
                list.serialize_element(name)?;
            }
        }
        list.end()
    }
}

/// Message of the newest requested frame, encoded once for all clients.
#[derive(Debug, Default)]
struct Encoded(Mutex<Option<(Arc<Frame>, Arc<str>)>>);

impl Encoded {
    fn get(&self, frame: &Arc<Frame>) -> Arc<str> {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match last.as_ref() {
            Some((last, text)) if Arc::ptr_eq(last, frame) => Arc::clone(text),
            _ => {
                let text: Arc<str> = message(frame).into();
                *last = Some((Arc::clone(frame), Arc::clone(&text)));
                text
            }
        }
    }
}

/// Serves clients at `address`; returns the bound address, since the port may be 0.
pub(crate) fn serve(address: SocketAddr, shell: &Shell) -> io::Result<SocketAddr> {
    let listener = listen(address)?;
    let bound = listener.local_addr()?;
    let clients = shell.clone();
    let encoded = Arc::new(Encoded::default());
    shell.spawn(take_clients(
        listener,
        clients,
        Vec::new(),
        move |(socket, _), shell, feed| serve_client(socket, Arc::clone(&encoded), shell, feed),
    ));
    Ok(bound)
}

async fn serve_client(
    socket: TcpStream,
    encoded: Arc<Encoded>,
    shell: Shell,
    mut feed: Feed,
) -> (Feed, io::Result<()>) {
    let served = send_frames(socket, &encoded, &shell, &mut feed).await;
    (feed, served)
}

/// Runs until the client leaves or accepts nothing for too long.
async fn send_frames(
    socket: TcpStream,
    encoded: &Encoded,
    shell: &Shell,
    feed: &mut Feed,
) -> io::Result<()> {
    let mut connection: Connection = tokio::select! {
        biased;
        () = shell.stop.cancelled() => return Ok(()),
        connected = accept_connection(socket, RULES) => connected?,
    };
    feed.catch_up();
    loop {
        tokio::select! {
            biased;
            () = shell.stop.cancelled() => {
                connection.close().await;
                return Ok(());
            }
            received = connection.receive() => match received? {
                Received::Text(_) | Received::Other => {}
                Received::Closed => return Ok(()),
            },
            frame = feed.next() => {
                let Some(frame) = frame else { return Ok(()) };
                let text = WebSocketMessage::text(&*encoded.get(&frame));
                connection.send([text], &shell.stop).await?;
                shell.counters.sent();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn a_message_contains_names_states_and_joints() {
        let frame = synthetic::frame(120);
        let read: serde_json::Value = serde_json::from_str(&message(&frame)).unwrap();
        assert_eq!(read["format"], "farfield-poses");
        assert_eq!(
            [&read["tick"], &read["time_s"]],
            [&120.into(), &1.0.into()] as [&serde_json::Value; 2]
        );
        assert_eq!(read["session"], "7");
        let person = &read["persons"][1];
        assert_eq!(person["name"], "Ada <& \"Zoë\">");
        assert_eq!(person["state"], "tracked");
        assert_eq!(
            person["unobserved"],
            serde_json::json!(["scapula_elevation_r"])
        );
        assert_eq!(person["joints_m"].as_object().unwrap().len(), 29);
        assert_eq!(person["angles"].as_object().unwrap().len(), 40);
        let knee = person["joints_m"]["left_knee"][2].as_f64().unwrap();
        let expected = frame.persons[1].joints_m[Joint::LeftKnee.index()].z;
        assert!((knee - expected).abs() <= 5e-7);
    }
}
