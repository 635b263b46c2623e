//! How long things took, over days in the room of a few kilobytes.
//!
//! Buckets grow with what they hold: `PER_OCTAVE` of one width from each power of two to the next, so that
//! a percentile is at most 1 / `PER_OCTAVE` above the truth (3 %). What is below `PER_OCTAVE` is exact,
//! and so are count, sum and largest. The idea is Gil Tene's `HdrHistogram`.

use crate::message::StageTime;

/// Buckets from a power of two to the next.
const PER_OCTAVE: u32 = 1 << OCTAVE_BITS;
const OCTAVE_BITS: u32 = 5;
/// One for every number below [`PER_OCTAVE`], then so many for each further bit of a `u32`.
const BUCKETS: usize = (PER_OCTAVE + (u32::BITS - OCTAVE_BITS) * PER_OCTAVE) as usize;

/// A distribution of microseconds, of bounded size whatever was counted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Histogram {
    counts: Box<[u64; BUCKETS]>,
    count: u64,
    total: u64,
    max: u32,
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            counts: Box::new([0; BUCKETS]),
            count: 0,
            total: 0,
            max: 0,
        }
    }
}

impl Histogram {
    /// Counts one more. Allocates nothing.
    pub fn record(&mut self, us: u32) {
        self.counts[bucket(us)] += 1;
        self.count += 1;
        self.total = self.total.saturating_add(u64::from(us));
        self.max = self.max.max(us);
    }

    /// How many were counted.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The largest, microseconds; 0 when there is none.
    pub fn max(&self) -> u32 {
        self.max
    }

    /// Adds what `other` has counted.
    pub fn merge(&mut self, other: &Self) {
        for (ours, theirs) in self.counts.iter_mut().zip(other.counts.iter()) {
            *ours += theirs;
        }
        self.count += other.count;
        self.total = self.total.saturating_add(other.total);
        self.max = self.max.max(other.max);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.counts.fill(0);
        (self.count, self.total, self.max) = (0, 0, 0);
    }

    /// The number, microseconds, that a `share` (0 to 1) of all is not above, by nearest rank: the upper end
    /// of its bucket, never above the largest. `None` when nothing was counted.
    pub fn quantile(&self, share: f64) -> Option<u32> {
        let rank = (share * self.count as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        let at = self.counts.iter().position(|&n| {
            seen += n;
            seen >= rank
        });
        (self.count > 0).then(|| at.map_or(self.max, |at| upper_end(at).min(self.max)))
    }

    /// Sums up as the time of `stage`. `None` when nothing was counted.
    pub fn stage_time(&self, stage: &str) -> Option<StageTime> {
        Some(StageTime {
            stage: stage.to_owned(),
            count: self.count,
            total_us: self.total,
            p50_us: self.quantile(0.5)?,
            p99_us: self.quantile(0.99)?,
            p999_us: self.quantile(0.999)?,
            max_us: self.max,
        })
    }
}

fn bucket(us: u32) -> usize {
    if us < PER_OCTAVE {
        return us as usize;
    }
    // The highest bits of the number: the leading one says the octave, those behind it the place there.
    let shift = us.ilog2() - OCTAVE_BITS;
    ((shift << OCTAVE_BITS) + (us >> shift)) as usize
}

/// The largest number that falls into a bucket.
fn upper_end(bucket: usize) -> u32 {
    let bucket = bucket as u32;
    if bucket < PER_OCTAVE {
        return bucket;
    }
    let shift = (bucket >> OCTAVE_BITS) - 1;
    let first = u64::from(PER_OCTAVE + bucket % PER_OCTAVE) << shift;
    u32::try_from(first + (1 << shift) - 1).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn nothing_counted_is_nothing_said() {
        assert_eq!(Histogram::default().stage_time("step"), None);
        assert_eq!(Histogram::default().quantile(0.5), None);
    }

    #[test]
    fn small_numbers_are_exact() {
        let mut h = Histogram::default();
        (1..=20).for_each(|us| h.record(us));
        let time = h.stage_time("step").unwrap();
        assert_eq!((time.count, time.total_us), (20, 210));
        assert_eq!((time.p50_us, time.p99_us, time.max_us), (10, 20, 20));
    }

    #[test]
    fn every_number_has_a_bucket_and_they_follow_each_other() {
        for bit in 0..32 {
            for us in [
                1u32 << bit,
                (1u32 << bit).wrapping_sub(1),
                (1 << bit) + (1 << bit >> 1),
            ] {
                let at = bucket(us);
                assert!(at < BUCKETS && upper_end(at) >= us, "{us}");
                assert!(at == 0 || upper_end(at - 1) < us, "{us}");
            }
        }
        assert_eq!(bucket(u32::MAX), BUCKETS - 1);
        assert_eq!(upper_end(BUCKETS - 1), u32::MAX);
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
                prop_assert!(got >= exact && f64::from(got) <= f64::from(exact) * (1.0 + 1.0 / f64::from(PER_OCTAVE)));
            }
        }

        #[test]
        fn what_was_counted_apart_is_as_if_counted_together(
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
