//! Medians and percentiles, each definition once. They differ in the choice between two neighbours.

/// At least this many values must support a result, if there are twice as many.
pub const FEWEST_REACHING: usize = 5;

/// The value that a `share` (0 to 1) of all `values` reaches, and at least [`FEWEST_REACHING`] of
/// them (or half of few values). `None` without values. NaN is ignored.
///
/// Scales, extents and clocks use it, because a single outlier determines a maximum.
pub fn reached_by(values: impl IntoIterator<Item = f64>, share: f64) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().filter(|it| !it.is_nan()).collect();
    let reaching = ((share * values.len() as f64).ceil() as usize).max(FEWEST_REACHING);
    let from_top = reaching.min(values.len().div_ceil(2)).checked_sub(1)?;
    let (_, reached, _) = values.select_nth_unstable_by(from_top, |a, b| b.total_cmp(a));
    Some(*reached)
}

/// The index among `count` sorted values of the smallest that a `share` (0 to 1) of all does not
/// exceed: the nearest rank.
pub fn nearest_rank(share: f64, count: usize) -> usize {
    (share * count as f64).ceil().max(1.0) as usize - 1
}

/// The smallest value of `sorted` that a `share` (0 to 1) of all does not exceed, by nearest rank;
/// `None` without values.
pub fn percentile<T: Copy>(sorted: &[T], share: f64) -> Option<T> {
    sorted.get(nearest_rank(share, sorted.len())).copied()
}

/// The value after a `share` (0 to 1) of `sorted`, or the last; `None` without values.
pub fn value_after<T: Copy>(sorted: &[T], share: f64) -> Option<T> {
    let after = (share * sorted.len() as f64) as usize;
    sorted.get(after).or(sorted.last()).copied()
}

/// The median of `values`, of two the upper one; `None` without values.
pub fn upper_median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    values.sort_by(f64::total_cmp);
    values.get(middle).copied()
}

/// The median of `sorted`, of two their mean; `None` without values.
pub fn mean_median(sorted: &[f64]) -> Option<f64> {
    let low = sorted.get(sorted.len().saturating_sub(1) / 2)?;
    Some(low.midpoint(sorted[sorted.len() / 2]))
}

/// The value below which half of the weight lies, interpolated between its neighbours, from (value,
/// weight) pairs; `None` without weight.
///
/// ```text
///   value at c = W/2 of the polygon through (c_i, v_i),   c_i = sum of the weights before i + w_i/2
/// ```
pub fn weighted_median(mut votes: Vec<(f64, f64)>) -> Option<f64> {
    votes.retain(|&(value, weight)| value.is_finite() && weight > 0.0);
    votes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * votes.iter().map(|vote| vote.1).sum::<f64>();
    let mut before: Option<(f64, f64)> = None;
    let mut below = 0.0;
    for (value, weight) in votes {
        let center = below + 0.5 * weight;
        if center >= half {
            return Some(match before {
                Some((c, v)) => v + (value - v) * (half - c) / (center - c),
                None => value,
            });
        }
        before = Some((center, value));
        below += weight;
    }
    before.map(|(_, value)| value)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn percentiles_are_taken_by_nearest_rank() {
        let sorted: Vec<u64> = (1..=200).collect();
        assert_eq!(percentile(&sorted, 0.5), Some(100));
        assert_eq!(percentile(&sorted, 0.99), Some(198));
        assert_eq!(percentile(&sorted, 1.0), Some(200));
        assert_eq!(percentile::<u64>(&[], 0.5), None);
    }

    #[test]
    fn the_value_after_a_share_is_one_rank_above_its_percentile() {
        let sorted: Vec<u64> = (1..=200).collect();
        assert_eq!(value_after(&sorted, 0.5), Some(101));
        assert_eq!(value_after(&sorted, 1.0), Some(200));
        assert_eq!(value_after::<u64>(&[], 0.5), None);
    }

    #[test]
    fn medians_of_even_counts_are_the_upper_value_or_the_mean() {
        assert_eq!(upper_median(vec![4.0, 1.0, 2.0, 3.0]), Some(3.0));
        assert_eq!(mean_median(&[1.0, 2.0, 3.0, 4.0]), Some(2.5));
        assert_eq!(upper_median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(mean_median(&[1.0, 2.0, 3.0]), Some(2.0));
        assert_eq!((upper_median(Vec::new()), mean_median(&[])), (None, None));
    }

    #[test]
    fn a_few_outliers_do_not_change_reached_by() {
        let with = |outliers: &[f64]| {
            let usual = (0..100).map(|i| 0.01 * f64::from(i));
            reached_by(usual.chain(outliers.iter().copied()), 0.05).unwrap()
        };
        assert!((with(&[]) - 0.95).abs() < 1e-12);
        for outlier in [1e9, f64::INFINITY, f64::NAN, -1e9] {
            assert!((with(&[outlier; 4]) - 0.95).abs() <= 0.04, "{outlier}");
        }
        assert_eq!(reached_by([8.0, 4.0], 0.05), Some(8.0));
        assert_eq!(reached_by([1.0, 900.0, 2.0], 0.05), Some(2.0));
        assert_eq!(reached_by([f64::NAN], 0.05), None);
    }

    #[test]
    fn the_weighted_median_of_an_even_count_is_in_the_middle() {
        let m = weighted_median(vec![(1.0, 1.0), (2.0, 1.0), (10.0, 1.0), (3.0, 1.0)]).unwrap();
        assert!((m - 2.5).abs() < 1e-12);
        assert!(weighted_median(vec![(1.0, 0.0)]).is_none());
    }

    proptest! {
        #[test]
        fn the_weighted_median_is_robust_to_one_outlier(
            values in prop::collection::vec((1.0f64..2.0, 0.1f64..1.0), 5..20),
        ) {
            let mut votes = values.clone();
            votes.push((1e6, 0.05));
            let m = weighted_median(votes).unwrap();
            prop_assert!((1.0..=2.0).contains(&m));
        }
    }
}
