//! Whether people stay who they are for as long as a venue runs.

use std::fmt;
use std::path::Path;

use farfield_proto::tick::Tick;

use crate::live_venue::{PoseLog, RepeatingTruth, VenueWatch};

/// How much is scored at once, and again with what follows: somebody may be lost between two parts. Seconds.
const PART_S: f64 = 60.0;
const OVERLAP_S: f64 = 5.0;
/// What is not scored: people are found. Seconds.
const SETTLE_S: f64 = 10.0;

/// What was heard of people so far.
pub(super) struct SoakedPeople {
    log: PoseLog,
    truth: RepeatingTruth,
    rate_hz: f64,
    /// The first tick of the part that is heard; `None` before the first pose.
    from: Option<Tick>,
    parts: u32,
    switches: u64,
    ghosts: u64,
    gaps: u64,
    frames: u64,
    /// Mean distance of the parts, summed, and of the worst.
    sum_mm: f64,
    worst_mm: f64,
}

impl SoakedPeople {
    /// Listens beside `watch`.
    ///
    /// # Errors
    /// What Zenoh says, and a truth that cannot be read.
    pub(super) fn listen(watch: &VenueWatch, truth: &Path, rate_hz: f64) -> anyhow::Result<Self> {
        Ok(Self {
            log: PoseLog::listen(watch)?,
            truth: RepeatingTruth::read(truth)?,
            rate_hz,
            from: None,
            parts: 0,
            switches: 0,
            ghosts: 0,
            gaps: 0,
            frames: 0,
            sum_mm: 0.0,
            worst_mm: 0.0,
        })
    }

    /// Scores the part that is heard, once it is whole.
    pub(super) fn look(&mut self, watch: &VenueWatch) {
        let newest = watch.seen().newest.as_ref().map(|set| set.tick);
        let Some(newest) = newest else { return };
        let ticks = |seconds: f64| (seconds * self.rate_hz) as i64;
        let from = *self.from.get_or_insert(newest + ticks(SETTLE_S));
        if newest < from + ticks(PART_S) {
            return;
        }
        let again = if self.parts == 0 { 0 } else { ticks(OVERLAP_S) };
        let scores = self
            .log
            .score(&self.truth, &(from + -again..newest), self.rate_hz);
        self.from = Some(newest);
        self.parts += 1;
        self.switches += scores.identity.switches;
        self.ghosts += scores.identity.false_births;
        for actor in scores.actors.values() {
            self.gaps += actor.gaps;
            self.frames += actor.frames;
        }
        let mm = scores.mean.mpjpe_mm.unwrap_or(f64::INFINITY);
        self.sum_mm += mm;
        self.worst_mm = self.worst_mm.max(mm);
    }

    /// What must not be.
    pub(super) fn wrong(&self) -> Vec<String> {
        let counts = [
            (self.switches, "id switches"),
            (self.ghosts, "people that nobody is"),
        ];
        let wrong = counts.iter().filter(|(n, _)| *n > 0);
        wrong.map(|(n, what)| format!("{n} {what}")).collect()
    }
}

impl fmt::Display for SoakedPeople {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} minutes scored: {} id switches, {} people that nobody is, {:.1} mm from the truth ({:.1} in the worst), {:.3} % gaps",
            self.parts,
            self.switches,
            self.ghosts,
            self.sum_mm / f64::from(self.parts.max(1)),
            self.worst_mm,
            100.0 * self.gaps as f64 / self.frames.max(1) as f64
        )
    }
}
