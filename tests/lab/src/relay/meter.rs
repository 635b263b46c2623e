//! Counts bytes: the sum, and the most in any one second.

use std::collections::VecDeque;

/// The window of [`ByteMeter::peak_bytes_s`], microseconds.
const SECOND_US: u64 = 1_000_000;

/// Counts bytes as they pass.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ByteMeter {
    /// Number of datagrams.
    pub datagrams: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Most bytes of any one second, wherever it begins.
    pub peak_bytes_s: u64,
    /// Datagrams of the second that ends with the newest: time and bytes.
    window: VecDeque<(u64, u64)>,
    in_window: u64,
}

impl ByteMeter {
    /// Counts a datagram of `bytes` at `now_us`, which never decreases. The second that ends with it contains what came after
    /// `now_us` less a second. A fullest second ends with a datagram, so none is missed.
    pub fn count(&mut self, now_us: u64, bytes: u64) {
        self.datagrams += 1;
        self.bytes += bytes;
        self.window.push_back((now_us, bytes));
        self.in_window += bytes;
        self.forget(now_us);
        self.peak_bytes_s = self.peak_bytes_s.max(self.in_window);
    }

    /// Bytes of the second that ends at `now_us`.
    pub fn bytes_s(&mut self, now_us: u64) -> u64 {
        self.forget(now_us);
        self.in_window
    }

    /// Resets the counts; the current second continues.
    pub fn restart(&mut self) {
        (self.datagrams, self.bytes) = (0, 0);
        self.peak_bytes_s = 0;
    }

    fn forget(&mut self, now_us: u64) {
        while let Some(&(then_us, bytes)) = self.window.front() {
            if then_us + SECOND_US > now_us {
                break;
            }
            self.window.pop_front();
            self.in_window -= bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_fullest_second_may_begin_anywhere() {
        let mut meter = ByteMeter::default();
        for (now_us, bytes) in [(0, 10), (900_000, 100), (1_100_000, 100), (1_899_999, 1)] {
            meter.count(now_us, bytes);
        }
        assert_eq!(meter.peak_bytes_s, 201);
        assert_eq!((meter.datagrams, meter.bytes), (4, 211));
        assert_eq!(meter.bytes_s(2_500_000), 1);
        assert_eq!(meter.bytes_s(9_000_000), 0);
        assert_eq!(meter.peak_bytes_s, 201);
    }

    proptest! {
        #[test]
        fn no_second_holds_more_than_the_peak(
            steps in prop::collection::vec((0u64..400_000, 1u64..2000), 1..60)
        ) {
            let mut meter = ByteMeter::default();
            let mut now_us = 0;
            let mut passed = Vec::new();
            for (step_us, bytes) in steps {
                now_us += step_us;
                passed.push((now_us, bytes));
                meter.count(now_us, bytes);
            }
            let fullest = passed.iter().map(|&(from_us, _)| {
                let second = from_us..from_us + SECOND_US;
                let inside = passed.iter().filter(|(at_us, _)| second.contains(at_us));
                inside.map(|(_, bytes)| bytes).sum::<u64>()
            });
            prop_assert_eq!(meter.peak_bytes_s, fullest.max().unwrap());
        }
    }
}
