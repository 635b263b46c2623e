//! Requests of clients. [`parse`] is the only entry point, and limits the size before parsing.

use farfield_proto::tick::Tick;
use serde::Deserialize;

use super::text::ActionKind;

/// Maximum size of a message, bytes.
pub const MAX_REQUEST_BYTES: usize = 4096;
/// Maximum number of people whose angles a client may select.
pub const MAX_CHOSEN_PERSONS: usize = 8;
/// Maximum number of selected angles.
pub const MAX_CHOSEN_ANGLES: usize = 16;
/// Maximum length of a person's name, characters.
pub const MAX_NAME_CHARS: usize = 64;
/// Minimum and maximum playback speed relative to real time, in both directions.
const SPEEDS: [f64; 2] = [0.01, 8.0];
/// Minimum and maximum tick rate that a client may request.
const RATES_HZ: [f64; 2] = [0.1, 1000.0];
/// Maximum number of a request: JavaScript's integers are exact up to here.
const MAX_NUMBER: u64 = 1 << 53;

/// One message of a client.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Number that the answer repeats; without one, only failures are answered.
    pub number: Option<u64>,
    /// The command.
    pub command: Command,
}

/// A command of a client.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Follow the newest tick.
    Live,
    /// Pause.
    Pause,
    /// Jump to a tick and pause.
    Seek(Tick),
    /// Move by a number of ticks and pause.
    Step(i64),
    /// Play from the current position.
    Play {
        /// Speed relative to real time, not 0.
        speed: f64,
        /// First and last tick of the repeated range.
        repeat: Option<[Tick; 2]>,
    },
    /// Select the camera to view; `None` for none.
    Camera(Option<u16>),
    /// Select angles.
    Angles {
        /// People.
        persons: Vec<u32>,
        /// Indices of the angles.
        angles: Vec<u16>,
    },
    /// Limit the ticks per second; `None` for no limit.
    Rate(Option<f64>),
    /// An action for all clients; requires the token.
    Act(Action),
}

/// An action for all clients, performed by the host program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Name a person; an empty name removes it.
    NamePerson {
        /// The person.
        person: u32,
        /// At most [`MAX_NAME_CHARS`] characters, without control characters.
        name: String,
    },
    /// Start a recording.
    StartRecording,
    /// Stop it.
    StopRecording,
}

impl Action {
    /// The kind of this action.
    pub fn kind(&self) -> ActionKind {
        match self {
            Self::NamePerson { .. } => ActionKind::NamePerson,
            Self::StartRecording | Self::StopRecording => ActionKind::Record,
        }
    }
}

/// Why a message is invalid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    /// It is too long.
    #[error("the message has {got} bytes, at most {MAX_REQUEST_BYTES} are read")]
    TooLong {
        /// Its length.
        got: usize,
    },
    /// It is not a message of the protocol.
    #[error("not understood: {0}")]
    NotUnderstood(String),
    /// A number or text is out of range.
    #[error("`{field}`: expected {expected}")]
    OutOfRange {
        /// The field.
        field: &'static str,
        /// The allowed values.
        expected: String,
    },
}

/// The serialised form of a message.
#[derive(Deserialize)]
struct Numbered {
    request: Option<u64>,
    #[serde(flatten)]
    command: SerializedCommand,
}

#[derive(Deserialize)]
#[serde(tag = "do", rename_all = "snake_case")]
enum SerializedCommand {
    Live,
    Pause,
    Seek {
        tick: i64,
    },
    Step {
        ticks: i64,
    },
    Play {
        speed: Option<f64>,
        r#loop: Option<[i64; 2]>,
    },
    Camera {
        camera: Option<u16>,
    },
    Angles {
        persons: Vec<u32>,
        angles: Vec<u16>,
    },
    Rate {
        hz: Option<f64>,
    },
    NamePerson {
        person: u32,
        name: String,
    },
    StartRecording,
    StopRecording,
}

/// Parses a client's message.
///
/// # Errors
/// [`RequestError`] with a message for the author of the client.
pub fn parse(text: &str) -> Result<Request, RequestError> {
    if text.len() > MAX_REQUEST_BYTES {
        return Err(RequestError::TooLong { got: text.len() });
    }
    let read: Result<Numbered, _> = serde_json::from_str(text);
    let read = read.map_err(|error| RequestError::NotUnderstood(error.to_string()))?;
    if read.request.is_some_and(|number| number > MAX_NUMBER) {
        return Err(out_of_range("request", "a number up to 2^53"));
    }
    Ok(Request {
        number: read.request,
        command: command(read.command)?,
    })
}

fn out_of_range(field: &'static str, expected: impl Into<String>) -> RequestError {
    RequestError::OutOfRange {
        field,
        expected: expected.into(),
    }
}

fn command(written: SerializedCommand) -> Result<Command, RequestError> {
    Ok(match written {
        SerializedCommand::Live => Command::Live,
        SerializedCommand::Pause => Command::Pause,
        SerializedCommand::Seek { tick } => Command::Seek(Tick(tick)),
        SerializedCommand::Step { ticks } => Command::Step(ticks),
        SerializedCommand::Play { speed, r#loop } => {
            let speed = speed.unwrap_or(1.0);
            if !(SPEEDS[0]..=SPEEDS[1]).contains(&speed.abs()) {
                return Err(out_of_range("speed", "-8 to 8, and not 0"));
            }
            if r#loop.is_some_and(|[from, to]| from >= to) {
                return Err(out_of_range(
                    "loop",
                    "two ticks, the first below the second",
                ));
            }
            let repeat = r#loop.map(|ticks| ticks.map(Tick));
            Command::Play { speed, repeat }
        }
        SerializedCommand::Camera { camera } => Command::Camera(camera),
        SerializedCommand::Angles { persons, angles } => {
            if persons.len() > MAX_CHOSEN_PERSONS {
                return Err(out_of_range(
                    "persons",
                    format!("at most {MAX_CHOSEN_PERSONS}"),
                ));
            }
            if angles.len() > MAX_CHOSEN_ANGLES {
                return Err(out_of_range(
                    "angles",
                    format!("at most {MAX_CHOSEN_ANGLES}"),
                ));
            }
            Command::Angles { persons, angles }
        }
        SerializedCommand::Rate { hz } => {
            if hz.is_some_and(|hz| !(RATES_HZ[0]..=RATES_HZ[1]).contains(&hz)) {
                return Err(out_of_range("hz", "0.1 to 1000"));
            }
            Command::Rate(hz)
        }
        SerializedCommand::NamePerson { person, name } => Command::Act(Action::NamePerson {
            person,
            name: checked_name(&name)?,
        }),
        SerializedCommand::StartRecording => Command::Act(Action::StartRecording),
        SerializedCommand::StopRecording => Command::Act(Action::StopRecording),
    })
}

/// The name without surrounding blanks.
fn checked_name(name: &str) -> Result<String, RequestError> {
    let name = name.trim();
    if name.chars().count() > MAX_NAME_CHARS || name.chars().any(char::is_control) {
        let expected = format!("at most {MAX_NAME_CHARS} characters of text");
        return Err(out_of_range("name", expected));
    }
    Ok(name.to_owned())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn command_of(text: &str) -> Command {
        parse(text).unwrap().command
    }

    #[test]
    fn every_message_of_the_manual_is_parsed() {
        assert_eq!(command_of(r#"{"do": "live"}"#), Command::Live);
        assert_eq!(command_of(r#"{"do": "pause"}"#), Command::Pause);
        assert_eq!(
            command_of(r#"{"do": "seek", "tick": 980}"#),
            Command::Seek(Tick(980))
        );
        assert_eq!(
            command_of(r#"{"do": "step", "ticks": -1}"#),
            Command::Step(-1)
        );
        let play = Command::Play {
            speed: 0.25,
            repeat: Some([Tick(900), Tick(990)]),
        };
        assert_eq!(
            command_of(r#"{"do": "play", "speed": 0.25, "loop": [900, 990]}"#),
            play
        );
        assert_eq!(
            command_of(r#"{"do": "camera", "camera": 3}"#),
            Command::Camera(Some(3))
        );
        assert_eq!(
            command_of(r#"{"do": "camera", "camera": null}"#),
            Command::Camera(None)
        );
        let angles = Command::Angles {
            persons: vec![3],
            angles: vec![12, 13],
        };
        assert_eq!(
            command_of(r#"{"do": "angles", "persons": [3], "angles": [12, 13]}"#),
            angles
        );
        assert_eq!(
            command_of(r#"{"do": "rate", "hz": 30}"#),
            Command::Rate(Some(30.0))
        );
        let named = parse(r#"{"do": "name_person", "person": 3, "name": " Anna ", "request": 12}"#)
            .unwrap();
        assert_eq!(named.number, Some(12));
        let name = "Anna".to_owned();
        assert_eq!(
            named.command,
            Command::Act(Action::NamePerson { person: 3, name })
        );
        assert_eq!(
            command_of(r#"{"do": "start_recording"}"#),
            Command::Act(Action::StartRecording)
        );
        assert_eq!(
            command_of(r#"{"do": "stop_recording"}"#),
            Command::Act(Action::StopRecording)
        );
    }

    #[test]
    fn values_out_of_range_are_refused_with_their_field() {
        for (text, field) in [
            (r#"{"do": "play", "speed": 0}"#.to_owned(), "speed"),
            (r#"{"do": "play", "speed": 9}"#.to_owned(), "speed"),
            (r#"{"do": "play", "loop": [5, 5]}"#.to_owned(), "loop"),
            (r#"{"do": "rate", "hz": 0}"#.to_owned(), "hz"),
            (
                format!(
                    r#"{{"do": "angles", "persons": [1], "angles": {:?}}}"#,
                    [0; 17]
                ),
                "angles",
            ),
            (
                format!(
                    r#"{{"do": "angles", "persons": {:?}, "angles": []}}"#,
                    [0; 9]
                ),
                "persons",
            ),
            (
                format!(
                    r#"{{"do": "name_person", "person": 1, "name": "{}"}}"#,
                    "x".repeat(65)
                ),
                "name",
            ),
            (
                r#"{"do": "name_person", "person": 1, "name": "a\u0007b"}"#.to_owned(),
                "name",
            ),
            (
                r#"{"do": "live", "request": 9007199254740993}"#.to_owned(),
                "request",
            ),
        ] {
            match parse(&text) {
                Err(RequestError::OutOfRange { field: found, .. }) => assert_eq!(found, field),
                other => panic!("{text}: {other:?}"),
            }
        }
        let long = format!(r#"{{"do": "live", "x": "{}"}}"#, "y".repeat(5000));
        assert!(matches!(parse(&long), Err(RequestError::TooLong { .. })));
    }

    proptest! {
        #[test]
        fn any_text_is_a_request_or_an_error(text in ".{0,200}") {
            let _parsed = parse(&text);
        }
    }
}
