//! Whether people keep their ids as long as a venue runs.

use std::fmt;
use std::path::Path;

use farfield_proto::tick::Tick;

use crate::live_venue::{PoseLog, RepeatingTruth, VenueWatch};

/// Duration of a scored part, and its overlap with the part before, since a person may be lost between two parts. Seconds.
const PART_S: f64 = 60.0;
const OVERLAP_S: f64 = 5.0;
/// Time at the start that is not scored, seconds: people are found.
const SETTLE_S: f64 = 10.0;

/// Scores of people so far.
pub(super) struct SoakedPeople {
    log: PoseLog,
    truth: RepeatingTruth,
    rate_hz: f64,
    /// The first tick of the current part; `None` before the first pose.
    from: Option<Tick>,
    parts: u32,
    switches: u64,
    false_people: u64,
    gaps: u64,
    frames: u64,
    /// Mean error of the parts, summed, and of the worst.
    sum_mm: f64,
    worst_mm: f64,
}

impl SoakedPeople {
    /// Subscribes to the poses of `watch`.
    ///
    /// # Errors
    /// Zenoh fails, or the truth cannot be read.
    pub(super) fn subscribe(watch: &VenueWatch, truth: &Path, rate_hz: f64) -> anyhow::Result<Self> {
        Ok(Self {
            log: PoseLog::subscribe(watch)?,
            truth: RepeatingTruth::read(truth)?,
            rate_hz,
            from: None,
            parts: 0,
            switches: 0,
            false_people: 0,
            gaps: 0,
            frames: 0,
            sum_mm: 0.0,
            worst_mm: 0.0,
        })
    }

    /// Scores the current part once it is complete.
    pub(super) fn update(&mut self, watch: &VenueWatch) {
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
        self.false_people += scores.identity.false_births;
        for actor in scores.actors.values() {
            self.gaps += actor.gaps;
            self.frames += actor.frames;
        }
        let mm = scores.mean.mpjpe_mm.unwrap_or(f64::INFINITY);
        self.sum_mm += mm;
        self.worst_mm = self.worst_mm.max(mm);
    }

    /// Faults that fail the soak.
    pub(super) fn wrong(&self) -> Vec<String> {
        let counts = [
            (self.switches, "id switches"),
            (self.false_people, "false people"),
        ];
        let wrong = counts.iter().filter(|(n, _)| *n > 0);
        wrong.map(|(n, what)| format!("{n} {what}")).collect()
    }
}

impl fmt::Display for SoakedPeople {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} minutes scored: {} id switches, {} false people, {:.1} mm from the truth ({:.1} in the worst), {:.3} % gaps",
            self.parts,
            self.switches,
            self.false_people,
            self.sum_mm / f64::from(self.parts.max(1)),
            self.worst_mm,
            100.0 * self.gaps as f64 / self.frames.max(1) as f64
        )
    }
}
