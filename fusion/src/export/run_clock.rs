//! One clock for all files of a run, and the ticks that have rows.

use std::ops::Range;

use farfield_proto::tick::Tick;

/// An absence longer than this has no rows, seconds: only runs of days have such, and every row
/// takes space.
const LONGEST_ABSENCE_S: f64 = 3600.0;

/// The clock of a run's files: seconds since its first tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunClock {
    pub(super) rate_hz: f64,
    /// `None` before the first tick.
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

    /// The first tick of the run, or `tick` if there was none yet.
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

/// Rows after the last pose of people who left before the end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunEnd {
    /// Their TRC files have rows up to the end.
    Known,
    /// Their files end with their last pose: the run may last for months, and must be able to end
    /// at once.
    Open,
}
