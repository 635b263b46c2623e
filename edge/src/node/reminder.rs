//! Tells a person who watches what an edge waits for.

use std::convert::Infallible;
use std::time::Duration;

use farfield_node::process::say;
use farfield_node::service_manager;
use tokio::time::{MissedTickBehavior, interval};

/// How long fusion may take to answer before a person is told that the edge waits for it.
const SILENCE: Duration = Duration::from_millis(500);
/// How often a person is told so again.
const REMIND_EVERY: Duration = Duration::from_secs(10);

/// Tells a person now and then what the edge waits for: what `waiting` says, if it says anything.
pub(super) async fn remind(waiting: impl Fn() -> Option<String>) -> Infallible {
    tokio::time::sleep(SILENCE).await;
    let mut reminders = interval(REMIND_EVERY);
    reminders.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        reminders.tick().await;
        if let Some(line) = waiting() {
            service_manager::tell(&line);
            say(format_args!("{line}"));
        }
    }
}
