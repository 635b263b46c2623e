//! Reads a recording: once completely for the index, then again where clients are.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Arc, Weak};

use farfield_proto::message::PoseSet;
use farfield_proto::tick::{Micros, SECOND_US, Tick};
use farfield_proto::wire;
use tracing::warn;

use super::{MAX_SESSIONS, PARTS_AT_ONCE, RecordedMessages, Recording, TickRange};
use crate::state::Shared;
use crate::state::history::{History, HistoryBounds};
use crate::state::known::context::{Context, Topic};
use crate::state::known::{External, Known, News};

/// Length of a part, microseconds; longer in very long recordings.
const PART_US: Micros = 4 * SECOND_US;
/// Maximum number of parts; the state at the start of each is stored.
const MAX_PARTS: Micros = 2048;
/// Maximum number of waiting requests: for four clients, the current part and its neighbours.
const MAX_REQUESTS: usize = 4 * PARTS_AT_ONCE;
/// A part is read from this long before its start, microseconds, since boxes and maps precede their
/// poses.
const BEFORE_US: Micros = SECOND_US;

/// Reads a recording for its clients.
pub(super) struct Loader {
    messages: Box<dyn RecordedMessages>,
    recording: Weak<Recording>,
    shared: Weak<Shared>,
    context: Arc<Context>,
    /// State at the end of what was indexed.
    known: Known,
    /// State at the start of each indexed part.
    beginnings: Vec<Known>,
    from_us: Micros,
    part_us: Micros,
    parts: usize,
    /// Time of the last alarm check for the index.
    reported_us: Micros,
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
            reported_us: Micros::MIN,
        }
    }

    /// Runs until all clients and the recording are gone.
    pub(super) fn run(mut self, wanted: &Receiver<usize>) {
        // Newest last; surplus requests of many clients are dropped unless repeated.
        let mut requests = Vec::new();
        loop {
            let is_indexed = self.beginnings.len() >= self.parts;
            if is_indexed && requests.is_empty() {
                match wanted.recv() {
                    Ok(part) => requests.push(part),
                    Err(_) => return,
                }
            }
            if !receive(wanted, &mut requests) {
                return;
            }
            let Some(recording) = self.recording.upgrade() else {
                return;
            };
            requests.retain(|part| !recording.has(*part));
            if let Some(part) = requests.pop() {
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

    /// Indexes the ticks of the next part, and stores the state at its start.
    fn index_next(&mut self, recording: &Recording) {
        let part = self.beginnings.len();
        self.beginnings.push(self.known.checkpoint());
        let [from_us, to_us] = self.times_us(part);
        let mut ticks: BTreeMap<u32, TickRange> = BTreeMap::new();
        let mut events = Vec::new();
        let external = self.external();
        let (known, context, reported_us) = (&mut self.known, &self.context, &mut self.reported_us);
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
                    // These do not affect the state at the start of the next part.
                    None | Some(Topic::Patches(_) | Topic::Sightings(_)) => {}
                    Some(topic) => {
                        if let News::Events(more) = known.take(topic, bytes, at_us) {
                            events.extend(more);
                        }
                    }
                }
                // Alarm start times and growing counters belong to the state at the start of the
                // next part.
                if at_us.saturating_sub(*reported_us) >= SECOND_US {
                    *reported_us = at_us;
                    known.note_alarms(&external);
                }
            });
        if let Some(shared) = self.shared.upgrade() {
            shared.events.push(events);
        }
        recording.indexed(part, &ticks);
        if let Err(error) = read {
            warn!(%error, "cannot read the rest of the recording");
            self.parts = self.beginnings.len();
        }
        if self.beginnings.len() >= self.parts {
            recording.finish_index();
        }
    }

    fn external(&self) -> External {
        let shared = self.shared.upgrade();
        shared.map(|shared| shared.external()).unwrap_or_default()
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
        let (external, shown) = (self.external(), recording.shown());
        let mut reported_us = Micros::MIN;
        let context = &self.context;
        let start_us = from_us.saturating_sub(BEFORE_US);
        let read = self
            .messages
            .read(start_us, to_us, &mut |key, bytes, at_us| {
                let is_before = at_us < from_us;
                let topic = context.topic(key).filter(|topic| {
                    // Statuses and events before the part are already in its initial state.
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
                // Also without new poses: as in a running venue, this is the status at the last
                // poses.
                if at_us.saturating_sub(reported_us) >= SECOND_US
                    && let Some([_, tick]) = history.span()
                {
                    reported_us = at_us;
                    history.push_status(tick, known.status(&external).to_json().into());
                }
            });
        if let Err(error) = read {
            warn!(%error, "cannot read a part of the recording");
        }
        recording.loaded(part, history);
    }
}

/// Receives all pending requests; returns `false` if all senders are gone.
fn receive(wanted: &Receiver<usize>, requests: &mut Vec<usize>) -> bool {
    loop {
        match wanted.try_recv() {
            Ok(part) => {
                requests.retain(|known| *known != part);
                requests.push(part);
            }
            Err(TryRecvError::Empty) => break,
            Err(TryRecvError::Disconnected) => return false,
        }
    }
    let too_many = requests.len().saturating_sub(MAX_REQUESTS);
    requests.drain(..too_many);
    true
}

fn note_tick(found: &mut BTreeMap<u32, TickRange>, session: u32, tick: Tick) {
    if found.len() >= MAX_SESSIONS && !found.contains_key(&session) {
        return;
    }
    let known = found.entry(session).or_insert(TickRange {
        first: tick,
        last: tick,
        ticks: 0,
    });
    known.first = known.first.min(tick);
    known.last = known.last.max(tick);
    known.ticks += 1;
}
