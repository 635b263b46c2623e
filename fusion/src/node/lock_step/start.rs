//! The start of a lock-step run: fusion waits until every edge is there, ready and listening.

use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::process::{Managed, NodeError};
use farfield_proto::transport::FUSION;
use farfield_proto::wire;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};
use tracing::debug;

use super::readiness::{RollCall, Start};
use super::run::Outside;
use crate::node::config::Config;
use crate::node::given::check_given_ticks;
use crate::node::session::link::{Heard, Presence, Said};
use crate::node::status::{check, own_status};

/// How often fusion says that it waits, and looks whether its boxes have listeners.
const CALL_EVERY: Duration = Duration::from_millis(100);
/// Calls between two reminders, for a person who watches, of who is missing.
const REMIND_EVERY: u32 = 100;

/// Waits for all edges; `None` when told to stop before.
///
/// By hand the wait has no end, as the other hosts may not even be switched on; under a parent it is as
/// long as any other wait of lock-step.
///
/// # Errors
/// When an edge holds other files, fails, or (under a parent) does not come, or a person is given by
/// hand at a tick that the run does not have.
pub(in crate::node) async fn roll_call(
    config: &Config,
    outside: &mut Outside<'_>,
) -> Result<Option<Start>, NodeError> {
    let Outside {
        ends,
        reporter,
        stop,
    } = outside;
    let mut roll = RollCall::new(&config.venue, config.ticks.clone());
    roll.expect_models(config.handout.models());
    let patience = Duration::from_secs_f64(config.venue.parameters.link.lockstep_timeout_s);
    let deadline = Instant::now() + patience;
    let mut calls = interval(CALL_EVERY);
    calls.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let status = wire::encode(&own_status(&config.venue.hashes));
    let mut n_calls = 0u32;
    loop {
        tokio::select! {
            () = stop.cancelled() => return Ok(None),
            heard = ends.heard.recv() => {
                hear(&mut roll, heard.context("the subscriptions have ended").map_err(NodeError::failed)?)?;
            }
            _ = calls.tick() => {
                n_calls = n_calls.wrapping_add(1);
                if n_calls % REMIND_EVERY == REMIND_EVERY / 4 {
                    reporter.waiting(&roll.missing());
                }
                // A full queue already holds a status.
                drop(ends.say.try_send(Said::Status(status.clone())));
            }
            () = sleep_until(deadline), if config.managed == Managed::Yes => {
                let missing = roll.missing().join(", ");
                return Err(NodeError::failed(anyhow!("viewpoint {missing} was not ready within {} s", patience.as_secs_f64())));
            }
        }
        let ticks = roll.ticks().map_err(NodeError::refused)?;
        if let (Some(ticks), true) = (ticks, *ends.matched.borrow()) {
            check_given_ticks(&config.venue, &config.venue_path, &ticks)
                .map_err(NodeError::refused)?;
            return Ok(Some(Start {
                ticks,
                edges: roll.ready().cloned().collect(),
            }));
        }
    }
}

fn hear(roll: &mut RollCall, heard: Heard) -> Result<(), NodeError> {
    match heard {
        // Fusion hears itself, too.
        Heard::Status(status) if status.node == FUSION => Ok(()),
        Heard::Status(status) => {
            // Whose files differ is refused, whatever else it says: it refuses us, too.
            roll.hear(&status).map_err(NodeError::refused)?;
            check(&status).map_err(NodeError::failed)
        }
        Heard::Alive(node, Presence::Gone) => {
            roll.forget(&node);
            Ok(())
        }
        Heard::Alive(_, Presence::There) => Ok(()),
        Heard::Patches(..) | Heard::Sightings(..) => {
            debug!("a message from before the start");
            Ok(())
        }
        Heard::Unreadable(key) => Err(NodeError::failed(anyhow!(
            "a message on {key} cannot be read: is another version of farfield running there?"
        ))),
    }
}
