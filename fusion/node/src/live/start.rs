//! The start of the venue's ticks.
//!
//! Ticks of cameras follow the clock: tick 0 was in 1970, and a restarted fusion changes nothing. Recordings are played from a
//! tick that fusion chooses when the edges are ready. If an edge already plays, an earlier fusion chose the tick, and it is kept.

use std::collections::BTreeSet;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::live::membership::Membership;
use farfield_fusion::live::tick_time::TickTime;
use farfield_fusion::live::{Micros, SECOND_US};
use farfield_proto::id::SessionId;
use farfield_proto::message::Status;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::live::LiveStatus;
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};

use super::super::config::FusionConfig;
use super::super::status::own_status;
use super::super::venue_checks::is_recorded;
use super::LiveContext;
use crate::session::messages::{FusionIncoming, FusionOutgoing, Liveliness};

/// Interval of fusion's statuses before the ticks begin.
const CALL_EVERY: Duration = Duration::from_millis(100);
/// Time to wait for further edges that play recordings, after one is ready.
const PATIENCE: Duration = Duration::from_secs(20);
/// Time from choosing the first tick to its start.
const RUN_UP_US: Micros = SECOND_US;
/// If ticks are already running, the first is this far ahead: the edges must know in time that they detect people then.
const FIRST_WORD_US: Micros = SECOND_US / 4;
/// Statuses between two reminders about missing edges.
const REMIND_EVERY: u32 = 100;

/// The state at the start of the ticks.
#[derive(Debug)]
pub(super) struct LiveStart {
    pub(super) time: TickTime,
    pub(super) first: Tick,
    pub(super) members: Membership,
    /// The present edges of the venue, by their tokens.
    pub(super) present: BTreeSet<String>,
}

/// Determines the time of the ticks and the first tick; `None` if stopped before.
///
/// # Errors
/// The subscriptions have ended.
pub(super) async fn clock_start(
    context: &mut LiveContext<'_>,
) -> anyhow::Result<Option<LiveStart>> {
    let LiveContext {
        config,
        interceptor,
        ends,
        reporter,
        session,
        stop,
        ..
    } = context;
    let venue = &config.venue;
    let mut members = Membership::new(venue);
    members.expect_models(config.handout.models());
    let mut present = BTreeSet::new();
    if !is_recorded(venue) {
        let time = TickTime::new(0, venue.rate_hz);
        let now = time.first_from(interceptor.clock.now_us() + FIRST_WORD_US);
        let requested = config.ticks.as_ref().map(|ticks| ticks.start);
        return Ok(Some(LiveStart {
            time,
            first: requested.map_or(now, |first| first.max(now)),
            members,
            present,
        }));
    }
    let status = waiting_status(&own_status(&venue.hashes), *session);
    let status = Box::new(status);
    let mut calls = interval(CALL_EVERY);
    calls.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut n_calls, mut leave_out_at) = (0u32, None);
    loop {
        let until: Option<Instant> = leave_out_at;
        let mut is_enough = false;
        tokio::select! {
            () = stop.cancelled() => return Ok(None),
            incoming = ends.incoming.recv() => {
                match incoming.context("the subscriptions have ended")? {
                    FusionIncoming::Status(status) if status.node != FUSION => {
                        members.update(&status, interceptor.clock.now_us());
                        if status.ready && leave_out_at.is_none() {
                            leave_out_at = Some(Instant::now() + PATIENCE);
                        }
                    }
                    FusionIncoming::Alive(node, Liveliness::There) => note_present(venue, &mut present, node),
                    FusionIncoming::Alive(node, Liveliness::Gone) => drop(present.remove(&node)),
                    _ => {}
                }
            }
            _ = calls.tick() => {
                n_calls = n_calls.wrapping_add(1);
                if n_calls % REMIND_EVERY == REMIND_EVERY / 4 {
                    reporter.waiting(&members.missing());
                }
                drop(ends.outgoing.try_send(FusionOutgoing::Status(status.clone())));
            }
            () = sleep_until(until.unwrap_or_else(Instant::now)), if until.is_some() => is_enough = true,
        }
        let now_us = interceptor.clock.now_us();
        let begins = settled_start(config, &members, now_us, is_enough);
        if let Some((time, first)) = begins {
            return Ok(Some(LiveStart {
                time,
                first,
                members,
                present,
            }));
        }
    }
}

/// The time of the ticks and the first tick, once the edges' statuses determine both. `is_enough`: do not wait for edges that
/// are not ready.
fn settled_start(
    config: &FusionConfig,
    members: &Membership,
    now_us: Micros,
    is_enough: bool,
) -> Option<(TickTime, Tick)> {
    let rate_hz = config.venue.rate_hz;
    let tick_by = |epoch_us| TickTime::new(epoch_us, rate_hz).first_from(now_us + FIRST_WORD_US);
    if let Some(epoch_us) = members.epoch_us(tick_by, config.ticks.as_ref()) {
        return Some((TickTime::new(epoch_us, rate_hz), tick_by(epoch_us)));
    }
    if !(is_enough || members.missing().is_empty()) {
        return None;
    }
    let ticks = config.ticks.clone().or_else(|| members.recorded());
    let first = ticks?.start;
    let at_us = now_us + RUN_UP_US;
    Some((TickTime::with_tick_at(first, at_us, rate_hz), first))
}

/// Records a present edge. Foreign nodes are ignored: they may declare any number of tokens.
pub(super) fn note_present(venue: &Venue, present: &mut BTreeSet<String>, node: String) {
    if venue.viewpoint_named(&node).is_some() {
        present.insert(node);
    }
}

/// A status that tells edges that the run is live.
fn waiting_status(own: &Status, session: SessionId) -> Status {
    Status {
        live: Some(LiveStatus {
            every_nth_tick: 1,
            ..LiveStatus::default()
        }),
        health: NodeHealth {
            follows: Some(session),
            ..NodeHealth::default()
        },
        ..own.clone()
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::venue::VenueHash;

    use super::super::tests::venue;
    use farfield_proto::wire;

    use super::*;

    #[test]
    fn tokens_of_foreign_nodes_are_ignored() {
        let mut present = BTreeSet::new();
        for node in ["a", "fusion", "stranger-1", "stranger-2", "b", "a"] {
            note_present(&venue(), &mut present, node.to_owned());
        }
        assert_eq!(present, ["a", "b"].map(str::to_owned).into());
    }

    #[test]
    fn the_first_status_reports_a_live_run() {
        let hashes = VenueHash {
            venue: "v".to_owned(),
            calibration: "c".to_owned(),
        };
        let status = waiting_status(&own_status(&hashes), SessionId(7));
        let received: Status = wire::decode(&wire::encode(&status)).unwrap();
        assert_eq!(received.live.unwrap().epoch_us, None);
        assert_eq!(received.health.follows, Some(SessionId(7)));
    }
}
