//! At which ticks an edge gets boxes: all, unless its link cannot carry them.
//!
//! An edge extrapolates boxes by their rates, so every second or fourth set does nearly as well. If
//! messages queue on the round trip, the number of sets is halved. When no message waits any more,
//! it is doubled again; after a failed attempt the next one comes later. Only ticks that 1, 2, 4 or
//! 8 divides are used.

use farfield_proto::transport::MESSAGE_OVERHEAD_BYTES;

use super::{Micros, SECOND_US};

/// Sparsest pace without a budget: every n-th tick.
const MOST_NTH: i64 = 8;
/// The same with a budget, a power of two.
const SPARSEST: i64 = 1024;
/// Longest mean wait of messages, microseconds and share of the shortest round trip (which varies
/// by as much).
const WAIT_US: f64 = 30_000.0;
const WAIT_SHARE: f64 = 0.25;
/// Share of that limit below which no message waits.
const NOTHING: f64 = 0.5;
/// Weight of one round trip.
const WEIGHT: f64 = 0.1;
/// Time for a change to take effect.
const CHANGE_PAUSE_US: Micros = SECOND_US;
/// Time without waiting before the next attempt to send more, initially and at most.
const PATIENCE_US: Micros = 4 * SECOND_US;
const MOST_PATIENCE_US: Micros = 64 * SECOND_US;
/// Share of a byte budget for boxes: the rest is for statuses and requests.
const BOX_SHARE: f64 = 0.85;

/// How often one edge gets boxes.
#[derive(Debug, Clone)]
pub struct Pace {
    /// Bytes per tick of the budget, with overhead.
    budget: Option<f64>,
    /// Bytes of a set with overhead: a slowly decaying maximum, because a budget applies to every
    /// second.
    set_bytes: f64,
    nth: i64,
    waited_us: f64,
    changed_us: Micros,
    empty_since_us: Option<Micros>,
    patience_us: Micros,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            budget: None,
            set_bytes: 0.0,
            nth: 1,
            waited_us: 0.0,
            changed_us: 0,
            empty_since_us: None,
            patience_us: PATIENCE_US,
        }
    }
}

impl Pace {
    /// Boxes of `rate_hz` ticks per second shall fit `budget_bytes_per_s`; 0: only the link is a
    /// limit.
    pub fn new(budget_bytes_per_s: f64, rate_hz: f64) -> Self {
        let has_budget = budget_bytes_per_s > 0.0;
        Self {
            budget: has_budget.then_some(BOX_SHARE * budget_bytes_per_s / rate_hz),
            ..Self::default()
        }
    }

    /// n: every n-th tick has boxes.
    pub fn nth(&self) -> i64 {
        let fits = |nth: &i64| {
            self.budget
                .is_none_or(|budget| self.set_bytes <= budget * *nth as f64)
        };
        let powers = std::iter::successors(Some(1), |nth| Some(nth * 2));
        let mut powers = powers.take_while(|nth| *nth <= SPARSEST);
        self.nth.max(powers.find(fits).unwrap_or(SPARSEST))
    }

    /// Records a sent set of `bytes`.
    pub fn sent(&mut self, bytes: usize) {
        let bytes = (bytes + MESSAGE_OVERHEAD_BYTES) as f64;
        self.set_bytes = bytes.max(self.set_bytes + (bytes - self.set_bytes) * WEIGHT);
    }

    /// Records a round trip of `round_trip_us` at `now_us`; `shortest_us` is the least of the last
    /// seconds.
    pub fn measured(&mut self, round_trip_us: Micros, shortest_us: Micros, now_us: Micros) {
        let waited_us = (round_trip_us - shortest_us).max(0) as f64;
        self.waited_us += (waited_us - self.waited_us) * WEIGHT;
        if now_us - self.changed_us < CHANGE_PAUSE_US {
            return;
        }
        let bound_us = WAIT_US + WAIT_SHARE * shortest_us as f64;
        if self.waited_us > bound_us {
            if self.nth < MOST_NTH {
                self.nth *= 2;
                self.changed_us = now_us;
                self.patience_us = (2 * self.patience_us).min(MOST_PATIENCE_US);
            }
            self.empty_since_us = None;
        } else if self.waited_us > NOTHING * bound_us {
            self.empty_since_us = None;
        } else if now_us - *self.empty_since_us.get_or_insert(now_us) >= self.patience_us
            && self.nth > 1
        {
            self.nth /= 2;
            self.changed_us = now_us;
            self.empty_since_us = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_US: Micros = 16_667;
    const SET_BYTES: usize = 500;

    /// Sends sets of 500 bytes for some seconds over a link of `bytes_per_s`. Returns the longest
    /// wait in the second half, and the bytes of the fullest second.
    fn run(pace: &mut Pace, bytes_per_s: f64, from_s: i64, seconds: i64) -> (f64, f64) {
        let (mut queue_bytes, mut longest_us): (f64, f64) = (0.0, 0.0);
        let (mut of_second, mut fullest): (f64, f64) = (0.0, 0.0);
        for tick in 0..60 * seconds {
            let now_us = (1 + from_s) * SECOND_US + tick * PERIOD_US;
            queue_bytes = (queue_bytes - bytes_per_s * PERIOD_US as f64 * 1e-6).max(0.0);
            if tick % 60 == 0 {
                of_second = 0.0;
            }
            if tick % pace.nth() == 0 {
                pace.sent(SET_BYTES);
                queue_bytes += (SET_BYTES + MESSAGE_OVERHEAD_BYTES) as f64;
                of_second += (SET_BYTES + MESSAGE_OVERHEAD_BYTES) as f64;
                fullest = fullest.max(of_second);
            }
            let waited_us = queue_bytes / bytes_per_s * 1e6;
            pace.measured(20_000 + waited_us as Micros, 20_000, now_us);
            if tick > 30 * seconds {
                longest_us = longest_us.max(waited_us);
            }
        }
        (longest_us, fullest)
    }

    #[test]
    fn a_fast_link_gets_boxes_at_every_tick() {
        let mut pace = Pace::default();
        run(&mut pace, 125_000.0, 0, 20);
        assert_eq!(pace.nth(), 1);
    }

    #[test]
    fn a_slow_link_gets_fewer_boxes_and_its_queue_stays_short() {
        let mut pace = Pace::default();
        let (longest_us, _) = run(&mut pace, 25_000.0, 0, 60);
        assert!(
            pace.nth() > 1 && longest_us < 200_000.0,
            "{pace:?} {longest_us}"
        );
    }

    #[test]
    fn a_recovered_link_gets_more_boxes() {
        let mut pace = Pace::default();
        run(&mut pace, 25_000.0, 0, 6);
        assert!(pace.nth() > 1);
        run(&mut pace, 125_000.0, 6, 120);
        assert_eq!(pace.nth(), 1);
    }

    #[test]
    fn a_budget_applies_to_every_second() {
        let mut pace = Pace::new(12_000.0, 60.0);
        let (_, fullest) = run(&mut pace, 125_000.0, 0, 20);
        assert!(fullest <= 12_000.0, "{fullest}");
    }
}
