//! Ticks that clients can seek to: the last minutes, or a recording.

use std::sync::{Arc, Mutex};

use farfield_proto::tick::Tick;

use super::history::{History, HistoryBounds};
use super::known::frame::SharedFrame;
use super::lock;
pub(crate) use super::recording::Lookup;
use super::recording::Recording;

/// Where the past is stored.
pub(crate) enum Past {
    /// In memory.
    Live(Mutex<History>),
    /// In a file; the parts in use are in memory.
    Recording(Arc<Recording>),
}

impl Past {
    pub(crate) fn live(bounds: HistoryBounds, rate_hz: f64) -> Self {
        Self::Live(Mutex::new(History::new(bounds, rate_hz)))
    }

    pub(super) fn push(&self, frame: SharedFrame) {
        if let Self::Live(history) = self {
            lock(history).push(frame);
        }
    }

    pub(super) fn push_status(&self, tick: Tick, status: Arc<str>) {
        if let Self::Live(history) = self {
            lock(history).push_status(tick, status);
        }
    }

    /// The first and last tick that clients can seek to.
    pub(crate) fn span(&self) -> Option<[Tick; 2]> {
        match self {
            Self::Live(history) => lock(history).span(),
            Self::Recording(recording) => recording.span(),
        }
    }

    /// The tick, otherwise the last one before it, otherwise the first.
    pub(crate) fn at(&self, tick: Tick) -> Lookup {
        match self {
            Self::Live(history) => {
                let found = lock(history).at(tick);
                found.map_or(Lookup::Nothing, Lookup::Frame)
            }
            Self::Recording(recording) => recording.at(tick),
        }
    }

    /// The status at a tick.
    pub(crate) fn status_at(&self, tick: Tick) -> Option<Arc<str>> {
        match self {
            Self::Live(history) => lock(history).status_at(tick),
            Self::Recording(recording) => recording.status_at(tick),
        }
    }

    /// Ticks of a range that are in memory; every n-th if more than `most`.
    pub(crate) fn range(&self, range: [Tick; 2], most: usize) -> Vec<SharedFrame> {
        match self {
            Self::Live(history) => lock(history).range(range, most),
            Self::Recording(recording) => recording.range(range, most),
        }
    }

    /// Whether the file is still being read.
    pub(crate) fn is_loading(&self) -> bool {
        match self {
            Self::Live(_) => false,
            Self::Recording(recording) => recording.is_loading(),
        }
    }
}
