//! How long a tick may wait for patches, and how often its poses were out in time.
//!
//! A tick waits until enough edges see each person ([`needed`]), so that one late edge delays no tick. A tick with a detection
//! pass waits for the sightings of enough edges ([`are_enough`]). With a target, the time from pictures to poses that the
//! operator asks for, it also waits no longer than the core needs to keep it. Slower edges are left out, counted and
//! reported. The target does not bound ticks with a detection pass, because new people would not be found.

use std::collections::BTreeMap;

use farfield_proto::id::PersonId;
use farfield_proto::order_statistics::nearest_rank;

use super::arrivals::NewestDelays;
use super::{Micros, SECOND_US};
use crate::export::summary::TargetLatencySummary;

/// Ticks whose time beside the waiting is remembered, and for how long, microseconds.
const KEPT: usize = 256;
const LIFE_US: Micros = 5 * SECOND_US;
/// Share of the ticks for which the time that is left for the core shall be enough.
const IN_TIME: f64 = 0.98;
/// What is left beyond that: for timers and the way to the network, microseconds.
const MARGIN_US: Micros = 1_000;
/// A share of ticks in time below which the target is not kept.
pub const KEPT_SHARE: f64 = 0.9;
/// A share of ticks above which an edge that is left out of them is named, and one below which that is over.
pub const LEFT_OUT_SHARE: f64 = 0.1;
const LEFT_OUT_NO_MORE: f64 = 0.05;
/// Fewest ticks of which shares are told, and of these fewest that must say something.
const ENOUGH: u64 = 100;
const ENOUGH_OF_THESE: u64 = ENOUGH / 2;

/// How long ticks of a live run wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LongestWaits {
    /// For patches, after the tick, microseconds.
    pub patches_us: Micros,
    /// Where the tick has a detection pass.
    pub detections_us: Micros,
    /// Since when the tick is next and enough of its sightings are there: unusually late ones are not waited for.
    pub enough_since_us: Option<Micros>,
}

/// Views of a person, or sightings of a detection pass, that a tick waits for: fewest, and as a share of all. Of four, one may be
/// late.
const FEWEST_VIEWS: usize = 3;
const MOST_VIEWS_SHARE: f64 = 0.75;

/// Whether the sightings of `arrived` edges are enough, where `all` send some.
pub fn are_enough(arrived: usize, all: usize) -> bool {
    arrived >= FEWEST_VIEWS && arrived as f64 >= MOST_VIEWS_SHARE * all as f64
}

/// How long a tick waits at most, where the patches of each person come so long after it from everyone who sees it (`None`: not
/// known), and at most `most_us`: a period more than the slowest that a person needs.
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
    /// For everything as long.
    pub fn of(most_us: Micros) -> Self {
        Self {
            patches_us: most_us,
            detections_us: most_us,
            enough_since_us: None,
        }
    }
}

/// A tick that had patches, and whose poses are out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PosedTick {
    /// From the first of its pictures to its poses, microseconds.
    pub latency_us: Micros,
    /// How long the core had it, microseconds.
    pub solving_us: Micros,
    /// How long before the tick's own time the first of its pictures was taken, microseconds: from that on it is late.
    pub early_us: Micros,
}

/// The ticks of one edge that it was awaited at.
#[derive(Debug, Clone, Copy, Default)]
struct AwaitedTicks {
    /// Those that were over before all its patches came, of how many.
    all: [u64; 2],
    /// The same since it was last told.
    recent: [u64; 2],
    is_slow: bool,
}

/// How the target was kept of late, shares from 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct RecentTicks {
    /// Of ticks with patches those in time; `None`: there were few.
    pub in_time: Option<f64>,
    /// The edges that are too slow, by index, with the share of ticks that they were left out of.
    pub too_slow: Vec<(usize, f64)>,
    /// Whether one of these was not before.
    pub is_news: bool,
    /// Ticks of which no edge made it.
    pub nobody: f64,
}

/// The target, and how it is kept.
#[derive(Debug, Clone, Default)]
pub struct TargetLatency {
    target_us: Option<Micros>,
    /// What ticks take beside the waiting after their time.
    spent: NewestDelays<KEPT>,
    /// Ticks that were in time, of how many.
    all: [u64; 2],
    /// The same since it was last told.
    recent: [u64; 2],
    edges: Vec<AwaitedTicks>,
    /// Ticks that edges were awaited at since it was last told, and those of which none made it.
    ticks: u64,
    nobody: u64,
}

impl TargetLatency {
    /// A target of `target_ms` milliseconds; 0: none.
    pub fn new(target_ms: f64) -> Self {
        Self {
            target_us: (target_ms > 0.0).then_some((target_ms * 1e3) as Micros),
            ..Self::default()
        }
    }

    /// How long the next tick waits at `now_us`, where it would wait for `most` without a target.
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

    /// A tick is over: per edge, in their order, whether it was left out; `None`: it was not there.
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
        self.nobody += u64::from(awaited().all(|left_out| *left_out));
    }

    /// The poses of a tick with patches went out at `now_us`.
    pub fn posed(&mut self, tick: PosedTick, now_us: Micros) {
        let Some(target_us) = self.target_us else {
            return;
        };
        let spent_us = tick.solving_us.saturating_add(tick.early_us.max(0));
        self.spent.add(spent_us, now_us);
        let in_time = u64::from(tick.latency_us <= target_us);
        for [kept, of] in [&mut self.all, &mut self.recent] {
            *kept += in_time;
            *of += 1;
        }
    }

    /// How the target was kept, `names` being those of the edges; `None` without a target or a tick.
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

    /// How the target was kept since this last said it; `None` while there are too few ticks.
    pub fn take_recent(&mut self) -> Option<RecentTicks> {
        if self.ticks < ENOUGH {
            return None;
        }
        let mut recent = RecentTicks {
            in_time: (self.recent[1] >= ENOUGH_OF_THESE).then(|| share(self.recent)),
            too_slow: Vec::new(),
            is_news: false,
            nobody: share([self.nobody, self.ticks]),
        };
        for (index, edge) in self.edges.iter_mut().enumerate() {
            let counts = std::mem::take(&mut edge.recent);
            let was_slow = edge.is_slow;
            let bound = if was_slow {
                LEFT_OUT_NO_MORE
            } else {
                LEFT_OUT_SHARE
            };
            edge.is_slow = counts[1] >= ENOUGH_OF_THESE && share(counts) > bound;
            if edge.is_slow {
                recent.too_slow.push((index, share(counts)));
                recent.is_news |= !was_slow;
            }
        }
        (self.recent, self.ticks, self.nobody) = ([0; 2], 0, 0);
        Some(recent)
    }

    /// The target, milliseconds.
    pub fn target_ms(&self) -> Option<f64> {
        self.target_us.map(|us| us as f64 / 1e3)
    }
}

/// So many of so many; 0 of none.
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
    fn three_of_four_sightings_are_enough_and_two_never_are() {
        let enough = |all: usize| (0..=all).find(|arrived| are_enough(*arrived, all));
        let of_all: Vec<Option<usize>> = [2, 3, 4, 5, 8, 12].map(enough).to_vec();
        assert_eq!(of_all, [None, Some(3), Some(3), Some(4), Some(6), Some(9)]);
    }

    #[test]
    fn without_a_target_a_tick_waits_as_long_as_it_may() {
        let mut target = TargetLatency::new(0.0);
        target.posed(tick(90_000, 9_000), 0);
        assert_eq!(target.longest_waits(MOST, 0), MOST);
        assert_eq!(target.summary(["a"].into_iter()), None);
    }

    /// How long a tick waits for people who are seen by edges of these delays each.
    fn wait(people: &[&[Option<Micros>]]) -> Micros {
        let mut come = Vec::new();
        for (id, views) in (0u32..).zip(people) {
            come.extend(views.iter().map(|us| (PersonId(id), *us)));
        }
        needed(&mut come, 10, MOST_US)
    }

    #[test]
    fn a_late_edge_holds_up_nobody_whom_three_others_see() {
        let [fast, usual, late] = [Some(20), Some(30), Some(150)];
        assert_eq!(wait(&[&[late, fast, usual, fast]]), 40);
        assert_eq!(wait(&[&[late, fast, fast]]), 160, "two views are few");
        assert_eq!(wait(&[&[late, late, fast, fast]]), 160);
        // Everybody is needed of somebody.
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
    fn without_a_target_too_a_late_edge_is_named() {
        let mut target = TargetLatency::new(0.0);
        (0..100).for_each(|_| target.over(&[Some(false), Some(true)]));
        let recent = target.take_recent().unwrap();
        assert_eq!((recent.in_time, recent.too_slow), (None, vec![(1, 1.0)]));
        assert_eq!(target.summary(["a", "b"].into_iter()), None);
    }

    #[test]
    fn what_the_core_takes_is_left_for_it() {
        let mut target = TargetLatency::new(50.0);
        for at_us in 0..100 {
            target.posed(tick(40_000, 8_000), at_us);
        }
        let waits = target.longest_waits(MOST, 100);
        assert_eq!(waits.patches_us, 50_000 - 8_000 - MARGIN_US);
        assert_eq!(waits.detections_us, MOST_US);
        // What was slow once is over.
        let later = target.longest_waits(MOST, 100 + LIFE_US);
        assert_eq!(later.patches_us, 50_000 - MARGIN_US);
    }

    /// Once a tick waited until it was late by as much: its latency counts from the first of its pictures.
    #[test]
    fn pictures_that_are_taken_before_their_tick_leave_less_time() {
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
    fn a_target_that_the_core_alone_misses_waits_for_nobody() {
        let mut target = TargetLatency::new(5.0);
        for at_us in 0..100 {
            target.over(&[Some(false)]);
            target.posed(tick(30_000, 20_000), at_us);
        }
        assert_eq!(target.longest_waits(MOST, 100).patches_us, 0);
        let recent = target.take_recent().unwrap();
        assert_eq!((recent.in_time, recent.nobody), (Some(0.0), 0.0));
        assert_eq!(target.take_recent(), None, "it is told of new ticks only");
        let none = TargetLatencySummary {
            target_ms: 5.0,
            in_time: 0.0,
            left_out: BTreeMap::new(),
        };
        assert_eq!(target.summary(["a"].into_iter()), Some(none));
    }

    #[test]
    fn a_target_that_is_mostly_kept_counts_as_kept() {
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

    /// Once an edge that never made it was left out for good, and nobody was told.
    #[test]
    fn an_edge_that_is_left_out_is_told_once_until_that_is_over() {
        let mut target = TargetLatency::new(60.0);
        let mut window = |every: usize| {
            for tick in 0..120 {
                target.over(&[Some(false), Some(tick % every == 0), None]);
            }
            target.take_recent().unwrap()
        };
        let far = window(1);
        assert_eq!((far.too_slow, far.is_news), (vec![(1, 1.0)], true));
        assert!(far.nobody < 1e-9, "{}", far.nobody);
        let still = window(15);
        assert_eq!((still.too_slow.len(), still.is_news), (1, false));
        assert!(window(30).too_slow.is_empty());
        assert!(window(15).too_slow.is_empty(), "seven of a hundred are few");
        let names = ["near", "far", "gone"].into_iter();
        let left_out = target.summary(names).unwrap().left_out;
        let named: Vec<&String> = left_out.keys().collect();
        assert_eq!(named, ["far"]);
    }

    #[test]
    fn that_no_edge_makes_it_is_told_though_no_tick_has_patches() {
        let mut target = TargetLatency::new(5.0);
        for tick in 0..100 {
            let makes_it = tick % 30 == 0;
            target.over(&[Some(!makes_it), Some(!makes_it)]);
        }
        let recent = target.take_recent().unwrap();
        assert_eq!((recent.in_time, recent.too_slow.len()), (None, 2));
        assert!(recent.nobody > 0.9);
        let summary = target.summary(["a", "b"].into_iter()).unwrap();
        assert_eq!((summary.in_time, summary.left_out.len()), (0.0, 2));
    }
}
