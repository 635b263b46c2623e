//! The ticks that can be gone to: of the last minutes, or of a recording.

use std::sync::{Arc, Mutex};

use farfield_proto::tick::Tick;

use super::history::{History, HistoryBounds};
use super::known::frame::SharedFrame;
use super::lock;
pub(crate) use super::recording::Found;
use super::recording::Recording;

/// Where the past is kept.
pub(crate) enum Past {
    /// In memory.
    Live(Mutex<History>),
    /// In a file, of which the parts in use are in memory.
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

    /// The first and the last tick that can be gone to.
    pub(crate) fn span(&self) -> Option<[Tick; 2]> {
        match self {
            Self::Live(history) => lock(history).span(),
            Self::Recording(recording) => recording.span(),
        }
    }

    /// The tick, or the last before it, or the first.
    pub(crate) fn at(&self, tick: Tick) -> Found {
        match self {
            Self::Live(history) => {
                let found = lock(history).at(tick);
                found.map_or(Found::Nothing, Found::Frame)
            }
            Self::Recording(recording) => recording.at(tick),
        }
    }

    /// How everything was then.
    pub(crate) fn status_at(&self, tick: Tick) -> Option<Arc<str>> {
        match self {
            Self::Live(history) => lock(history).status_at(tick),
            Self::Recording(recording) => recording.status_at(tick),
        }
    }

    /// Ticks of a range that are in memory; of more than `most` every n-th.
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
