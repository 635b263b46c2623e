//! How long after a tick an edge's messages arrive, and so how long fusion waits for them.
//!
//! Ticks with a detection pass take an edge longer, those without people no time. They are counted
//! separately.

use farfield_proto::order_statistics::nearest_rank;

use super::{Micros, SECOND_US};

/// Arrivals that are remembered: enough for three seconds at 80 Hz.
const REMEMBERED: usize = 256;
/// The same at ticks with a detection pass: passes are a second apart.
const REMEMBERED_DETECTIONS: usize = 16;
/// Share of the arrivals that shall be in time.
const IN_TIME: f64 = 0.98;
/// Wait beyond the slowest of those, microseconds: for timers and threads.
const MARGIN_US: Micros = 1_500;
/// A detection pass takes longer the more people it finds, and a new person must not come too late.
/// So the wait is this many times the slowest pass.
const PASS_TIMES: Micros = 2;
/// The usual arrival at a tick with a detection pass is their median.
const USUAL: f64 = 0.5;
/// Share of the arrivals that are early: fusion does not wait for an edge whose early ones come too
/// late.
const EARLY: f64 = 0.1;
/// Least arrivals for a statistic.
const ENOUGH: usize = 8;
/// Older arrivals do not count: the cause of a delay may be over.
const LIFE_US: Micros = 3 * SECOND_US;
/// The same for ticks with a detection pass.
const DETECTION_LIFE_US: Micros = 12 * SECOND_US;

/// What an edge does at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// It sends an empty set: it sees no people.
    Idle,
    /// Patches.
    Follow,
    /// Patches, and a detection pass.
    Detect,
}

/// The delays of one edge's latest messages.
#[derive(Debug, Clone, Default)]
pub struct Arrivals {
    idle: NewestDelays<REMEMBERED>,
    followed: NewestDelays<REMEMBERED>,
    detected: NewestDelays<REMEMBERED_DETECTIONS>,
}

impl Arrivals {
    /// A message came at `now_us`, `delay_us` after its tick.
    pub fn add(&mut self, task: Task, delay_us: Micros, now_us: Micros) {
        match task {
            Task::Idle => self.idle.add(delay_us, now_us),
            Task::Follow => self.followed.add(delay_us, now_us),
            Task::Detect => self.detected.add(delay_us, now_us),
        }
    }

    /// How long after a tick to wait for its messages, at most `most_us`; that long while nothing
    /// is known.
    pub fn wait_us(&mut self, task: Task, now_us: Micros, most_us: Micros) -> Micros {
        let times = match task {
            Task::Idle | Task::Follow => 1,
            Task::Detect => PASS_TIMES,
        };
        let slowest_us = self.slowest_us(task, now_us);
        slowest_us.map_or(most_us, |us| (times * us + MARGIN_US).clamp(0, most_us))
    }

    /// How long after a tick with a detection pass its messages usually come, microseconds; `None`
    /// while nothing is known.
    pub fn usual_pass_us(&mut self, now_us: Micros) -> Option<Micros> {
        self.share(USUAL, Task::Detect, now_us)
    }

    /// How long after a tick nearly all of its messages have come, microseconds; `None` while
    /// nothing is known.
    pub fn slowest_us(&mut self, task: Task, now_us: Micros) -> Option<Micros> {
        let in_time = match task {
            Task::Idle | Task::Follow => IN_TIME,
            Task::Detect => 1.0,
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
            // An edge without people is no slower than with people.
            Task::Idle => {
                let idle = self.idle.share(share, ENOUGH, now_us - LIFE_US);
                idle.or_else(|| self.share(share, Task::Follow, now_us))
            }
            Task::Follow => self.followed.share(share, ENOUGH, now_us - LIFE_US),
            Task::Detect => self.detected.share(share, 1, now_us - DETECTION_LIFE_US),
        }
    }
}

/// The newest `N` delays, with their times.
#[derive(Debug, Clone)]
pub(super) struct NewestDelays<const N: usize> {
    newest: Vec<(Micros, Micros)>,
    next: usize,
    sorted: Vec<Micros>,
}

impl<const N: usize> Default for NewestDelays<N> {
    fn default() -> Self {
        Self {
            newest: Vec::with_capacity(N),
            next: 0,
            sorted: Vec::with_capacity(N),
        }
    }
}

impl<const N: usize> NewestDelays<N> {
    pub(super) fn add(&mut self, delay_us: Micros, now_us: Micros) {
        if self.newest.len() < N {
            self.newest.push((delay_us, now_us));
        } else {
            self.newest[self.next] = (delay_us, now_us);
        }
        self.next = (self.next + 1) % N;
    }

    /// The delay that a `share` of those since `since_us` does not exceed, nearest rank; `None`
    /// with fewer than `enough`.
    pub(super) fn share(&mut self, share: f64, enough: usize, since_us: Micros) -> Option<Micros> {
        let fresh = self.newest.iter().filter(|(_, at)| *at >= since_us);
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
    fn unknown_delays_are_waited_for_to_the_bound() {
        let mut arrivals = Arrivals::default();
        assert_eq!(arrivals.wait_us(Task::Follow, 0, MOST_US), MOST_US);
        (0..8).for_each(|i| arrivals.add(Task::Follow, 10_000, i));
        assert_eq!(
            arrivals.wait_us(Task::Follow, 10, MOST_US),
            10_000 + MARGIN_US
        );
        assert_eq!(arrivals.wait_us(Task::Detect, 10, MOST_US), MOST_US);
        assert_eq!(arrivals.wait_us(Task::Follow, 10, 5_000), 5_000);
        assert_eq!(
            arrivals.wait_us(Task::Follow, LIFE_US + 20, MOST_US),
            MOST_US
        );
    }

    #[test]
    fn one_late_message_in_a_hundred_does_not_extend_the_wait() {
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
    fn the_wait_for_detection_passes_allows_slower_ones() {
        let mut arrivals = Arrivals::default();
        (0..100).for_each(|i| arrivals.add(Task::Follow, 8_000, i));
        arrivals.add(Task::Detect, 120_000, 100);
        assert_eq!(
            arrivals.wait_us(Task::Detect, 101, MOST_US),
            240_000 + MARGIN_US
        );
        assert_eq!(
            arrivals.wait_us(Task::Follow, 101, MOST_US),
            8_000 + MARGIN_US
        );
    }

    #[test]
    fn always_late_differs_from_sometimes_late() {
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
        fn the_wait_and_the_memory_are_bounded(
            delays in prop::collection::vec(any::<i32>(), 0..600), most in 1i64..5_000_000,
        ) {
            let mut arrivals = Arrivals::default();
            for (i, delay) in (0i64..).zip(&delays) {
                let task = if i % 60 == 0 { Task::Detect } else { Task::Follow };
                arrivals.add(task, Micros::from(*delay), i);
                for task in [Task::Follow, Task::Detect] {
                    prop_assert!((0..=most).contains(&arrivals.wait_us(task, i, most)));
                }
            }
            prop_assert!(arrivals.followed.newest.len() <= REMEMBERED && arrivals.detected.newest.len() <= REMEMBERED_DETECTIONS);
        }
    }
}
