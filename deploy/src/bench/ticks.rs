//! The ticks of a benchmark, repeated in rounds: simulated people in memory, or a recording; and the stopwatch for
//! them.

use std::time::Instant;

use farfield_fusion::pipeline::{Pipeline, Stage};
use farfield_fusion_node::RecordedRun;
use farfield_node::clock;
use farfield_sim::recorded_venue::RecordedVenue;

/// Ticks that can be processed repeatedly, each time by a new fusion.
pub(super) trait BenchTicks: Send {
    /// Returns to before the first tick.
    ///
    /// # Errors
    /// When that is impossible.
    fn rewind(&mut self) -> anyhow::Result<()>;

    /// Processes the next tick and times it with `watch`; `None` after the last.
    ///
    /// # Errors
    /// When the tick cannot be read.
    fn step(&mut self, watch: &mut Stopwatch) -> anyhow::Result<Option<BenchTick>>;
}

/// Result of a tick.
pub(super) struct BenchTick {
    pub(super) has_detection: bool,
    /// People with a pose.
    pub(super) tracked: usize,
}

/// Simulated people in memory, and fusion at its current tick.
pub(super) struct CrowdTicks<'a> {
    venue: &'a RecordedVenue,
    fusion: Pipeline,
    at: usize,
}

impl<'a> CrowdTicks<'a> {
    /// For all recorded ticks of `venue`.
    pub(super) fn new(venue: &'a RecordedVenue) -> Self {
        Self {
            venue,
            fusion: venue.fusion(),
            at: 0,
        }
    }
}

impl BenchTicks for CrowdTicks<'_> {
    fn rewind(&mut self) -> anyhow::Result<()> {
        (self.fusion, self.at) = (self.venue.fusion(), 0);
        Ok(())
    }

    fn step(&mut self, watch: &mut Stopwatch) -> anyhow::Result<Option<BenchTick>> {
        let Some(group) = self.venue.groups().get(self.at) else {
            return Ok(None);
        };
        self.at += 1;
        watch.start();
        let output = self.fusion.step(group, &mut |stage| watch.lap(stage));
        Ok(Some(BenchTick {
            has_detection: !group.sighting_sets.is_empty(),
            tracked: output.poses.persons.len(),
        }))
    }
}

impl BenchTicks for RecordedRun {
    fn rewind(&mut self) -> anyhow::Result<()> {
        Ok(RecordedRun::rewind(self)?)
    }

    fn step(&mut self, watch: &mut Stopwatch) -> anyhow::Result<Option<BenchTick>> {
        let Some(recorded) = self.replay().read()? else {
            return Ok(None);
        };
        watch.start();
        let output = self
            .replay()
            .solve(&recorded, &mut |stage| watch.lap(stage))?;
        Ok(Some(BenchTick {
            has_detection: !recorded.group.sighting_sets.is_empty(),
            tracked: output.poses.persons.len(),
        }))
    }
}

pub(super) struct Stopwatch {
    since: Instant,
    /// Times of the stages of the step, microseconds.
    pub(super) laps_us: [f64; Stage::ALL.len()],
}

impl Stopwatch {
    /// Restarts from zero.
    pub(super) fn start(&mut self) {
        *self = Self::new();
    }

    /// Records the time of `stage`, which has just ended.
    pub(super) fn lap(&mut self, stage: Stage) {
        let now = clock::now();
        self.laps_us[stage as usize] = 1e6 * (now - self.since).as_secs_f64();
        self.since = now;
    }

    /// Starts now.
    pub(super) fn new() -> Self {
        Self {
            since: clock::now(),
            laps_us: Default::default(),
        }
    }
}
