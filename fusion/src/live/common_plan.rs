//! The common plan of ticks: as many as the edges that make most of the views can process and send.
//!
//! An edge that is too slow skips ticks. A pose needs ticks that several edges share, so fusion
//! sends one plan to all of them: work on every n-th tick. An edge that is slower than that works
//! on a multiple of n. Each edge reports the n that it needs. Of these, fusion takes the one that
//! gives most views beyond the first at a tick: a single view makes no pose. So one slow edge of
//! four does not slow down the others.

use super::{Micros, SECOND_US};

/// How long a plan of more ticks must be better before it is used: edges measure over seconds.
const PATIENCE_US: Micros = SECOND_US;

/// The plan that all edges follow.
#[derive(Debug, Clone)]
pub struct CommonPlan {
    every_nth: u16,
    /// Since when more ticks would be better.
    room_since_us: Option<Micros>,
}

impl Default for CommonPlan {
    fn default() -> Self {
        Self {
            every_nth: 1,
            room_since_us: None,
        }
    }
}

impl CommonPlan {
    /// n, if all edges work on every n-th tick.
    pub fn every_nth(&self) -> u16 {
        self.every_nth
    }

    /// Updates the plan from the n that each edge needs at `now_us`.
    pub fn update(&mut self, needed_nths: &[u16], now_us: Micros) {
        let best = best_nth(needed_nths);
        if best >= self.every_nth
            || now_us - *self.room_since_us.get_or_insert(now_us) >= PATIENCE_US
        {
            (self.every_nth, self.room_since_us) = (best, None);
        }
    }
}

/// The plan whose ticks get most views beyond the first. Of equal plans, the one with more views at
/// a tick. Of only two edges, the faster one: it keeps following people between the shared ticks.
fn best_nth(needed_nths: &[u16]) -> u16 {
    let views_beyond_first = |nth: u16| {
        let shares = needed_nths
            .iter()
            .map(|needed| 1.0 / f64::from(needed.div_ceil(nth)));
        let views = (shares.sum::<f64>() - 1.0) / f64::from(nth);
        // Rounds, so that rounding errors do not decide between equal plans.
        (1e9 * views).round()
    };
    let plans = needed_nths.iter().copied().filter(|nth| *nth > 0);
    plans
        .max_by(|a, b| {
            let [of_a, of_b] = [*a, *b].map(views_beyond_first);
            let fewer_ticks = if needed_nths.len() > 2 {
                a.cmp(b)
            } else {
                b.cmp(a)
            };
            of_a.total_cmp(&of_b).then(fewer_ticks)
        })
        .unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn equally_slow_edges_share_all_their_ticks() {
        assert_eq!(best_nth(&[2, 3, 3, 3]), 3);
        assert_eq!(best_nth(&[4, 4, 4, 4]), 4);
        assert_eq!(best_nth(&[2, 4, 4]), 4, "one view alone is no pose");
        assert_eq!(best_nth(&[]), 1);
    }

    #[test]
    fn one_slow_edge_of_two_does_not_slow_the_other() {
        assert_eq!(best_nth(&[1, 64]), 1);
        assert_eq!(best_nth(&[4, 2]), 2);
        assert_eq!(best_nth(&[1, 3]), 1);
    }

    #[test]
    fn one_slow_edge_of_four_slows_no_other() {
        assert_eq!(best_nth(&[1, 1, 1, 9]), 1);
        assert_eq!(best_nth(&[2, 2, 9, 2]), 2);
        assert_eq!(best_nth(&[3, 2, 2, 2]), 2);
    }

    #[test]
    fn fewer_ticks_apply_at_once_and_more_after_a_second() {
        let mut plan = CommonPlan::default();
        plan.update(&[4, 4, 4], 0);
        assert_eq!(plan.every_nth(), 4);
        plan.update(&[1, 1, 1], SECOND_US);
        plan.update(&[4, 4, 4], 3 * SECOND_US / 2);
        plan.update(&[2, 2, 2], 2 * SECOND_US);
        assert_eq!(plan.every_nth(), 4, "not for a moment without load");
        plan.update(&[2, 2, 2], 3 * SECOND_US);
        assert_eq!(plan.every_nth(), 2);
    }

    proptest! {
        /// Counted tick by tick.
        #[test]
        fn no_other_plan_gets_more_views(needed_nths in prop::collection::vec(1u16..7, 2..6)) {
            let counted = |nth: u16| {
                // A multiple of every n that edges use here: 1 to 6, 8 and 10.
                let ticks = 120u32;
                let views = (0..ticks).map(|tick| {
                    let works = |needed: &&u16| tick % u32::from(needed.next_multiple_of(nth)) == 0;
                    let views = needed_nths.iter().filter(works).count();
                    views.saturating_sub(1) as u64
                });
                views.sum::<u64>()
            };
            let best = counted(best_nth(&needed_nths));
            for nth in &needed_nths {
                prop_assert!(counted(*nth) <= best);
            }
        }
    }
}
