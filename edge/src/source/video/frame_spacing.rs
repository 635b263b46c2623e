//! Checks that the frames of a recording come at even times, so that frame n is tick n.
//!
//! Phones lengthen intervals in poor light, and capture programs drop frames. The mean rate can
//! then be right and no interval irregular, while frames are still several ticks off those of other
//! cameras.

use std::ops::Range;

use farfield_proto::order_statistics::upper_median;

/// Accepted time between two frames, in periods. Outside this range a frame was lost or doubled.
const GAP_PERIODS: Range<f64> = 0.5..1.5;
/// Largest deviation of a frame from even times: one period, because containers round times to
/// milliseconds, plus a share of the recording's length, because the clock of a camera drifts while
/// it warms up.
const MAX_OFF_PERIODS: f64 = 1.0;
const CLOCK_DRIFT: f64 = 1e-4;

/// An irregular interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OddGap {
    /// The frame before it, counted from 0.
    pub(super) before: usize,
    /// Its length, seconds.
    pub(super) gap_s: f64,
}

/// The first irregular interval of a recording with this period; `times_s` must rise.
pub(super) fn odd_gap(times_s: &[f64], period_s: f64) -> Option<OddGap> {
    let gaps_s = times_s.windows(2).map(|pair| pair[1] - pair[0]);
    let mut odd = gaps_s
        .enumerate()
        .filter(|(_, gap_s)| !GAP_PERIODS.contains(&(gap_s / period_s)));
    odd.next().map(|(before, gap_s)| OddGap { before, gap_s })
}

/// The median time between two frames; `None` for fewer than two frames.
pub(super) fn usual_gap_s(times_s: &[f64]) -> Option<f64> {
    let gaps_s = times_s.windows(2).map(|pair| pair[1] - pair[0]);
    upper_median(gaps_s.collect())
}

/// The mean time between two frames; `None` for fewer than two frames.
fn mean_period_s(times_s: &[f64]) -> Option<f64> {
    let (first, last) = (times_s.first()?, times_s.last()?);
    let n_gaps = times_s.len() - 1;
    (n_gaps > 0 && last > first).then(|| (last - first) / n_gaps as f64)
}

/// The frame with the largest deviation from an even rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FarOff {
    /// The frame, counted from 0.
    pub(super) frame: usize,
    /// Its delay and the largest allowed one, seconds.
    pub(super) late_s: f64,
    pub(super) most_s: f64,
}

/// The frame with the largest deviation; `None` if all are within the limit.
pub(super) fn farthest_off(times_s: &[f64]) -> Option<FarOff> {
    let period_s = mean_period_s(times_s)?;
    let first_s = times_s[0];
    let most_s = MAX_OFF_PERIODS * period_s + CLOCK_DRIFT * (times_s[times_s.len() - 1] - first_s);
    let late = times_s.iter().enumerate();
    let late = late.map(|(n, at_s)| (n, at_s - first_s - n as f64 * period_s));
    let (frame, late_s) = late.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    (late_s.abs() > most_s).then_some(FarOff {
        frame,
        late_s,
        most_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: f64 = 60.0;

    fn times_s(n: usize, off_s: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..n).map(|n| n as f64 / HZ + off_s(n as f64)).collect()
    }

    #[test]
    fn a_varying_rate_is_reported_with_its_largest_deviation() {
        // As on a phone: no interval is half a period off, and the mean is right.
        let off_s = |n: f64| (0.05 - 5e-5 * n) * (n * std::f64::consts::PI / 100.0).sin();
        let phone = times_s(201, off_s);
        assert_eq!(odd_gap(&phone, 1.0 / HZ), None);
        let FarOff { frame, late_s, .. } = farthest_off(&phone).unwrap();
        assert!((40..=60).contains(&frame) && (late_s - 0.0475).abs() < 1e-3);
    }

    #[test]
    fn rounded_times_and_a_slightly_wrong_rate_are_even() {
        let rounded: Vec<f64> = times_s(5000, |n| n * 1e-5)
            .iter()
            .map(|at_s| (at_s * 1e3).round() / 1e3)
            .collect();
        assert_eq!(farthest_off(&rounded), None);
        assert_eq!(farthest_off(&[]), None);
        assert_eq!(farthest_off(&[1.0, 1.0]), None);
    }

    #[test]
    fn clock_drift_of_a_warming_camera_is_even() {
        let n = 3600.0 * HZ;
        let warming = times_s(3600 * 60, |at| 4e-5 * (at / HZ) * (1.0 - at / n));
        assert_eq!(farthest_off(&warming), None);
    }

    #[test]
    fn the_usual_gap_ignores_lost_frames() {
        let lost = times_s(100, |n| 8.0 / HZ * (n / 25.0).floor());
        assert!((usual_gap_s(&lost).unwrap() - 1.0 / HZ).abs() < 1e-9);
        assert_eq!(usual_gap_s(&[1.0]), None);
    }

    #[test]
    fn a_lost_frame_is_an_odd_gap() {
        let lost = times_s(100, |n| if n < 30.0 { 0.0 } else { 2.0 / HZ });
        let gap = odd_gap(&lost, 1.0 / HZ).unwrap();
        assert!(gap.before == 29 && (gap.gap_s - 3.0 / HZ).abs() < 1e-9);
    }
}
