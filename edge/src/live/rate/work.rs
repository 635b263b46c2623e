//! How many people the edge has time for, beside what its link carries.
//!
//! The time of a tick is measured as that of a round: as many people as there are workers of the network take as long as
//! one. What counts is the slowest of the last seconds, so that the plan does not swing between two rates.

use super::super::{Micros, SECOND_US};

/// Share of its time that an edge plans with. Ticks vary: four edges on two cores at 0.9 dropped every third tick of their plan,
/// each another one, and fusion had one view where it needs two.
pub const PLANNED: f64 = 0.75;
/// Rounds of which the mean is taken, but for those that took longest: another program has held them up.
const ROUNDS: usize = 12;
const HELD_UP: usize = 1;
/// The slowest mean counts for so long, at least for half of it, microseconds: the plan follows within 3 s of a faster edge,
/// and does not swing within less.
const WINDOW_US: Micros = 3 * SECOND_US;

/// What ticks cost the edge.
#[derive(Debug, Clone)]
pub(super) struct Work {
    period_us: f64,
    workers: usize,
    /// The newest rounds, microseconds.
    rounds_us: [u32; ROUNDS],
    n_rounds: usize,
    /// The slowest mean of the half of the window that goes on, and of the one before.
    slowest_us: [Option<f64>; 2],
    turned_at_us: Micros,
}

impl Work {
    pub(super) fn new(rate_hz: f64) -> Self {
        Self {
            period_us: SECOND_US as f64 / rate_hz,
            workers: 1,
            rounds_us: [0; ROUNDS],
            n_rounds: 0,
            slowest_us: [None; 2],
            turned_at_us: 0,
        }
    }

    /// So many people are worked on at a time, and so many crops a second were measured beforehand: they count until enough
    /// ticks were.
    pub(super) fn set_workers(&mut self, workers: usize, crops_per_s: f64) {
        self.workers = workers.max(1);
        let round_us = self.workers as f64 * SECOND_US as f64 / crops_per_s;
        self.slowest_us = [Some(round_us).filter(|us| us.is_finite()), None];
    }

    /// Notes a tick that ended at `now_us`, whose `persons` took so long.
    pub(super) fn add(&mut self, persons: usize, took_us: u32, now_us: Micros) {
        if persons == 0 {
            return;
        }
        let rounds = self.rounds(persons) as u32;
        self.rounds_us[self.n_rounds % ROUNDS] = took_us / rounds;
        self.n_rounds += 1;
        if self.n_rounds < ROUNDS {
            return;
        }
        let mut sorted = self.rounds_us;
        sorted.sort_unstable();
        let usual = &sorted[..ROUNDS - HELD_UP];
        let mean_us = usual.iter().map(|us| f64::from(*us)).sum::<f64>() / usual.len() as f64;
        if now_us - self.turned_at_us > WINDOW_US / 2 {
            self.slowest_us = [None, self.slowest_us[0]];
            self.turned_at_us = now_us;
        }
        let slowest_us = self.slowest_us[0].unwrap_or(mean_us);
        self.slowest_us[0] = Some(slowest_us.max(mean_us));
    }

    /// For how many ticks a tick of so many `persons` takes the time; 0 before it was measured.
    pub(super) fn ticks(&self, persons: usize) -> f64 {
        self.round_us().map_or(0.0, |round_us| {
            self.rounds(persons) as f64 * round_us / (PLANNED * self.period_us)
        })
    }

    fn round_us(&self) -> Option<f64> {
        let slowest_us = self.slowest_us.iter().flatten();
        slowest_us.copied().reduce(f64::max)
    }

    fn rounds(&self, persons: usize) -> usize {
        persons.div_ceil(self.workers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_US: Micros = 16_667;

    /// What ticks of `persons` cost, each of which takes `persons_us`, from tick `from` on.
    fn feed(work: &mut Work, persons: usize, persons_us: u32, from: i64, ticks: i64) {
        for tick in from..from + ticks {
            work.add(persons, persons_us, tick * PERIOD_US);
        }
    }

    #[test]
    fn before_it_was_measured_nothing_bounds_it() {
        let mut work = Work::new(60.0);
        feed(&mut work, 2, 200_000, 0, 11);
        assert!(work.ticks(8) < 1e-9);
        feed(&mut work, 2, 200_000, 20, 1);
        assert!(work.ticks(8) > 1.0);
    }

    #[test]
    fn two_workers_do_two_people_in_the_time_of_one() {
        let mut work = Work::new(60.0);
        work.set_workers(2, 100.0);
        assert!(
            (work.ticks(2) - 1.6).abs() < 1e-3,
            "as it was measured beforehand"
        );
        feed(&mut work, 2, 12_500, 0, 300);
        assert!((work.ticks(1) - 1.0).abs() < 1e-3 && (work.ticks(2) - 1.0).abs() < 1e-3);
        assert!((work.ticks(3) - 2.0).abs() < 1e-3);
    }

    #[test]
    fn a_tick_that_another_program_held_up_changes_nothing() {
        let mut work = Work::new(60.0);
        feed(&mut work, 1, 10_000, 0, 60);
        let before = work.ticks(1);
        feed(&mut work, 1, 300_000, 60, 1);
        assert!((work.ticks(1) - before).abs() < 1e-9);
    }

    #[test]
    fn what_was_slow_counts_for_seconds_and_not_for_ever() {
        let mut work = Work::new(60.0);
        feed(&mut work, 1, 60_000, 0, 60);
        let slow = work.ticks(1);
        feed(&mut work, 1, 10_000, 60, 60);
        assert!((work.ticks(1) - slow).abs() < 1e-9);
        feed(&mut work, 1, 10_000, 120, 180);
        assert!((work.ticks(1) - slow / 6.0).abs() < 1e-9);
    }
}
