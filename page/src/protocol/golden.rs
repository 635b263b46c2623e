//! Compares one example of every binary message and of the venue with the files in `page/golden/`.
//! `UPDATE_GOLDEN=1` rewrites the files: only for a new kind of message, or with a new protocol
//! version.
//!
//! The examples are written by hand, with distinct values in adjacent fields.
//! `page/golden/README.md` repeats them for the page's test.

use std::fs;
use std::path::PathBuf;

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;

use super::camera_view::{CameraView, ViewedPerson, ViewedSighting};
use super::chosen_angles::ChosenAngles;
use super::text::{ActionKind, Mode};
use super::tick::{JointGrid, TickMessage, TickPerson};
use super::venue;
use crate::state::fixture::venue as synthetic;

const SESSION: u32 = 0x0102_0304;
const TICK: Tick = Tick(1_000_000_007);

fn check(name: &str, encoded: &[u8]) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("golden")
        .join(name);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        fs::write(&path, encoded).unwrap();
    }
    let stored = fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(
        stored, encoded,
        "{name}: the bytes of the protocol have changed"
    );
}

fn tick() -> TickMessage {
    TickMessage {
        is_live: true,
        session: SESSION,
        tick: TICK,
        at_us: 1_767_225_600_123_456,
        grid: JointGrid {
            origin_m: [1.5, -2.5, 0.25],
            step_m: 0.001,
        },
        joints: 3,
        persons: vec![
            TickPerson {
                id: PersonId(7),
                state: PersonState::Tracked,
                views: 4,
                viewpoints: 0b1101,
                unobserved: 1 << 39 | 1,
                clamped: 1 << 18,
                joints: vec![[0, 1, -1], [1000, -2000, 700], [i16::MAX, i16::MIN, 5]],
                sigma: vec![6, 254, 255],
            },
            TickPerson {
                id: PersonId(70_000),
                state: PersonState::Coasting,
                views: 0,
                viewpoints: 0,
                unobserved: 0,
                clamped: 0,
                joints: Vec::new(),
                sigma: Vec::new(),
            },
        ],
    }
}

fn camera_view() -> CameraView {
    CameraView {
        camera: CameraIndex(5),
        session: SESSION,
        tick: TICK,
        keypoints: 2,
        persons: vec![
            ViewedPerson {
                id: PersonId(7),
                bounding_box: Some(BoundingBox {
                    center_px: [960.25, 540.5],
                    size_px: [80.0, 200.0],
                    rotation_rad: -0.125,
                }),
                is_chosen: true,
                keypoints_px: vec![Some([950.25, 470.0]), None],
            },
            ViewedPerson {
                id: PersonId(8),
                bounding_box: None,
                is_chosen: false,
                keypoints_px: Vec::new(),
            },
        ],
        sightings: vec![ViewedSighting {
            score: 0.75,
            keypoints_px: vec![None, Some([-3.5, 12.75])],
        }],
    }
}

fn chosen_angles() -> ChosenAngles {
    ChosenAngles {
        session: SESSION,
        tick: TICK,
        angles: 2,
        persons: vec![
            (PersonId(7), vec![0.5, -1.25]),
            (PersonId(8), vec![2.0, 0.0]),
        ],
    }
}

#[test]
fn tick_messages_match_the_golden_file() {
    let encoded = tick().encode();
    check("tick.bin", &encoded);
    assert_eq!(TickMessage::decode(&encoded), Ok(tick()));
}

#[test]
fn camera_views_match_the_golden_file() {
    let encoded = camera_view().encode();
    check("camera_view.bin", &encoded);
    assert_eq!(CameraView::decode(&encoded), Ok(camera_view()));
}

#[test]
fn chosen_angles_match_the_golden_file() {
    let encoded = chosen_angles().encode();
    check("chosen_angles.bin", &encoded);
    assert_eq!(ChosenAngles::decode(&encoded), Ok(chosen_angles()));
}

#[test]
fn the_venue_document_matches_the_golden_file() {
    let (venue, skeleton) = (synthetic::venue(), synthetic::skeleton());
    let document = venue::document(&venue, &skeleton, Mode::Live, &[ActionKind::NamePerson]);
    let release = format!("\"release\":\"{}\"", env!("CARGO_PKG_VERSION"));
    assert!(document.contains(&release));
    // Independent of the release.
    let document = document.replace(&release, "\"release\":\"0.0.0\"");
    check("venue.json", format!("{document}\n").as_bytes());
}

#[test]
fn tick_fields_are_at_the_documented_offsets() {
    let bytes = tick().encode();
    assert_eq!(bytes[..4], [1, 1, 1, 0]);
    assert_eq!(bytes[4..8], [4, 3, 2, 1]);
    assert_eq!(bytes[8..16], 1_000_000_007i64.to_le_bytes());
    assert_eq!(bytes[16..24], 1_767_225_600_123_456i64.to_le_bytes());
    assert_eq!(bytes[24..28], 1.5f32.to_le_bytes());
    assert_eq!(bytes[36..40], 0.001f32.to_le_bytes());
    assert_eq!(bytes[40..44], [2, 0, 3, 14]);
    assert_eq!(bytes[48..56], [7, 0, 0, 0, 1, 1, 4, 0]);
    // The second joint, and the first standard deviation, of the first person.
    assert_eq!(bytes[48 + 38..48 + 44], [0xe8, 3, 0x30, 0xf8, 0xbc, 2]);
    assert_eq!(bytes[48 + 50], 6);
    assert_eq!(bytes.len(), 48 + 2 * 56);
}
