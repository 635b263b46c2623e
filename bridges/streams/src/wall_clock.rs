//! Unix time for protocols that need it: follows the venue's clock from the arrival of the first
//! frame.

use std::time::{Duration, SystemTime};

/// Distance between the venue's clock and this machine's at which time stamps restart: the run is
/// not live, or was paused.
const MOST_APART: Duration = Duration::from_secs(1);
/// Rate at which stamps follow a slower venue clock, seconds per second; twice the usual slew rate
/// of a clock.
const FOLLOWS: f64 = 2e-4;

/// Estimate of the Unix time of the venue's clock.
#[derive(Debug, Default)]
pub(crate) struct WallClock {
    /// Unix time of elapsed time 0.
    zero: Option<Duration>,
    /// Elapsed time of the last frame, seconds.
    last_s: f64,
}

impl WallClock {
    /// Unix time of a frame that is `elapsed_s` after the first and arrives `now`.
    pub(crate) fn stamp(&mut self, elapsed_s: f64, now: Duration) -> Duration {
        let elapsed = Duration::try_from_secs_f64(elapsed_s).unwrap_or_default();
        // Never ahead of `now`, so that stamps increase even in a run that is faster than real time
        // and keeps restarting.
        let at_once = now.saturating_sub(elapsed);
        let passed_s = (elapsed_s - self.last_s).clamp(0.0, 1.0);
        self.last_s = elapsed_s;
        // Frames arrive with varying delays: the smallest delays determine the offset, and the
        // estimate ages.
        let zero = self.zero.filter(|zero| {
            at_once
                .checked_sub(*zero)
                .is_some_and(|it| it <= MOST_APART)
        });
        let drifted = zero.map(|zero| zero + Duration::from_secs_f64(FOLLOWS * passed_s));
        let zero = drifted.map_or(at_once, |zero| zero.min(at_once));
        self.zero = Some(zero);
        zero.saturating_add(elapsed)
    }
}

/// Current Unix time.
pub(crate) fn since_1970() -> Duration {
    SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_of_a_fast_run_increase_and_never_exceed_now() {
        let mut clock = WallClock::default();
        let mut last = Duration::ZERO;
        for frame in 0..600 {
            let now = Duration::from_secs(1000) + frame * Duration::from_millis(5);
            let stamp = clock.stamp(f64::from(frame) / 30.0, now);
            assert!(
                last <= stamp && stamp <= now,
                "{frame}: {stamp:?} at {now:?}"
            );
            last = stamp;
        }
    }

    #[test]
    fn a_slower_venue_clock_is_followed_for_hours() {
        let mut clock = WallClock::default();
        let mut worst_s = 0.0_f64;
        for frame in 0..36_000 {
            let true_s = 1000.0 + f64::from(frame);
            // Every fifth frame arrives without delay.
            let late_s = 0.02 * f64::from(frame % 5);
            let now = Duration::from_secs_f64(true_s + late_s);
            let stamp = clock.stamp(f64::from(frame) * (1.0 - 1e-4), now);
            worst_s = worst_s.max((stamp.as_secs_f64() - true_s).abs());
        }
        assert!(worst_s < 2e-3, "{worst_s} s");
    }

    #[test]
    fn stamps_follow_the_venue_clock_and_restart_after_a_pause() {
        let mut clock = WallClock::default();
        let mut stamp = |elapsed_s, now_s| {
            clock
                .stamp(elapsed_s, Duration::from_secs_f64(now_s))
                .as_secs_f64()
        };
        assert!((stamp(0.0, 1000.0) - 1000.0).abs() < 1e-6);
        // Delayed on its way.
        assert!((stamp(0.5, 1000.53) - 1000.5).abs() < 1e-3);
        assert!((stamp(1.0, 1090.0) - 1090.0).abs() < 1e-6);
        assert!((stamp(1.5, 1090.5) - 1090.5).abs() < 1e-6);
    }
}
