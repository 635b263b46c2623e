//! The start of a lock-step run: fusion waits until every edge is present, ready and subscribed.

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::process::{Managed, NodeError};
use farfield_proto::id::SessionId;
use farfield_proto::transport::FUSION;
use farfield_proto::wire::{VERSION, WireError};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};
use tracing::debug;

use super::readiness::{Readiness, Start};
use super::run::Outside;
use crate::config::FusionConfig;
use crate::session::messages::{FusionIncoming, FusionOutgoing, Liveliness};
use crate::status::{check, own_status};
use crate::venue_checks::check_given_ticks;

/// Interval of fusion's statuses, and of checking that its boxes have subscribers.
const CALL_EVERY: Duration = Duration::from_millis(100);
/// Statuses between two reminders to the operator about missing edges.
const REMIND_EVERY: u32 = 100;
/// Messages of a newer version after which a node cannot speak our version. It has received our status by then: it sends ten
/// messages a second.
const MAX_NEWER: u32 = 20;

/// Waits for all edges; `None` if stopped before.
///
/// A node started by hand waits forever, because the other hosts may still be off. Under a parent the wait is limited as all
/// others in lock-step.
///
/// # Errors
/// An edge has other files, fails, or (under a parent) does not come, or a `[[person]]` is at a tick outside the run.
pub(crate) async fn wait_until_ready(
    config: &FusionConfig,
    session: SessionId,
    outside: &mut Outside<'_>,
) -> Result<Option<Start>, NodeError> {
    let Outside {
        ends,
        reporter,
        stop,
    } = outside;
    let mut readiness = Readiness::new(&config.venue, config.ticks.clone());
    readiness.expect_models(config.handout.models());
    let patience = Duration::from_secs_f64(config.venue.parameters.link.lockstep_timeout_s);
    let deadline = Instant::now() + patience;
    let mut calls = interval(CALL_EVERY);
    calls.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut status = Box::new(own_status(&config.venue.hashes));
    status.health.follows = Some(session);
    let validity = config.reach.validity;
    status.health.certificate_ends_s = validity.map(|v| v.until_s.cast_unsigned());
    let mut n_calls = 0u32;
    let mut newer = BTreeMap::new();
    loop {
        tokio::select! {
            () = stop.cancelled() => return Ok(None),
            incoming = ends.incoming.recv() => {
                let incoming = incoming.context("the subscriptions have ended").map_err(NodeError::failed)?;
                receive(&mut readiness, &mut newer, incoming)?;
            }
            _ = calls.tick() => {
                n_calls = n_calls.wrapping_add(1);
                if n_calls % REMIND_EVERY == REMIND_EVERY / 4 {
                    reporter.waiting(&readiness.missing());
                }
                // A full queue already holds a status.
                drop(ends.outgoing.try_send(FusionOutgoing::Status(status.clone())));
            }
            () = sleep_until(deadline), if config.managed == Managed::Yes => {
                let missing = readiness.missing().join(", ");
                return Err(NodeError::failed(anyhow!("viewpoint {missing} was not ready within {} s", patience.as_secs_f64())));
            }
        }
        let ticks = readiness.ticks().map_err(NodeError::refused)?;
        if let (Some(ticks), true) = (ticks, *ends.matched.borrow()) {
            check_given_ticks(&config.venue, &config.venue_path, &ticks)
                .map_err(NodeError::refused)?;
            return Ok(Some(Start {
                ticks,
                edges: readiness.ready().cloned().collect(),
            }));
        }
    }
}

/// Processes a message; `newer` counts the messages of newer versions, by key.
fn receive(
    readiness: &mut Readiness,
    newer: &mut BTreeMap<String, u32>,
    incoming: FusionIncoming,
) -> Result<(), NodeError> {
    match incoming {
        // Fusion also receives its own status.
        FusionIncoming::Status(status) if status.node == FUSION => Ok(()),
        FusionIncoming::Status(status) => {
            // Different files are reported before a failure, which may be the edge's refusal of our files.
            readiness.receive(&status).map_err(NodeError::refused)?;
            check(&status).map_err(NodeError::failed)
        }
        FusionIncoming::Alive(node, Liveliness::Gone) => {
            readiness.forget(&node);
            Ok(())
        }
        FusionIncoming::Alive(_, Liveliness::There) => Ok(()),
        FusionIncoming::Patches(..) | FusionIncoming::Sightings(..) => {
            debug!("a message before the start");
            Ok(())
        }
        FusionIncoming::Unreadable(key, error) => {
            if let WireError::Version { got: VERSION.. } = error {
                let messages = newer.entry(key.clone()).or_insert(0);
                *messages += 1;
                if *messages <= MAX_NEWER {
                    debug!(%key, %error, "not readable");
                    return Ok(());
                }
            }
            Err(NodeError::failed(anyhow!(
                "a message on {key} cannot be read: {error}"
            )))
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::wire::OLDEST_READ;

    use super::*;
    use crate::lock_step::readiness::tests::readiness;

    #[test]
    fn a_newer_node_gets_time_to_find_our_version() {
        let mut readiness = readiness(None);
        let mut newer = BTreeMap::new();
        let key = || "link-test/status/a".to_owned();
        let mut receive_version = |got| {
            let incoming = FusionIncoming::Unreadable(key(), WireError::Version { got });
            receive(&mut readiness, &mut newer, incoming)
        };
        for _ in 0..MAX_NEWER {
            receive_version(VERSION + 1).unwrap();
        }
        let error = receive_version(VERSION + 1).unwrap_err().to_string();
        let version = format!("version {}", VERSION + 1);
        assert!(
            error.contains("status/a") && error.contains(&version),
            "{error}"
        );
        receive_version(OLDEST_READ - 1).unwrap_err();
    }
}
