//! Unix time for protocols that want it: steps of the venue's clock, from when the first frame came.

use std::time::{Duration, SystemTime};

/// When the venue's clock and this machine's are so far apart, stamps begin anew: a run that is not live, or one that
/// stood still.
const MOST_APART: Duration = Duration::from_secs(1);

/// Unix time of the venue's clock, as far as it is known.
#[derive(Debug, Default)]
pub(crate) struct WallClock {
    /// Unix time of elapsed 0.
    zero: Option<Duration>,
}

impl WallClock {
    /// Unix time of a frame that is `elapsed_s` after the first one and comes `now`.
    pub(crate) fn stamp(&mut self, elapsed_s: f64, now: Duration) -> Duration {
        let elapsed = Duration::try_from_secs_f64(elapsed_s).unwrap_or_default();
        // Never ahead of now: then stamps rise, also where a run is faster than time and begins anew again and again.
        let is_near = |zero: &Duration| {
            let late = now.checked_sub(zero.saturating_add(elapsed));
            late.is_some_and(|late| late <= MOST_APART)
        };
        let zero = self.zero.filter(is_near);
        let zero = *self
            .zero
            .insert(zero.unwrap_or_else(|| now.saturating_sub(elapsed)));
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
    fn stamps_go_with_the_venues_clock_and_begin_anew_where_it_stood_still() {
        let mut clock = WallClock::default();
        let mut stamp = |elapsed_s, now_s| {
            clock
                .stamp(elapsed_s, Duration::from_secs_f64(now_s))
                .as_secs_f64()
        };
        assert!((stamp(0.0, 1000.0) - 1000.0).abs() < 1e-6);
        // Late by a delay of its own.
        assert!((stamp(0.5, 1000.53) - 1000.5).abs() < 1e-6);
        assert!((stamp(1.0, 1090.0) - 1090.0).abs() < 1e-6);
        assert!((stamp(1.5, 1090.5) - 1090.5).abs() < 1e-6);
    }
}
