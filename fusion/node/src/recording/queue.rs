//! The queue of the thread that writes a recording.
//!
//! Callers never wait: a message that finds no place is counted, and missing in the recording.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use farfield_node::clock;
use farfield_proto::id::SessionId;
use farfield_proto::key::Keys;
use farfield_proto::message::decision::Decision;
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use farfield_proto::wire;

use crate::session::wiretap::{CopiedMessage, CopiedStep, Wiretap};

/// Memory for queued messages: a hanging disk must not fill all of it.
const QUEUE_BYTES: usize = 64 << 20;
/// Approximate memory of a message apart from its topic and bytes: two allocations and its place in the queue.
const NOTE_BYTES: usize = size_of::<Note>() + 32;

/// Queues the messages of fusion for the writer.
pub(crate) struct RecordingQueue {
    notes: Sender<Note>,
    state: Arc<QueueState>,
    session: SessionId,
    decisions: String,
    own_status: String,
    /// The tick of the first decision, that of the session's first boxes.
    first: OnceLock<Tick>,
}

/// Shared by queue and writer.
#[derive(Debug, Default)]
pub(crate) struct QueueState {
    queued_bytes: AtomicUsize,
    lost: Arc<AtomicU64>,
    failure: Mutex<Option<String>>,
}

/// An entry of the queue.
#[derive(Debug)]
pub(crate) enum Note {
    /// A message.
    Passed(QueuedMessage),
    /// The end.
    End,
}

/// A message to record.
#[derive(Debug)]
pub(crate) struct QueuedMessage {
    /// Its key.
    pub(super) topic: String,
    /// Its payload.
    pub(super) bytes: Vec<u8>,
    /// Its time: Unix time, nanoseconds.
    pub(super) at_ns: u64,
}

impl QueuedMessage {
    /// Its approximate memory in the queue.
    pub(super) fn cost(&self) -> usize {
        self.topic.len() + self.bytes.len() + NOTE_BYTES
    }
}

impl RecordingQueue {
    /// A queue for the messages of fusion in `session`, and its receiving end.
    pub(crate) fn open(venue: &str, session: SessionId) -> (Self, Receiver<Note>) {
        let (queue, notes) = channel();
        let keys = Keys::new(venue);
        let this = Self {
            notes: queue,
            state: Arc::default(),
            session,
            decisions: keys.decision(),
            own_status: keys.status(FUSION),
            first: OnceLock::new(),
        };
        (this, notes)
    }

    /// Sets the tick of the session's first boxes, for a recording that begins later.
    pub(super) fn begins_after(&self, first: Tick) {
        self.first.get_or_init(|| first);
    }

    /// The state shared with the writer.
    pub(super) fn state(&self) -> &Arc<QueueState> {
        &self.state
    }

    /// Queues a message of time `at_us`, microseconds of Unix time.
    pub(crate) fn note(&self, topic: &str, bytes: &[u8], at_us: i64) {
        let passed = QueuedMessage {
            topic: topic.to_owned(),
            bytes: bytes.to_owned(),
            at_ns: u64::try_from(at_us).unwrap_or(0).saturating_mul(1000),
        };
        let cost = passed.cost();
        let before = self.state.queued_bytes.fetch_add(cost, Ordering::Relaxed);
        let has_place = before == 0 || before + cost <= QUEUE_BYTES;
        // After the recording has failed, losses are not counted.
        if !has_place {
            self.state.taken(cost);
            self.state.lost.fetch_add(1, Ordering::Relaxed);
        } else if self.notes.send(Note::Passed(passed)).is_err() {
            self.state.taken(cost);
        }
    }

    /// Marks the end.
    pub(super) fn end(&self) {
        // A failed writer has already ended.
        drop(self.notes.send(Note::End));
    }
}

impl Wiretap for RecordingQueue {
    fn received(&self, message: CopiedMessage<'_>) {
        // Fusion's own messages are recorded when they are published.
        if message.key != self.own_status {
            self.note(message.key, message.bytes, message.at_us);
        }
    }

    fn published(&self, message: CopiedMessage<'_>) {
        // Decisions are recorded when they are made: none may be missing.
        if message.key != self.decisions {
            self.note(message.key, message.bytes, message.at_us);
        }
    }

    fn decided(&self, decided: CopiedStep<'_>) {
        let first = *self.first.get_or_init(|| decided.group.tick);
        let decision = Decision {
            horizons_ticks: decided.horizons.to_vec(),
            ..decided.group.decision(self.session, first)
        };
        self.note(
            &self.decisions,
            &wire::encode(&decision),
            i64::try_from(clock::unix_time().as_micros()).unwrap_or(i64::MAX),
        );
    }

    fn failure(&self) -> Option<String> {
        self.state.failure()
    }
}

impl QueueState {
    /// Releases the memory of a message with this [`QueuedMessage::cost`].
    pub(super) fn taken(&self, cost: usize) {
        self.queued_bytes.fetch_sub(cost, Ordering::Relaxed);
    }

    /// The counter of lost messages.
    pub(super) fn lost_counter(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.lost)
    }

    /// Messages lost since the start.
    pub(super) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    /// Records the reason of an early end.
    pub(super) fn fail(&self, reason: String) {
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        *failure = Some(reason);
    }

    /// The reason of an early end, if any.
    pub(super) fn failure(&self) -> Option<String> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_fusion::align::TickGroup;

    fn open() -> (RecordingQueue, Receiver<Note>) {
        RecordingQueue::open("hall", SessionId(7))
    }

    /// A disk that hangs for 22 s at four viewpoints and 60 Hz: sets, boxes, poses, decisions. A queue of 8,192 messages lost 4,213
    /// of them.
    #[test]
    fn a_disk_hanging_for_22_s_costs_no_message() {
        let (queue, notes) = open();
        for _ in 0..22 * 60 {
            for _ in 0..4 {
                queue.note("hall/patches/north-east", &[0; 4000], 0);
                queue.note("hall/boxes/north-east", &[0; 600], 0);
            }
            queue.note("hall/pose", &[0; 3000], 0);
            queue.note("hall/decision", &[0; 200], 0);
        }
        assert_eq!(queue.state().lost(), 0);
        assert_eq!(notes.try_iter().count(), 22 * 60 * 10);
    }

    #[test]
    fn the_queue_is_bounded_by_memory_and_callers_never_wait() {
        for n_bytes in [1, QUEUE_BYTES / 4] {
            let (queue, notes) = open();
            let message = vec![0; n_bytes];
            let note = || queue.note("hall/pose", &message, 0);
            let cost = "hall/pose".len() + n_bytes + NOTE_BYTES;
            let n_places = QUEUE_BYTES / cost;
            for _ in 0..n_places + 3 {
                note();
            }
            assert_eq!(queue.state().lost(), 3);
            let Ok(Note::Passed(passed)) = notes.recv() else {
                panic!("no message was queued");
            };
            queue.state().taken(passed.cost());
            note();
            assert_eq!(queue.state().lost(), 3, "there is room again");
            drop(notes);
            note();
            assert_eq!(queue.state().lost(), 4, "the queue is full");
        }
    }

    #[test]
    fn decisions_are_recorded_once_with_the_first_tick() {
        let (queue, notes) = open();
        for tick in [40, 41] {
            let group = TickGroup {
                tick: Tick(tick),
                ..TickGroup::default()
            };
            queue.decided(CopiedStep {
                group: &group,
                late: &[],
                horizons: &[2.5],
            });
            queue.published(CopiedMessage {
                key: "hall/decision",
                bytes: b"the same once more",
                at_us: 0,
            });
        }
        let noted: Vec<Decision> = notes
            .try_iter()
            .filter_map(|note| match note {
                Note::Passed(passed) => wire::decode(&passed.bytes).ok(),
                Note::End => None,
            })
            .collect();
        let ticks: Vec<_> = noted.iter().map(|d| (d.first.0, d.tick.0)).collect();
        assert_eq!(ticks, [(40, 40), (40, 41)]);
        assert_eq!(noted[0].horizons_ticks, [2.5]);
    }
}
