//! The one place that reads this machine's clock.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

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

/// Time since 1970, zero on a machine whose clock is before that.
pub(crate) fn unix_time() -> Duration {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default()
}
