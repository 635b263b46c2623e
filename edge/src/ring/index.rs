//! The index of the ring: which sets are stored, and where.

use std::collections::BTreeMap;

use farfield_proto::id::SessionId;
use farfield_proto::message::fill::{FillRequest, MAX_STORED};
use farfield_proto::tick::Tick;
use farfield_proto::wire::MAX_MESSAGE_BYTES;

use super::record::Label;

/// Bytes of an answer beside its messages.
const ANSWER_HEAD_BYTES: usize = 64;
/// Bytes that a message takes in an answer beside its own.
const STORED_HEAD_BYTES: usize = 8;

/// Where a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordLocation {
    /// Position of its segment in the ring.
    pub segment: usize,
    /// Offset in the segment, bytes.
    pub at: u64,
    /// Length of its message, bytes.
    pub len: usize,
}

/// All records by session and tick, in the order in which they were stored.
#[derive(Debug, Default)]
pub struct RingIndex {
    places: BTreeMap<(SessionId, Tick, u64), RecordLocation>,
    next: u64,
}

/// The records that answer a fill request.
#[derive(Debug, PartialEq, Eq)]
pub struct Found {
    /// The records.
    pub places: Vec<RecordLocation>,
    /// The tick after the last that they are about.
    pub to: Tick,
}

impl RingIndex {
    /// Notes a record.
    pub fn add(&mut self, label: Label, place: RecordLocation) {
        self.places
            .insert((label.session, label.tick, self.next), place);
        self.next += 1;
    }

    /// Forgets the records of a segment that is written over.
    pub fn forget(&mut self, segment: usize) {
        self.places.retain(|_, place| place.segment != segment);
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Whole ticks from the request's first, up to its `max_bytes`; at least one tick.
    pub fn find(&self, request: &FillRequest) -> Found {
        let mut found = Found {
            places: Vec::new(),
            to: request.to,
        };
        let most = (request.max_bytes as usize).min(MAX_MESSAGE_BYTES - ANSWER_HEAD_BYTES);
        let (mut bytes, mut whole, mut of_tick) = (0, 0, None);
        let from = (request.session, request.from, 0);
        let to = (request.session, request.to, 0);
        if from >= to {
            return found;
        }
        for (&(_, tick, _), &place) in self.places.range(from..to) {
            if of_tick != Some(tick) {
                whole = found.places.len();
            }
            let is_first_tick = whole == 0;
            let cost = place.len + STORED_HEAD_BYTES;
            let fits_message = bytes + cost <= MAX_MESSAGE_BYTES - ANSWER_HEAD_BYTES
                && found.places.len() < MAX_STORED;
            if is_first_tick && !fits_message {
                // No answer can hold all of it; what there is room for is better than nothing.
                continue;
            }
            if !is_first_tick && (bytes + cost > most || !fits_message) {
                found.places.truncate(whole);
                found.to = tick;
                return found;
            }
            bytes += cost;
            of_tick = Some(tick);
            found.places.push(place);
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::fill::SetKind;

    use super::*;

    fn index(records: &[(u64, i64, usize)]) -> RingIndex {
        let mut index = RingIndex::default();
        for (i, &(session, tick, len)) in records.iter().enumerate() {
            let label = Label {
                session: SessionId(session),
                tick: Tick(tick),
                kind: SetKind::Patches,
            };
            let place = RecordLocation {
                segment: i % 2,
                at: i as u64,
                len,
            };
            index.add(label, place);
        }
        index
    }

    fn ask(index: &RingIndex, from: i64, to: i64, max_bytes: u32) -> (Vec<u64>, i64) {
        let found = index.find(&FillRequest {
            session: SessionId(1),
            from: Tick(from),
            to: Tick(to),
            max_bytes,
        });
        (found.places.iter().map(|p| p.at).collect(), found.to.0)
    }

    #[test]
    fn an_answer_holds_whole_ticks_within_its_bytes() {
        let index = index(&[
            (1, 5, 100),
            (1, 5, 100),
            (1, 6, 100),
            (1, 9, 100),
            (2, 6, 100),
        ]);
        assert_eq!(ask(&index, 0, 20, 1000), (vec![0, 1, 2, 3], 20));
        assert_eq!(ask(&index, 0, 20, 350), (vec![0, 1, 2], 9));
        assert_eq!(ask(&index, 0, 20, 250), (vec![0, 1], 6));
        assert_eq!(ask(&index, 9, 20, 250), (vec![3], 20));
        assert_eq!(ask(&index, 7, 9, 250), (Vec::new(), 9), "nothing is there");
    }

    #[test]
    fn the_first_tick_comes_whatever_it_takes() {
        let index = index(&[(1, 5, 900), (1, 5, 900), (1, 6, 100)]);
        assert_eq!(ask(&index, 5, 9, 10), (vec![0, 1], 6));
    }

    #[test]
    fn an_answer_never_outgrows_a_message() {
        let large = MAX_MESSAGE_BYTES - 100;
        let index = index(&[(1, 5, large), (1, 5, large), (1, 6, large)]);
        assert_eq!(ask(&index, 5, 9, 10), (vec![0], 6));
    }

    #[test]
    fn what_is_written_over_is_forgotten() {
        let mut index = index(&[(1, 5, 100), (1, 6, 100), (1, 7, 100)]);
        index.forget(0);
        assert_eq!(ask(&index, 0, 9, 1000), (vec![1], 9));
    }
}
