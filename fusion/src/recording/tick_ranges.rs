//! Sets of ticks as ranges that do not touch.

use std::collections::BTreeMap;

use farfield_proto::tick::Tick;

/// Half-open ranges of ticks, each with its minimum length.
#[derive(Debug, Default)]
pub(super) struct TickRanges(BTreeMap<Tick, End>);

/// Data of a range besides its first tick.
#[derive(Debug, Clone, Copy)]
struct End {
    to: Tick,
    /// A shorter rest is dropped.
    least: i64,
}

impl TickRanges {
    /// Number of ranges.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// Number of ticks.
    pub(super) fn ticks(&self) -> u64 {
        let lengths = self.0.iter().map(|(&from, end)| end.to - from);
        lengths.map(i64::unsigned_abs).sum()
    }

    /// Whether `tick` is in one of them.
    pub(super) fn contains(&self, tick: Tick) -> bool {
        let before = self.0.range(..=tick).next_back();
        before.is_some_and(|(_, end)| tick < end.to)
    }

    /// The first range.
    pub(super) fn first(&self) -> Option<[Tick; 2]> {
        self.0.first_key_value().map(|(&from, end)| [from, end.to])
    }

    /// Adds a range that comes after all others.
    pub(super) fn push(&mut self, [from, to]: [Tick; 2], least: i64) {
        if let Some(mut last) = self.0.last_entry()
            && last.get().to == from
            && last.get().least == least
        {
            last.get_mut().to = to;
            return;
        }
        self.0.insert(from, End { to, least });
    }

    /// Removes `from..to`, and rests that become too short.
    pub(super) fn cut(&mut self, [from, to]: [Tick; 2]) {
        let touched: Vec<(Tick, End)> = self
            .0
            .range(..to)
            .rev()
            .take_while(|(_, end)| end.to > from)
            .map(|(&start, &end)| (start, end))
            .collect();
        for (start, end) in touched {
            self.0.remove(&start);
            for (start, to) in [(start, from), (to, end.to)] {
                if to - start >= end.least {
                    self.0.insert(start, End { to, ..end });
                }
            }
        }
    }

    /// All of them.
    #[cfg(test)]
    pub(super) fn all(&self) -> Vec<[i64; 2]> {
        let ranges = self.0.iter();
        ranges.map(|(from, end)| [from.0, end.to.0]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranges(all: &[[i64; 2]], least: i64) -> TickRanges {
        let mut ranges = TickRanges::default();
        for &[from, to] in all {
            ranges.push([Tick(from), Tick(to)], least);
        }
        ranges
    }

    #[test]
    fn a_cut_keeps_both_sides() {
        let mut some = ranges(&[[0, 10], [20, 30]], 1);
        some.cut([Tick(4), Tick(22)]);
        assert_eq!(some.all(), [[0, 4], [22, 30]]);
        some.cut([Tick(25), Tick(26)]);
        assert_eq!(some.all(), [[0, 4], [22, 25], [26, 30]]);
        assert!(some.contains(Tick(24)) && !some.contains(Tick(25)));
        assert_eq!((some.len(), some.ticks()), (3, 11));
    }

    #[test]
    fn a_rest_that_is_too_short_is_removed() {
        let mut some = ranges(&[[10, 20]], 3);
        some.cut([Tick(12), Tick(13)]);
        assert_eq!(some.all(), [[13, 20]]);
    }

    #[test]
    fn ranges_that_touch_are_one() {
        assert_eq!(ranges(&[[0, 4], [4, 9]], 1).all(), [[0, 9]]);
    }
}
