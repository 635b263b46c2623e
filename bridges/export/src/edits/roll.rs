//! Who of a run is there when: what edits are checked by, and the table of `farfield people`.

use std::collections::BTreeMap;
use std::ops::Range;

/// Most stretches that are kept of a person; what comes and goes more often is counted as if it stayed.
const MOST_STRETCHES: usize = 100_000;

/// Who is there when, by the ids of the poses.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Roll {
    /// Per person the stretches of ticks with a pose at each, ascending and apart.
    pub(super) stretches: BTreeMap<u32, Vec<Range<i64>>>,
}

/// One person, as edits make it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PersonRoll {
    /// First and last tick with a pose.
    pub span: [i64; 2],
    /// Ticks with a pose.
    pub ticks: u64,
    /// Stretches of ticks without a pose between the first and the last.
    pub gaps: usize,
}

impl Roll {
    /// Person `id` has a pose at `tick`. Ticks of a person must rise.
    pub fn add(&mut self, tick: i64, id: u32) {
        let stretches = self.stretches.entry(id).or_default();
        let is_full = stretches.len() >= MOST_STRETCHES;
        match stretches.last_mut() {
            Some(last) if is_full || last.end >= tick => last.end = tick.saturating_add(1),
            _ => stretches.push(tick..tick.saturating_add(1)),
        }
    }

    /// Everybody of the poses.
    pub fn ids(&self) -> impl DoubleEndedIterator<Item = u32> {
        self.stretches.keys().copied()
    }

    /// How many ids the poses have.
    pub fn n_ids(&self) -> usize {
        self.stretches.len()
    }

    /// Whether the poses have that id.
    pub fn has(&self, id: u32) -> bool {
        self.stretches.contains_key(&id)
    }
}

/// The stretches that lie in both lists.
pub(super) fn common(a: &[Range<i64>], b: &[Range<i64>]) -> Vec<Range<i64>> {
    let (mut i, mut j) = (0, 0);
    let mut common = Vec::new();
    while let (Some(x), Some(y)) = (a.get(i), b.get(j)) {
        let both = x.start.max(y.start)..x.end.min(y.end);
        if !both.is_empty() {
            common.push(both);
        }
        if x.end <= y.end {
            i += 1;
        } else {
            j += 1;
        }
    }
    common
}

/// Ticks in words: the first few stretches, and how many there are of all.
pub(super) fn ticks_in_words(stretches: &[Range<i64>]) -> String {
    const TOLD: usize = 3;
    let stretch = |ticks: &Range<i64>| match ticks.end.abs_diff(ticks.start) {
        1 => ticks.start.to_string(),
        _ => format!("{} to {}", ticks.start, ticks.end - 1),
    };
    let told: Vec<String> = stretches.iter().take(TOLD).map(stretch).collect();
    let more = if stretches.len() > TOLD { ", ..." } else { "" };
    let n: u64 = stretches
        .iter()
        .map(|ticks| ticks.end.abs_diff(ticks.start))
        .sum();
    let plural = if n == 1 { "tick" } else { "ticks" };
    format!("{plural} {}{more} ({n} in all)", told.join(", "))
}
