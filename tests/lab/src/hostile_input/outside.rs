//! Input of other programs and of strangers for the import, the page and the streams.

use std::path::Path;

use farfield_calibration::alignment::{ClickedChange, ClickedFile, Marks};
use farfield_export::SubjectProfile;
use farfield_export::edits::{EditList, Roll};
use farfield_fusion::body::fit::{KnownBody, fit_known};
use farfield_fusion::body::observed::ObservedJoints;
use farfield_fusion::body::prior::BodyPrior;
use farfield_import::formats::{ParseOptions, parse};
use farfield_page::protocol::request;
use farfield_proto::venue::parameters::IkParameters;
use farfield_streams::foxglove;
use farfield_streams::lsl::query::is_met;
use farfield_streams::lsl::request::{Datagram, Request};
use farfield_streams::lsl::{self, info::Info};
use farfield_streams::qtm::{Command, Incoming};

use super::{read_or_refused, refused, size, text};

/// Keypoints of other programs of any content: recognised and read, or refused.
pub(super) fn imported_keypoints(bytes: &[u8]) -> String {
    let parsed = parse(
        bytes,
        Path::new("cam1_000001.json"),
        ParseOptions::default(),
    );
    match &parsed {
        Ok(read) => format!("read: {:?}", read.format),
        Err(_) => read_or_refused(&parsed),
    }
}

/// Marks clicked in images, of any content: read or refused.
pub(super) fn clicked_marks_text(bytes: &[u8]) -> String {
    let text = text(bytes);
    let marks = read_or_refused(&Marks::parse(text, Path::new("marks.toml")));
    let begun = ClickedFile::parse(text, Path::new("marks.toml"));
    if let Ok(begun) = &begun {
        // Marks that were read are written, and read the same.
        let again = begun
            .checked(Path::new("marks.toml"))
            .expect("what is written can be read");
        assert_eq!(
            again.checked(Path::new("marks.toml")).as_ref(),
            Ok(&again),
            "it is the same from then on"
        );
    }
    // The same from a page, as JSON.
    let change = ClickedChange::parse(text.as_bytes())
        .and_then(|change| change.clicked.checked(Path::new("clicked.toml")));
    format!(
        "{marks}; {}; {}",
        read_or_refused(&begun),
        read_or_refused(&change)
    )
}

/// Names and edits of people, or a profile, of any content: read and applied, or refused.
pub(super) fn edits_text(bytes: &[u8]) -> String {
    let text = text(bytes);
    let profile = SubjectProfile::parse(text, Path::new("anna.toml"));
    let list = match EditList::parse(text, Path::new("edits.jsonl")) {
        Ok(list) => list,
        Err(error) if profile.is_err() => return read_or_refused::<(), _>(&Err(error)),
        Err(_) => return subject(text),
    };
    let mut roll = Roll::default();
    for tick in 0..9 {
        roll.add(tick, if tick < 5 { 3 } else { 7 });
    }
    let applied = list.identities(Some(&roll));
    if let Ok(identities) = &applied {
        let shown = (0..9).map(|tick| identities.person_at(tick, if tick < 5 { 3 } else { 7 }));
        let made = |person| person == 3 || person == 7 || identities.has_made(person);
        assert!(shown.flatten().all(made), "an unknown person");
    }
    read_or_refused(&applied)
}

/// A profile that fusion uses for a subject: refused, or a standing person is fitted with it.
fn subject(text: &str) -> String {
    let body = match BodyPrior::parse(text, Path::new("anna.toml")) {
        Ok((_, body)) => body,
        Err(error) => return format!("a profile, {}", refused(&error)),
    };
    let seen = ObservedJoints::from_named(STANDING);
    let known = KnownBody {
        prior: &body,
        seen_s: 2.0,
    };
    let fitted = match fit_known(&[seen], Some(known), &IkParameters::default(), None) {
        Ok(fitted) => fitted,
        Err(error) => return format!("a subject, {}", refused(&error)),
    };
    let lengths_m = fitted.skeleton.proportions().lengths_m();
    for (name, length_m) in lengths_m {
        assert!(length_m.is_finite(), "{name} is {length_m} m");
    }
    "a subject".to_owned()
}

/// A person who stands upright and faces x, world, metres.
const STANDING: [(&str, [f64; 3]); 17] = [
    ("nose", [0.1, 0.0, 1.60]),
    ("left_eye", [0.09, 0.03, 1.63]),
    ("right_eye", [0.09, -0.03, 1.63]),
    ("left_ear", [0.0, 0.07, 1.60]),
    ("right_ear", [0.0, -0.07, 1.60]),
    ("left_shoulder", [0.0, 0.19, 1.40]),
    ("right_shoulder", [0.0, -0.19, 1.40]),
    ("left_elbow", [0.0, 0.20, 1.11]),
    ("right_elbow", [0.0, -0.20, 1.11]),
    ("left_wrist", [0.02, 0.20, 0.85]),
    ("right_wrist", [0.02, -0.20, 0.85]),
    ("left_hip", [0.0, 0.09, 0.93]),
    ("right_hip", [0.0, -0.09, 0.93]),
    ("left_knee", [0.02, 0.09, 0.51]),
    ("right_knee", [0.02, -0.09, 0.51]),
    ("left_ankle", [0.0, 0.09, 0.09]),
    ("right_ankle", [0.0, -0.09, 0.09]),
];

/// Messages of a browser on a WebSocket, of any content: understood, or answered.
pub(super) fn page_request_text(bytes: &[u8]) -> String {
    read_or_refused(&request::parse(text(bytes)))
}

/// Messages of a client of the QTM protocol, of any content and in any pieces: packets, each a command or answered.
pub(super) fn qtm_packets(bytes: &[u8]) -> String {
    let mut incoming = Incoming::default();
    let mut behaviour = String::new();
    for piece in bytes.chunks(7) {
        incoming.push(piece);
        loop {
            match incoming.take() {
                Ok(Some(packet)) => {
                    let command = Command::parse(&String::from_utf8_lossy(&packet.payload));
                    behaviour.push(if command.is_ok() { '+' } else { '-' });
                }
                Ok(None) => break,
                Err(_) => return format!("{}!", size(behaviour.len())),
            }
        }
    }
    let understood = behaviour.matches('+').count();
    format!("{} of {}", size(understood), size(behaviour.len()))
}

/// Messages of a client of Foxglove's protocol, of any content: a request, or ignored.
pub(super) fn foxglove_request_text(bytes: &[u8]) -> String {
    match foxglove::Request::parse(text(bytes)) {
        Some(foxglove::Request::Subscribe { subscriptions }) => {
            format!("subscribes to {}", size(subscriptions.len()))
        }
        Some(foxglove::Request::Unsubscribe { subscription_ids }) => {
            format!("leaves {}", size(subscription_ids.len()))
        }
        None => "nothing".to_owned(),
    }
}

/// Messages of an inlet of Lab Streaming Layer, of any content: as a datagram, and by TCP in pieces; with its query.
pub(super) fn lsl_requests(bytes: &[u8]) -> String {
    let info = Info {
        venue: "hall".to_owned(),
        rate_hz: 60.0,
        uid: "01234567-89ab-cdef-0123-456789abcdef".to_owned(),
        hostname: "lab".to_owned(),
        created_at_s: 1.0,
        data_port: 16572,
        service_port: 16572,
    };
    let datagram = match Datagram::parse(bytes) {
        Some(Datagram::ShortInfo { query, .. }) => {
            format!("is it: {}", is_met(query, &info.fields()))
        }
        Some(Datagram::TimeData { wave, t0_s }) => {
            let answer = lsl::request::time_answer(wave, t0_s, [0.0, 0.5]);
            assert_eq!(answer.split_whitespace().count(), 4, "{answer}");
            "the time".to_owned()
        }
        None => "nothing".to_owned(),
    };
    let mut incoming = lsl::request::Incoming::default();
    for piece in bytes.chunks(7) {
        let request = match incoming.push(piece) {
            Ok(None) => continue,
            Ok(Some(Request::FullInfo)) => "all".to_owned(),
            Ok(Some(Request::ShortInfo(query))) => is_met(&query, &info.fields()).to_string(),
            Ok(Some(Request::Feed(feed))) => {
                let answer = feed.answer(&info.uid);
                assert!(answer.head.len() < 1024, "a long answer");
                format!("samples {:?}", answer.data_version)
            }
            Err(error) => refused(&error),
        };
        return format!("{datagram}, {request}");
    }
    format!("{datagram}, more")
}
