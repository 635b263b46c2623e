//! A recording as a past that can be gone to: an index by tick, and the parts in use in memory.
//!
//! The file is read once from its beginning, in parts, for the index and for what was known at the beginning of each; then
//! the parts that clients are at. What is kept of parts that nobody is at is dropped, the longest unused first.

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

/// Parts that may be asked for before the first is read.
const MAX_WANTED: usize = 64;
/// Most sessions of fusion in a recording.
const MAX_SESSIONS: usize = 64;
/// So many parts find room in memory in any case: the one that is shown, and those beside it.
const PARTS_AT_ONCE: usize = 3;

/// Where the messages of a recording come from: what `PageState::message` would have been given, by time.
pub trait RecordedMessages: Send {
    /// When the first and the last message came, microseconds of Unix time.
    fn span_us(&self) -> [Micros; 2];

    /// Gives every message of `from_us` to `to_us` (not included) to `visit`, in order: key, payload, when.
    ///
    /// # Errors
    /// Why the file cannot be read there, in a sentence for the operator. What was given before counts.
    fn read(
        &mut self,
        from_us: Micros,
        to_us: Micros,
        visit: &mut dyn FnMut(&str, &[u8], Micros),
    ) -> Result<(), String>;
}

/// What was found of a tick.
#[derive(Debug)]
pub(crate) enum Found {
    /// It, or the nearest to it.
    Frame(SharedFrame),
    /// It is on its way.
    Loading,
    /// There is nothing.
    Nothing,
}

/// A recording, as clients ask for it.
pub(crate) struct Recording {
    inner: Mutex<Inner>,
    wanted: OnceLock<SyncSender<usize>>,
    most_bytes: usize,
}

#[derive(Default)]
struct Inner {
    /// Where the ticks are, by the lower half of fusion's session: ticks of two sessions have nothing to do with each other.
    sessions: BTreeMap<u32, IndexedSession>,
    /// The session that is shown: the one with the most ticks so far.
    shown: Option<u32>,
    is_indexed: bool,
    loaded: BTreeMap<usize, LoadedPart>,
    uses: u64,
}

/// Where the ticks of a session are.
#[derive(Debug, Default)]
struct IndexedSession {
    ticks: u64,
    /// First and last tick of every part that has any, ascending.
    parts: Vec<IndexedPart>,
}

/// Where the ticks of a part are.
#[derive(Debug, Clone, Copy)]
struct IndexedPart {
    first: Tick,
    last: Tick,
    part: usize,
}

/// The ticks of a session in a part.
#[derive(Debug, Clone, Copy)]
struct FoundTicks {
    first: Tick,
    last: Tick,
    ticks: u64,
}

/// A part in memory.
struct LoadedPart {
    history: History,
    bytes: usize,
    /// The number of its last use.
    used: u64,
}

impl Inner {
    /// The parts of the session that is shown, ascending.
    fn index(&self) -> &[IndexedPart] {
        let shown = self.shown.and_then(|shown| self.sessions.get(&shown));
        shown.map_or(&[], |session| &session.parts)
    }

    /// Where in the index the part is that holds a tick, or the last before it, or the first.
    fn place(&self, tick: Tick) -> Option<usize> {
        let index = self.index();
        let after = index.partition_point(|indexed| indexed.first <= tick);
        (!index.is_empty()).then(|| after.saturating_sub(1))
    }

    fn part(&self, tick: Tick) -> Option<usize> {
        Some(self.index().get(self.place(tick)?)?.part)
    }

    /// Notes the ticks of a session in the next part.
    fn note(&mut self, part: usize, session: u32, found: FoundTicks) {
        if self.sessions.len() >= MAX_SESSIONS && !self.sessions.contains_key(&session) {
            return;
        }
        let indexed = self.sessions.entry(session).or_default();
        indexed.ticks += found.ticks;
        // Ticks that a file has twice are where they were first.
        let first = indexed
            .parts
            .last()
            .map_or(found.first, |before| found.first.max(before.last + 1));
        if first <= found.last {
            let last = found.last;
            indexed.parts.push(IndexedPart { first, last, part });
        }
    }

    /// Shows the session with the most ticks.
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
    /// Holds at most about so many bytes of it in memory.
    pub(crate) fn new(most_bytes: usize) -> Self {
        Self {
            inner: Mutex::default(),
            wanted: OnceLock::new(),
            most_bytes,
        }
    }

    /// Starts to read; the thread ends when the recording is dropped.
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
        // It is started once.
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

    /// A tick; its part and those beside it are asked for where they are not in memory.
    pub(crate) fn at(&self, tick: Tick) -> Found {
        let mut inner = lock(&self.inner);
        // The part that is shown is used last.
        inner.uses += 2;
        let uses = inner.uses;
        let Some(place) = inner.place(tick) else {
            return if inner.is_indexed {
                Found::Nothing
            } else {
                Found::Loading
            };
        };
        // The part itself last: the newest wish is read first.
        for beside in [place.wrapping_sub(1), place + 1, place] {
            let Some(part) = inner.index().get(beside).map(|indexed| indexed.part) else {
                continue;
            };
            let used = if beside == place { uses } else { uses - 1 };
            match inner.loaded.get_mut(&part) {
                Some(loaded) => loaded.used = used,
                None => self.want(part),
            }
        }
        let part = inner.index().get(place).map(|indexed| indexed.part);
        let loaded = part.and_then(|part| inner.loaded.get(&part));
        loaded.map_or(Found::Loading, |loaded| {
            loaded.history.at(tick).map_or(Found::Nothing, Found::Frame)
        })
    }

    fn want(&self, part: usize) {
        if let Some(wanted) = self.wanted.get() {
            // Who finds no room waits, and asks again.
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

    /// What of a range is in memory; of more than `most` ticks every n-th.
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

    /// Notes where the ticks of the next part are, by session.
    fn indexed(&self, part: usize, found: &BTreeMap<u32, FoundTicks>) {
        let mut inner = lock(&self.inner);
        for (session, found) in found {
            inner.note(part, *session, *found);
        }
        inner.choose();
    }

    /// The session that is shown.
    fn shown(&self) -> Option<u32> {
        lock(&self.inner).shown
    }

    /// Most memory of one part, bytes.
    fn most_part_bytes(&self) -> usize {
        self.most_bytes / PARTS_AT_ONCE
    }

    fn index_is_whole(&self) {
        lock(&self.inner).is_indexed = true;
    }

    /// Takes a part into memory, and drops what was not used for the longest time where there is too much.
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
