//! The text messages of the server, beside ticks and status.

use std::collections::BTreeMap;

use farfield_proto::tick::Tick;
use serde::Serialize;

use super::PROTOCOL;

/// What a server shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// It is fed by a running fusion.
    Live,
    /// It is fed by a replay, which solves a recording again: with people and events alone.
    Replay,
    /// It shows a file.
    Recording,
}

impl Mode {
    /// Whether ticks come by themselves, so that the newest can be followed.
    pub(crate) fn is_fed(self) -> bool {
        self != Self::Recording
    }
}

/// A kind of action, as pages know it.
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
    /// The first of all.
    Hello {
        /// Version of the protocol.
        protocol: u8,
        /// What the server shows.
        mode: Mode,
        /// Whether the client came with the token.
        may_act: bool,
        /// What can be done here.
        actions: &'a [ActionKind],
    },
    /// The names of people, by id.
    Names {
        /// All of them.
        names: &'a BTreeMap<u32, String>,
    },
    /// Who became who.
    Events {
        /// In order.
        events: Vec<&'a EventLine>,
    },
    /// Where the client is in time.
    Playback(Playback),
    /// To a request that has a number, and to all that failed.
    Answer {
        /// The number.
        request: Option<u64>,
        /// Whether it was done.
        ok: bool,
        /// Why not.
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

    /// The message as it is sent.
    pub fn to_json(&self) -> String {
        json(self)
    }
}

/// A value of this module's neighbours as JSON.
pub(crate) fn json(value: &impl Serialize) -> String {
    // Our types have text keys and numbers alone: nothing of them can fail.
    serde_json::to_string(value).unwrap_or_else(|error| {
        tracing::error!(%error, "a message cannot be written as JSON");
        "{}".to_owned()
    })
}

/// One event of one person.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EventLine {
    /// The lower half of fusion's session.
    pub session: u32,
    /// When.
    pub tick: Tick,
    /// When it was published, microseconds of Unix time.
    pub at_us: i64,
    /// Who.
    pub person: u32,
    /// The second person of the event, where there is one.
    pub other: Option<u32>,
    /// Its kind.
    pub change: &'static str,
    /// A line for people.
    pub text: String,
}

/// Where a client is in time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Playback {
    /// What it does.
    pub state: PlaybackState,
    /// The tick last sent.
    pub tick: Option<Tick>,
    /// Times real time.
    pub speed: f64,
    /// First and last tick of what is repeated.
    #[serde(rename = "loop")]
    pub repeat: Option<[Tick; 2]>,
    /// The first tick that can be gone to.
    pub first: Option<Tick>,
    /// The last.
    pub last: Option<Tick>,
    /// Whether something is still on its way.
    pub loading: bool,
}

/// What a client does in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PlaybackState {
    /// It follows what is new.
    Live,
    /// It goes through the past.
    Playing,
    /// It stays.
    Paused,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_those_of_the_manual() {
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
