//! Recordings with changed records and chunks: compressed, cut, reordered, and with false lengths.

use std::collections::BTreeMap;
use std::io::{Cursor, Read as _, Write as _};

use mcap::records::{Metadata, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::compression::CompressionFormat;
use super::framing::FramingError;
use super::messages::MessagesInTime;
use super::published::published;
use super::reader::RecordingError;
use super::tests::{in_all_forms, open, recording};
use super::{FACTS, PROFILE, VENUE_FILE};

/// `bytes` compressed.
pub(super) fn pack(format: CompressionFormat, bytes: &[u8]) -> Vec<u8> {
    match format {
        CompressionFormat::Lz4 => {
            let mut frame = lz4_flex::frame::FrameEncoder::new(Vec::new());
            frame.write_all(bytes).unwrap();
            frame.finish().unwrap()
        }
        CompressionFormat::Zstd => {
            let level = ruzstd::encoding::CompressionLevel::Fastest;
            ruzstd::encoding::compress_to_vec(bytes, level)
        }
    }
}

/// A recording with the body of each top-level record replaced.
fn rewritten(bytes: &[u8], mut body: impl FnMut(u8, &[u8]) -> Vec<u8>) -> Vec<u8> {
    let options = LinearReaderOptions::default().with_emit_chunks(true);
    let mut reader = LinearReader::new_with_options(options);
    let (mut file, mut written) = (bytes, mcap::MAGIC.to_vec());
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            LinearReadEvent::ReadRequest(n) => {
                file.read_exact(&mut reader.insert(n)[..n]).unwrap();
                reader.notify_read(n);
            }
            LinearReadEvent::Record { data, opcode } => {
                let body = body(opcode, data);
                written.push(opcode);
                written.extend((body.len() as u64).to_le_bytes());
                written.extend(body);
            }
        }
    }
    [written.as_slice(), mcap::MAGIC].concat()
}

/// The recording with its chunks compressed, as another tool does it.
pub(super) fn compressed(bytes: &[u8], format: CompressionFormat) -> Vec<u8> {
    rewritten(bytes, |opcode, body| {
        match mcap::parse_record(opcode, body) {
            Ok(Record::Chunk { data, .. }) => {
                let name = [&b"lz4"[..], b"zstd"][format as usize];
                let packed = pack(format, &data);
                // Times, size and checksum do not change.
                let mut body = body[..28].to_vec();
                body.extend((name.len() as u32).to_le_bytes());
                body.extend(name);
                body.extend((packed.len() as u64).to_le_bytes());
                body.extend(packed);
                body
            }
            _ => body.to_vec(),
        }
    })
}

/// The recording as rewritten by another tool: messages first, then the attached file and the
/// metadata.
fn with_metadata_last() -> Vec<u8> {
    let bytes = recording();
    let options = mcap::WriteOptions::new().profile(PROFILE).compression(None);
    let mut written = Cursor::new(Vec::new());
    let mut writer = options.create(&mut written).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        writer.write(&message.unwrap()).unwrap();
    }
    let ours = open(&bytes).unwrap();
    let venue = ours.file(VENUE_FILE).unwrap().as_bytes();
    writer
        .attach(&mcap::Attachment {
            log_time: 5,
            create_time: 5,
            name: VENUE_FILE.to_owned(),
            media_type: "application/toml".to_owned(),
            data: venue.into(),
        })
        .unwrap();
    let others = BTreeMap::from([("venue".to_owned(), "x".to_owned())]);
    for (name, metadata) in [("another tool", others), (FACTS, ours.facts().clone())] {
        let name = name.to_owned();
        writer.write_metadata(&Metadata { name, metadata }).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    written.into_inner()
}

#[test]
fn metadata_after_the_messages_are_read() {
    let plain = with_metadata_last();
    let [lz4, zstd] =
        [CompressionFormat::Lz4, CompressionFormat::Zstd].map(|it| compressed(&plain, it));
    let ours = recording();
    let expected = open(&ours).unwrap();
    for bytes in [plain, lz4, zstd] {
        let found = open(&bytes).unwrap();
        assert_eq!(found.facts(), expected.facts());
        assert_eq!(found.file(VENUE_FILE), expected.file(VENUE_FILE));
        assert_eq!(found.sessions(), expected.sessions());
        assert!(found.end().whole && found.unreadable() == 0);
        let mut poses = Vec::new();
        let read = published(&mut Cursor::new(&bytes), &mut |set| poses.push(set.tick.0));
        assert_eq!(read.unwrap().sessions[0].n, 3);
        assert_eq!(poses, [0, 1, 2]);
        let mut n_messages = 0;
        let mut in_time = MessagesInTime::open(Cursor::new(&bytes)).unwrap();
        in_time.read(0..9, &mut |_, _, _| n_messages += 1).unwrap();
        // Six sets, one of them filled, and for three ticks the decision, the poses, and the poses
        // as JSON.
        assert_eq!(n_messages, 6 + 9);
    }
}

#[test]
fn a_file_that_ends_before_its_metadata_is_no_recording_yet() {
    let bytes = with_metadata_last();
    // The names of the viewpoints, which only the facts have.
    let within = bytes.windows(5).position(|it| it == b"ne sw").unwrap();
    let refused = open(&bytes[..within]).err().unwrap();
    assert!(matches!(refused, RecordingError::NoHead), "{refused}");
}

#[test]
fn a_compressed_chunk_with_a_wrong_checksum_is_skipped_and_counted() {
    for format in [CompressionFormat::Lz4, CompressionFormat::Zstd] {
        let mut chunks = 0;
        let bytes = rewritten(&compressed(&recording(), format), |opcode, body| {
            let mut body = body.to_vec();
            chunks += u32::from(opcode == op::CHUNK);
            if opcode == op::CHUNK && chunks == 3 {
                body[24] ^= 1;
            }
            body
        });
        let recording = open(&bytes).unwrap();
        assert_eq!(recording.end().damaged_chunks, 1);
        assert_eq!(recording.sessions()[0].decisions.len(), 2);
    }
}

/// The error for a recording whose chunks were edited by `change`.
fn refused_with(bytes: &[u8], change: impl Fn(&mut Vec<u8>)) -> RecordingError {
    let bytes = rewritten(bytes, |opcode, body| {
        let mut body = body.to_vec();
        if opcode == op::CHUNK {
            change(&mut body);
        }
        body
    });
    open(&bytes).err().unwrap()
}

/// The problem of a damaged file.
fn damage(error: &RecordingError) -> Option<&'static str> {
    match error {
        RecordingError::Framing(FramingError::Damaged { problem, .. }) => Some(problem),
        _ => None,
    }
}

#[test]
fn a_chunk_that_is_too_large_is_refused_before_decompression() {
    for bytes in in_all_forms() {
        let refused = refused_with(&bytes, |body| body[16..24].fill(0x7f));
        assert_eq!(damage(&refused), Some("a chunk that unpacks to too much"));
    }
}

#[test]
fn a_chunk_with_a_false_size_is_refused() {
    for bytes in in_all_forms() {
        // Without a checksum only the length reveals it.
        let refused = refused_with(&bytes, |body| {
            body[17] += 1;
            body[24..28].fill(0);
        });
        assert_eq!(damage(&refused), Some("a broken chunk"));
    }
}

#[test]
fn an_unknown_compression_is_reported() {
    let lz4 = &in_all_forms()[1];
    let refused = refused_with(lz4, |body| body[32..35].copy_from_slice(b"xz5"));
    assert!(
        matches!(&refused, RecordingError::Framing(FramingError::Compressed(name)) if name == "xz5"),
        "{refused}"
    );
}

#[test]
fn a_text_longer_than_its_record_is_refused() {
    for (wanted, at) in [
        (op::HEADER, 0),
        (op::ATTACHMENT, 16),
        (op::METADATA, 0),
        (op::CHUNK, 28),
    ] {
        let bytes = rewritten(&recording(), |opcode, body| {
            let mut body = body.to_vec();
            if opcode == wanted {
                body[at..at + 4].fill(0xff);
            }
            body
        });
        let refused = open(&bytes).err().unwrap();
        let is_broken = damage(&refused).is_some_and(|problem| problem.starts_with("a broken"));
        assert!(is_broken, "{wanted}: {refused}");
    }
}

#[test]
fn an_attached_file_must_be_complete() {
    let change = |change: fn(&mut Vec<u8>)| {
        rewritten(&recording(), |opcode, body| {
            let mut body = body.to_vec();
            if opcode == op::ATTACHMENT {
                change(&mut body);
            }
            body
        })
    };
    let other = change(|body| *body.iter_mut().rev().nth(8).unwrap() ^= 1);
    let recording = open(&other).unwrap();
    assert_eq!(recording.end().damaged_chunks, 1);
    assert_eq!(recording.file(VENUE_FILE), None);
    let short = change(|body| body.truncate(body.len() - 16));
    let refused = open(&short).err().unwrap();
    assert_eq!(damage(&refused), Some("a broken record"));
}

#[test]
fn a_foreign_record_that_is_too_long_is_skipped() {
    let bytes = rewritten(&recording(), |_, body| body.to_vec());
    let at = mcap::MAGIC.len();
    let mut long = vec![0xfe];
    long.extend((65u64 << 20).to_le_bytes());
    long.resize(9 + (65 << 20), 0);
    let with = [&bytes[..at], &long, &bytes[at..]].concat();
    let recording = open(&with).unwrap();
    assert!(recording.end().whole);
    assert_eq!(recording.sessions()[0].decisions.len(), 3);
    assert!(matches!(
        open(&with[..with.len() / 2]).err().unwrap(),
        RecordingError::NoHead
    ));
}
