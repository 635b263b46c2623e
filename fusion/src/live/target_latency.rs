//! The time that the operator gives a tick, from its pictures to its poses: how long patches may be waited for, and how
//! often the poses were out in time.
//!
//! Without a target a tick waits for whoever sends it something. With one it waits for as long as the core still makes it
//! in time: who is slower than that takes part with what comes earlier, and is named. Ticks with a detection pass are
//! waited for as ever, since nobody would be found otherwise.

use super::arrivals::NewestDelays;
use super::{Micros, SECOND_US};
use crate::export::summary::TargetLatencySummary;

/// Ticks whose time in the core is remembered, and for how long, microseconds.
const KEPT: usize = 256;
const LIFE_US: Micros = 5 * SECOND_US;
/// Share of the ticks for which the time that is left for the core shall be enough.
const IN_TIME: f64 = 0.98;
/// What is left beyond that: for timers and the way to the network, microseconds.
const MARGIN_US: Micros = 1_000;
/// A share of ticks in time below which the target is not kept.
pub const KEPT_SHARE: f64 = 0.9;
/// Fewest ticks of which a share is told.
const ENOUGH: u64 = 100;

/// How long ticks of a live run wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LongestWaits {
    /// For patches, after the tick, microseconds.
    pub patches_us: Micros,
    /// Where the tick has a detection pass.
    pub detections_us: Micros,
}

/// The target, and how it is kept.
#[derive(Debug, Clone, Default)]
pub struct TargetLatency {
    target_us: Option<Micros>,
    solving: NewestDelays<KEPT>,
    /// Ticks that were in time, of how many.
    all: [u64; 2],
    /// The same since [`Self::take_share`] last said something.
    recent: [u64; 2],
}

impl TargetLatency {
    /// A target of `target_ms` milliseconds; 0: none.
    pub fn new(target_ms: f64) -> Self {
        Self {
            target_us: (target_ms > 0.0).then_some((target_ms * 1e3) as Micros),
            ..Self::default()
        }
    }

    /// How long the next tick waits at `now_us`, where it would wait for `most_us` without a target.
    pub fn longest_waits(&mut self, most_us: Micros, now_us: Micros) -> LongestWaits {
        let left_us = self.target_us.map(|target_us| {
            let solving_us = self.solving.share(IN_TIME, 1, now_us - LIFE_US);
            (target_us - solving_us.unwrap_or(0) - MARGIN_US).max(0)
        });
        LongestWaits {
            patches_us: left_us.map_or(most_us, |us| us.min(most_us)),
            detections_us: most_us,
        }
    }

    /// A tick's poses went out at `now_us`, `latency_us` after its pictures were taken; the core had it for `solving_us`.
    pub fn posed(&mut self, latency_us: Micros, solving_us: Micros, now_us: Micros) {
        let Some(target_us) = self.target_us else {
            return;
        };
        self.solving.add(solving_us, now_us);
        let in_time = u64::from(latency_us <= target_us);
        for [kept, of] in [&mut self.all, &mut self.recent] {
            *kept += in_time;
            *of += 1;
        }
    }

    /// How the target was kept; `None` without a target or a tick.
    pub fn summary(&self) -> Option<TargetLatencySummary> {
        let [kept, of] = self.all;
        let target_ms = self.target_ms()?;
        (of > 0).then(|| TargetLatencySummary {
            target_ms,
            in_time: kept as f64 / of as f64,
        })
    }

    /// The share of ticks in time since this last said it; `None` while there are too few.
    pub fn take_share(&mut self) -> Option<f64> {
        let [kept, of] = self.recent;
        if of < ENOUGH {
            return None;
        }
        self.recent = [0; 2];
        Some(kept as f64 / of as f64)
    }

    /// The target, milliseconds.
    pub fn target_ms(&self) -> Option<f64> {
        self.target_us.map(|us| us as f64 / 1e3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST_US: Micros = 400_000;

    #[test]
    fn without_a_target_a_tick_waits_as_long_as_it_may() {
        let mut target = TargetLatency::new(0.0);
        target.posed(90_000, 9_000, 0);
        assert_eq!(target.longest_waits(MOST_US, 0).patches_us, MOST_US);
        assert_eq!(target.summary(), None);
    }

    #[test]
    fn what_the_core_takes_is_left_for_it() {
        let mut target = TargetLatency::new(50.0);
        for tick in 0..100 {
            target.posed(40_000, 8_000, tick);
        }
        let waits = target.longest_waits(MOST_US, 100);
        assert_eq!(waits.patches_us, 50_000 - 8_000 - MARGIN_US);
        assert_eq!(waits.detections_us, MOST_US);
        // What was slow once is over.
        let later = target.longest_waits(MOST_US, 100 + LIFE_US);
        assert_eq!(later.patches_us, 50_000 - MARGIN_US);
    }

    #[test]
    fn a_target_that_the_core_alone_misses_waits_for_nobody() {
        let mut target = TargetLatency::new(5.0);
        for tick in 0..100 {
            target.posed(30_000, 20_000, tick);
        }
        assert_eq!(target.longest_waits(MOST_US, 100).patches_us, 0);
        assert_eq!(target.take_share(), Some(0.0));
        assert_eq!(target.take_share(), None, "it is told of new ticks only");
        let none = TargetLatencySummary {
            target_ms: 5.0,
            in_time: 0.0,
        };
        assert_eq!(target.summary(), Some(none));
    }

    #[test]
    fn a_target_that_is_mostly_kept_counts_as_kept() {
        let mut target = TargetLatency::new(50.0);
        for tick in 0..100 {
            target.posed(if tick % 20 == 0 { 60_000 } else { 45_000 }, 5_000, tick);
        }
        assert_eq!(target.summary().map(|kept| kept.in_time), Some(0.95));
        assert!(target.take_share().is_some_and(|share| share > KEPT_SHARE));
    }
}
