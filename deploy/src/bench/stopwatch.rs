//! The times of a step of fusion and of its stages.

use std::time::Instant;

use farfield_fusion::pipeline::Stage;
use farfield_node::clock;

/// Times a step and its stages.
pub(super) struct Stopwatch {
    since: Instant,
    /// What the stages of the step took, microseconds.
    pub(super) laps_us: [f64; Stage::ALL.len()],
}

impl Stopwatch {
    /// Lets it run from zero.
    pub(super) fn start(&mut self) {
        *self = Self::new();
    }

    /// Notes the time of `stage`, which has just ended.
    pub(super) fn lap(&mut self, stage: Stage) {
        let now = clock::now();
        self.laps_us[stage as usize] = 1e6 * (now - self.since).as_secs_f64();
        self.since = now;
    }

    /// Runs from now on.
    pub(super) fn new() -> Self {
        Self {
            since: clock::now(),
            laps_us: Default::default(),
        }
    }
}
