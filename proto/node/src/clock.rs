//! The only reader of this machine's clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use farfield_proto::message::health::{MAX_AHEAD_US, SystemClock};

use crate::system_clock;

/// The present instant, for durations.
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

/// Time since 1970, or zero if the machine's clock shows an earlier time.
pub fn unix_time() -> Duration {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default()
}

/// Seconds since 1970.
pub fn unix_s() -> i64 {
    unix_time().as_secs().cast_signed()
}

/// Largest correction of a [`VenueClock`] towards the system's clock, microseconds per second. It
/// exceeds the drift of any oscillator, and is far too small to disturb the measurement of clocks.
/// The remaining difference is reported.
const SLEW_US_PER_S: i64 = 100;

/// The venue's clock: Unix time, the same on all machines by PTP or NTP. It never jumps, even if
/// the system's clock is set. Clones show the same time.
#[derive(Debug, Clone)]
pub struct VenueClock {
    start: Instant,
    /// Unix time at `start`, microseconds.
    at_start_us: Arc<AtomicI64>,
    fault: ClockFault,
}

/// A simulated fault of a clock; by default none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClockFault {
    /// Offset of the system's time, microseconds.
    pub shift_us: i64,
    /// After how many seconds the clock is set, and by how many microseconds.
    pub set: Option<(u32, i64)>,
    /// The reported state of synchronisation; `None`: the real state.
    pub synchronised: Option<bool>,
}

impl ClockFault {
    fn shift_us(&self, since_start: Duration) -> i64 {
        let set = self
            .set
            .filter(|(after_s, _)| since_start >= Duration::from_secs(u64::from(*after_s)));
        self.shift_us
            .saturating_add(set.map_or(0, |(_, by_us)| by_us))
    }
}

impl VenueClock {
    /// Starts with the system's time.
    pub fn start() -> Self {
        Self::start_with(ClockFault::default())
    }

    /// Starts with a system time that has `fault`.
    #[cfg(feature = "study")]
    pub fn start_wrong(fault: ClockFault) -> Self {
        Self::start_with(fault)
    }

    fn start_with(fault: ClockFault) -> Self {
        let start_us = unix_us().saturating_add(fault.shift_us(Duration::ZERO));
        Self {
            start: now(),
            at_start_us: Arc::new(AtomicI64::new(start_us)),
            fault,
        }
    }

    /// Microseconds since 1970.
    pub fn now_us(&self) -> i64 {
        self.at_start_us
            .load(Ordering::Relaxed)
            .saturating_add(self.elapsed_us())
    }

    /// The instant at which the clock shows `us`; the present instant for a time in the past.
    pub fn instant_at(&self, us: i64) -> Instant {
        let ahead_us = us.saturating_sub(self.now_us()).max(0);
        now() + Duration::from_micros(ahead_us.unsigned_abs())
    }

    /// Moves towards the system's clock by a small step; call it once per second.
    pub fn discipline(&self) {
        let step_us = self.ahead_us().clamp(-SLEW_US_PER_S, SLEW_US_PER_S);
        self.at_start_us.fetch_add(step_us, Ordering::Relaxed);
    }

    /// The state of the system's clock, and by how much it is ahead of this clock.
    pub fn system(&self) -> SystemClock {
        let reported = system_clock::read();
        SystemClock {
            synchronised: self.fault.synchronised.unwrap_or(reported.synchronised),
            ahead_us: self.ahead_us().clamp(-MAX_AHEAD_US, MAX_AHEAD_US),
            ..reported
        }
    }

    fn ahead_us(&self) -> i64 {
        let since_start = now().duration_since(self.start);
        let shown_us = unix_us().saturating_add(self.fault.shift_us(since_start));
        shown_us.saturating_sub(self.now_us())
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
    fn the_clock_saturates_at_the_end_of_time() {
        let clock = VenueClock {
            start: now().checked_sub(Duration::from_millis(5)).unwrap(),
            at_start_us: Arc::new(AtomicI64::new(i64::MAX)),
            fault: ClockFault::default(),
        };
        assert_eq!(clock.now_us(), i64::MAX);
        clock.discipline();
        assert!(clock.now_us() > i64::MAX - 2 * SLEW_US_PER_S);
    }
}
