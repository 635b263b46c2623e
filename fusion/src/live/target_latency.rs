//! How long a tick may wait for patches, and how often its poses were in time.
//!
//! A tick waits until enough edges see each person ([`needed`]), so that one late edge delays no
//! tick. A tick with a detection pass waits for the sightings of enough edges ([`are_enough`]). The
//! target is the time from pictures to poses that the operator asks for. With a target, a tick
//! waits no longer than the core's time allows. Slower edges are skipped, counted and reported. The
//! target does not bound ticks with a detection pass, because new people would not be found.

use std::collections::BTreeMap;

use farfield_proto::id::PersonId;
use farfield_proto::order_statistics::nearest_rank;

use super::arrivals::NewestDelays;
use super::{Micros, SECOND_US};
use crate::export::summary::TargetLatencySummary;

/// Ticks whose time without waiting is remembered, and for how long, microseconds.
const REMEMBERED: usize = 256;
const LIFE_US: Micros = 5 * SECOND_US;
/// Share of the ticks for which the time left for the core shall be enough.
const IN_TIME: f64 = 0.98;
/// Reserve beyond that, for timers and network, microseconds.
const MARGIN_US: Micros = 1_000;
/// Share of ticks in time below which the target is missed.
pub const KEPT_SHARE: f64 = 0.9;
/// Share of skipped ticks above which an edge is reported, and one below which the report ends.
pub const LEFT_OUT_SHARE: f64 = 0.1;
const LEFT_OUT_NO_MORE: f64 = 0.05;
/// Fewest ticks for a report, and fewest ticks of one kind.
const ENOUGH: u64 = 100;
const ENOUGH_OF_THESE: u64 = ENOUGH / 2;

/// How long ticks of a live run wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LongestWaits {
    /// For patches, after the tick, microseconds.
    pub patches_us: Micros,
    /// For the sightings of a detection pass.
    pub detections_us: Micros,
    /// Since when enough sightings of the next tick are there: fusion does not wait for unusually
    /// late ones.
    pub enough_since_us: Option<Micros>,
}

/// Views of a person, or sightings of a detection pass, that a tick waits for: fewest, and as a
/// share of all. Of four, one may be late.
const FEWEST_VIEWS: usize = 3;
const MOST_VIEWS_SHARE: f64 = 0.75;

/// Whether the sightings of `arrived` edges are enough if `all` send some.
pub fn are_enough(arrived: usize, all: usize) -> bool {
    arrived >= FEWEST_VIEWS && arrived as f64 >= MOST_VIEWS_SHARE * all as f64
}

/// How long a tick waits, at most `most_us`: one period more than the slowest view that a person
/// needs. `patches_come` has the delay of each view of each person (`None`: unknown).
pub fn needed(
    patches_come: &mut [(PersonId, Option<Micros>)],
    period_us: Micros,
    most_us: Micros,
) -> Micros {
    patches_come.sort_unstable_by_key(|(person, us)| (*person, us.unwrap_or(most_us)));
    let of_persons = patches_come.chunk_by(|(a, _), (b, _)| a == b);
    let slowest_us = of_persons.map(|views| {
        let waited_for = nearest_rank(MOST_VIEWS_SHARE, views.len()).max(FEWEST_VIEWS - 1);
        let (_, us) = views[waited_for.min(views.len() - 1)];
        us.unwrap_or(most_us)
    });
    let needed_us = slowest_us.max().map(|us| us.saturating_add(period_us));
    needed_us.map_or(most_us, |us| us.clamp(0, most_us))
}

impl LongestWaits {
    /// The same limit for patches and sightings.
    pub fn same(most_us: Micros) -> Self {
        Self {
            patches_us: most_us,
            detections_us: most_us,
            enough_since_us: None,
        }
    }
}

/// A tick with patches whose poses were published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PosedTick {
    /// From the first of its pictures to its poses, microseconds.
    pub latency_us: Micros,
    /// Time in the core, microseconds.
    pub solving_us: Micros,
    /// How long before the tick's time its first picture was taken, microseconds: latency counts
    /// from that.
    pub early_us: Micros,
}

/// Ticks at which one edge was awaited.
#[derive(Debug, Clone, Copy, Default)]
struct AwaitedTicks {
    /// Ticks that ended before all its patches came, of how many.
    all: [u64; 2],
    /// The same since the last report.
    recent: [u64; 2],
    is_slow: bool,
}

/// How the target was kept recently, shares from 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct RecentTicks {
    /// Share of ticks with patches that were in time; `None` if there were few.
    pub in_time: Option<f64>,
    /// The edges that are too slow, by index, with their share of skipped ticks.
    pub too_slow: Vec<(usize, f64)>,
    /// Share of ticks for which all edges were too late.
    pub all_late: f64,
}

/// The target, and how it is kept.
#[derive(Debug, Clone, Default)]
pub struct TargetLatency {
    target_us: Option<Micros>,
    /// Time that ticks take after their own time, without waiting.
    spent: NewestDelays<REMEMBERED>,
    /// Ticks in time, of how many.
    all: [u64; 2],
    /// The same since the last report.
    recent: [u64; 2],
    edges: Vec<AwaitedTicks>,
    /// Ticks with awaited edges since the last report, and those for which all edges were too late.
    ticks: u64,
    all_late: u64,
}

impl TargetLatency {
    /// A target of `target_ms` milliseconds; 0: none.
    pub fn new(target_ms: f64) -> Self {
        Self {
            target_us: (target_ms > 0.0).then_some((target_ms * 1e3) as Micros),
            ..Self::default()
        }
    }

    /// How long the next tick waits at `now_us`, where `most` applies without a target.
    pub fn longest_waits(&mut self, most: LongestWaits, now_us: Micros) -> LongestWaits {
        let left_us = self.target_us.map(|target_us| {
            let spent_us = self.spent.share(IN_TIME, 1, now_us - LIFE_US);
            (target_us - spent_us.unwrap_or(0) - MARGIN_US).max(0)
        });
        LongestWaits {
            patches_us: left_us.map_or(most.patches_us, |us| us.min(most.patches_us)),
            ..most
        }
    }

    /// Records the end of a tick: per edge, in order, whether it was skipped; `None` if it was not
    /// awaited.
    pub fn over(&mut self, left_out: &[Option<bool>]) {
        let awaited = || left_out.iter().flatten();
        if awaited().next().is_none() {
            return;
        }
        self.edges
            .resize_with(self.edges.len().max(left_out.len()), AwaitedTicks::default);
        for (edge, left_out) in self.edges.iter_mut().zip(left_out) {
            let Some(left_out) = left_out else { continue };
            for [out, of] in [&mut edge.all, &mut edge.recent] {
                *out += u64::from(*left_out);
                *of += 1;
            }
        }
        self.ticks += 1;
        self.all_late += u64::from(awaited().all(|left_out| *left_out));
    }

    /// Records that the poses of a tick with patches were published at `now_us`.
    pub fn posed(&mut self, tick: PosedTick, now_us: Micros) {
        let Some(target_us) = self.target_us else {
            return;
        };
        let spent_us = tick.solving_us.saturating_add(tick.early_us.max(0));
        self.spent.add(spent_us, now_us);
        let in_time = u64::from(tick.latency_us <= target_us);
        for [in_time_count, of] in [&mut self.all, &mut self.recent] {
            *in_time_count += in_time;
            *of += 1;
        }
    }

    /// How the target was kept; `names` are those of the edges. `None` without a target or a tick.
    pub fn summary<'a>(
        &self,
        names: impl Iterator<Item = &'a str>,
    ) -> Option<TargetLatencySummary> {
        let target_ms = self.target_ms()?;
        let left_out: BTreeMap<String, f64> = names
            .zip(&self.edges)
            .filter(|(_, edge)| edge.all[0] > 0)
            .map(|(name, edge)| (name.to_owned(), share(edge.all)))
            .collect();
        (self.all[1] > 0 || !left_out.is_empty()).then(|| TargetLatencySummary {
            target_ms,
            in_time: share(self.all),
            left_out,
        })
    }

    /// How the target was kept since the last call; `None` while there are too few ticks.
    pub fn take_recent(&mut self) -> Option<RecentTicks> {
        if self.ticks < ENOUGH {
            return None;
        }
        let mut recent = RecentTicks {
            in_time: (self.recent[1] >= ENOUGH_OF_THESE).then(|| share(self.recent)),
            too_slow: Vec::new(),
            all_late: share([self.all_late, self.ticks]),
        };
        for (index, edge) in self.edges.iter_mut().enumerate() {
            let counts = std::mem::take(&mut edge.recent);
            let bound = if edge.is_slow {
                LEFT_OUT_NO_MORE
            } else {
                LEFT_OUT_SHARE
            };
            edge.is_slow = counts[1] >= ENOUGH_OF_THESE && share(counts) > bound;
            if edge.is_slow {
                recent.too_slow.push((index, share(counts)));
            }
        }
        (self.recent, self.ticks, self.all_late) = ([0; 2], 0, 0);
        Some(recent)
    }

    /// The target, milliseconds.
    pub fn target_ms(&self) -> Option<f64> {
        self.target_us.map(|us| us as f64 / 1e3)
    }
}

/// Share; 0 of none.
fn share([part, of]: [u64; 2]) -> f64 {
    part as f64 / of.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST_US: Micros = 400_000;
    const MOST: LongestWaits = LongestWaits {
        patches_us: MOST_US,
        detections_us: MOST_US,
        enough_since_us: None,
    };

    fn tick(latency_us: Micros, solving_us: Micros) -> PosedTick {
        PosedTick {
            latency_us,
            solving_us,
            early_us: 0,
        }
    }

    #[test]
    fn three_of_four_sightings_are_enough_and_two_are_not() {
        let enough = |all: usize| (0..=all).find(|arrived| are_enough(*arrived, all));
        let of_all: Vec<Option<usize>> = [2, 3, 4, 5, 8, 12].map(enough).to_vec();
        assert_eq!(of_all, [None, Some(3), Some(3), Some(4), Some(6), Some(9)]);
    }

    #[test]
    fn without_a_target_a_tick_waits_to_the_limit() {
        let mut target = TargetLatency::new(0.0);
        target.posed(tick(90_000, 9_000), 0);
        assert_eq!(target.longest_waits(MOST, 0), MOST);
        assert_eq!(target.summary(["a"].into_iter()), None);
    }

    /// How long a tick waits for people who are seen by edges with these delays.
    fn wait(people: &[&[Option<Micros>]]) -> Micros {
        let mut come = Vec::new();
        for (id, views) in (0u32..).zip(people) {
            come.extend(views.iter().map(|us| (PersonId(id), *us)));
        }
        needed(&mut come, 10, MOST_US)
    }

    #[test]
    fn a_late_edge_does_not_delay_people_in_three_other_views() {
        let [fast, usual, late] = [Some(20), Some(30), Some(150)];
        assert_eq!(wait(&[&[late, fast, usual, fast]]), 40);
        assert_eq!(wait(&[&[late, fast, fast]]), 160, "two views are few");
        assert_eq!(wait(&[&[late, late, fast, fast]]), 160);
        // Each view is needed for some person.
        assert_eq!(wait(&[&[late, fast, usual, fast], &[late, fast]]), 160);
        assert_eq!(
            wait(&[&[late, late, fast, fast, fast, fast, fast, usual]]),
            40
        );
        assert_eq!(
            wait(&[&[None, fast, fast]]),
            MOST_US,
            "it may be as late as any"
        );
        assert_eq!(wait(&[&[None, fast, fast, usual]]), 40);
        assert_eq!(wait(&[]), MOST_US);
        assert_eq!(wait(&[&[Some(Micros::MAX); 4]]), MOST_US);
    }

    #[test]
    fn a_late_edge_is_reported_without_a_target() {
        let mut target = TargetLatency::new(0.0);
        (0..100).for_each(|_| target.over(&[Some(false), Some(true)]));
        let recent = target.take_recent().unwrap();
        assert_eq!((recent.in_time, recent.too_slow), (None, vec![(1, 1.0)]));
        assert_eq!(target.summary(["a", "b"].into_iter()), None);
    }

    #[test]
    fn the_time_of_the_core_is_reserved() {
        let mut target = TargetLatency::new(50.0);
        for at_us in 0..100 {
            target.posed(tick(40_000, 8_000), at_us);
        }
        let waits = target.longest_waits(MOST, 100);
        assert_eq!(waits.patches_us, 50_000 - 8_000 - MARGIN_US);
        assert_eq!(waits.detections_us, MOST_US);
        // Slow ticks are forgotten.
        let later = target.longest_waits(MOST, 100 + LIFE_US);
        assert_eq!(later.patches_us, 50_000 - MARGIN_US);
    }

    /// Regression: a tick waited too long when its pictures were early; its latency counts from the
    /// first of its pictures.
    #[test]
    fn early_pictures_leave_less_time() {
        let mut target = TargetLatency::new(50.0);
        for at_us in 0..100 {
            let early_us = if at_us % 2 == 0 { 12_000 } else { -3_000 };
            let tick = PosedTick {
                early_us,
                ..tick(40_000, 8_000)
            };
            target.posed(tick, at_us);
        }
        let waits = target.longest_waits(MOST, 100);
        assert_eq!(waits.patches_us, 50_000 - 12_000 - 8_000 - MARGIN_US);
    }

    #[test]
    fn an_impossible_target_waits_for_no_edge() {
        let mut target = TargetLatency::new(5.0);
        for at_us in 0..100 {
            target.over(&[Some(false)]);
            target.posed(tick(30_000, 20_000), at_us);
        }
        assert_eq!(target.longest_waits(MOST, 100).patches_us, 0);
        let recent = target.take_recent().unwrap();
        assert_eq!((recent.in_time, recent.all_late), (Some(0.0), 0.0));
        assert_eq!(target.take_recent(), None, "only new ticks are reported");
        let none = TargetLatencySummary {
            target_ms: 5.0,
            in_time: 0.0,
            left_out: BTreeMap::new(),
        };
        assert_eq!(target.summary(["a"].into_iter()), Some(none));
    }

    #[test]
    fn a_mostly_kept_target_counts_as_kept() {
        let mut target = TargetLatency::new(50.0);
        for at_us in 0..100 {
            let latency_us = if at_us % 20 == 0 { 60_000 } else { 45_000 };
            target.over(&[Some(false)]);
            target.posed(tick(latency_us, 5_000), at_us);
        }
        let summary = target.summary(["a"].into_iter()).unwrap();
        assert!((summary.in_time - 0.95).abs() < 1e-9);
        let in_time = target.take_recent().unwrap().in_time;
        assert!(in_time.is_some_and(|share| share > KEPT_SHARE));
    }

    /// Regression: an edge that was always late was skipped forever without a report.
    #[test]
    fn a_skipped_edge_is_reported_once_until_it_recovers() {
        let mut target = TargetLatency::new(60.0);
        let mut window = |every: usize| {
            for tick in 0..120 {
                target.over(&[Some(false), Some(tick % every == 0), None]);
            }
            target.take_recent().unwrap()
        };
        let far = window(1);
        assert_eq!(far.too_slow, [(1, 1.0)]);
        assert!(far.all_late < 1e-9, "{}", far.all_late);
        let still = window(15);
        assert_eq!(still.too_slow.len(), 1);
        assert!(window(30).too_slow.is_empty());
        assert!(window(15).too_slow.is_empty(), "seven of a hundred are few");
        let names = ["near", "far", "gone"].into_iter();
        let left_out = target.summary(names).unwrap().left_out;
        let named: Vec<&String> = left_out.keys().collect();
        assert_eq!(named, ["far"]);
    }

    #[test]
    fn all_edges_late_is_reported_without_patches() {
        let mut target = TargetLatency::new(5.0);
        for tick in 0..100 {
            let makes_it = tick % 30 == 0;
            target.over(&[Some(!makes_it), Some(!makes_it)]);
        }
        let recent = target.take_recent().unwrap();
        assert_eq!((recent.in_time, recent.too_slow.len()), (None, 2));
        assert!(recent.all_late > 0.9);
        let summary = target.summary(["a", "b"].into_iter()).unwrap();
        assert_eq!((summary.in_time, summary.left_out.len()), (0.0, 2));
    }
}
