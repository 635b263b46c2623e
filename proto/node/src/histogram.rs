//! A histogram of durations over days, in bounded memory.
//!
//! The buckets are those of the crate `hdrhistogram` (Gil Tene's `HdrHistogram`) with two
//! significant figures from 1 microsecond to `u32::MAX` (71 minutes). A percentile is at most 1/128
//! above the truth. Values below 256, count, sum and maximum are exact. A histogram takes 13 kB.

use hdrhistogram::Histogram as Buckets;

use farfield_proto::message::StageTime;

/// Significant decimal figures.
const FIGURES: u8 = 2;

/// A distribution of microseconds, of bounded size.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    buckets: Buckets<u32>,
    total: u64,
    max: u32,
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            buckets: Buckets::new_with_max(u32::MAX.into(), FIGURES)
                .expect("two figures up to 2^32 are within the crate's range"),
            total: 0,
            max: 0,
        }
    }
}

impl Histogram {
    /// Records one value without allocation.
    pub fn record(&mut self, us: u32) {
        self.buckets.saturating_record(us.into());
        self.total = self.total.saturating_add(us.into());
        self.max = self.max.max(us);
    }

    /// The number of values.
    pub fn count(&self) -> u64 {
        self.buckets.len()
    }

    /// The maximum, microseconds; 0 without values.
    pub fn max(&self) -> u32 {
        self.max
    }

    /// Adds the values of `other`.
    ///
    /// # Panics
    /// Never: all histograms have the same buckets.
    pub fn merge(&mut self, other: &Self) {
        self.buckets
            .add(&other.buckets)
            .expect("all histograms have the same buckets");
        self.total = self.total.saturating_add(other.total);
        self.max = self.max.max(other.max);
    }

    /// Removes all values.
    pub fn clear(&mut self) {
        self.buckets.reset();
        (self.total, self.max) = (0, 0);
    }

    /// The smallest value, microseconds, that a `share` (0 to 1) of all values does not exceed, by
    /// nearest rank: the upper end of its bucket, at most the maximum. `None` without values.
    pub fn quantile(&self, share: f64) -> Option<u32> {
        let upper_end = self.buckets.value_at_quantile(share);
        let us = u32::try_from(upper_end).unwrap_or(u32::MAX).min(self.max);
        (self.count() > 0).then_some(us)
    }

    /// The values as the time of `stage`; `None` without values.
    pub fn stage_time(&self, stage: &str) -> Option<StageTime> {
        Some(StageTime {
            stage: stage.to_owned(),
            count: self.count(),
            total_us: self.total,
            p50_us: self.quantile(0.5)?,
            p99_us: self.quantile(0.99)?,
            p999_us: self.quantile(0.999)?,
            max_us: self.max,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn an_empty_histogram_has_no_results() {
        assert_eq!(Histogram::default().stage_time("step"), None);
        assert_eq!(Histogram::default().quantile(0.5), None);
    }

    #[test]
    fn small_numbers_are_exact() {
        let mut h = Histogram::default();
        (1..=200).for_each(|us| h.record(us));
        let time = h.stage_time("step").unwrap();
        assert_eq!((time.count, time.total_us), (200, 20_100));
        assert_eq!((time.p50_us, time.p99_us, time.max_us), (100, 198, 200));
    }

    #[test]
    fn every_value_is_counted_in_bounded_memory() {
        let mut h = Histogram::default();
        let room = h.buckets.distinct_values();
        for us in (0..32).flat_map(|bit| [1u32 << bit, (1u32 << bit) - 1]) {
            h.record(us);
            h.record(u32::MAX - us);
        }
        assert_eq!(h.count(), 128);
        assert_eq!(h.buckets.distinct_values(), room);
        assert!(room * size_of::<u32>() < 14_000, "{room} buckets");
        assert_eq!((h.quantile(1.0), h.max()), (Some(u32::MAX), u32::MAX));
    }

    #[test]
    fn clear_removes_all_values() {
        let mut h = Histogram::default();
        h.record(7);
        h.clear();
        assert_eq!(h, Histogram::default());
    }

    proptest! {
        #[test]
        fn percentiles_are_those_of_all_samples_within_a_bucket(
            mut samples in prop::collection::vec(0u32..3_000_000, 1..300),
        ) {
            let mut h = Histogram::default();
            for &us in &samples {
                h.record(us);
            }
            let exact = StageTime::from_samples("s", &mut samples).unwrap();
            let got = h.stage_time("s").unwrap();
            prop_assert_eq!((got.count, got.total_us, got.max_us), (exact.count, exact.total_us, exact.max_us));
            for (got, exact) in [(got.p50_us, exact.p50_us), (got.p99_us, exact.p99_us), (got.p999_us, exact.p999_us)] {
                prop_assert!(got >= exact && f64::from(got) <= f64::from(exact) * (1.0 + 1.0 / 128.0));
            }
        }

        #[test]
        fn merged_histograms_equal_one_histogram(
            a in prop::collection::vec(any::<u32>(), 0..50), b in prop::collection::vec(any::<u32>(), 0..50),
        ) {
            let of = |samples: &[u32]| {
                let mut h = Histogram::default();
                for &us in samples {
                    h.record(us);
                }
                h
            };
            let mut merged = of(&a);
            merged.merge(&of(&b));
            prop_assert_eq!(merged, of(&[a, b].concat()));
        }
    }
}
