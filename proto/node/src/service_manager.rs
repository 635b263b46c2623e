//! What a node tells systemd: that it has started, what it does now, and that its work goes on. Without `NOTIFY_SOCKET` it tells
//! nothing. Other service managers speak the same protocol.

use std::convert::Infallible;
use std::future::pending;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use farfield_proto::plain_text;
use sd_notify::NotifyState;
use tokio::time::{MissedTickBehavior, interval};

use crate::clock;

/// When the work went on last; `None`: the node waits for others, and no work is due. A process has one service manager.
static WORKED: Mutex<Option<Instant>> = Mutex::new(None);

/// Sends so many signs of life in the time (`WatchdogSec`) that is allowed between two.
const SIGNS_OF_LIFE: u32 = 4;

/// Notes that the work goes on. When it was not noted for half of `WatchdogSec`, the node gives no more signs of life.
pub fn note_work() {
    *worked() = Some(clock::now());
}

/// Notes that the work is over: what is left to do may take its time.
pub fn end_work() {
    *worked() = None;
}

fn worked() -> MutexGuard<'static, Option<Instant>> {
    WORKED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Says in a line what the node does: `systemctl status` shows it.
pub fn tell(line: &str) {
    send(NotifyState::Status(&plain_text::one_line(line)));
}

/// Says that the node has started and, as long as it is polled, that it lives.
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

/// Whether the node lives at `now`: it waits, or its work went on a short while ago.
fn goes_on(worked: Option<Instant>, now: Instant, allowed: Duration) -> bool {
    worked.is_none_or(|worked| now.saturating_duration_since(worked) < allowed)
}

/// A service manager that has gone needs to know nothing.
fn send(state: NotifyState<'_>) {
    drop(sd_notify::notify(&[state]));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_waits_lives_and_whose_work_stands_still_does_not() {
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
