//! Load shedding: if a tick costs more than its time, the patches of some viewpoints are skipped,
//! in turn.
//!
//! The cost of a tick is proportional to its patches, so it is known in advance. If it exceeds a
//! fixed share of the tick period, as many viewpoints as needed are skipped, beginning after the
//! last skipped one. So every viewpoint is used again within a few ticks, and no person is lost
//! that the others see well enough. At least three stay. Skipped patches are in the recording, and
//! the tick's decision does not list them, so a replay skips the same.

use super::Micros;

/// Share of the tick period that the patches of one tick may take.
const SHARE_OF_PERIOD: f64 = 0.85;
/// Fewest viewpoints with patches that a tick keeps: with fewer, distances are unknown.
const LEAST_VIEWPOINTS: usize = 3;
/// Weight of a tick in the running mean of the cost of a patch.
const WEIGHT: f64 = 0.05;

/// Which viewpoints a tick skips.
#[derive(Debug, Clone, Default)]
pub struct Shedding {
    /// Microseconds for each patch, a running mean; `None` before the first tick with patches.
    us_per_patch: Option<f64>,
    /// Where the next turn begins.
    turn: usize,
    left_out: Vec<bool>,
    /// Viewpoints that the last tick skipped.
    n_left_out: usize,
}

impl Shedding {
    /// Records a tick of `patches` that took `took_us`. Ticks with detection passes are excluded:
    /// their extra cost comes once a second, and there is time to catch up.
    pub fn stepped(&mut self, patches: usize, took_us: Micros) {
        if patches > 0 {
            let cost = took_us as f64 / patches as f64;
            let mean = self.us_per_patch.get_or_insert(cost);
            *mean += WEIGHT * (cost - *mean);
        }
    }

    /// Whether each viewpoint is skipped in a tick with so many `patches` of each, `period_us`
    /// after the previous one.
    pub fn leave_out(&mut self, patches: &[usize], period_us: f64) -> &[bool] {
        let n = patches.len();
        self.left_out.clear();
        self.left_out.resize(n, false);
        self.n_left_out = 0;
        let us_per_patch = self.us_per_patch.unwrap_or(0.0);
        let mut left: usize = patches.iter().sum();
        let mut viewpoints = patches.iter().filter(|&&patches| patches > 0).count();
        let first = self.turn;
        for at in (0..n).map(|i| (first + i) % n) {
            let fits = left as f64 * us_per_patch <= SHARE_OF_PERIOD * period_us;
            if fits || viewpoints <= LEAST_VIEWPOINTS {
                break;
            }
            if patches[at] > 0 {
                self.left_out[at] = true;
                self.n_left_out += 1;
                self.turn = (at + 1) % n;
                left -= patches[at];
                viewpoints -= 1;
            }
        }
        &self.left_out
    }

    /// How many viewpoints the last tick skipped.
    pub fn n_left_out(&self) -> usize {
        self.n_left_out
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PERIOD_US: f64 = 16_667.0;

    fn learnt(us_per_patch: Micros) -> Shedding {
        let mut shedding = Shedding::default();
        shedding.stepped(100, 100 * us_per_patch);
        shedding
    }

    #[test]
    fn a_tick_within_its_time_skips_no_viewpoint() {
        let mut shedding = learnt(50);
        assert_eq!(shedding.leave_out(&[22; 12], PERIOD_US), [false; 12]);
        assert_eq!(shedding.n_left_out(), 0);
    }

    #[test]
    fn without_measurements_no_viewpoint_is_skipped() {
        let mut shedding = Shedding::default();
        assert_eq!(shedding.leave_out(&[200; 16], PERIOD_US), [false; 16]);
    }

    #[test]
    fn viewpoints_are_skipped_in_turn() {
        // 16 x 22 patches of 60 us: 14.2 ms hold 236 of 352, so six viewpoints are too many.
        let mut shedding = learnt(60);
        let mut times_left_out = [0; 16];
        for _ in 0..8 {
            let left_out = shedding.leave_out(&[22; 16], PERIOD_US).to_vec();
            assert_eq!(left_out.iter().filter(|out| **out).count(), 6);
            for (times, out) in times_left_out.iter_mut().zip(left_out) {
                *times += u32::from(out);
            }
        }
        assert_eq!(times_left_out, [3; 16]);
    }

    #[test]
    fn at_least_three_viewpoints_are_kept() {
        let mut shedding = learnt(100_000);
        let left_out = shedding.leave_out(&[4, 0, 4, 4, 4, 4], PERIOD_US);
        assert_eq!(left_out, [true, false, true, false, false, false]);
    }

    #[test]
    fn one_slow_tick_skips_no_viewpoint() {
        let mut shedding = learnt(40);
        shedding.stepped(264, 264 * 200);
        assert_eq!(shedding.leave_out(&[22; 12], PERIOD_US), [false; 12]);
    }

    proptest! {
        #[test]
        fn kept_patches_fit_the_time_or_are_the_minimum(
            patches in prop::collection::vec(0usize..40, 0..40), us_per_patch in 1i64..2_000, ticks in 1usize..20,
        ) {
            let mut shedding = learnt(us_per_patch);
            for _ in 0..ticks {
                let left_out = shedding.leave_out(&patches, PERIOD_US).to_vec();
                let kept = patches.iter().zip(left_out).filter(|(n, out)| **n > 0 && !out);
                let (viewpoints, sum) = kept.fold((0, 0), |(v, sum), (n, _)| (v + 1, sum + n));
                prop_assert!(viewpoints <= LEAST_VIEWPOINTS || sum as f64 * us_per_patch as f64 <= PERIOD_US);
            }
        }
    }
}
