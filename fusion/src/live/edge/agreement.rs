//! Agreement of clocks: each lies between two bounds, and the bounds that most clocks share are
//! used.
//!
//! Marzullo's algorithm, as in NTP's selection of servers (RFC 5905, section 11.2.1): the
//! intersection of the largest number of intervals.

use crate::live::Micros;

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
