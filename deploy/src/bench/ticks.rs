//! What a bench steps over, round after round: a crowd that was recorded in memory, or somebody's own recording.

use farfield_fusion::node::RecordedRun;
use farfield_fusion::pipeline::Pipeline;
use farfield_sim::recorded_venue::RecordedVenue;

use super::stopwatch::Stopwatch;

/// Ticks that can be stepped over again and again, each time with a fusion that knows nothing of them.
pub(super) trait BenchTicks: Send {
    /// Goes back to before the first tick.
    ///
    /// # Errors
    /// When there is no way back.
    fn rewind(&mut self) -> anyhow::Result<()>;

    /// Steps over the next tick and lets `watch` run meanwhile; `None` when there is none.
    ///
    /// # Errors
    /// When the tick cannot be read.
    fn step(&mut self, watch: &mut Stopwatch) -> anyhow::Result<Option<BenchTick>>;
}

/// What came of a tick.
pub(super) struct BenchTick {
    pub(super) has_detection: bool,
    /// People with a pose.
    pub(super) tracked: usize,
}

/// A crowd in memory, and fusion on its way through it.
pub(super) struct CrowdTicks<'a> {
    venue: &'a RecordedVenue,
    fusion: Pipeline,
    at: usize,
}

impl<'a> CrowdTicks<'a> {
    /// All that was recorded of `venue`.
    pub(super) fn of(venue: &'a RecordedVenue) -> Self {
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
