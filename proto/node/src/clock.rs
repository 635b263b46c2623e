//! The one place that reads this machine's clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Now, for spans.
#[expect(
    clippy::disallowed_methods,
    reason = "this is the place that the lint points to"
)]
pub fn now() -> Instant {
    Instant::now()
}

/// Microseconds since `start`, at most `u32::MAX` (71 minutes).
pub fn micros_since(start: Instant) -> u32 {
    u32::try_from(now().duration_since(start).as_micros()).unwrap_or(u32::MAX)
}

/// Time since 1970, zero on a machine whose clock is before that.
pub fn unix_time() -> Duration {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default()
}

/// Fastest that a [`VenueClock`] follows the system's clock, microseconds per second: far above what
/// any oscillator drifts by, far below what a tick would notice.
const SLEW_US_PER_S: i64 = 1000;

/// The clock that the venue goes by: Unix time, by PTP or NTP the same on all machines, that never jumps,
/// whatever is done to the system's clock. Clones show the same time.
#[derive(Debug, Clone)]
pub struct VenueClock {
    start: Instant,
    /// Unix time at `start`, microseconds.
    at_start_us: Arc<AtomicI64>,
    /// How far it is wrong on purpose, microseconds.
    shift_us: i64,
}

impl VenueClock {
    /// Starts with the system's time.
    pub fn start() -> Self {
        Self::put_forward(0)
    }

    /// Starts with the system's time put forward by `shift_us` microseconds, and keeps that distance.
    #[cfg(feature = "study")]
    pub fn start_shifted(shift_us: i64) -> Self {
        Self::put_forward(shift_us)
    }

    fn put_forward(shift_us: i64) -> Self {
        Self {
            start: now(),
            at_start_us: Arc::new(AtomicI64::new(unix_us().saturating_add(shift_us))),
            shift_us,
        }
    }

    /// Microseconds since 1970.
    pub fn now_us(&self) -> i64 {
        self.at_start_us
            .load(Ordering::Relaxed)
            .saturating_add(self.elapsed_us())
    }

    /// The instant at which the clock shows `us`; now, for what is over.
    pub fn instant_at(&self, us: i64) -> Instant {
        let ahead_us = us.saturating_sub(self.now_us()).max(0);
        now() + Duration::from_micros(ahead_us.unsigned_abs())
    }

    /// Follows the system's clock by a little; to be called once a second.
    pub fn discipline(&self) {
        let shown_us = unix_us().saturating_add(self.shift_us);
        let error_us = shown_us.saturating_sub(self.now_us());
        let step_us = error_us.clamp(-SLEW_US_PER_S, SLEW_US_PER_S);
        self.at_start_us.fetch_add(step_us, Ordering::Relaxed);
    }

    fn elapsed_us(&self) -> i64 {
        i64::try_from(now().duration_since(self.start).as_micros()).unwrap_or(i64::MAX)
    }
}

fn unix_us() -> i64 {
    i64::try_from(unix_time().as_micros()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_the_end_of_time_the_clock_stands_still() {
        let clock = VenueClock {
            start: now().checked_sub(Duration::from_millis(5)).unwrap(),
            at_start_us: Arc::new(AtomicI64::new(i64::MAX)),
            shift_us: 0,
        };
        assert_eq!(clock.now_us(), i64::MAX);
        clock.discipline();
        assert!(clock.now_us() > i64::MAX - 2 * SLEW_US_PER_S);
    }
}
