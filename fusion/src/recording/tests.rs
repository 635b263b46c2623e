//! Recordings, written and read in memory: complete, torn, damaged and forged.

use std::collections::BTreeMap;
use std::io::{self, Cursor, Write};

use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::decision::{Decision, UsedSet};
use farfield_proto::message::live::{LiveBoxes, PatchTiming};
use farfield_proto::message::{BoxSet, Order, PatchSet, PersonState, PoseSet, SightingSet};
use farfield_proto::tick::Tick;
use farfield_proto::wire::{self, Message};
use proptest::prelude::*;

use super::chunk_tests::compressed;
use super::compression::CompressionFormat;
use super::framing::FramingError;
use super::messages::MessagesInTime;
use super::reader::{AnySet, Recording, RecordingError};
use super::writer::{Head, PassedMessage, RecordingWriter};
use super::*;
use crate::export::fixture;

const SESSION: SessionId = SessionId(1 << 63);

fn head() -> Head {
    let facts = [("venue", "hall"), ("viewpoints", "ne sw")];
    Head {
        venue: "hall".to_owned(),
        viewpoints: vec!["ne".to_owned(), "sw".to_owned()],
        rate_hz: 50.0,
        started_ns: 5,
        files: vec![(VENUE_FILE.to_owned(), b"name = \"hall\"\n".to_vec())],
        facts: BTreeMap::from(facts.map(|(k, v)| (k.to_owned(), v.to_owned()))),
        json_poses: Some(fixture::layout()),
    }
}

fn patches(tick: i64, viewpoint: u16) -> PatchSet {
    PatchSet {
        session: SESSION,
        tick: Tick(tick),
        viewpoint: ViewpointIndex(viewpoint),
        part: 0,
        parts: 1,
        sighting_parts: 0,
        timing: None,
        persons: Vec::new(),
    }
}

fn decision(tick: i64, viewpoints: &[u16]) -> Decision {
    let used = |&viewpoint| UsedSet {
        viewpoint: ViewpointIndex(viewpoint),
        part: 0,
    };
    Decision {
        session: SESSION,
        first: Tick(0),
        tick: Tick(tick),
        horizons_ticks: Vec::new(),
        patches: viewpoints.iter().map(used).collect(),
        sightings: Vec::new(),
    }
}

fn poses(tick: i64) -> PoseSet {
    PoseSet {
        session: SESSION,
        tick: Tick(tick),
        persons: vec![fixture::pose(1, PersonState::Tracked)],
    }
}

fn put<W: Write, M: Message>(writer: &mut RecordingWriter<W>, topic: &str, message: &M) {
    let bytes = wire::encode(message);
    let passed = PassedMessage {
        topic,
        bytes: &bytes,
        log_ns: 1_000,
    };
    assert!(writer.write(&passed).unwrap().is_some(), "{topic}");
}

/// Three ticks in a chunk each; in the second, `sw` was late, in the third it was filled.
pub(super) fn recording() -> Vec<u8> {
    let mut writer = RecordingWriter::create(Vec::new(), head()).unwrap();
    for tick in 0..3 {
        put(&mut writer, "hall/patch/ne", &patches(tick, 0));
        if tick == 0 {
            put(&mut writer, "hall/patch/sw", &patches(tick, 1));
        }
        let there: &[u16] = if tick == 0 { &[0, 1] } else { &[0] };
        put(&mut writer, "hall/decision", &decision(tick, there));
        put(&mut writer, "hall/pose", &poses(tick));
        if tick == 1 {
            put(&mut writer, "hall/patch/sw", &patches(tick, 1));
        }
        writer.flush().unwrap();
    }
    put(&mut writer, "hall/fill/sw/patch", &patches(2, 1));
    writer.finish().unwrap()
}

/// The same recording as written, and with compressed chunks.
pub(super) fn in_all_forms() -> [Vec<u8>; 3] {
    let plain = recording();
    let [lz4, zstd] =
        [CompressionFormat::Lz4, CompressionFormat::Zstd].map(|format| compressed(&plain, format));
    [plain, lz4, zstd]
}

pub(super) fn open(bytes: &[u8]) -> Result<Recording<Cursor<&[u8]>>, RecordingError> {
    Recording::open(Cursor::new(bytes))
}

#[test]
fn a_written_recording_is_read() {
    for bytes in in_all_forms() {
        let mut recording = open(&bytes).unwrap();
        assert!(recording.end().whole && recording.unreadable() == 0);
        assert_eq!(recording.end().damaged_chunks, 0);
        assert_eq!(recording.file(VENUE_FILE), Some("name = \"hall\"\n"));
        let part = recording.sessions()[0].clone();
        assert_eq!((part.sets, part.filled), (6, 1));
        assert_eq!(part.decisions[1], decision(1, &[0]));
        for tick in [0, 2, 1] {
            let sets = recording.sets(SESSION, Tick(tick)).unwrap();
            let expected = [0, 1].map(|viewpoint| AnySet::Patches(patches(tick, viewpoint)));
            assert_eq!(sets, expected);
            let published = recording.poses(SESSION, Tick(tick)).unwrap();
            assert_eq!(published, Some(poses(tick)));
        }
    }
}

#[test]
fn other_readers_of_mcap_find_the_messages_and_the_json() {
    let bytes = recording();
    let messages: Vec<mcap::Message<'_>> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .collect::<Result<_, _>>()
        .unwrap();
    let of = |topic: &str| -> Vec<&mcap::Message<'_>> {
        let messages = messages.iter();
        messages.filter(|m| m.channel.topic == topic).collect()
    };
    assert_eq!(of("hall/patch/ne").len(), 3);
    assert_eq!(
        of("hall/patch/ne")[0].channel.message_encoding,
        WIRE_ENCODING
    );
    let json = of("hall/pose/json");
    assert_eq!(json.len(), 3);
    let schema = json[0].channel.schema.as_ref().unwrap();
    assert_eq!(schema.encoding, "jsonschema");
    let value: serde_json::Value = serde_json::from_slice(&json[2].data).unwrap();
    assert_eq!(value["persons"][0]["person"], 1);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.attachment_indexes.len(), 1);
}

#[test]
fn patches_are_stamped_with_their_sending() {
    let mut writer = RecordingWriter::create(Vec::new(), head()).unwrap();
    let boxes = BoxSet {
        session: SESSION,
        tick: Tick(0),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        order: Order::Track,
        live: Some(LiveBoxes {
            sequence: 0,
            epoch_us: 7_000_000,
            clock_correction_us: None,
            heard: None,
            every_nth_tick: 2,
        }),
        detection_cameras: Vec::new(),
        persons: Vec::new(),
    };
    put(&mut writer, "hall/box/ne", &boxes);
    let sent = PatchSet {
        timing: Some(PatchTiming {
            sent_after_us: 30_000,
            clock_correction_us: 0,
            echo: None,
        }),
        ..patches(100, 0)
    };
    put(&mut writer, "hall/patch/ne", &sent);
    let bytes = writer.finish().unwrap();
    let last = mcap::MessageStream::new(&bytes).unwrap().last();
    // 7 s, 100 ticks at 50 Hz, 30 ms.
    assert_eq!(last.unwrap().unwrap().publish_time, 9_030_000_000);
}

#[test]
fn an_unknown_key_is_not_recorded() {
    let mut writer = RecordingWriter::create(Vec::new(), head()).unwrap();
    let passed = PassedMessage {
        topic: "hall/patch/stranger",
        bytes: b"x",
        log_ns: 0,
    };
    assert_eq!(writer.write(&passed).unwrap(), None);
}

#[test]
fn a_torn_file_is_read_up_to_its_last_complete_chunk() {
    for bytes in in_all_forms() {
        let mut ticks = Vec::new();
        for len in 0..bytes.len() {
            match open(&bytes[..len]) {
                Ok(recording) => {
                    let sessions = recording.sessions();
                    assert!(!recording.end().whole || len + mcap::MAGIC.len() >= bytes.len());
                    assert!(recording.end().read_bytes <= len as u64);
                    ticks.push(sessions.first().map_or(0, |part| part.decisions.len()));
                }
                Err(error) => {
                    let early = matches!(
                        error,
                        RecordingError::NoHead | RecordingError::Framing(FramingError::NotMcap)
                    );
                    assert!(early && ticks.is_empty(), "{len} bytes: {error}");
                }
            }
        }
        assert!(ticks.is_sorted(), "more bytes never hold fewer ticks");
        ticks.dedup();
        assert_eq!(ticks, [0, 1, 2, 3]);
    }
}

#[test]
fn a_chunk_with_a_wrong_checksum_is_skipped_and_counted() {
    let mut bytes = recording();
    // In the pose of the second tick, as the first byte that differs between ticks 1 and 2 would
    // be.
    let needle = wire::encode(&poses(1));
    let at = bytes
        .windows(needle.len())
        .position(|w| w == needle)
        .unwrap();
    bytes[at + needle.len() - 1] ^= 1;
    let recording = open(&bytes).unwrap();
    assert_eq!(recording.end().damaged_chunks, 1);
    let decisions = &recording.sessions()[0].decisions;
    assert_eq!(decisions.len(), 2);
}

#[test]
fn foreign_files_are_reported() {
    let refused = |bytes: &[u8]| open(bytes).err().unwrap();
    for bytes in [&b""[..], &[b'x'; 4000]] {
        let error = refused(bytes);
        assert!(
            matches!(error, RecordingError::Framing(FramingError::NotMcap)),
            "{error}"
        );
    }
    let options = mcap::WriteOptions::new().profile("ros2").compression(None);
    let mut foreign = Cursor::new(Vec::new());
    options.create(&mut foreign).unwrap().finish().unwrap();
    let error = refused(foreign.get_ref());
    assert!(
        matches!(&error, RecordingError::Foreign(profile) if profile == "ros2"),
        "{error}"
    );
}

#[test]
fn two_sessions_of_fusion_are_separated() {
    let mut writer = RecordingWriter::create(Vec::new(), head()).unwrap();
    let second = SessionId(7);
    put(&mut writer, "hall/patch/ne", &patches(1, 0));
    for tick in [2, 3] {
        let set = PatchSet {
            session: second,
            ..patches(tick, 0)
        };
        put(&mut writer, "hall/patch/ne", &set);
    }
    let sightings = SightingSet {
        session: second,
        tick: Tick(3),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        sightings: Vec::new(),
    };
    put(&mut writer, "hall/sighting/ne", &sightings);
    let bytes = writer.finish().unwrap();
    let mut recording = open(&bytes).unwrap();
    let parts: Vec<_> = recording
        .sessions()
        .iter()
        .map(|p| (p.session, p.sets))
        .collect();
    assert_eq!(parts, [(second, 3), (SESSION, 1)]);
    assert_eq!(recording.sets(second, Tick(3)).unwrap().len(), 2);
    assert!(recording.sets(SESSION, Tick(3)).unwrap().is_empty());
}

/// Accepts this many bytes, like a full disk.
struct Disk {
    left: usize,
    written: Vec<u8>,
}

impl Write for &mut Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(self.left);
        if taken == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.left -= taken;
        self.written.extend_from_slice(&bytes[..taken]);
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_and_earlier_data_is_readable() {
    let whole = recording().len();
    let mut disk = Disk {
        left: 3 * whole,
        written: Vec::new(),
    };
    let mut writer = RecordingWriter::create(&mut disk, head()).unwrap();
    let mut written = Ok(());
    for tick in 0.. {
        let bytes = wire::encode(&decision(tick, &[0]));
        let passed = PassedMessage {
            topic: "hall/decision",
            bytes: &bytes,
            log_ns: 0,
        };
        written = writer.write(&passed).and_then(|_content| writer.flush());
        if written.is_err() {
            break;
        }
    }
    assert_eq!(written.unwrap_err().kind(), io::ErrorKind::StorageFull);
    assert!(writer.finish().is_err(), "and it stays one");
    let recording = open(&disk.written).unwrap();
    assert!(recording.sessions()[0].decisions.len() > 3);
}

proptest! {
    #[test]
    fn no_bytes_panic_the_reader(bytes in any::<Vec<u8>>()) {
        drop(open(&bytes));
        drop(open(&[mcap::MAGIC, &bytes[..]].concat()));
    }

    #[test]
    fn no_change_of_a_recording_panics_the_reader(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        form in 0usize..3,
    ) {
        let mut bytes = in_all_forms()[form].clone();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(mut recording) = open(&bytes) {
            let parts = recording.sessions().to_vec();
            for part in parts {
                drop(recording.sets(part.session, part.ticks[0]));
            }
        }
    }

    #[test]
    fn every_set_is_read_in_any_order(
        ticks in prop::collection::btree_set((-1_000_000_000_000i64..1_000_000_000_000, 0u16..2), 1..40),
        seed in any::<u64>(),
    ) {
        let mut order: Vec<(i64, u16)> = ticks.into_iter().collect();
        let n = order.len();
        order.rotate_left(seed as usize % n);
        let mut writer = RecordingWriter::create(Vec::new(), head()).unwrap();
        for &(tick, viewpoint) in &order {
            let topic = ["hall/patch/ne", "hall/patch/sw"][usize::from(viewpoint)];
            put(&mut writer, topic, &patches(tick, viewpoint));
        }
        let bytes = writer.finish().unwrap();
        let mut recording = open(&bytes).unwrap();
        prop_assert_eq!(recording.sessions()[0].sets, n);
        for (tick, viewpoint) in order {
            let sets = recording.sets(SESSION, Tick(tick)).unwrap();
            prop_assert!(sets.contains(&AnySet::Patches(patches(tick, viewpoint))));
        }
    }
}

#[test]
fn messages_come_in_order_of_time_from_any_file() {
    for bytes in in_all_forms() {
        let mut messages = MessagesInTime::open(Cursor::new(bytes.as_slice())).unwrap();
        assert_eq!(
            messages.attached().file(VENUE_FILE),
            Some("name = \"hall\"\n")
        );
        assert_eq!(messages.span_us(), Some([1, 1]));
        let mut passed = Vec::new();
        let mut visit = |key: &str, bytes: &[u8], at_us| {
            if key == "hall/pose" {
                passed.push((wire::decode::<PoseSet>(bytes).unwrap(), at_us));
            }
        };
        messages.read(1..2, &mut visit).unwrap();
        messages.read(2..9, &mut visit).unwrap();
        assert_eq!(passed, [0, 1, 2].map(|tick| (poses(tick), 1)));
    }
}

#[test]
fn a_foreign_file_has_no_messages() {
    let refused = MessagesInTime::open(Cursor::new(b"no MCAP file at all".as_slice()));
    assert!(refused.is_err());
    let bytes = recording();
    for length in (0..bytes.len()).step_by(97) {
        let cut = MessagesInTime::open(Cursor::new(&bytes[..length]));
        if let Ok(mut cut) = cut {
            cut.read(0..9, &mut |_, _, _| {}).unwrap();
        }
    }
}

#[test]
fn published_poses_are_read_once_with_the_longest_session_first() {
    let mut file = Vec::new();
    let mut writer = RecordingWriter::create(&mut file, head()).unwrap();
    let other = |tick| PoseSet {
        session: SessionId(7),
        ..poses(tick)
    };
    for set in [
        other(100),
        poses(1),
        poses(2),
        poses(2),
        poses(1),
        other(101),
        poses(4),
    ] {
        put(&mut writer, "hall/pose", &set);
    }
    put(&mut writer, "hall/smooth", &poses(5));
    writer.finish().unwrap();
    let mut seen = Vec::new();
    let published = super::published::published(&mut Cursor::new(&file), &mut |set| seen.push(set));
    let published = published.unwrap();
    assert_eq!(seen, [other(100), poses(1), poses(2), other(101), poses(4)]);
    let ticks: Vec<_> = published
        .sessions
        .iter()
        .map(|it| (it.session, it.span.map(|tick| tick.0), it.n))
        .collect();
    assert_eq!(ticks, [(SESSION, [1, 4], 3), (SessionId(7), [100, 101], 2)]);
    assert!(published.end.whole && published.attached.file(VENUE_FILE).is_some());
}
