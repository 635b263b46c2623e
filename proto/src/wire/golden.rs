//! Bytes that must never change: every version of the messages and of the codec, in
//! `proto/golden/`.
//!
//! Each file is decoded to its message, and a version that is still written is encoded to the same
//! bytes. With `FARFIELD_GOLDEN=write` missing files are written; none is ever overwritten, and
//! `.ci/run` refuses a change of one.

use std::fmt::Debug;
use std::fs;
use std::path::PathBuf;

use super::fixture::{
    box_set, patch_set, pose_set, sighting_set, sighting_set_whole, status, thumbnail,
};
use super::*;
use crate::id::{SessionId, ViewpointIndex};
use crate::message::decision::{Decision, UsedSet};
use crate::message::fill::{FillRequest, Filled, SetKind, StoredSet};
use crate::message::handout::{
    Chunk, FileKind, FileList, HandoutRequest, ListSignature, SharedFile, SignedList,
};
use crate::message::identity_event::tests::every_event;
use crate::message::naming::tests::every_naming;
use crate::patch::{CompressionLevel, Decoder, EncodedMaps, Encoder, Maps, quantize};
use crate::tick::Tick;

fn hex(bytes: &[u8]) -> String {
    bytes
        .iter()
        .fold(String::new(), |text, b| text + &format!("{b:02x}"))
}

fn bytes_of(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex
        .trim()
        .chars()
        .map(|c| c.to_digit(16).unwrap() as u8)
        .collect();
    digits
        .chunks_exact(2)
        .map(|pair| pair[0] << 4 | pair[1])
        .collect()
}

/// The content of `proto/golden/vVERSION/name`; a missing file is written from `today` if
/// requested.
fn golden(version: u8, name: &str, today: Option<&str>) -> String {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("golden/v{version}"));
    let path = folder.join(name);
    let asked = std::env::var_os("FARFIELD_GOLDEN").is_some_and(|mode| mode == "write");
    if let (Some(today), true, false) = (today, asked, path.exists()) {
        fs::create_dir_all(&folder).unwrap();
        fs::write(&path, format!("{today}\n")).unwrap();
    }
    fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}; a new VERSION has new files", path.display()))
}

fn is_written(version: u8) -> bool {
    (OLDEST_WRITTEN..=VERSION).contains(&version)
}

fn check<M: Message + PartialEq + Debug>(name: &str, message: &M) {
    check_by_version(name, message, |_| message);
}

/// The same for a message that decodes to `older` in versions with fewer fields.
fn check_by_version<'a, M: Message + PartialEq + Debug + 'a>(
    name: &str,
    message: &M,
    older: impl Fn(u8) -> &'a M,
) {
    for version in OLDEST_READ..=VERSION {
        let today = is_written(version).then(|| hex(&encode_as(message, version)));
        let kept = golden(version, &format!("{name}.hex"), today.as_deref());
        let read: M = decode(&bytes_of(&kept)).unwrap();
        assert_eq!(
            read,
            *older(version),
            "{name} of version {version} is read as something else"
        );
        if let Some(today) = today {
            assert_eq!(
                today,
                kept.trim(),
                "{name} of version {version}: a change needs a new VERSION"
            );
        }
    }
}

#[test]
fn message_bytes_are_fixed_in_every_version() {
    check("patch_set", &patch_set());
    let boxes = box_set();
    let mut without_plan = boxes.clone();
    without_plan
        .live
        .iter_mut()
        .for_each(|live| live.every_nth_tick = 0);
    check_by_version("box_set", &boxes, |version| match version {
        ..=1 => &without_plan,
        2.. => &boxes,
    });
    check("sighting_set", &sighting_set());
    check("sighting_set_whole", &sighting_set_whole());
    check("pose_set", &pose_set());
    let status = status();
    let mut without_need = status.clone();
    without_need
        .live
        .iter_mut()
        .for_each(|live| live.needed_nth_tick = 0);
    check_by_version("status", &status, |version| match version {
        ..=1 => &without_need,
        2.. => &status,
    });
    check("identity_events", &every_event());
    check("thumbnail", &thumbnail());
    check("namings", &every_naming());
    let used = |viewpoint, part| UsedSet {
        viewpoint: ViewpointIndex(viewpoint),
        part,
    };
    check(
        "decision",
        &Decision {
            session: SessionId(9),
            first: Tick(-3),
            tick: Tick(300),
            horizons_ticks: vec![1.0, 6.5],
            patches: vec![used(0, 0), used(1, 2)],
            sightings: vec![used(1, 0)],
        },
    );
}

#[test]
fn request_and_answer_bytes_are_fixed_in_every_version() {
    check(
        "fill_request",
        &FillRequest {
            session: SessionId(9),
            from: Tick(300),
            to: Tick(420),
            max_bytes: 65_536,
        },
    );
    let stored = |kind, bytes| StoredSet { kind, bytes };
    check(
        "filled",
        &Filled {
            to: Tick(301),
            stored: vec![
                stored(SetKind::Patches, vec![3, 1]),
                stored(SetKind::Sightings, vec![]),
            ],
        },
    );
    check(
        "handout_request",
        &HandoutRequest::Chunk {
            file: 2,
            from: 65_536,
        },
    );
    check("handout_request_list", &HandoutRequest::List);
    let kinds = [
        FileKind::Venue,
        FileKind::Calibration,
        FileKind::NetworkCard,
        FileKind::Network,
        FileKind::DetectorCard,
        FileKind::Detector,
    ];
    let file = |kind| SharedFile {
        kind,
        path: "a/b.toml".to_owned(),
        bytes: 300,
        blake3: [7; 32],
    };
    check(
        "file_list",
        &FileList {
            venue: "hall".to_owned(),
            files: kinds.map(file).into(),
        },
    );
    check(
        "signed_list",
        &SignedList {
            list: vec![1, 2],
            signature: Some(ListSignature {
                certificate: vec![3],
                ecdsa: vec![4, 5],
            }),
        },
    );
    check(
        "chunk",
        &Chunk {
            bytes: vec![9, 8, 7],
        },
    );
}

/// Four keypoints on a map of 48 x 64 cells: one peak, two that overlap, a ridge, and nothing.
fn maps() -> Maps {
    let mut maps = Maps::new(48, 64, 4);
    let peaks: [&[[f32; 4]]; 3] = [
        &[[24.2, 9.1, 1.6, 0.93]],
        &[[30.3, 16.4, 1.8, 0.71], [33.9, 19.2, 2.2, 0.42]],
        &[
            [20.0, 50.0, 1.5, 0.6],
            [22.0, 51.0, 1.5, 0.6],
            [24.5, 52.5, 1.5, 0.55],
        ],
    ];
    for (k, peaks) in peaks.into_iter().enumerate() {
        for (i, cell) in maps.cells_mut(k).iter_mut().enumerate() {
            let [x, y] = [(i % 48) as f32, (i / 48) as f32];
            let value = peaks.iter().map(|&[px, py, sigma, height]| {
                let squared = (x - px) * (x - px) + (y - py) * (y - py);
                height * libm::expf(-squared / (2.0 * sigma * sigma))
            });
            *cell = quantize(value.fold(0.0, f32::max));
        }
    }
    maps
}

#[test]
fn codec_bytes_and_maps_are_fixed_in_every_version() {
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    for version in OLDEST_READ..=VERSION {
        for level in CompressionLevel::all() {
            let name = format!("patch_level_{}.txt", level.number());
            let mut read = Maps::new(48, 64, 4);
            let mut hash = |bytes: Vec<u8>| {
                let encoded = EncodedMaps {
                    width: 48,
                    height: 64,
                    keypoints: 4,
                    bytes,
                };
                decoder.decode(&encoded, &mut read).unwrap();
                let mut hasher = blake3::Hasher::new();
                for k in 0..4 {
                    hasher.update(read.cells(k));
                }
                hasher.finalize().to_hex().to_string()
            };
            let today = is_written(version).then(|| {
                let bytes = encoder.encode(&maps(), level).bytes;
                format!("{}\n{}", hex(&bytes), hash(bytes))
            });
            let kept = golden(version, &name, today.as_deref());
            let (kept_bytes, kept_hash) = kept.trim().split_once('\n').unwrap();
            assert_eq!(
                hash(bytes_of(kept_bytes)),
                kept_hash,
                "{name} of version {version} is decoded to other maps"
            );
            if let Some(today) = today {
                assert_eq!(
                    today,
                    kept.trim(),
                    "{name} of version {version}: a change needs a new VERSION"
                );
            }
        }
    }
}
