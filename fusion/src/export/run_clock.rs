//! One clock for all files of a run, and which ticks have rows there.

use std::ops::Range;

use farfield_proto::tick::Tick;

/// An absence longer than this leaves no rows, seconds: only runs that go on for days have such, and every row is bytes.
const LONGEST_ABSENCE_S: f64 = 3600.0;

/// The clock of a run's files: seconds since its first tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunClock {
    pub(super) rate_hz: f64,
    /// `None` before it.
    pub(super) first: Option<Tick>,
    pub(super) end: RunEnd,
}

impl RunClock {
    pub(super) fn new(rate_hz: f64, end: RunEnd) -> Self {
        Self {
            rate_hz,
            first: None,
            end,
        }
    }

    /// The first tick of the run, which is `tick` if there was none yet.
    pub(super) fn first_at(&self, tick: Tick) -> Tick {
        self.first.unwrap_or(tick)
    }

    /// Time of `tick` since the first.
    pub(super) fn seconds(&self, tick: Tick) -> f64 {
        (tick - self.first_at(tick)) as f64 / self.rate_hz
    }

    /// The ticks of an absence that get a row.
    pub(super) fn blank(&self, absence: Range<i64>) -> Range<i64> {
        let seconds = (absence.end - absence.start) as f64 / self.rate_hz;
        if seconds > LONGEST_ABSENCE_S {
            return absence.end..absence.end;
        }
        absence
    }
}

/// What becomes of those who left before the end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunEnd {
    /// Their TRC files have rows up to it.
    Known,
    /// Their files end with their last pose: the run may go on for months, and must end at once when it is told to.
    Open,
}
