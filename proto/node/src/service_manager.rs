//! Reports to systemd: start, current work, and signs of life. Without `NOTIFY_SOCKET` nothing is
//! sent. Other service managers use the same protocol.

use std::convert::Infallible;
use std::future::pending;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use farfield_proto::plain_text;
use sd_notify::NotifyState;
use tokio::time::{MissedTickBehavior, interval};

use crate::clock;

/// When the work last made progress; `None` while the node waits for others and has no work. A
/// process has one service manager.
static WORKED: Mutex<Option<Instant>> = Mutex::new(None);

/// Signs of life per watchdog period (`WatchdogSec`).
const SIGNS_OF_LIFE: u32 = 4;

/// Notes progress of the work. Without progress for half of `WatchdogSec`, the node sends no more
/// signs of life.
pub fn note_work() {
    *worked() = Some(clock::now());
}

/// Notes the end of the work; the rest may take any time.
pub fn end_work() {
    *worked() = None;
}

fn worked() -> MutexGuard<'static, Option<Instant>> {
    WORKED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reports in a line what the node does, for `systemctl status`.
pub fn report(line: &str) {
    send(NotifyState::Status(&plain_text::one_line(line)));
}

/// Reports the start and, as long as it is polled, signs of life.
pub(crate) async fn watch() -> Infallible {
    send(NotifyState::Ready);
    let Some(allowed) = sd_notify::watchdog_enabled() else {
        return pending().await;
    };
    let mut signs = interval((allowed / SIGNS_OF_LIFE).max(Duration::from_millis(1)));
    signs.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        signs.tick().await;
        let worked = *worked();
        if goes_on(worked, clock::now(), allowed / 2) {
            send(NotifyState::Watchdog);
        }
    }
}

/// Whether the node is alive at `now`: it waits, or its work made progress recently.
fn goes_on(worked: Option<Instant>, now: Instant, allowed: Duration) -> bool {
    worked.is_none_or(|worked| now.saturating_duration_since(worked) < allowed)
}

/// Errors are ignored, because a service manager that is gone needs no report.
fn send(state: NotifyState<'_>) {
    drop(sd_notify::notify(&[state]));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_waiting_node_is_alive_and_a_stalled_one_is_not() {
        let (now, allowed) = (
            clock::now() + Duration::from_mins(1),
            Duration::from_secs(15),
        );
        let worked = |ago_s| now.checked_sub(Duration::from_secs(ago_s));
        assert!(goes_on(None, now, allowed));
        assert!(goes_on(worked(14), now, allowed));
        assert!(!goes_on(worked(15), now, allowed));
    }
}
