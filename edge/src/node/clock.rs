//! The one place that reads this machine's clock.

use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Now, for spans.
#[expect(
    clippy::disallowed_methods,
    reason = "this is the place that the lint points to"
)]
pub(crate) fn now() -> Instant {
    Instant::now()
}

/// Microseconds since `start`, at most `u32::MAX` (71 minutes).
pub(crate) fn micros_since(start: Instant) -> u32 {
    u32::try_from(now().duration_since(start).as_micros()).unwrap_or(u32::MAX)
}

/// Fastest that a [`VenueClock`] follows the system's clock, microseconds per second: far above what any
/// oscillator drifts by, far below what a tick would notice.
const SLEW_US_PER_S: i64 = 1000;

/// The clock that the edge goes by: Unix time, by PTP or NTP the same on all machines, that never jumps,
/// whatever is done to the system's clock.
#[derive(Debug)]
pub(crate) struct VenueClock {
    start: Instant,
    /// Unix time at `start`, microseconds.
    at_start_us: AtomicI64,
    /// How far it is wrong on purpose, microseconds.
    shift_us: i64,
}

impl VenueClock {
    /// Starts with the system's time, put forward by `shift_us`.
    pub(crate) fn start(shift_us: i64) -> Self {
        Self {
            start: now(),
            at_start_us: AtomicI64::new(unix_us().saturating_add(shift_us)),
            shift_us,
        }
    }

    /// Microseconds since 1970.
    pub(crate) fn now_us(&self) -> i64 {
        let since_us = now().duration_since(self.start).as_micros();
        let since_us = i64::try_from(since_us).unwrap_or(i64::MAX);
        self.at_start_us
            .load(Ordering::Relaxed)
            .saturating_add(since_us)
    }

    /// Follows the system's clock by a little; to be called once a second.
    pub(crate) fn discipline(&self) {
        let error_us = unix_us() + self.shift_us - self.now_us();
        let step_us = error_us.clamp(-SLEW_US_PER_S, SLEW_US_PER_S);
        self.at_start_us.fetch_add(step_us, Ordering::Relaxed);
    }
}

fn unix_us() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    i64::try_from(since.unwrap_or_default().as_micros()).unwrap_or(i64::MAX)
}
