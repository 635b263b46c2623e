//! The number of people that the edge has time for, independent of its link.
//!
//! The time of a tick is measured per round: as many crops as the network has workers take as long
//! as one. The plan must not oscillate between two rates. The slowest mean of the last seconds
//! therefore decides whether an edge processes more ticks, and the mean of all decides whether it
//! skips more.

use super::super::{Micros, SECOND_US};

/// Share of its time that an edge plans with. Durations vary: at 0.9 four edges on two cores each
/// dropped every third planned tick, a different one each, and fusion had one view where it needs
/// two.
pub const PLANNED: f64 = 0.75;
/// Share of its time that ticks may take before an edge skips more of them. With one share for
/// both, an edge oscillated between 15 and 7.5 Hz.
const BEARABLE: f64 = 0.95;
/// Rounds in a mean, and the number of slowest ones that are ignored because another program
/// delayed them.
const ROUNDS: usize = 12;
const HELD_UP: usize = 1;
/// Lifetime of means, microseconds, at least half of it. The plan follows a faster edge within 3 s
/// and does not oscillate faster.
const WINDOW_US: Micros = 3 * SECOND_US;

/// The load that an edge asks about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wish {
    /// To process more ticks.
    TakeMore,
    /// To continue with the current ticks.
    Continue,
}

/// Durations of rounds in a part of the window.
#[derive(Debug, Clone, Copy, Default)]
struct Past {
    slowest_us: f64,
    /// Sum of the means weighted with the duration of their ticks, and sum of the durations.
    sum: f64,
    time_us: f64,
}

/// The cost of ticks.
#[derive(Debug, Clone)]
pub(super) struct Work {
    period_us: f64,
    workers: usize,
    /// The newest rounds, microseconds.
    rounds_us: [u32; ROUNDS],
    n_rounds: usize,
    /// The current and the previous half of the window.
    past: [Option<Past>; 2],
    turned_at_us: Micros,
}

impl Work {
    pub(super) fn new(rate_hz: f64) -> Self {
        Self {
            period_us: SECOND_US as f64 / rate_hz,
            workers: 1,
            rounds_us: [0; ROUNDS],
            n_rounds: 0,
            past: [None; 2],
            turned_at_us: 0,
        }
    }

    /// Sets the number of parallel crops, and the measured crops per second, which count until
    /// enough ticks are known.
    pub(super) fn set_workers(&mut self, workers: usize, crops_per_s: f64) {
        self.workers = workers.max(1);
        let round_us = self.workers as f64 * SECOND_US as f64 / crops_per_s;
        let measured = Past::default().with(round_us, 1.0);
        self.past = [Some(measured).filter(|_| round_us.is_finite()), None];
    }

    /// Records a tick that ended at `now_us`, its `crops` and its duration.
    pub(super) fn add(&mut self, crops: usize, took_us: u32, now_us: Micros) {
        if crops == 0 {
            return;
        }
        let rounds = self.rounds(crops) as u32;
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
            self.past = [None, self.past[0]];
            self.turned_at_us = now_us;
        }
        let tick_us = self.period_us.max(took_us.into());
        self.past[0] = Some(self.past[0].unwrap_or_default().with(mean_us, tick_us));
    }

    /// The number of ticks whose time a tick with this many `crops` takes; 0 before measurements.
    pub(super) fn ticks(&self, crops: usize, wish: Wish) -> f64 {
        let past = self.past.iter().flatten();
        let share_us = match wish {
            Wish::TakeMore => past.map(|it| it.slowest_us).fold(0.0, f64::max) / PLANNED,
            Wish::Continue => {
                let (sum, time_us) = past.fold((0.0, 0.0), |(sum, time_us), it| {
                    (sum + it.sum, time_us + it.time_us)
                });
                sum / time_us.max(1.0) / BEARABLE
            }
        };
        self.rounds(crops) as f64 * share_us / self.period_us
    }

    fn rounds(&self, crops: usize) -> usize {
        crops.div_ceil(self.workers)
    }
}

impl Past {
    fn with(self, mean_us: f64, tick_us: f64) -> Self {
        Self {
            slowest_us: self.slowest_us.max(mean_us),
            sum: self.sum + mean_us * tick_us,
            time_us: self.time_us + tick_us,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_US: Micros = 16_667;

    /// Adds ticks of `crops` with the duration `tick_us`, from tick `from`.
    fn feed(work: &mut Work, crops: usize, tick_us: u32, from: i64, ticks: i64) {
        for tick in from..from + ticks {
            work.add(crops, tick_us, tick * PERIOD_US);
        }
    }

    #[test]
    fn work_is_unbounded_before_measurements() {
        let mut work = Work::new(60.0);
        feed(&mut work, 2, 200_000, 0, 11);
        assert!(work.ticks(8, Wish::TakeMore) < 1e-9);
        feed(&mut work, 2, 200_000, 20, 1);
        assert!(work.ticks(8, Wish::TakeMore) > 1.0);
    }

    #[test]
    fn two_workers_process_two_people_in_the_time_of_one() {
        let mut work = Work::new(60.0);
        work.set_workers(2, 100.0);
        assert!(
            (work.ticks(2, Wish::TakeMore) - 1.6).abs() < 1e-3,
            "as it was measured beforehand"
        );
        feed(&mut work, 2, 12_500, 0, 300);
        assert!(
            (work.ticks(1, Wish::TakeMore) - 1.0).abs() < 1e-3
                && (work.ticks(2, Wish::TakeMore) - 1.0).abs() < 1e-3
        );
        assert!((work.ticks(3, Wish::TakeMore) - 2.0).abs() < 1e-3);
    }

    #[test]
    fn a_tick_delayed_by_another_program_is_ignored() {
        let mut work = Work::new(60.0);
        feed(&mut work, 1, 10_000, 0, 60);
        let before = work.ticks(1, Wish::TakeMore);
        feed(&mut work, 1, 300_000, 60, 1);
        assert!((work.ticks(1, Wish::TakeMore) - before).abs() < 1e-9);
    }

    #[test]
    fn a_slow_round_counts_for_seconds_only() {
        let mut work = Work::new(60.0);
        feed(&mut work, 1, 60_000, 0, 60);
        let slow = work.ticks(1, Wish::TakeMore);
        feed(&mut work, 1, 10_000, 60, 60);
        assert!((work.ticks(1, Wish::TakeMore) - slow).abs() < 1e-9);
        feed(&mut work, 1, 10_000, 120, 180);
        assert!((work.ticks(1, Wish::TakeMore) - slow / 6.0).abs() < 1e-9);
    }
}
