//! What a client may send: [`parse`] is the only way in, bounded before anything is read.

use farfield_proto::tick::Tick;
use serde::Deserialize;

/// Longest message of a client, bytes.
pub const MAX_REQUEST_BYTES: usize = 4096;
/// Most people whose angles one client is sent.
pub const MAX_CHOSEN_PERSONS: usize = 8;
/// Most angles of each.
pub const MAX_CHOSEN_ANGLES: usize = 16;
/// Longest name of a person, characters.
pub const MAX_NAME_CHARS: usize = 64;
/// Fastest and slowest play, times real time, either way.
const SPEEDS: [f64; 2] = [0.01, 8.0];
/// Least and most ticks a second that a client may want.
const RATES_HZ: [f64; 2] = [0.1, 1000.0];
/// Largest number of a request: JavaScript's numbers are exact up to here.
const MAX_NUMBER: u64 = 1 << 53;

/// One message of a client.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The number that the answer repeats; without one there is no answer unless something is wrong.
    pub number: Option<u64>,
    /// What it wants.
    pub wish: Wish,
}

/// What a client wants.
#[derive(Debug, Clone, PartialEq)]
pub enum Wish {
    /// Follow what is new.
    Live,
    /// Stay.
    Pause,
    /// Go to a tick and stay.
    Seek(Tick),
    /// Go by so many ticks and stay.
    Step(i64),
    /// Play from where it is.
    Play {
        /// Times real time, not 0.
        speed: f64,
        /// First and last tick of what is repeated.
        repeat: Option<[Tick; 2]>,
    },
    /// Send what a camera sees; `None`: of none.
    Camera(Option<u16>),
    /// Send angles.
    Angles {
        /// Of whom.
        persons: Vec<u32>,
        /// Which.
        angles: Vec<u16>,
    },
    /// Send at most so many ticks a second; `None`: all.
    Rate(Option<f64>),
    /// Something that is done for all, and needs the token.
    Act(Action),
}

/// What is done for all clients, by who runs the server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Give a person a name; empty: take it away.
    NamePerson {
        /// Who.
        person: u32,
        /// At most [`MAX_NAME_CHARS`] characters, none of them a control character.
        name: String,
    },
    /// Begin a recording.
    StartRecording,
    /// End it.
    StopRecording,
}

/// Why a message is not understood.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    /// It is too long.
    #[error("the message has {got} bytes, at most {MAX_REQUEST_BYTES} are read")]
    TooLong {
        /// Its length.
        got: usize,
    },
    /// It is not one of the messages of the protocol.
    #[error("not understood: {0}")]
    NotUnderstood(String),
    /// A number or a text is outside what is allowed.
    #[error("`{field}`: expected {expected}")]
    OutOfRange {
        /// Which field.
        field: &'static str,
        /// What it may be.
        expected: String,
    },
}

/// A message as it is written.
#[derive(Deserialize)]
struct Numbered {
    request: Option<u64>,
    #[serde(flatten)]
    wish: WrittenWish,
}

#[derive(Deserialize)]
#[serde(tag = "do", rename_all = "snake_case")]
enum WrittenWish {
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

/// Reads what a client sent.
///
/// # Errors
/// [`RequestError`] in words for whoever wrote the client.
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
        wish: wish(read.wish)?,
    })
}

fn out_of_range(field: &'static str, expected: impl Into<String>) -> RequestError {
    RequestError::OutOfRange {
        field,
        expected: expected.into(),
    }
}

fn wish(written: WrittenWish) -> Result<Wish, RequestError> {
    Ok(match written {
        WrittenWish::Live => Wish::Live,
        WrittenWish::Pause => Wish::Pause,
        WrittenWish::Seek { tick } => Wish::Seek(Tick(tick)),
        WrittenWish::Step { ticks } => Wish::Step(ticks),
        WrittenWish::Play { speed, r#loop } => {
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
            Wish::Play { speed, repeat }
        }
        WrittenWish::Camera { camera } => Wish::Camera(camera),
        WrittenWish::Angles { persons, angles } => {
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
            Wish::Angles { persons, angles }
        }
        WrittenWish::Rate { hz } => {
            if hz.is_some_and(|hz| !(RATES_HZ[0]..=RATES_HZ[1]).contains(&hz)) {
                return Err(out_of_range("hz", "0.1 to 1000"));
            }
            Wish::Rate(hz)
        }
        WrittenWish::NamePerson { person, name } => Wish::Act(Action::NamePerson {
            person,
            name: checked_name(&name)?,
        }),
        WrittenWish::StartRecording => Wish::Act(Action::StartRecording),
        WrittenWish::StopRecording => Wish::Act(Action::StopRecording),
    })
}

/// The name without blanks around it.
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

    fn wish_of(text: &str) -> Wish {
        parse(text).unwrap().wish
    }

    #[test]
    fn every_message_of_the_manual_is_understood() {
        assert_eq!(wish_of(r#"{"do": "live"}"#), Wish::Live);
        assert_eq!(wish_of(r#"{"do": "pause"}"#), Wish::Pause);
        assert_eq!(
            wish_of(r#"{"do": "seek", "tick": 980}"#),
            Wish::Seek(Tick(980))
        );
        assert_eq!(wish_of(r#"{"do": "step", "ticks": -1}"#), Wish::Step(-1));
        let play = Wish::Play {
            speed: 0.25,
            repeat: Some([Tick(900), Tick(990)]),
        };
        assert_eq!(
            wish_of(r#"{"do": "play", "speed": 0.25, "loop": [900, 990]}"#),
            play
        );
        assert_eq!(
            wish_of(r#"{"do": "camera", "camera": 3}"#),
            Wish::Camera(Some(3))
        );
        assert_eq!(
            wish_of(r#"{"do": "camera", "camera": null}"#),
            Wish::Camera(None)
        );
        let angles = Wish::Angles {
            persons: vec![3],
            angles: vec![12, 13],
        };
        assert_eq!(
            wish_of(r#"{"do": "angles", "persons": [3], "angles": [12, 13]}"#),
            angles
        );
        assert_eq!(
            wish_of(r#"{"do": "rate", "hz": 30}"#),
            Wish::Rate(Some(30.0))
        );
        let named = parse(r#"{"do": "name_person", "person": 3, "name": " Anna ", "request": 12}"#)
            .unwrap();
        assert_eq!(named.number, Some(12));
        let name = "Anna".to_owned();
        assert_eq!(
            named.wish,
            Wish::Act(Action::NamePerson { person: 3, name })
        );
        assert_eq!(
            wish_of(r#"{"do": "start_recording"}"#),
            Wish::Act(Action::StartRecording)
        );
        assert_eq!(
            wish_of(r#"{"do": "stop_recording"}"#),
            Wish::Act(Action::StopRecording)
        );
    }

    #[test]
    fn what_is_out_of_range_is_refused_by_the_name_of_its_field() {
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
