//! Text messages of the server other than ticks and status.

use std::collections::BTreeMap;

use farfield_proto::tick::Tick;
use serde::Serialize;

use super::PROTOCOL;

/// What a server shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Data of a running fusion.
    Live,
    /// Data of a replay, which solves a recording again; people and events only.
    Replay,
    /// A file.
    Recording,
}

impl Mode {
    /// Whether new ticks arrive, so that the newest can be followed.
    pub(crate) fn is_fed(self) -> bool {
        self != Self::Recording
    }
}

/// A kind of action.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionKind {
    /// People can be given names.
    NamePerson,
    /// Recordings can be started and stopped.
    Record,
}

/// One text message.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum TextMessage<'a> {
    /// The first message.
    Hello {
        /// Version of the protocol.
        protocol: u8,
        /// What the server shows.
        mode: Mode,
        /// Whether the client has the token.
        may_act: bool,
        /// The available actions.
        actions: &'a [ActionKind],
    },
    /// The names of people, by id.
    Names {
        /// All of them.
        names: &'a BTreeMap<u32, String>,
    },
    /// Identity events.
    Events {
        /// In order.
        events: Vec<&'a EventLine>,
    },
    /// The client's playback position.
    Playback(Playback),
    /// Sent for numbered requests and for all that failed.
    Answer {
        /// The number.
        request: Option<u64>,
        /// Whether it succeeded.
        ok: bool,
        /// Reason for a failure.
        error: Option<String>,
    },
}

impl<'a> TextMessage<'a> {
    /// The first message to a client.
    pub fn hello(mode: Mode, may_act: bool, actions: &'a [ActionKind]) -> Self {
        Self::Hello {
            protocol: PROTOCOL,
            mode,
            may_act,
            actions,
        }
    }

    /// The answer to a request.
    pub fn answer(request: Option<u64>, outcome: Result<(), String>) -> Self {
        let error = outcome.err();
        Self::Answer {
            request,
            ok: error.is_none(),
            error,
        }
    }

    /// The message as JSON.
    pub fn to_json(&self) -> String {
        json(self)
    }
}

/// Serialises a value of this module tree.
pub(crate) fn json(value: &impl Serialize) -> String {
    // Our types contain only text keys and numbers, so serialisation cannot fail.
    serde_json::to_string(value).unwrap_or_else(|error| {
        tracing::error!(%error, "cannot serialise a message as JSON");
        "{}".to_owned()
    })
}

/// One event of one person.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EventLine {
    /// The lower half of fusion's session.
    pub session: u32,
    /// Its tick.
    pub tick: Tick,
    /// When it was published, microseconds of Unix time.
    pub at_us: i64,
    /// The person.
    pub person: u32,
    /// The second person of the event, if any.
    pub other: Option<u32>,
    /// Its kind.
    pub change: &'static str,
    /// Description for people.
    pub text: String,
}

/// Playback position of a client.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Playback {
    /// Playback state.
    pub state: PlaybackState,
    /// The last sent tick.
    pub tick: Option<Tick>,
    /// Speed relative to real time.
    pub speed: f64,
    /// First and last tick of the repeated range.
    #[serde(rename = "loop")]
    pub repeat: Option<[Tick; 2]>,
    /// The first available tick.
    pub first: Option<Tick>,
    /// The last available tick.
    pub last: Option<Tick>,
    /// Whether data is still being loaded.
    pub loading: bool,
}

/// Playback state of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PlaybackState {
    /// Follows the newest tick.
    Live,
    /// Moves through the past.
    Playing,
    /// Stays at a tick.
    Paused,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_messages_match_the_manual() {
        let hello = TextMessage::hello(
            Mode::Live,
            true,
            &[ActionKind::NamePerson, ActionKind::Record],
        );
        assert_eq!(
            hello.to_json(),
            r#"{"type":"hello","protocol":1,"mode":"live","may_act":true,"actions":["name_person","record"]}"#
        );
        let names = BTreeMap::from([(3, "Anna".to_owned())]);
        let names = TextMessage::Names { names: &names };
        assert_eq!(names.to_json(), r#"{"type":"names","names":{"3":"Anna"}}"#);
        let playback = TextMessage::Playback(Playback {
            state: PlaybackState::Live,
            tick: Some(Tick(1000)),
            speed: 1.0,
            repeat: None,
            first: Some(Tick(400)),
            last: Some(Tick(1000)),
            loading: false,
        });
        assert_eq!(
            playback.to_json(),
            r#"{"type":"playback","state":"live","tick":1000,"speed":1.0,"loop":null,"first":400,"last":1000,"loading":false}"#
        );
        let answer = TextMessage::answer(Some(12), Err("no".to_owned()));
        assert_eq!(
            answer.to_json(),
            r#"{"type":"answer","request":12,"ok":false,"error":"no"}"#
        );
    }
}
