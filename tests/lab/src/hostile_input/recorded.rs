//! Files that programs write: recordings, segments of a ring, maps.

use std::io::Cursor;
use std::sync::{Arc, LazyLock};

use farfield_edge::ring::record::{put_record, record_at, records, segment_head, segment_number};
use farfield_edge::source::MapPainter;
use farfield_fusion::recording::reader::Recording;
use farfield_proto::camera::CameraModel;
use farfield_sim::embedded;
use farfield_sim::maps_file::MapsFile;

use super::{refused, size};

/// Recordings of any content: read to their end or to a fault.
pub(super) fn recording_file(bytes: &[u8]) -> String {
    let mut recording = match Recording::open(Cursor::new(bytes)) {
        Ok(recording) => recording,
        Err(error) => return refused(&error),
    };
    let mut n_sets = 0;
    let sessions = recording.sessions().to_vec();
    for part in &sessions {
        for tick in part.ticks {
            let sets = recording.sets(part.session, tick);
            let poses = recording.poses(part.session, tick);
            assert!(
                sets.is_ok() && poses.is_ok(),
                "an entry of the index cannot be read"
            );
            n_sets += sets.map_or(0, |sets| sets.len());
        }
    }
    let unreadable = size(usize::try_from(recording.unreadable()).unwrap_or(usize::MAX));
    format!(
        "read, whole {}, {} sessions, {} sets, {unreadable} unreadable",
        recording.end().whole,
        size(sessions.len()),
        size(n_sets),
    )
}

/// Segments of an edge's ring of any content: the complete records up to the first torn one.
pub(super) fn ring_segment(bytes: &[u8]) -> String {
    let (found, end) = records(bytes);
    assert!(end <= bytes.len());
    let mut again = segment_head(segment_number(bytes).unwrap_or(0)).to_vec();
    for record in &found {
        assert_eq!(record_at(bytes, record.at), Some(*record));
        put_record(record.label, record.message, &mut again);
    }
    let (same, _) = records(&again);
    assert_eq!(same.len(), found.len());
    let mut pairs = same.iter().zip(&found);
    assert!(pairs.all(|(a, b)| (a.label, a.message) == (b.label, b.message)));
    let torn = end < bytes.len();
    format!("{} records, torn {torn}", size(found.len()))
}

/// Files of maps: read or refused. Head and checksum are made valid, so that the content is reached.
pub(super) fn maps_file(rest: &[u8]) -> String {
    const MAGIC: &[u8] = b"FARFIELD-MAPS\0\x01";
    static CAMERA: LazyLock<Arc<CameraModel>> = LazyLock::new(|| {
        let scene = embedded::scene("court").expect("an embedded scene can be read");
        Arc::new(scene.cameras()[0].clone())
    });
    let mut bytes = [MAGIC, rest].concat();
    let checksum = blake3::hash(&bytes);
    bytes.extend_from_slice(checksum.as_bytes());
    let file = match MapsFile::parse(bytes) {
        Ok(file) => file,
        Err(error) => return refused(&error),
    };
    let mut behaviour = "read".to_owned();
    for tick in 0..u64::from(file.header().ticks).min(4) {
        behaviour += match file.observation(tick, &CAMERA) {
            Ok(Some(seen)) => {
                let seen: &dyn MapPainter = &seen;
                assert!(seen.persons().iter().all(|person| person.len() == 17));
                ", seen"
            }
            Ok(None) => ", nothing",
            Err(_) => ", broken",
        };
    }
    behaviour
}
