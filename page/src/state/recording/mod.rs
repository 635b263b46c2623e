//! A recording that clients can seek in: an index by tick, and the parts in use in memory.
//!
//! The file is read once in parts, for the index and for the state at the start of each part; then
//! again where clients are. Unused parts are removed from memory, the least recently used first.

mod loader;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread;

use farfield_proto::tick::{Micros, Tick};

use super::history::History;
use super::known::frame::SharedFrame;
use super::{Shared, lock};
use loader::Loader;

/// Maximum number of requested parts before the first is read.
const MAX_WANTED: usize = 64;
/// Maximum number of fusion sessions in a recording.
const MAX_SESSIONS: usize = 64;
/// Number of parts that always fit in memory: the current one and its neighbours.
const PARTS_AT_ONCE: usize = 3;

/// Source of a recording's messages, with the arguments of `PageState::message`, in order of time.
pub trait RecordedMessages: Send {
    /// Times of the first and last message, microseconds of Unix time.
    fn span_us(&self) -> [Micros; 2];

    /// Passes every message from `from_us` up to `to_us` (exclusive) to `visit`, in order: key,
    /// payload, time.
    ///
    /// # Errors
    /// A sentence for the operator if the file cannot be read there. Messages already passed remain
    /// valid.
    fn read(
        &mut self,
        from_us: Micros,
        to_us: Micros,
        visit: &mut dyn FnMut(&str, &[u8], Micros),
    ) -> Result<(), String>;
}

/// Result of looking up a tick.
#[derive(Debug)]
pub(crate) enum Lookup {
    /// The tick, or the nearest one.
    Frame(SharedFrame),
    /// Being loaded.
    Loading,
    /// There is none.
    Nothing,
}

/// A recording as clients use it.
pub(crate) struct Recording {
    inner: Mutex<Inner>,
    wanted: OnceLock<SyncSender<usize>>,
    most_bytes: usize,
}

#[derive(Default)]
struct Inner {
    /// Positions of ticks by the lower half of fusion's session; ticks of different sessions are
    /// unrelated.
    sessions: BTreeMap<u32, IndexedSession>,
    /// The displayed session: the one with the most ticks so far.
    shown: Option<u32>,
    is_indexed: bool,
    loaded: BTreeMap<usize, LoadedPart>,
    uses: u64,
}

/// Positions of the ticks of a session.
#[derive(Debug, Default)]
struct IndexedSession {
    ticks: u64,
    /// First and last tick of every non-empty part, ascending.
    parts: Vec<IndexedPart>,
}

/// Position of the ticks of a part.
#[derive(Debug, Clone, Copy)]
struct IndexedPart {
    first: Tick,
    last: Tick,
    part: usize,
}

/// The ticks of a session in a part.
#[derive(Debug, Clone, Copy)]
struct TickRange {
    first: Tick,
    last: Tick,
    ticks: u64,
}

/// A part in memory.
struct LoadedPart {
    history: History,
    bytes: usize,
    /// Sequence number of its last use.
    used: u64,
}

impl Inner {
    /// The parts of the displayed session, ascending.
    fn index(&self) -> &[IndexedPart] {
        let shown = self.shown.and_then(|shown| self.sessions.get(&shown));
        shown.map_or(&[], |session| &session.parts)
    }

    /// Index position of the part with the tick, otherwise of the last one before it, otherwise of
    /// the first.
    fn place(&self, tick: Tick) -> Option<usize> {
        let index = self.index();
        let after = index.partition_point(|indexed| indexed.first <= tick);
        (!index.is_empty()).then(|| after.saturating_sub(1))
    }

    fn part(&self, tick: Tick) -> Option<usize> {
        Some(self.index().get(self.place(tick)?)?.part)
    }

    /// Records the ticks of a session in the next part.
    fn note(&mut self, part: usize, session: u32, found: TickRange) {
        if self.sessions.len() >= MAX_SESSIONS && !self.sessions.contains_key(&session) {
            return;
        }
        let indexed = self.sessions.entry(session).or_default();
        indexed.ticks += found.ticks;
        // Duplicate ticks belong to their first occurrence.
        let first = indexed
            .parts
            .last()
            .map_or(found.first, |before| found.first.max(before.last + 1));
        if first <= found.last {
            let last = found.last;
            indexed.parts.push(IndexedPart { first, last, part });
        }
    }

    /// Selects the session with the most ticks.
    fn choose(&mut self) {
        let most = self
            .sessions
            .iter()
            .max_by_key(|(_, session)| session.ticks);
        let shown = most.map(|(session, _)| *session);
        if shown != self.shown {
            self.shown = shown;
            self.loaded.clear();
        }
    }
}

impl Recording {
    /// Limits the data in memory to about this many bytes.
    pub(crate) fn new(most_bytes: usize) -> Self {
        Self {
            inner: Mutex::default(),
            wanted: OnceLock::new(),
            most_bytes,
        }
    }

    /// Starts reading; the thread ends when the recording is dropped.
    pub(crate) fn start(
        self: &Arc<Self>,
        messages: Box<dyn RecordedMessages>,
        shared: &Arc<Shared>,
    ) -> std::io::Result<()> {
        let (sender, receiver) = sync_channel(MAX_WANTED);
        let loader = Loader::new(messages, Arc::downgrade(self), shared);
        thread::Builder::new()
            .name("page-recording".to_owned())
            .spawn(move || loader.run(&receiver))?;
        // Called only once.
        self.wanted.get_or_init(|| sender);
        Ok(())
    }

    pub(crate) fn span(&self) -> Option<[Tick; 2]> {
        let inner = lock(&self.inner);
        let index = inner.index();
        Some([index.first()?.first, index.last()?.last])
    }

    pub(crate) fn is_loading(&self) -> bool {
        !lock(&self.inner).is_indexed
    }

    /// Looks up a tick; requests its part and the neighbours if they are not in memory.
    pub(crate) fn at(&self, tick: Tick) -> Lookup {
        let mut inner = lock(&self.inner);
        // The current part counts as used last.
        inner.uses += 2;
        let uses = inner.uses;
        let Some(place) = inner.place(tick) else {
            return if inner.is_indexed {
                Lookup::Nothing
            } else {
                Lookup::Loading
            };
        };
        // The part itself last: the newest request is read first.
        for neighbour in [place.wrapping_sub(1), place + 1, place] {
            let Some(part) = inner.index().get(neighbour).map(|indexed| indexed.part) else {
                continue;
            };
            let used = if neighbour == place { uses } else { uses - 1 };
            match inner.loaded.get_mut(&part) {
                Some(loaded) => loaded.used = used,
                None => self.want(part),
            }
        }
        let part = inner.index().get(place).map(|indexed| indexed.part);
        let loaded = part.and_then(|part| inner.loaded.get(&part));
        loaded.map_or(Lookup::Loading, |loaded| {
            loaded
                .history
                .at(tick)
                .map_or(Lookup::Nothing, Lookup::Frame)
        })
    }

    fn want(&self, part: usize) {
        if let Some(wanted) = self.wanted.get() {
            // If the queue is full, the client waits and asks again.
            let _is_taken = wanted.try_send(part).is_ok();
        }
    }

    pub(crate) fn status_at(&self, tick: Tick) -> Option<Arc<str>> {
        let inner = lock(&self.inner);
        inner
            .loaded
            .get(&inner.part(tick)?)?
            .history
            .status_at(tick)
    }

    /// Ticks of a range that are in memory; every n-th if more than `most`.
    pub(crate) fn range(&self, [from, to]: [Tick; 2], most: usize) -> Vec<SharedFrame> {
        let inner = lock(&self.inner);
        let parts = inner
            .index()
            .iter()
            .filter(|indexed| indexed.first <= to && indexed.last >= from);
        let loaded = parts.filter_map(|indexed| inner.loaded.get(&indexed.part));
        let frames: Vec<SharedFrame> = loaded
            .flat_map(|loaded| loaded.history.range([from, to], usize::MAX))
            .collect();
        let every = frames.len().div_ceil(most.max(1)).max(1);
        frames.into_iter().step_by(every).collect()
    }

    fn has(&self, part: usize) -> bool {
        lock(&self.inner).loaded.contains_key(&part)
    }

    /// Records the positions of the ticks of the next part, by session.
    fn indexed(&self, part: usize, found: &BTreeMap<u32, TickRange>) {
        let mut inner = lock(&self.inner);
        for (session, found) in found {
            inner.note(part, *session, *found);
        }
        inner.choose();
    }

    /// The displayed session.
    fn shown(&self) -> Option<u32> {
        lock(&self.inner).shown
    }

    /// Maximum memory of one part, bytes.
    fn most_part_bytes(&self) -> usize {
        self.most_bytes / PARTS_AT_ONCE
    }

    fn finish_index(&self) {
        lock(&self.inner).is_indexed = true;
    }

    /// Stores a part in memory; removes the least recently used ones if there is too much.
    fn loaded(&self, part: usize, history: History) {
        let mut inner = lock(&self.inner);
        let used = inner.uses.saturating_sub(1);
        let bytes = history.bytes();
        let loaded = LoadedPart {
            history,
            bytes,
            used,
        };
        inner.loaded.insert(part, loaded);
        let mut all: usize = inner.loaded.values().map(|loaded| loaded.bytes).sum();
        while all > self.most_bytes && inner.loaded.len() > 1 {
            let others = inner.loaded.iter().filter(|(number, _)| **number != part);
            let Some((&oldest, bytes)) = others
                .min_by_key(|(_, loaded)| loaded.used)
                .map(|(number, loaded)| (number, loaded.bytes))
            else {
                break;
            };
            all -= bytes;
            inner.loaded.remove(&oldest);
        }
    }
}
