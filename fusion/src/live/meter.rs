//! Bytes of the last second.

use super::{Micros, SECOND_US};

/// Bins per second, plus the one in progress: the result covers the last second and up to one bin
/// more.
const BINS: Micros = 21;
const BIN_US: Micros = SECOND_US / (BINS - 1);

/// Counts bytes per second.
#[derive(Debug, Clone, Default)]
pub struct Meter {
    bins: [u32; BINS as usize],
    /// Number of the newest bin since 1970.
    newest: Micros,
}

impl Meter {
    /// Adds `bytes` that came at `now_us`. A time before an earlier one counts as that one.
    pub fn add(&mut self, bytes: u64, now_us: Micros) {
        self.advance(now_us);
        let bin = &mut self.bins[index(self.newest)];
        *bin = bin.saturating_add(u32::try_from(bytes).unwrap_or(u32::MAX));
    }

    /// Bytes of the last second before `now_us`.
    pub fn bytes_per_s(&mut self, now_us: Micros) -> u32 {
        self.advance(now_us);
        self.bins
            .iter()
            .fold(0, |sum, &bin| sum.saturating_add(bin))
    }

    fn advance(&mut self, now_us: Micros) {
        let now = now_us.div_euclid(BIN_US);
        let passed = now.saturating_sub(self.newest).clamp(0, BINS);
        for bin in 0..passed {
            self.bins[index(now - bin)] = 0;
        }
        self.newest = self.newest.max(now);
    }
}

fn index(bin: Micros) -> usize {
    bin.rem_euclid(BINS) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_older_than_a_second_do_not_count() {
        let mut meter = Meter::default();
        let start = 1_700_000_000 * SECOND_US;
        for i in 0..60 {
            meter.add(100, start + i * SECOND_US / 60);
        }
        assert_eq!(meter.bytes_per_s(start + SECOND_US - 1), 6000);
        let half = meter.bytes_per_s(start + SECOND_US * 3 / 2);
        assert!((3000..=3300).contains(&half), "{half}");
        assert_eq!(meter.bytes_per_s(start + 10 * SECOND_US), 0);
    }

    #[test]
    fn time_going_back_keeps_the_count() {
        let mut meter = Meter::default();
        meter.add(100, 10 * SECOND_US);
        meter.add(100, 9 * SECOND_US);
        assert_eq!(meter.bytes_per_s(10 * SECOND_US), 200);
    }
}
