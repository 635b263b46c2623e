//! The index of the ring: the stored sets and their locations.

use farfield_proto::id::SessionId;
use farfield_proto::message::fill::{FillRequest, MAX_STORED};
use farfield_proto::tick::Tick;
use farfield_proto::wire::MAX_MESSAGE_BYTES;

use super::record::{Label, RECORD_HEAD_BYTES, SEGMENT_HEAD_BYTES};

/// Bytes of an answer in addition to its messages.
const ANSWER_HEAD_BYTES: usize = 64;
/// Bytes in an answer for each message in addition to its own.
const STORED_HEAD_BYTES: usize = 8;

/// Location of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordLocation {
    /// Index of its segment in the ring.
    pub segment: usize,
    /// Offset in the segment, bytes.
    pub at: u64,
    /// Length of its message, bytes.
    pub len: usize,
}

/// All records of the segments in order of storage, 12 bytes each. For small sets an index by
/// session and tick took a third of the ring's size in memory. Requests are rare and can scan.
#[derive(Debug, Default)]
pub struct RingIndex {
    segments: Vec<SegmentIndex>,
}

/// The records of one segment, which are contiguous.
#[derive(Debug, Default)]
struct SegmentIndex {
    /// Sequence number of the segment's start; 0 without records.
    begun: u64,
    ticks: Vec<Tick>,
    /// Lengths of the messages, bytes.
    lens: Vec<u32>,
    /// The sessions, each with the index of its first record.
    sessions: Vec<(usize, SessionId)>,
}

impl SegmentIndex {
    /// The records of `session`, with their locations in segment `segment`.
    fn of_session(
        &self,
        segment: usize,
        session: SessionId,
    ) -> impl Iterator<Item = (Tick, RecordLocation)> {
        let (mut at, mut sessions) = (SEGMENT_HEAD_BYTES as u64, self.sessions.iter().peekable());
        let mut is_wanted = false;
        let records = self.ticks.iter().zip(&self.lens).enumerate();
        records.filter_map(move |(number, (&tick, &len))| {
            if let Some((_, of)) = sessions.next_if(|(first, _)| *first == number) {
                is_wanted = *of == session;
            }
            let len = len as usize;
            let place = RecordLocation { segment, at, len };
            at += (RECORD_HEAD_BYTES + len) as u64;
            is_wanted.then_some((tick, place))
        })
    }
}

/// The records that answer a fill request.
#[derive(Debug, PartialEq, Eq)]
pub struct FoundRecords {
    /// The records.
    pub places: Vec<RecordLocation>,
    /// The tick after the last one that they cover.
    pub to: Tick,
}

impl RingIndex {
    /// Adds the next record of segment `segment`, with a message of `len` bytes.
    pub fn add(&mut self, label: Label, segment: usize, len: usize) {
        let begun = self.segments.iter().map(|it| it.begun).max();
        if self.segments.len() <= segment {
            self.segments.resize_with(segment + 1, Default::default);
        }
        let index = &mut self.segments[segment];
        if index.ticks.is_empty() {
            index.begun = begun.unwrap_or(0) + 1;
        }
        if index.sessions.last().map(|&(_, last)| last) != Some(label.session) {
            index.sessions.push((index.ticks.len(), label.session));
        }
        index.ticks.push(label.tick);
        // No message is longer than four gigabytes.
        index.lens.push(len as u32);
    }

    /// Removes the records of a segment that is overwritten.
    pub fn forget(&mut self, segment: usize) {
        if let Some(index) = self.segments.get_mut(segment) {
            index.ticks.clear();
            index.lens.clear();
            index.sessions.clear();
        }
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.segments.iter().map(|it| it.ticks.len()).sum()
    }

    /// Whether there are no records.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The records of the requested ticks, by tick, and in order of storage within a tick.
    fn requested(&self, request: &FillRequest) -> Vec<(Tick, RecordLocation)> {
        let mut segments: Vec<usize> = (0..self.segments.len()).collect();
        segments.sort_by_key(|&segment| self.segments[segment].begun);
        let records = segments
            .into_iter()
            .flat_map(|segment| self.segments[segment].of_session(segment, request.session));
        let ticks = request.from..request.to;
        let mut requested: Vec<_> = records.filter(|(tick, _)| ticks.contains(tick)).collect();
        requested.sort_by_key(|(tick, _)| *tick);
        requested
    }

    /// Complete ticks from the request's first, up to its `max_bytes`; at least one tick.
    pub fn find(&self, request: &FillRequest) -> FoundRecords {
        let mut found = FoundRecords {
            places: Vec::new(),
            to: request.to,
        };
        let most = (request.max_bytes as usize).min(MAX_MESSAGE_BYTES - ANSWER_HEAD_BYTES);
        let (mut bytes, mut whole, mut of_tick) = (0, 0, None);
        for (tick, place) in self.requested(request) {
            if of_tick != Some(tick) {
                whole = found.places.len();
            }
            let is_first_tick = whole == 0;
            let cost = place.len + STORED_HEAD_BYTES;
            let fits_message = bytes + cost <= MAX_MESSAGE_BYTES - ANSWER_HEAD_BYTES
                && found.places.len() < MAX_STORED;
            if is_first_tick && !fits_message {
                // No answer can hold the whole tick; a part of it is better than none.
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

    fn label(session: u64, tick: i64) -> Label {
        Label {
            session: SessionId(session),
            tick: Tick(tick),
            kind: SetKind::Patches,
        }
    }

    /// An index of records that alternate between two segments.
    fn index(records: &[(u64, i64, usize)]) -> RingIndex {
        let mut index = RingIndex::default();
        for (i, &(session, tick, len)) in records.iter().enumerate() {
            index.add(label(session, tick), i % 2, len);
        }
        index
    }

    /// The records of the answer, by segment and index in it, and the tick after.
    fn ask(index: &RingIndex, from: i64, to: i64, max_bytes: u32) -> (Vec<usize>, i64) {
        let found = index.find(&FillRequest {
            session: SessionId(1),
            from: Tick(from),
            to: Tick(to),
            max_bytes,
        });
        let number = |place: &RecordLocation| {
            let lens = &index.segments[place.segment].lens;
            let mut at = SEGMENT_HEAD_BYTES as u64;
            for (number, &len) in lens.iter().enumerate() {
                if at == place.at {
                    assert_eq!(place.len, len as usize);
                    return 2 * number + place.segment;
                }
                at += RECORD_HEAD_BYTES as u64 + u64::from(len);
            }
            panic!("no record begins at {}", place.at);
        };
        (found.places.iter().map(number).collect(), found.to.0)
    }

    #[test]
    fn a_record_takes_few_bytes_of_memory() {
        // Symptom to prevent: the index of a ring of small sets took a third of `ring_mib`, 110
        // bytes per set.
        let mut index = RingIndex::default();
        let n_records = 1 << 14;
        for tick in 0..n_records {
            index.add(label(7, tick / 2), 0, 300);
        }
        let of = &index.segments[0];
        let bytes = of.ticks.capacity() * size_of::<Tick>() + of.lens.capacity() * size_of::<u32>();
        assert!(bytes <= 12 * n_records as usize, "{bytes}");
        assert!(of.sessions.len() == 1 && index.len() == n_records as usize);
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
        // The records of tick 5 are in two segments, of which the first was started earlier.
        assert_eq!(ask(&index, 0, 20, 1000), (vec![0, 1, 2, 3], 20));
        assert_eq!(ask(&index, 20, 0, 1000).0, Vec::<usize>::new());
        assert_eq!(ask(&index, 0, 20, 350), (vec![0, 1, 2], 9));
        assert_eq!(ask(&index, 0, 20, 250), (vec![0, 1], 6));
        assert_eq!(ask(&index, 9, 20, 250), (vec![3], 20));
        assert_eq!(ask(&index, 7, 9, 250), (Vec::new(), 9), "nothing is there");
    }

    #[test]
    fn the_first_tick_is_returned_at_any_size() {
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
    fn overwritten_records_are_removed() {
        let mut index = index(&[(1, 5, 100), (1, 6, 100), (1, 5, 100)]);
        index.forget(0);
        assert_eq!(ask(&index, 0, 9, 1000), (vec![1], 9));
        index.add(label(1, 6), 0, 100);
        assert_eq!(ask(&index, 0, 9, 1000), (vec![1, 0], 9), "it was restarted");
    }
}
