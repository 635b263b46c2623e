//! The byte budget: the bytes sent in the last second, and whether more may be sent.
//!
//! A sliding window is used, not a token bucket, because a bucket allows a burst above its rate.
//! The bound holds over every window of one second, plus 50 ms because the network may bunch
//! messages.

use super::{Micros, SECOND_US};

/// Width of a slot of the window, microseconds.
const SLOT_US: Micros = 10_000;
/// The window: one second, 50 ms for the network's jitter, and the current partial slot.
const SLOTS: i64 = SECOND_US / SLOT_US + 5 + 1;

/// Bytes in a sliding window, in constant memory.
#[derive(Debug, Clone)]
pub struct ByteBudget {
    /// Most bytes in any second; `None` without a bound.
    most: Option<u64>,
    slots: [u64; SLOTS as usize],
    /// Number of the newest slot by time.
    newest: i64,
}

impl ByteBudget {
    /// Allows at most `bytes_per_s` in any second; 0 means no bound.
    pub fn new(bytes_per_s: f64) -> Self {
        Self {
            most: (bytes_per_s > 0.0).then_some(bytes_per_s as u64),
            slots: [0; SLOTS as usize],
            newest: i64::MIN / 2,
        }
    }

    /// The bound, bytes per second.
    pub fn most(&self) -> Option<u64> {
        self.most
    }

    /// Counts `bytes` as sent at `now_us` if they fit; returns whether they fit.
    pub fn take(&mut self, bytes: usize, now_us: Micros) -> bool {
        self.advance(now_us);
        let bytes = bytes as u64;
        let used: u64 = self.slots.iter().sum();
        if self.most.is_some_and(|most| used + bytes > most) {
            return false;
        }
        self.slots[slot(self.newest)] += bytes;
        true
    }

    /// Bytes that still fit at `now_us`; `None` without a bound.
    pub fn left(&mut self, now_us: Micros) -> Option<u64> {
        self.advance(now_us);
        let used: u64 = self.slots.iter().sum();
        self.most.map(|most| most.saturating_sub(used))
    }

    /// Bytes sent in the last second.
    pub fn sent(&mut self, now_us: Micros) -> u64 {
        self.advance(now_us);
        (0..SECOND_US / SLOT_US)
            .map(|back| self.slots[slot(self.newest - back)])
            .sum()
    }

    /// If the clock goes back, the slot stays the same.
    fn advance(&mut self, now_us: Micros) {
        let now = now_us.div_euclid(SLOT_US);
        let passed = (now - self.newest).clamp(0, SLOTS);
        for back in 0..passed {
            self.slots[slot(now - back)] = 0;
        }
        self.newest = self.newest.max(now);
    }
}

fn slot(number: i64) -> usize {
    number.rem_euclid(SLOTS) as usize
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn without_a_bound_everything_fits_and_is_counted() {
        let mut budget = ByteBudget::new(0.0);
        assert!(budget.take(1 << 30, 0) && budget.take(1 << 30, 0));
        assert_eq!(budget.sent(0), 1 << 31);
        assert_eq!(budget.left(0), None);
    }

    #[test]
    fn sent_bytes_expire_after_the_window() {
        let mut budget = ByteBudget::new(1000.0);
        assert!(budget.take(1000, 5));
        assert!(!budget.take(1, SECOND_US));
        assert!(budget.take(1, SECOND_US + SLOTS * SLOT_US));
    }

    proptest! {
        #[test]
        fn no_second_holds_more_than_the_bound(
            sends in prop::collection::vec((0i64..60_000, 1usize..400), 1..400), start in 0i64..1_000_000,
        ) {
            let most = 5000;
            let mut budget = ByteBudget::new(f64::from(most));
            let mut now = start;
            let mut sent: Vec<(Micros, usize)> = Vec::new();
            for (gap, bytes) in sends {
                now += gap;
                if budget.take(bytes, now) {
                    sent.push((now, bytes));
                }
            }
            for (from, _) in &sent {
                let within = sent.iter().filter(|(at, _)| (*from..from + SECOND_US).contains(at));
                prop_assert!(within.map(|(_, b)| b).sum::<usize>() <= most as usize);
            }
        }

        #[test]
        fn after_a_window_of_silence_everything_fits_again(first in 1usize..1000, pause in 1_100_000i64..10_000_000) {
            let mut budget = ByteBudget::new(1000.0);
            prop_assert!(budget.take(first, 0));
            prop_assert!(budget.take(1000, pause));
        }
    }
}
