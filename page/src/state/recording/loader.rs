//! Reads a recording: once through for the index, and again where clients are.

use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Arc, Weak};

use farfield_proto::message::PoseSet;
use farfield_proto::tick::{Micros, SECOND_US, Tick};
use farfield_proto::wire;
use tracing::warn;

use super::{IndexedPart, RecordedMessages, Recording};
use crate::state::Shared;
use crate::state::history::{History, HistoryBounds};
use crate::state::known::context::{Context, Topic};
use crate::state::known::{Known, News};

/// Length of a part, microseconds, unless the recording is very long.
const PART_US: Micros = 4 * SECOND_US;
/// Most parts: what is known at the beginning of each is kept.
const MAX_PARTS: Micros = 2048;
/// How long before a part it is read from, microseconds: boxes and maps come before their poses.
const BEFORE_US: Micros = SECOND_US;

/// Reads a recording for its clients.
pub(super) struct Loader {
    messages: Box<dyn RecordedMessages>,
    recording: Weak<Recording>,
    shared: Weak<Shared>,
    context: Arc<Context>,
    /// What is known at the end of what was read for the index.
    known: Known,
    /// Parts read for the index so far: what was known at the beginning of each.
    beginnings: Vec<Known>,
    from_us: Micros,
    part_us: Micros,
    parts: usize,
}

impl Loader {
    pub(super) fn new(
        messages: Box<dyn RecordedMessages>,
        recording: Weak<Recording>,
        shared: &Arc<Shared>,
    ) -> Self {
        let [from_us, to_us] = messages.span_us();
        let span_us = to_us.saturating_sub(from_us).max(0).saturating_add(1);
        let part_us = PART_US.max(span_us / MAX_PARTS + 1);
        Self {
            messages,
            recording,
            context: Arc::clone(&shared.context),
            known: Known::new(Arc::clone(&shared.context)),
            shared: Arc::downgrade(shared),
            beginnings: Vec::new(),
            from_us,
            part_us,
            parts: (span_us / part_us + 1) as usize,
        }
    }

    /// Until nobody is left who could ask.
    pub(super) fn run(mut self, wanted: &Receiver<usize>) {
        loop {
            let is_indexed = self.beginnings.len() >= self.parts;
            let mut wishes = Vec::new();
            if is_indexed {
                match wanted.recv() {
                    Ok(part) => wishes.push(part),
                    Err(_) => return,
                }
            }
            loop {
                match wanted.try_recv() {
                    Ok(part) => wishes.push(part),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return,
                }
            }
            let Some(recording) = self.recording.upgrade() else {
                return;
            };
            let mut done = BTreeSet::new();
            // The newest wish first, and of a crowd of wishes those that are still wished for.
            for part in wishes.into_iter().rev() {
                if done.insert(part) && !recording.has(part) {
                    self.load(part, &recording);
                }
            }
            if !is_indexed {
                self.index_next(&recording);
            }
        }
    }

    fn times_us(&self, part: usize) -> [Micros; 2] {
        let from_us = self
            .from_us
            .saturating_add(self.part_us.saturating_mul(part.cast_signed() as Micros));
        [from_us, from_us.saturating_add(self.part_us)]
    }

    /// Notes where the ticks of the next part are, and what is known at its beginning.
    fn index_next(&mut self, recording: &Recording) {
        let part = self.beginnings.len();
        self.beginnings.push(self.known.essence());
        let [from_us, to_us] = self.times_us(part);
        let mut ticks: Option<[Tick; 2]> = None;
        let mut events = Vec::new();
        let (known, context) = (&mut self.known, &self.context);
        let read = self
            .messages
            .read(from_us, to_us, &mut |key, bytes, at_us| {
                match context.topic(key) {
                    Some(Topic::Poses) => {
                        if let Ok(PoseSet { tick, .. }) = wire::decode(bytes) {
                            let [first, last] = ticks.unwrap_or([tick; 2]);
                            ticks = Some([first.min(tick), last.max(tick)]);
                        }
                    }
                    // Of these nothing is known at the beginning of the next part.
                    None | Some(Topic::Patches(_) | Topic::Sightings(_)) => {}
                    Some(topic) => {
                        if let News::Events(more) = known.take(topic, bytes, at_us) {
                            events.extend(more);
                        }
                    }
                }
            });
        if let Some(shared) = self.shared.upgrade() {
            shared.events.push(events);
        }
        recording.indexed(ticks.map(|[first, last]| IndexedPart { first, last, part }));
        if let Err(error) = read {
            warn!(%error, "the recording cannot be read further");
            self.parts = self.beginnings.len();
        }
        if self.beginnings.len() >= self.parts {
            recording.index_is_whole();
        }
    }

    /// Reads a part into memory.
    fn load(&mut self, part: usize, recording: &Recording) {
        let Some(beginning) = self.beginnings.get(part) else {
            return;
        };
        let mut known = beginning.clone();
        let [from_us, to_us] = self.times_us(part);
        let bounds = HistoryBounds {
            bytes: usize::MAX,
            seconds: f64::INFINITY,
        };
        let mut history = History::new(bounds, self.context.venue.rate_hz);
        let beside = self
            .shared
            .upgrade()
            .map(|shared| shared.beside())
            .unwrap_or_default();
        let mut told_us = Micros::MIN;
        let context = &self.context;
        let start_us = from_us.saturating_sub(BEFORE_US);
        let read = self
            .messages
            .read(start_us, to_us, &mut |key, bytes, at_us| {
                let Some(topic) = context.topic(key) else {
                    return;
                };
                let news = known.take(topic, bytes, at_us);
                if at_us < from_us {
                    return;
                }
                if let News::Frame(frame) = news {
                    let tick = frame.tick;
                    history.push(frame);
                    if at_us.saturating_sub(told_us) >= SECOND_US {
                        told_us = at_us;
                        history.push_status(tick, known.status(&beside).to_json().into());
                    }
                }
            });
        if let Err(error) = read {
            warn!(%error, "a part of the recording cannot be read");
        }
        recording.loaded(part, history);
    }
}
