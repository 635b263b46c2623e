//! Which time the machines of a venue agree on, and whether it is fusion's own clock that is wrong.

use farfield_proto::message::health::SystemClock;

use super::agreement::{OffsetBounds, agreement};
use super::clock::EdgeClock;
use crate::live::Micros;

/// How near to the time that it keeps a clock is that NTP or PTP keeps right, microseconds.
const KEPT_WITHIN_US: Micros = 1_000;
/// So many clocks must agree: none is believed alone.
const ENOUGH: usize = 2;

/// The time that most systems show.
#[derive(Debug, Clone, Default)]
pub struct CommonClock {
    common_us: Micros,
    own_us: Micros,
}

impl CommonClock {
    /// Weighs fusion's own system against those of the edges that are there. Systems that say that something keeps them
    /// right are asked alone, where there are several. Returns [`Self::common_us`].
    pub fn weigh<'a>(
        &mut self,
        own: SystemClock,
        edges: impl Iterator<Item = &'a EdgeClock> + Clone,
    ) -> Micros {
        self.own_us = own.ahead_us;
        let kept = edges.clone().filter(|edge| edge.is_synchronised());
        let mut voters: Vec<OffsetBounds> = kept.filter_map(EdgeClock::system_bounds).collect();
        if own.synchronised {
            voters.push(OffsetBounds {
                lo_us: own.ahead_us.saturating_sub(KEPT_WITHIN_US),
                hi_us: own.ahead_us.saturating_add(KEPT_WITHIN_US),
            });
        }
        // What one alone says of itself, an edge in other hands may say, too.
        if voters.len() < ENOUGH && !own.synchronised {
            voters = edges.filter_map(EdgeClock::system_bounds).collect();
        }
        let agreed = agreement(&voters).filter(|_| voters.len() >= ENOUGH);
        // Fusion's own time where it can be true; else what was agreed on before, as bounds come and go with the queues.
        self.common_us = match agreed {
            Some(bounds) if bounds.beyond_us(self.own_us) > 0 => bounds.nearest(self.common_us),
            _ => self.own_us,
        };
        self.common_us
    }

    /// That time less the one that fusion's run goes by, microseconds.
    pub fn common_us(&self) -> Micros {
        self.common_us
    }

    /// By how much fusion's own system seems to be wrong, microseconds.
    pub fn own_error_us(&self) -> Micros {
        self.own_us.saturating_sub(self.common_us)
    }
}

#[cfg(test)]
mod tests {
    use super::super::clock::Exchange;
    use super::*;

    /// An edge whose clock is off by `offset_us`, 30 ms there and 10 ms back.
    fn edge(offset_us: Micros, synchronised: bool) -> EdgeClock {
        let mut clock = EdgeClock::default();
        for at_us in (0..60).map(|i| i * 16_667) {
            clock.add(&Exchange {
                boxes_sent_us: at_us,
                held_us: 0,
                patches_sent_us: at_us + 30_000 + offset_us,
                correction_us: 0,
                arrived_us: at_us + 40_000,
            });
        }
        clock.hear_system(Some(SystemClock {
            synchronised,
            ..SystemClock::default()
        }));
        clock
    }

    fn own(synchronised: bool) -> SystemClock {
        SystemClock {
            synchronised,
            ..SystemClock::default()
        }
    }

    fn off_us(own: SystemClock, edges: &[EdgeClock]) -> Vec<Micros> {
        let mut common = CommonClock::default();
        let common_us = common.weigh(own, edges.iter());
        let agree = |edge: &EdgeClock| {
            let mut edge = edge.clone();
            edge.agree_on(common_us);
            edge.surely_off_us()
        };
        edges.iter().map(agree).collect()
    }

    #[test]
    fn where_all_edges_agree_it_is_fusion_that_is_wrong() {
        let edges = [-2_000_000, -2_001_000, -1_999_000].map(|us| edge(us, false));
        assert_eq!(off_us(own(false), &edges), [0, 0, 0]);
        let mut common = CommonClock::default();
        common.weigh(own(false), edges.iter());
        assert!((common.own_error_us() - 2_000_000).abs() < 40_000);
    }

    #[test]
    fn one_edge_alone_is_not_believed_against_fusion() {
        assert!(off_us(own(false), &[edge(-2_000_000, false)])[0] > 1_900_000);
        assert!(off_us(own(true), &[edge(-2_000_000, true)])[0] > 1_900_000);
        let kept_right = [edge(-2_000_000, true)];
        assert!(off_us(own(false), &kept_right)[0] > 1_900_000);
    }

    #[test]
    fn the_one_that_is_wrong_is_found_among_many() {
        let edges = [0, 2_000_000, 500].map(|us| edge(us, true));
        let off = off_us(own(true), &edges);
        assert_eq!((off[0], off[2]), (0, 0));
        assert!(off[1] > 1_900_000);
    }

    #[test]
    fn one_edge_that_says_that_it_is_kept_right_turns_nobody_else_out() {
        let edges = [edge(2_000_000, true), edge(0, false), edge(500, false)];
        let off = off_us(own(false), &edges);
        assert!(off[0] > 1_900_000 && (off[1], off[2]) == (0, 0), "{off:?}");
    }

    #[test]
    fn whatever_an_edge_says_of_its_clock_there_is_an_answer() {
        for ahead_us in [i64::MIN, i64::MAX] {
            let mut wrong = edge(0, true);
            wrong.hear_system(Some(SystemClock {
                synchronised: true,
                max_error_us: None,
                ahead_us,
            }));
            let edges = [wrong, edge(0, false), edge(0, false)];
            assert_eq!(off_us(own(false), &edges)[1..], [0, 0]);
            assert_eq!(off_us(own(true), &edges)[1..], [0, 0]);
        }
    }

    #[test]
    fn clocks_that_nothing_keeps_right_do_not_outvote_one_that_is_kept() {
        let edges = [2_000_000, 2_000_000].map(|us| edge(us, false));
        assert!(off_us(own(true), &edges).iter().all(|&us| us > 1_900_000));
    }

    #[test]
    fn links_that_are_all_lopsided_alike_move_nothing() {
        let edges = [0, 0, 0].map(|us| edge(us, true));
        let mut common = CommonClock::default();
        assert_eq!(common.weigh(own(false), edges.iter()), 0);
    }
}
