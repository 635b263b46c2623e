//! The share of a link for sightings, which decides which detection passes are made.
//!
//! A pass sends all visible people, about 90 bytes each. Fusion requests passes for new,
//! unexplained or lost people, which is just when a link is full. Such passes would keep it full,
//! and no person would be detected again. Sightings therefore get a share of the rate, and each
//! pass occupies it for the time that its bytes need. A requested pass waits until little of that
//! time is left. A regular pass, which all viewpoints make, has a larger tolerance. This is the
//! virtual scheduling of ITU-T I.371 with a tolerance per kind. Patches get the capacity that
//! sightings leave.

use crate::live::budget::ByteBudget;
use crate::live::{Micros, SECOND_US};

/// Share of the rate for sightings.
const SHARE: f64 = 0.25;
/// Time for which earlier sightings may still occupy the share at a requested pass, microseconds.
const REQUESTED_TOLERANCE_US: Micros = SECOND_US / 2;
/// The same at a regular pass: more than the usual period.
const REGULAR_TOLERANCE_US: Micros = 3 * SECOND_US / 2;
/// Longest time without a pass on any link, microseconds.
const MAX_PAUSE_US: Micros = 5 * SECOND_US;

/// The occupation of the share by sightings.
#[derive(Debug, Clone)]
pub(super) struct SightingShare {
    sent: ByteBudget,
    free_at_us: Micros,
}

impl Default for SightingShare {
    fn default() -> Self {
        Self {
            sent: ByteBudget::new(0.0),
            free_at_us: Micros::MIN,
        }
    }
}

impl SightingShare {
    /// Records sightings of `total` bytes on a link of `rate` bytes per second.
    pub(super) fn sent(&mut self, total: usize, rate: f64, now_us: Micros) {
        self.sent.take(total, now_us);
        let takes_us = total as f64 / (SHARE * rate) * SECOND_US as f64;
        let free_at_us = self.free_at_us.max(now_us) + takes_us as Micros;
        self.free_at_us = free_at_us.min(now_us + MAX_PAUSE_US + REGULAR_TOLERANCE_US);
    }

    /// Whether a detection pass may be made now.
    pub(super) fn may_detect(&self, is_regular: bool, now_us: Micros) -> bool {
        let tolerance_us = if is_regular {
            REGULAR_TOLERANCE_US
        } else {
            REQUESTED_TOLERANCE_US
        };
        self.free_at_us <= now_us + tolerance_us
    }

    /// The part of `rate` for patches, bytes per second: without the sightings of the last second,
    /// which count at most their share.
    pub(super) fn left_for_patches(&mut self, rate: f64, now_us: Micros) -> f64 {
        (rate - self.sent.sent(now_us) as f64).max((1.0 - SHARE) * rate)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Period of regular passes, ticks at 60 Hz.
    const PERIOD: i64 = 60;

    /// The ticks at which an edge makes passes of `bytes` if one is requested at every tick; 4,600
    /// bytes are fifty people.
    fn passes(bytes: usize, rate: f64, ticks: i64) -> Vec<i64> {
        let mut share = SightingShare::default();
        let mut made = Vec::new();
        for tick in 0..ticks {
            let now_us = tick * SECOND_US / 60;
            if share.may_detect(tick % PERIOD == 0, now_us) {
                share.sent(bytes, rate, now_us);
                made.push(tick);
            }
        }
        made
    }

    #[test]
    fn an_unbounded_link_allows_every_pass() {
        assert_eq!(passes(5_600, f64::INFINITY, 600).len(), 600);
    }

    #[test]
    fn a_quarter_megabit_allows_all_regular_and_some_requested_passes() {
        let made = passes(4_600, 31_000.0, 600);
        assert!((0..10).all(|second| made.contains(&(second * PERIOD))));
        assert!((14..=20).contains(&made.len()), "{made:?}");
        assert!(made[1] < 15, "one soon after the first: {made:?}");
    }

    #[test]
    fn a_thinner_link_skips_some_regular_passes() {
        let made = passes(4_600, 4_000.0, 6_000);
        assert!((18..=25).contains(&made.len()), "{made:?}");
        assert!(made.iter().any(|tick| tick % PERIOD == 0));
    }

    #[test]
    fn patches_get_the_rest_and_at_least_their_share() {
        let mut share = SightingShare::default();
        assert!((share.left_for_patches(10_000.0, 0) - 10_000.0).abs() < 1e-9);
        share.sent(2_000, 10_000.0, 0);
        assert!((share.left_for_patches(10_000.0, 1) - 8_000.0).abs() < 1e-9);
        share.sent(20_000, 10_000.0, 2);
        assert!((share.left_for_patches(10_000.0, 3) - 7_500.0).abs() < 1e-9);
        assert!(share.left_for_patches(f64::INFINITY, 4).is_infinite());
    }

    proptest! {
        #[test]
        fn sightings_stay_within_their_share_over_time(
            bytes in 100usize..20_000, rate in 2_000.0f64..1e6,
        ) {
            let ticks = 6_000;
            let made = passes(bytes, rate, ticks).len() as f64;
            let seconds = ticks as f64 / 60.0;
            // The last pass, and those that never wait longer than five seconds.
            let most = SHARE * rate * (seconds + 2.0) + bytes as f64;
            let least_often = seconds / 5.0 * bytes as f64;
            prop_assert!(made * bytes as f64 <= most.max(1.2 * least_often + bytes as f64));
        }
    }
}
