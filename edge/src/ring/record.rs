//! Encoding of segments and records.

use farfield_proto::id::SessionId;
use farfield_proto::message::fill::SetKind;
use farfield_proto::tick::Tick;
use farfield_proto::wire::MAX_MESSAGE_BYTES;

/// First bytes of a segment.
const MAGIC: &[u8; 8] = b"FFRING1\n";
/// Bytes of a segment before its first record.
pub const SEGMENT_HEAD_BYTES: usize = 16;
/// Bytes of a record before its message.
pub const RECORD_HEAD_BYTES: usize = 25;
/// Bytes of these that the checksum does not cover.
const UNCHECKED_BYTES: usize = 8;

/// Identification of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Label {
    /// The session of fusion that defines the person ids.
    pub session: SessionId,
    /// The tick of the pictures.
    pub tick: Tick,
    /// The kind of the message.
    pub kind: SetKind,
}

/// A record in a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RingRecord<'a> {
    /// Its identification.
    pub label: Label,
    /// The message as transmitted.
    pub message: &'a [u8],
    /// Offset of the record in its segment, bytes.
    pub at: usize,
}

/// The head of the segment with this number.
pub fn segment_head(number: u64) -> [u8; SEGMENT_HEAD_BYTES] {
    let mut head = [0; SEGMENT_HEAD_BYTES];
    head[..8].copy_from_slice(MAGIC);
    head[8..].copy_from_slice(&number.to_le_bytes());
    head
}

/// The number of a segment; `None` if the data are no segment.
pub fn segment_number(segment: &[u8]) -> Option<u64> {
    let (magic, rest) = segment.split_at_checked(8)?;
    let number = rest.first_chunk().copied().map(u64::from_le_bytes);
    number.filter(|_| magic == MAGIC)
}

/// Appends a record to `bytes`.
pub fn put_record(label: Label, message: &[u8], bytes: &mut Vec<u8>) {
    let at = bytes.len();
    bytes.extend_from_slice(&(message.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&[0; 4]);
    bytes.extend_from_slice(&label.session.0.to_le_bytes());
    bytes.extend_from_slice(&label.tick.0.to_le_bytes());
    bytes.push(match label.kind {
        SetKind::Patches => 0,
        SetKind::Sightings => 1,
    });
    bytes.extend_from_slice(message);
    let checksum = crc32fast::hash(&bytes[at + UNCHECKED_BYTES..]);
    bytes[at + 4..at + UNCHECKED_BYTES].copy_from_slice(&checksum.to_le_bytes());
}

/// The complete records of a segment up to the first incomplete one, and the offset of that one.
pub fn records(segment: &[u8]) -> (Vec<RingRecord<'_>>, usize) {
    let (mut found, mut at) = (Vec::new(), SEGMENT_HEAD_BYTES);
    while let Some(record) = record_at(segment, at) {
        at += RECORD_HEAD_BYTES + record.message.len();
        found.push(record);
    }
    (found, at.min(segment.len()))
}

/// The record at `at`; `None` if it is incomplete or missing.
pub fn record_at(segment: &[u8], at: usize) -> Option<RingRecord<'_>> {
    let rest = segment.get(at..)?;
    let (len, rest) = rest.split_first_chunk()?;
    let (checksum, rest) = rest.split_first_chunk()?;
    let len = u32::from_le_bytes(*len) as usize;
    if len > MAX_MESSAGE_BYTES {
        return None;
    }
    let checked = rest.get(..RECORD_HEAD_BYTES - UNCHECKED_BYTES + len)?;
    if crc32fast::hash(checked) != u32::from_le_bytes(*checksum) {
        return None;
    }
    let (session, checked) = checked.split_first_chunk()?;
    let (tick, checked) = checked.split_first_chunk()?;
    let (kind, message) = checked.split_first()?;
    let kind = match kind {
        0 => SetKind::Patches,
        1 => SetKind::Sightings,
        _ => return None,
    };
    let label = Label {
        session: SessionId(u64::from_le_bytes(*session)),
        tick: Tick(i64::from_le_bytes(*tick)),
        kind,
    };
    Some(RingRecord { label, message, at })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn label(session: u64, tick: i64, patches: bool) -> Label {
        Label {
            session: SessionId(session),
            tick: Tick(tick),
            kind: if patches {
                SetKind::Patches
            } else {
                SetKind::Sightings
            },
        }
    }

    fn segment(messages: &[(u64, i64, bool, Vec<u8>)]) -> Vec<u8> {
        let mut bytes = segment_head(3).to_vec();
        for (session, tick, patches, message) in messages {
            put_record(label(*session, *tick, *patches), message, &mut bytes);
        }
        bytes
    }

    proptest! {
        #[test]
        fn every_record_comes_back_and_a_torn_one_ends_the_segment(
            messages in prop::collection::vec((any::<u64>(), any::<i64>(), any::<bool>(), any::<Vec<u8>>()), 0..8),
            cut in any::<prop::sample::Index>(),
        ) {
            let bytes = segment(&messages);
            prop_assert_eq!(segment_number(&bytes), Some(3));
            let (found, end) = records(&bytes);
            prop_assert_eq!(end, bytes.len());
            prop_assert_eq!(found.len(), messages.len());
            for (record, (session, tick, patches, message)) in found.iter().zip(&messages) {
                prop_assert_eq!(record.label, label(*session, *tick, *patches));
                prop_assert_eq!(record.message, &message[..]);
            }
            let cut = cut.index(bytes.len());
            let (whole, end) = records(&bytes[..cut]);
            prop_assert_eq!(&whole[..], &found[..whole.len()]);
            prop_assert!(end <= cut && (whole.len() < found.len() || found.is_empty()));
        }

        #[test]
        fn a_changed_byte_ends_the_segment_before_its_record(
            messages in prop::collection::vec((any::<u64>(), any::<i64>(), any::<bool>(), any::<Vec<u8>>()), 1..8),
            at in any::<prop::sample::Index>(),
            change in 1u8..,
        ) {
            let mut bytes = segment(&messages);
            let at = SEGMENT_HEAD_BYTES + at.index(bytes.len() - SEGMENT_HEAD_BYTES);
            bytes[at] ^= change;
            prop_assert!(records(&bytes).1 <= at);
        }

        #[test]
        fn no_bytes_panic_the_reader(bytes in any::<Vec<u8>>()) {
            let (found, end) = records(&bytes);
            prop_assert!(end <= bytes.len() && found.len() <= bytes.len());
            drop((segment_number(&bytes), records(&[&segment_head(1), &bytes[..]].concat())));
        }
    }
}
