//! How many ticks ahead an edge's boxes are made: the tick at which they will be used.
//!
//! The first estimate comes from the path: boxes leave fusion some time after the stepped tick,
//! travel, and are used for the next pictures. Then the edge's reports correct it: the tick that
//! the used boxes were made for, and the tick of the pictures. Only the edge knows how long its
//! pictures take.

use super::{Micros, SECOND_US};

/// Longest horizon, ticks: beyond any useful prediction.
pub const LONGEST: i64 = 120;
/// Least change of the path estimate that is used, ticks: smaller ones would only make the boxes
/// unsteady.
const FAR_OFF: f64 = 3.0;
/// Largest mean difference of use and horizon, ticks: more is corrected.
const APART: f64 = 0.75;
/// Weight of one use in the running mean.
const WEIGHT: f64 = 0.05;
/// Time between two corrections: a corrected horizon must be used first.
const TRIM_EVERY_US: Micros = SECOND_US;

/// The horizon of one edge.
#[derive(Debug, Clone, Default)]
pub struct Horizon {
    ticks: Option<i64>,
    /// Correction of the path estimate, ticks.
    trim: i64,
    /// Ticks of the pictures minus those that the boxes were made for: a running mean.
    apart: f64,
    uses: u32,
    trimmed_us: Micros,
}

impl Horizon {
    /// How many ticks after the stepped one the boxes are for; 1 while unknown.
    pub fn ticks(&self) -> i64 {
        self.ticks.unwrap_or(1)
    }

    /// Sets the path: boxes leave `publish_us` after the time of their tick and take `one_way_us`
    /// to the edge.
    pub fn set_path(&mut self, publish_us: f64, one_way_us: f64, period_us: f64) {
        let on_arrival = (publish_us + one_way_us) / period_us;
        // The pictures of the next tick; half a tick later on average.
        let path_ticks = (on_arrival + 0.5 + self.trim as f64).clamp(1.0, LONGEST as f64);
        let is_far = self
            .ticks
            .is_none_or(|ticks| (ticks as f64 - path_ticks).abs() >= FAR_OFF);
        if is_far {
            self.start(path_ticks.round() as i64);
        }
    }

    /// Records that at `now_us` an edge used boxes for pictures `apart` ticks after their tick.
    pub fn used(&mut self, apart: i64, now_us: Micros) {
        let apart = apart.clamp(-LONGEST, LONGEST) as f64;
        self.uses = self.uses.saturating_add(1);
        self.apart += (apart - self.apart) * WEIGHT.max(1.0 / f64::from(self.uses));
        let Some(ticks) = self.ticks else { return };
        if self.trimmed_us == 0 {
            self.trimmed_us = now_us;
        }
        if now_us - self.trimmed_us < TRIM_EVERY_US || self.apart.abs() < APART {
            return;
        }
        let trim = self.apart.round() as i64;
        self.trim = (self.trim + trim).clamp(-LONGEST, LONGEST);
        self.start((ticks + trim).clamp(1, LONGEST));
        self.trimmed_us = now_us;
    }

    fn start(&mut self, ticks: i64) {
        self.ticks = Some(ticks);
        (self.apart, self.uses, self.trimmed_us) = (0.0, 0, 0);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PERIOD_US: f64 = 16_667.0;

    #[test]
    fn the_path_sets_the_horizon_first_and_after_large_changes() {
        let mut horizon = Horizon::default();
        assert_eq!(horizon.ticks(), 1);
        horizon.set_path(25_000.0, 8_000.0, PERIOD_US);
        assert_eq!(horizon.ticks(), 2);
        horizon.set_path(29_000.0, 8_000.0, PERIOD_US);
        assert_eq!(horizon.ticks(), 2, "it is steady");
        horizon.set_path(120_000.0, 100_000.0, PERIOD_US);
        assert_eq!(horizon.ticks(), 14);
    }

    #[test]
    fn lost_boxes_do_not_move_it() {
        let mut horizon = Horizon::default();
        horizon.set_path(25_000.0, 8_000.0, PERIOD_US);
        (0..2000).for_each(|i| horizon.used(i64::from(i % 20 == 0), i * 16_667));
        assert_eq!(horizon.ticks(), 2);
    }

    proptest! {
        #[test]
        fn the_horizon_converges_to_the_tick_of_use(
            publish in 1_000.0..300_000.0f64, one_way in 0.0..150_000.0f64, late in -2i64..6,
        ) {
            let mut horizon = Horizon::default();
            horizon.set_path(publish, one_way, PERIOD_US);
            let used = (horizon.ticks() + late).max(1);
            for i in 0..1200i64 {
                horizon.set_path(publish, one_way, PERIOD_US);
                // The boxes used now were sent a round trip before, at the horizon of that time:
                // close enough.
                horizon.used(used - horizon.ticks(), i * 16_667);
            }
            prop_assert!((horizon.ticks() - used).abs() <= 1);
        }

        #[test]
        fn the_horizon_stays_valid_for_any_report(uses in prop::collection::vec(any::<i64>(), 0..300)) {
            let mut horizon = Horizon::default();
            horizon.set_path(5_000.0, 100.0, PERIOD_US);
            for (i, apart) in (0i64..).zip(uses) {
                horizon.used(apart, i * SECOND_US);
                prop_assert!((1..=LONGEST).contains(&horizon.ticks()));
            }
        }
    }
}
