//! Reports to the operator what an edge waits for.

use std::convert::Infallible;
use std::time::Duration;

use farfield_node::process::say;
use farfield_node::service_manager;
use tokio::time::{MissedTickBehavior, interval};

/// Time until the first report that the edge waits for fusion.
const SILENCE: Duration = Duration::from_millis(500);
/// Interval of further reports.
const REMIND_EVERY: Duration = Duration::from_secs(10);

/// Prints the result of `waiting` at intervals, if there is one.
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
