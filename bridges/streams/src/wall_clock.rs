//! Unix time for protocols that want it: steps of the venue's clock, from when the first frame came.

use std::time::{Duration, SystemTime};

/// When the venue's clock and this machine's are so far apart, stamps begin anew: a run that is not live, or one that
/// stood still.
const MOST_APART: Duration = Duration::from_secs(1);
/// How fast stamps follow a venue's clock that is slower than this machine's: seconds per second, twice what the clock is slewed by.
const FOLLOWS: f64 = 2e-4;

/// Unix time of the venue's clock, as far as it is known.
#[derive(Debug, Default)]
pub(crate) struct WallClock {
    /// Unix time of elapsed 0.
    zero: Option<Duration>,
    /// Elapsed time of the last frame, seconds.
    last_s: f64,
}

impl WallClock {
    /// Unix time of a frame that is `elapsed_s` after the first one and comes `now`.
    pub(crate) fn stamp(&mut self, elapsed_s: f64, now: Duration) -> Duration {
        let elapsed = Duration::try_from_secs_f64(elapsed_s).unwrap_or_default();
        // Never ahead of now: then stamps rise, also where a run is faster than time and begins anew again and again.
        let at_once = now.saturating_sub(elapsed);
        let passed_s = (elapsed_s - self.last_s).clamp(0.0, 1.0);
        self.last_s = elapsed_s;
        // Frames come late by delays of their own: the least late ones tell, and what they tell grows old.
        let zero = self.zero.filter(|zero| {
            at_once
                .checked_sub(*zero)
                .is_some_and(|it| it <= MOST_APART)
        });
        let followed = zero.map(|zero| zero + Duration::from_secs_f64(FOLLOWS * passed_s));
        let zero = followed.map_or(at_once, |zero| zero.min(at_once));
        self.zero = Some(zero);
        zero.saturating_add(elapsed)
    }
}

/// Unix time.
pub(crate) fn since_1970() -> Duration {
    SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_of_a_run_that_is_faster_than_time_rise_and_are_never_ahead_of_now() {
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
    fn a_venue_whose_clock_is_slower_for_hours_is_followed() {
        let mut clock = WallClock::default();
        let mut worst_s = 0.0_f64;
        for frame in 0..36_000 {
            let true_s = 1000.0 + f64::from(frame);
            // Every fifth frame comes at once.
            let late_s = 0.02 * f64::from(frame % 5);
            let now = Duration::from_secs_f64(true_s + late_s);
            let stamp = clock.stamp(f64::from(frame) * (1.0 - 1e-4), now);
            worst_s = worst_s.max((stamp.as_secs_f64() - true_s).abs());
        }
        assert!(worst_s < 2e-3, "{worst_s} s");
    }

    #[test]
    fn stamps_go_with_the_venues_clock_and_begin_anew_where_it_stood_still() {
        let mut clock = WallClock::default();
        let mut stamp = |elapsed_s, now_s| {
            clock
                .stamp(elapsed_s, Duration::from_secs_f64(now_s))
                .as_secs_f64()
        };
        assert!((stamp(0.0, 1000.0) - 1000.0).abs() < 1e-6);
        // Late by a delay of its own.
        assert!((stamp(0.5, 1000.53) - 1000.5).abs() < 1e-3);
        assert!((stamp(1.0, 1090.0) - 1090.0).abs() < 1e-6);
        assert!((stamp(1.5, 1090.5) - 1090.5).abs() < 1e-6);
    }
}
