//! How long after a tick an edge's messages come, and so how long it is worth to wait for them.
//!
//! Ticks with a detection pass take an edge longer, those without anybody no time, and both are counted apart.

use farfield_proto::order_statistics::nearest_rank;

use super::{Micros, SECOND_US};

/// Arrivals that are kept: enough for three seconds at 80 Hz.
const KEPT: usize = 256;
/// Arrivals at ticks with a detection pass that are kept: passes are a second apart.
const KEPT_DETECTIONS: usize = 16;
/// Share of the arrivals that shall be in time.
const IN_TIME: f64 = 0.98;
/// How much longer than the slowest of those is waited, microseconds: what timers and threads need.
const MARGIN_US: Micros = 1_500;
/// A detection pass takes longer the more people it finds: one who is new must not come too late, and is waited for so many times as
/// long as the slowest pass took.
const PASS_TIMES: Micros = 2;
/// The usual arrival at a tick with a detection pass is their median.
const USUAL: f64 = 0.5;
/// Share of the arrivals that are early: an edge whose early ones come too late is not waited for.
const EARLY: f64 = 0.1;
/// From so many arrivals on they say something.
const ENOUGH: usize = 8;
/// Arrivals that are older say nothing any more: what held them up once is over.
const LIFE_US: Micros = 3 * SECOND_US;
/// The same for ticks with a detection pass.
const DETECTION_LIFE_US: Micros = 12 * SECOND_US;

/// What a tick asks of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// To say that it is there: it sees nobody.
    Idle,
    /// Patches.
    Follow,
    /// Patches, and a detection pass.
    Look,
}

/// The delays of one edge's latest messages.
#[derive(Debug, Clone, Default)]
pub struct Arrivals {
    idle: NewestDelays<KEPT>,
    followed: NewestDelays<KEPT>,
    detected: NewestDelays<KEPT_DETECTIONS>,
}

impl Arrivals {
    /// A message came at `now_us`, `delay_us` after its tick.
    pub fn add(&mut self, task: Task, delay_us: Micros, now_us: Micros) {
        match task {
            Task::Idle => self.idle.add(delay_us, now_us),
            Task::Follow => self.followed.add(delay_us, now_us),
            Task::Look => self.detected.add(delay_us, now_us),
        }
    }

    /// How long after a tick its messages are worth waiting for, at most `most_us`, which it also is while
    /// nothing is known.
    pub fn wait_us(&mut self, task: Task, now_us: Micros, most_us: Micros) -> Micros {
        let times = match task {
            Task::Idle | Task::Follow => 1,
            Task::Look => PASS_TIMES,
        };
        let slowest_us = self.slowest_us(task, now_us);
        slowest_us.map_or(most_us, |us| (times * us + MARGIN_US).clamp(0, most_us))
    }

    /// How long after a tick with a detection pass its messages usually come, microseconds; `None` while nothing is known.
    pub fn usual_pass_us(&mut self, now_us: Micros) -> Option<Micros> {
        self.share(USUAL, Task::Look, now_us)
    }

    /// How long after a tick nearly all of its messages have come, microseconds; `None` while nothing is known.
    pub fn slowest_us(&mut self, task: Task, now_us: Micros) -> Option<Micros> {
        let in_time = match task {
            Task::Idle | Task::Follow => IN_TIME,
            Task::Look => 1.0,
        };
        self.share(in_time, task, now_us)
    }

    /// Whether even the early ones come later than `most_us` after their tick.
    pub fn are_later_than(&mut self, most_us: Micros, task: Task, now_us: Micros) -> bool {
        self.share(EARLY, task, now_us)
            .is_some_and(|us| us > most_us)
    }

    fn share(&mut self, share: f64, task: Task, now_us: Micros) -> Option<Micros> {
        match task {
            // Who sees nobody is no slower than it is with people.
            Task::Idle => {
                let idle = self.idle.share(share, ENOUGH, now_us - LIFE_US);
                idle.or_else(|| self.share(share, Task::Follow, now_us))
            }
            Task::Follow => self.followed.share(share, ENOUGH, now_us - LIFE_US),
            Task::Look => self.detected.share(share, 1, now_us - DETECTION_LIFE_US),
        }
    }
}

/// The newest `N` delays, with the times at which they were noted.
#[derive(Debug, Clone)]
pub(super) struct NewestDelays<const N: usize> {
    kept: Vec<(Micros, Micros)>,
    next: usize,
    sorted: Vec<Micros>,
}

impl<const N: usize> Default for NewestDelays<N> {
    fn default() -> Self {
        Self {
            kept: Vec::with_capacity(N),
            next: 0,
            sorted: Vec::with_capacity(N),
        }
    }
}

impl<const N: usize> NewestDelays<N> {
    pub(super) fn add(&mut self, delay_us: Micros, now_us: Micros) {
        if self.kept.len() < N {
            self.kept.push((delay_us, now_us));
        } else {
            self.kept[self.next] = (delay_us, now_us);
        }
        self.next = (self.next + 1) % N;
    }

    /// The delay that a `share` of those since `since_us` does not pass, nearest rank; `None` with fewer than
    /// `enough`.
    pub(super) fn share(&mut self, share: f64, enough: usize, since_us: Micros) -> Option<Micros> {
        let fresh = self.kept.iter().filter(|(_, at)| *at >= since_us);
        self.sorted.clear();
        self.sorted.extend(fresh.map(|(delay, _)| *delay));
        if self.sorted.len() < enough.max(1) {
            return None;
        }
        let rank = nearest_rank(share, self.sorted.len());
        Some(*self.sorted.select_nth_unstable(rank).1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MOST_US: Micros = 400_000;

    #[test]
    fn what_is_not_known_is_waited_for_to_the_bound() {
        let mut arrivals = Arrivals::default();
        assert_eq!(arrivals.wait_us(Task::Follow, 0, MOST_US), MOST_US);
        (0..8).for_each(|i| arrivals.add(Task::Follow, 10_000, i));
        assert_eq!(
            arrivals.wait_us(Task::Follow, 10, MOST_US),
            10_000 + MARGIN_US
        );
        assert_eq!(arrivals.wait_us(Task::Look, 10, MOST_US), MOST_US);
        assert_eq!(arrivals.wait_us(Task::Follow, 10, 5_000), 5_000);
        assert_eq!(
            arrivals.wait_us(Task::Follow, LIFE_US + 20, MOST_US),
            MOST_US
        );
    }

    #[test]
    fn one_straggler_in_a_hundred_is_not_waited_for_and_more_are() {
        let mut arrivals = Arrivals::default();
        for i in 0..256 {
            let delay_us = if i % 100 == 0 { 90_000 } else { 8_000 };
            arrivals.add(Task::Follow, delay_us, i);
        }
        assert_eq!(
            arrivals.wait_us(Task::Follow, 256, MOST_US),
            8_000 + MARGIN_US
        );
        for i in 0..6 {
            arrivals.add(Task::Follow, 60_000, 256 + i);
        }
        assert!(arrivals.wait_us(Task::Follow, 260, MOST_US) > 60_000);
    }

    #[test]
    fn detection_passes_are_waited_for_until_one_that_finds_more_people_comes() {
        let mut arrivals = Arrivals::default();
        (0..100).for_each(|i| arrivals.add(Task::Follow, 8_000, i));
        arrivals.add(Task::Look, 120_000, 100);
        assert_eq!(
            arrivals.wait_us(Task::Look, 101, MOST_US),
            240_000 + MARGIN_US
        );
        assert_eq!(
            arrivals.wait_us(Task::Follow, 101, MOST_US),
            8_000 + MARGIN_US
        );
    }

    #[test]
    fn who_is_late_all_the_time_is_told_from_who_is_late_at_times() {
        let mut arrivals = Arrivals::default();
        assert_eq!(arrivals.slowest_us(Task::Follow, 0), None);
        assert!(
            !arrivals.are_later_than(0, Task::Follow, 0),
            "it is not known"
        );
        for i in 0..100 {
            let delay_us = if i % 2 == 0 { 90_000 } else { 20_000 };
            arrivals.add(Task::Follow, delay_us, i);
        }
        assert_eq!(arrivals.slowest_us(Task::Follow, 100), Some(90_000));
        assert!(!arrivals.are_later_than(30_000, Task::Follow, 100));
        assert!(arrivals.are_later_than(19_000, Task::Follow, 100));
    }

    proptest! {
        #[test]
        fn the_wait_is_bounded_whatever_comes(
            delays in prop::collection::vec(any::<i32>(), 0..600), most in 1i64..5_000_000,
        ) {
            let mut arrivals = Arrivals::default();
            for (i, delay) in (0i64..).zip(&delays) {
                let task = if i % 60 == 0 { Task::Look } else { Task::Follow };
                arrivals.add(task, Micros::from(*delay), i);
                for task in [Task::Follow, Task::Look] {
                    prop_assert!((0..=most).contains(&arrivals.wait_us(task, i, most)));
                }
            }
            prop_assert!(arrivals.followed.kept.len() <= KEPT && arrivals.detected.kept.len() <= KEPT_DETECTIONS);
        }
    }
}
