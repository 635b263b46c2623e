//! The common time of a venue's machines, and whether fusion's own clock is wrong.
//!
//! Each clock lies between two bounds, and the bounds that most clocks share are used: Marzullo's
//! algorithm, as in NTP's selection of servers (RFC 5905, section 11.2.1): the
//! intersection of the largest number of intervals.

use farfield_proto::message::health::SystemClock;

use super::clock::EdgeClock;
use crate::live::Micros;

/// Accuracy of a clock that NTP or PTP synchronises, microseconds.
const SYNCHRONISED_WITHIN_US: Micros = 1_000;
/// Least clocks that must agree: a single one does not count.
const ENOUGH: usize = 2;

/// The time of most systems.
#[derive(Debug, Clone, Default)]
pub struct CommonClock {
    common_us: Micros,
    own_us: Micros,
}

impl CommonClock {
    /// Compares fusion's system with those of the edges. If there are several synchronised systems,
    /// only those count. Returns [`Self::common_us`].
    pub fn weigh<'a>(
        &mut self,
        own: SystemClock,
        edges: impl Iterator<Item = &'a EdgeClock> + Clone,
    ) -> Micros {
        self.own_us = own.ahead_us;
        let synchronised = edges.clone().filter(|edge| edge.is_synchronised());
        let mut voters: Vec<OffsetBounds> =
            synchronised.filter_map(EdgeClock::system_bounds).collect();
        if own.synchronised {
            voters.push(OffsetBounds {
                lo_us: own.ahead_us.saturating_sub(SYNCHRONISED_WITHIN_US),
                hi_us: own.ahead_us.saturating_add(SYNCHRONISED_WITHIN_US),
            });
        }
        // A single report of synchronisation does not count: it could come from a foreign edge.
        if voters.len() < ENOUGH && !own.synchronised {
            voters = edges.filter_map(EdgeClock::system_bounds).collect();
        }
        let agreed = agreement(&voters).filter(|_| voters.len() >= ENOUGH);
        // Fusion's own time if it is possible; else the previous common time, because bounds vary
        // with queues.
        self.common_us = match agreed {
            Some(bounds) if bounds.beyond_us(self.own_us) > 0 => bounds.nearest(self.common_us),
            _ => self.own_us,
        };
        self.common_us
    }

    /// The common time minus the time of fusion's run, microseconds.
    pub fn common_us(&self) -> Micros {
        self.common_us
    }

    /// Estimated error of fusion's own system, microseconds.
    pub fn own_error_us(&self) -> Micros {
        self.own_us.saturating_sub(self.common_us)
    }
}

/// Bounds of the offset of a clock, microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OffsetBounds {
    /// At least.
    pub lo_us: Micros,
    /// At most, not below `lo_us`.
    pub hi_us: Micros,
}

impl OffsetBounds {
    /// The bounds moved by `us`.
    #[must_use]
    pub fn moved(self, us: Micros) -> Self {
        Self {
            lo_us: self.lo_us.saturating_add(us),
            hi_us: self.hi_us.saturating_add(us),
        }
    }

    /// The offset between the bounds that is nearest to `us`.
    pub fn nearest(&self, us: Micros) -> Micros {
        us.clamp(self.lo_us, self.hi_us.max(self.lo_us))
    }

    /// Halfway between the bounds.
    pub fn middle_us(&self) -> Micros {
        self.lo_us.midpoint(self.hi_us)
    }

    /// How far `us` is outside; 0 between the bounds.
    pub fn beyond_us(&self, us: Micros) -> Micros {
        us.saturating_sub(self.nearest(us)).saturating_abs()
    }
}

/// What more than half of `clocks` agree on; `None` where there is no such agreement.
pub fn agreement(clocks: &[OffsetBounds]) -> Option<OffsetBounds> {
    let contain = |us: Micros| clocks.iter().filter(|c| c.beyond_us(us) == 0).count();
    // The intersection of most intervals begins where one of them begins.
    let (count, lo_us) = clocks
        .iter()
        .map(|clock| (contain(clock.lo_us), clock.lo_us))
        .max_by_key(|&(count, lo_us)| (count, std::cmp::Reverse(lo_us)))?;
    let agree = clocks.iter().filter(|c| c.beyond_us(lo_us) == 0);
    let hi_us = agree.map(|clock| clock.hi_us).min()?;
    (2 * count > clocks.len()).then_some(OffsetBounds { lo_us, hi_us })
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
        clock.set_system(Some(SystemClock {
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
            edge.set_common(common_us);
            edge.surely_off_us()
        };
        edges.iter().map(agree).collect()
    }

    #[test]
    fn if_all_edges_agree_fusion_is_wrong() {
        let edges = [-2_000_000, -2_001_000, -1_999_000].map(|us| edge(us, false));
        assert_eq!(off_us(own(false), &edges), [0, 0, 0]);
        let mut common = CommonClock::default();
        common.weigh(own(false), edges.iter());
        assert!((common.own_error_us() - 2_000_000).abs() < 40_000);
    }

    #[test]
    fn one_edge_does_not_outvote_fusion() {
        assert!(off_us(own(false), &[edge(-2_000_000, false)])[0] > 1_900_000);
        assert!(off_us(own(true), &[edge(-2_000_000, true)])[0] > 1_900_000);
        let synchronised = [edge(-2_000_000, true)];
        assert!(off_us(own(false), &synchronised)[0] > 1_900_000);
    }

    #[test]
    fn a_single_wrong_clock_is_found() {
        let edges = [0, 2_000_000, 500].map(|us| edge(us, true));
        let off = off_us(own(true), &edges);
        assert_eq!((off[0], off[2]), (0, 0));
        assert!(off[1] > 1_900_000);
    }

    #[test]
    fn one_synchronised_edge_does_not_outvote_the_others() {
        let edges = [edge(2_000_000, true), edge(0, false), edge(500, false)];
        let off = off_us(own(false), &edges);
        assert!(off[0] > 1_900_000 && (off[1], off[2]) == (0, 0), "{off:?}");
    }

    #[test]
    fn any_report_of_an_edge_gives_a_finite_result() {
        for ahead_us in [i64::MIN, i64::MAX] {
            let mut wrong = edge(0, true);
            wrong.set_system(Some(SystemClock {
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
    fn unsynchronised_clocks_do_not_outvote_a_synchronised_one() {
        let edges = [2_000_000, 2_000_000].map(|us| edge(us, false));
        assert!(off_us(own(true), &edges).iter().all(|&us| us > 1_900_000));
    }

    #[test]
    fn equally_asymmetric_links_change_nothing() {
        let edges = [0, 0, 0].map(|us| edge(us, true));
        let mut common = CommonClock::default();
        assert_eq!(common.weigh(own(false), edges.iter()), 0);
    }
}

#[cfg(test)]
mod agreement_tests {
    use proptest::prelude::*;

    use super::*;

    fn between(lo_us: Micros, hi_us: Micros) -> OffsetBounds {
        OffsetBounds { lo_us, hi_us }
    }

    #[test]
    fn a_single_different_clock_is_outvoted() {
        let clocks = [between(-5, 5), between(-1, 9), between(100, 120)];
        assert_eq!(agreement(&clocks), Some(between(-1, 5)));
        assert_eq!(agreement(&clocks[1..]), None, "of two none is outvoted");
        assert_eq!(agreement(&clocks[2..]), Some(between(100, 120)));
        assert_eq!(agreement(&[]), None);
    }

    proptest! {
        #[test]
        fn the_common_part_of_all_bounds_is_the_agreement(
            offset in -1_000_000i64..1_000_000,
            ways in prop::collection::vec((0i64..200_000, 0i64..200_000), 1..30),
        ) {
            let clocks: Vec<_> = ways.iter().map(|(up, down)| between(offset - down, offset + up)).collect();
            let agreed = agreement(&clocks).unwrap();
            prop_assert_eq!(agreed.beyond_us(offset), 0);
            prop_assert!(clocks.iter().all(|c| c.lo_us <= agreed.lo_us && agreed.hi_us <= c.hi_us));
        }
    }
}
