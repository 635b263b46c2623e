//! The start of a lock-step run: fusion waits until every edge is there, ready and listening.

use std::ops::Range;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::process::{Managed, NodeError};
use farfield_proto::message::Status;
use farfield_proto::tick::Tick;
use farfield_proto::venue::VenueHash;
use farfield_proto::wire;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};
use tracing::debug;

use super::config::Config;
use super::given::check_given_ticks;
use super::link::{Heard, NODE, Presence, Said};
use super::lockstep::{Outside, check};
use super::roll_call::RollCall;

/// How often fusion says that it waits, and looks whether its boxes have listeners.
const CALL_EVERY: Duration = Duration::from_millis(100);
/// Calls between two reminders, for a person who watches, of who is missing.
const REMIND_EVERY: u32 = 100;

/// What is known when a run begins.
#[derive(Debug)]
pub(super) struct Start {
    /// The ticks of the run.
    pub(super) ticks: Range<Tick>,
    /// The word of every edge, by name.
    pub(super) edges: Vec<Status>,
}

/// Fusion's own status over files with these fingerprints.
pub(super) fn own_status(hashes: &VenueHash) -> Status {
    Status {
        node: NODE.to_owned(),
        process: 0,
        viewpoint: None,
        ready: true,
        venue_hash: hashes.venue.clone(),
        calibration_hash: hashes.calibration.clone(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: None,
        tick: None,
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: None,
    }
}

/// Fusion's last status: why it gives up, as much of it as a status may say.
pub(super) fn failed_status(hashes: &VenueHash, error: &NodeError) -> Status {
    Status {
        ready: false,
        failure: Some(wire::cut_text(error.to_string())),
        ..own_status(hashes)
    }
}

/// Waits for all edges; `None` when told to stop before.
///
/// By hand the wait has no end, as the other hosts may not even be switched on; under a parent it is as
/// long as any other wait of lock-step.
///
/// # Errors
/// When an edge holds other files, fails, or (under a parent) does not come, or a person is given by
/// hand at a tick that the run does not have.
pub(super) async fn roll_call(
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
        Heard::Status(status) if status.node == NODE => Ok(()),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_failure_is_cut_and_still_read_by_the_edges() {
        let hashes = VenueHash {
            venue: "v".to_owned(),
            calibration: "c".to_owned(),
        };
        let error = NodeError::failed(anyhow!("tick 7: {}", "\u{2026}".repeat(5000)));
        let status = failed_status(&hashes, &error);
        let heard: Status = wire::decode(&wire::encode(&status)).unwrap();
        assert!(heard.failure.unwrap().starts_with("tick 7: \u{2026}"));
        assert!(!heard.ready);
    }
}
