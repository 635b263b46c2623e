//! Reads a recording: once through for the index, and again where clients are.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Arc, Weak};

use farfield_proto::message::PoseSet;
use farfield_proto::tick::{Micros, SECOND_US, Tick};
use farfield_proto::wire;
use tracing::warn;

use super::{FoundTicks, MAX_SESSIONS, PARTS_AT_ONCE, RecordedMessages, Recording};
use crate::state::Shared;
use crate::state::history::{History, HistoryBounds};
use crate::state::known::context::{Context, Topic};
use crate::state::known::{Beside, Known, News};

/// Length of a part, microseconds, unless the recording is very long.
const PART_US: Micros = 4 * SECOND_US;
/// Most parts: what is known at the beginning of each is kept.
const MAX_PARTS: Micros = 2048;
/// Wishes that wait at most: of four clients the part that each is at, and those beside it.
const MAX_WISHES: usize = 4 * PARTS_AT_ONCE;
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
    /// When alarms were looked for last, for the index.
    told_us: Micros,
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
            told_us: Micros::MIN,
        }
    }

    /// Until nobody is left who could ask.
    pub(super) fn run(mut self, wanted: &Receiver<usize>) {
        // The newest last; of a crowd those that are not asked for again are dropped.
        let mut wishes = Vec::new();
        loop {
            let is_indexed = self.beginnings.len() >= self.parts;
            if is_indexed && wishes.is_empty() {
                match wanted.recv() {
                    Ok(part) => wishes.push(part),
                    Err(_) => return,
                }
            }
            if !hear(wanted, &mut wishes) {
                return;
            }
            let Some(recording) = self.recording.upgrade() else {
                return;
            };
            wishes.retain(|part| !recording.has(*part));
            if let Some(part) = wishes.pop() {
                self.load(part, &recording);
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
        let mut ticks: BTreeMap<u32, FoundTicks> = BTreeMap::new();
        let mut events = Vec::new();
        let beside = self.beside();
        let (known, context, told_us) = (&mut self.known, &self.context, &mut self.told_us);
        let read = self
            .messages
            .read(from_us, to_us, &mut |key, bytes, at_us| {
                match context.topic(key) {
                    Some(Topic::Poses) => {
                        if let Ok(PoseSet { tick, session, .. }) = wire::decode(bytes) {
                            known.note_poses(session, at_us);
                            note_tick(&mut ticks, session.0 as u32, tick);
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
                // Since when something is wrong, and which counters grow, is known at the beginning of the next part.
                if at_us.saturating_sub(*told_us) >= SECOND_US {
                    *told_us = at_us;
                    known.note_alarms(&beside);
                }
            });
        if let Some(shared) = self.shared.upgrade() {
            shared.events.push(events);
        }
        recording.indexed(part, &ticks);
        if let Err(error) = read {
            warn!(%error, "the recording cannot be read further");
            self.parts = self.beginnings.len();
        }
        if self.beginnings.len() >= self.parts {
            recording.index_is_whole();
        }
    }

    fn beside(&self) -> Beside {
        let shared = self.shared.upgrade();
        shared.map(|shared| shared.beside()).unwrap_or_default()
    }

    /// Reads a part into memory.
    fn load(&mut self, part: usize, recording: &Recording) {
        let Some(beginning) = self.beginnings.get(part) else {
            return;
        };
        let mut known = beginning.clone();
        let [from_us, to_us] = self.times_us(part);
        let bounds = HistoryBounds {
            bytes: recording.most_part_bytes(),
            seconds: f64::INFINITY,
        };
        let mut history = History::new(bounds, self.context.venue.rate_hz);
        let (beside, shown) = (self.beside(), recording.shown());
        let mut told_us = Micros::MIN;
        let context = &self.context;
        let start_us = from_us.saturating_sub(BEFORE_US);
        let read = self
            .messages
            .read(start_us, to_us, &mut |key, bytes, at_us| {
                let is_before = at_us < from_us;
                let topic = context.topic(key).filter(|topic| {
                    // What these said before the part is known.
                    !(is_before && matches!(topic, Topic::Status(_) | Topic::Events))
                });
                let Some(topic) = topic else {
                    return;
                };
                let news = known.take(topic, bytes, at_us);
                if is_before {
                    return;
                }
                if let News::Frame(frame) = news {
                    let is_next = history.span().is_none_or(|[_, last]| last < frame.tick);
                    if is_next && shown == Some(frame.session) {
                        history.push(frame);
                    }
                }
                // Also while no poses come: as with a running venue this is how it was at the last of them.
                if at_us.saturating_sub(told_us) >= SECOND_US
                    && let Some([_, tick]) = history.span()
                {
                    told_us = at_us;
                    history.push_status(tick, known.status(&beside).to_json().into());
                }
            });
        if let Err(error) = read {
            warn!(%error, "a part of the recording cannot be read");
        }
        recording.loaded(part, history);
    }
}

/// Takes all wishes that were said; `false`: nobody is left who could wish.
fn hear(wanted: &Receiver<usize>, wishes: &mut Vec<usize>) -> bool {
    loop {
        match wanted.try_recv() {
            Ok(part) => {
                wishes.retain(|known| *known != part);
                wishes.push(part);
            }
            Err(TryRecvError::Empty) => break,
            Err(TryRecvError::Disconnected) => return false,
        }
    }
    let too_many = wishes.len().saturating_sub(MAX_WISHES);
    wishes.drain(..too_many);
    true
}

fn note_tick(found: &mut BTreeMap<u32, FoundTicks>, session: u32, tick: Tick) {
    if found.len() >= MAX_SESSIONS && !found.contains_key(&session) {
        return;
    }
    let known = found.entry(session).or_insert(FoundTicks {
        first: tick,
        last: tick,
        ticks: 0,
    });
    known.first = known.first.min(tick);
    known.last = known.last.max(tick);
    known.ticks += 1;
}
