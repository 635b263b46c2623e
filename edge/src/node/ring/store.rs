//! Storage of the segments as files.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use farfield_proto::message::fill::{FillRequest, Filled, StoredSet};
use tracing::warn;

use crate::ring::index::RingIndex;
use crate::ring::record::{
    Label, RECORD_HEAD_BYTES, SEGMENT_HEAD_BYTES, put_record, record_at, records, segment_head,
    segment_number,
};

/// Segments per ring. If the newest is full, the oldest is overwritten.
const SEGMENTS: usize = 8;
/// Most records per segment: bounds the index in memory if sets are small.
const MAX_RECORDS: usize = 1 << 14;
/// Lock file: only one process uses the ring.
const LOCK: &str = "ring.lock";

/// Result of storing a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stored {
    /// The message was stored.
    Kept,
    /// The message is larger than a segment, so a ring of this size cannot store it.
    TooLarge,
}

/// A ring on disk.
pub(super) struct Ring {
    segments: Vec<RingSegment>,
    segment_bytes: u64,
    /// The segment being written.
    current: usize,
    index: RingIndex,
    /// Torn records found when the ring was opened: at most one per killed process.
    pub(super) torn: u64,
    buffer: Vec<u8>,
    /// Held until the process ends.
    _lock: File,
}

/// One file of the ring.
struct RingSegment {
    file: File,
    number: u64,
    bytes: u64,
    records: usize,
}

impl Ring {
    /// Opens or creates the ring in `folder`, with at most `bytes` on disk.
    ///
    /// # Errors
    /// If the folder or a file cannot be created or read, or another process uses the ring.
    pub(super) fn open(folder: &Path, bytes: u64) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let lock = open_file(&folder.join(LOCK))?;
        lock.try_lock().map_err(io::Error::from)?;
        let segment_bytes = (bytes / SEGMENTS as u64).max(SEGMENT_HEAD_BYTES as u64);
        let mut this = Self {
            segments: Vec::with_capacity(SEGMENTS),
            segment_bytes,
            current: 0,
            index: RingIndex::default(),
            torn: 0,
            buffer: Vec::new(),
            _lock: lock,
        };
        for i in 0..SEGMENTS {
            let segment = this.open_segment(&path(folder, i), i)?;
            this.segments.push(segment);
        }
        let newest = this.segments.iter().enumerate();
        this.current = newest.max_by_key(|(_, s)| s.number).map_or(0, |(i, _)| i);
        Ok(this)
    }

    /// Number of stored records.
    pub(super) fn len(&self) -> usize {
        self.index.len()
    }

    /// Stores a message; the oldest ones are overwritten.
    ///
    /// # Errors
    /// If it cannot be written. The ring is unchanged, and later messages may succeed.
    pub(super) fn store(&mut self, label: Label, message: &[u8]) -> io::Result<Stored> {
        let mut record = std::mem::take(&mut self.buffer);
        record.clear();
        put_record(label, message, &mut record);
        let stored = self.append(label, &record);
        self.buffer = record;
        stored
    }

    /// The stored messages of the requested ticks, without unreadable ones.
    pub(super) fn answer(&mut self, request: &FillRequest) -> Filled {
        let found = self.index.find(request);
        let mut stored = Vec::with_capacity(found.places.len());
        for place in found.places {
            let Some(segment) = self.segments.get(place.segment) else {
                continue;
            };
            self.buffer.resize(RECORD_HEAD_BYTES + place.len, 0);
            if let Err(error) = segment.file.read_exact_at(&mut self.buffer, place.at) {
                warn!(%error, "a set cannot be read from the ring");
                continue;
            }
            // A disk can also lose data.
            if let Some(record) = record_at(&self.buffer, 0) {
                stored.push(StoredSet {
                    kind: record.label.kind,
                    bytes: record.message.to_owned(),
                });
            }
        }
        Filled {
            to: found.to,
            stored,
        }
    }

    /// For tests: makes writes fail or succeed again.
    #[cfg(test)]
    pub(super) fn refuse_writes(&mut self, folder: &Path, refuse: bool) {
        for (i, segment) in self.segments.iter_mut().enumerate() {
            let opened = OpenOptions::new()
                .read(true)
                .write(!refuse)
                .open(path(folder, i));
            segment.file = opened.unwrap();
        }
    }

    fn open_segment(&mut self, path: &Path, index: usize) -> io::Result<RingSegment> {
        let mut file = open_file(path)?;
        if file.metadata()?.len() > self.segment_bytes {
            // The file comes from a larger ring.
            file.set_len(0)?;
        }
        let content = fs::read(path)?;
        let Some(number) = segment_number(&content) else {
            file.set_len(0)?;
            file.write_all(&segment_head(0))?;
            return Ok(RingSegment {
                file,
                number: 0,
                bytes: SEGMENT_HEAD_BYTES as u64,
                records: 0,
            });
        };
        let (found, end) = records(&content);
        for record in &found {
            self.index.add(record.label, index, record.message.len());
        }
        if end < content.len() {
            self.torn += 1;
            file.set_len(end as u64)?;
        }
        Ok(RingSegment {
            file,
            number,
            bytes: end as u64,
            records: found.len(),
        })
    }

    fn append(&mut self, label: Label, record: &[u8]) -> io::Result<Stored> {
        let len = record.len() as u64;
        if len + SEGMENT_HEAD_BYTES as u64 > self.segment_bytes {
            return Ok(Stored::TooLarge);
        }
        let full = self.segments.get(self.current).is_none_or(|segment| {
            segment.bytes + len > self.segment_bytes || segment.records >= MAX_RECORDS
        });
        if full {
            self.turn()?;
        }
        let current = self.current;
        let segment = self.segments.get_mut(current);
        let segment = segment.ok_or_else(|| io::Error::other("the ring has no segments"))?;
        let at = segment.bytes;
        // At a fixed position: the next write overwrites the rest of a failed one.
        segment.file.write_all_at(record, at)?;
        segment.bytes += len;
        segment.records += 1;
        self.index
            .add(label, current, record.len() - RECORD_HEAD_BYTES);
        Ok(Stored::Kept)
    }

    /// Starts the next segment, over the oldest.
    fn turn(&mut self) -> io::Result<()> {
        let number = self.segments.get(self.current).map_or(0, |s| s.number) + 1;
        let next = (self.current + 1) % SEGMENTS;
        let Some(segment) = self.segments.get_mut(next) else {
            return Ok(());
        };
        self.index.forget(next);
        segment.file.set_len(0)?;
        segment.file.write_all_at(&segment_head(number), 0)?;
        (segment.number, segment.bytes, segment.records) = (number, SEGMENT_HEAD_BYTES as u64, 0);
        self.current = next;
        Ok(())
    }
}

fn path(folder: &Path, segment: usize) -> PathBuf {
    folder.join(format!("ring-{segment}.seg"))
}

/// Opens or creates a file of the ring. Symbolic links are refused, because their targets do not
/// belong to the ring.
fn open_file(path: &Path) -> io::Result<File> {
    if path.is_symlink() {
        let words = format!("{} is a symbolic link: remove it", path.display());
        return Err(io::Error::other(words));
    }
    let mut options = OpenOptions::new();
    options
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::SessionId;
    use farfield_proto::message::fill::{MAX_ANSWER_BYTES, SetKind};
    use farfield_proto::tick::Tick;

    use super::*;

    fn label(tick: i64) -> Label {
        Label {
            session: SessionId(1),
            tick: Tick(tick),
            kind: SetKind::Patches,
        }
    }

    fn message(tick: i64) -> Vec<u8> {
        vec![tick as u8; 200]
    }

    fn stored(ring: &mut Ring, from: i64, to: i64) -> Vec<Vec<u8>> {
        let mut found = Vec::new();
        let mut request = FillRequest {
            session: SessionId(1),
            from: Tick(from),
            to: Tick(to),
            max_bytes: MAX_ANSWER_BYTES,
        };
        while request.from < request.to {
            let filled = ring.answer(&request);
            found.extend(filled.stored.into_iter().map(|set| set.bytes));
            request.from = filled.to;
        }
        found
    }

    fn on_disk(folder: &Path) -> u64 {
        let entries = fs::read_dir(folder).unwrap();
        entries.map(|e| e.unwrap().metadata().unwrap().len()).sum()
    }

    #[test]
    fn the_newest_sets_stay_within_the_limit_of_the_disk() {
        let dir = tempfile::tempdir().unwrap();
        let mut ring = Ring::open(dir.path(), 64 << 10).unwrap();
        for tick in 0..2000 {
            ring.store(label(tick), &message(tick)).unwrap();
            assert!(on_disk(dir.path()) <= 64 << 10);
        }
        let kept = stored(&mut ring, 0, 2000);
        let least = (7 * (8 << 10)) / 225 - 7;
        assert!(kept.len() >= least, "{} of {least}", kept.len());
        let newest: Vec<Vec<u8>> = (2000 - kept.len().cast_signed() as i64..2000)
            .map(message)
            .collect();
        assert_eq!(kept, newest);
    }

    #[test]
    fn an_existing_ring_is_reused_and_a_torn_record_detected() {
        let dir = tempfile::tempdir().unwrap();
        let mut ring = Ring::open(dir.path(), 64 << 10).unwrap();
        for tick in 0..50 {
            ring.store(label(tick), &message(tick)).unwrap();
        }
        let current = path(dir.path(), ring.current);
        drop(ring);
        let file = OpenOptions::new().write(true).open(current).unwrap();
        let len = file.metadata().unwrap().len();
        file.set_len(len - 7).unwrap();
        let mut ring = Ring::open(dir.path(), 64 << 10).unwrap();
        assert_eq!(ring.torn, 1);
        assert_eq!(stored(&mut ring, 0, 50).len(), 49);
        ring.store(label(49), &message(49)).unwrap();
        drop(ring);
        let mut ring = Ring::open(dir.path(), 64 << 10).unwrap();
        assert_eq!((ring.torn, ring.len()), (0, 50));
        let all: Vec<Vec<u8>> = (0..50).map(message).collect();
        assert_eq!(stored(&mut ring, 0, 50), all);
    }

    #[test]
    fn files_that_are_no_segments_are_replaced() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(path(dir.path(), 3), [7; 5000]).unwrap();
        fs::write(path(dir.path(), 4), vec![7; 50_000]).unwrap();
        let mut ring = Ring::open(dir.path(), 64 << 10).unwrap();
        assert_eq!(ring.len(), 0);
        ring.store(label(1), &message(1)).unwrap();
        assert_eq!(stored(&mut ring, 0, 9).len(), 1);
    }

    #[test]
    fn a_symbolic_link_as_a_segment_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let theirs = dir.path().join("theirs");
        fs::write(&theirs, [7; 5000]).unwrap();
        let ring = dir.path().join("ring");
        fs::create_dir(&ring).unwrap();
        std::os::unix::fs::symlink(&theirs, path(&ring, 3)).unwrap();
        let refused = Ring::open(&ring, 64 << 10).err().unwrap().to_string();
        assert!(
            refused.contains("ring-3.seg is a symbolic link"),
            "{refused}"
        );
        assert_eq!(fs::read(&theirs).unwrap(), [7; 5000]);
    }

    #[test]
    fn a_ring_has_one_owner() {
        let dir = tempfile::tempdir().unwrap();
        let first = Ring::open(dir.path(), 64 << 10).unwrap();
        assert!(Ring::open(dir.path(), 64 << 10).is_err());
        drop(first);
        Ring::open(dir.path(), 64 << 10).unwrap();
    }

    #[test]
    fn a_message_that_is_larger_than_a_segment_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let mut ring = Ring::open(dir.path(), 8 << 10).unwrap();
        assert_eq!(ring.store(label(1), &[0; 2000]).unwrap(), Stored::TooLarge);
        assert_eq!(ring.store(label(2), &[0; 500]).unwrap(), Stored::Kept);
    }
}
