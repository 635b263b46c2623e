//! The loop of an edge in lock-step: a box set arrives, the pipeline processes its tick, the
//! patches are sent.
//!
//! The loop only waits for events. The pipeline's thread reads frames, computes, and queues the
//! messages.

use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::process::{Ending, NodeError, say};
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::{BoxSet, Order, Status};
use farfield_proto::tick::Tick;
use farfield_proto::venue::same_files::{OtherFile, OwnFiles};
use farfield_proto::wire::{self, WireError};
use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;
use tracing::debug;

use super::link::{EdgeEnds, EdgeIncoming, EdgeOutgoing};
use super::worker::EdgeWorker;
use crate::box_parts::BoxParts;

/// Interval of status messages until the first boxes arrive.
const CALL_EVERY: Duration = Duration::from_millis(100);
/// Calls per status once the run has begun: one status per second.
const CALLS_PER_STATUS: u32 = 10;

/// Unanswered calls before the operator is informed that fusion is silent, and between two
/// reminders.
const SILENT_CALLS: u32 = 50;
const REMIND_EVERY: u32 = 100;

/// Consecutive unreadable messages before the run, after which fusion must have another version. It
/// sends ten per second then.
const MAX_GARBLED: u32 = 20;

/// How a lock-step run ends.
pub(super) enum LockStepEnding {
    /// The run ended.
    End(Ending),
    /// Fusion runs live, as this message shows.
    Live(EdgeIncoming),
}

/// Whether the message comes from a fusion in live mode.
fn is_live(incoming: &EdgeIncoming) -> bool {
    match incoming {
        EdgeIncoming::Boxes(boxes) => boxes.live.is_some(),
        EdgeIncoming::Fusion(status) => status.live.is_some(),
        EdgeIncoming::FusionGone | EdgeIncoming::Unreadable(..) => false,
    }
}

fn is_reminder_due(unheard: u32) -> bool {
    unheard >= SILENT_CALLS && (unheard - SILENT_CALLS).is_multiple_of(REMIND_EVERY)
}

/// Why a reached fusion may be silent. Zenoh does not answer a client that it rejects.
fn silence(node: &str, health: &NodeHealth) -> String {
    match health.certificate_ends_s {
        Some(_) => format!(
            "fusion was reached, but does not answer this node: it rejects this node's certificate, or has just stopped (fusion's log names the certificate; older keys are rejected once `farfield certs --renew {node}` has made new ones)"
        ),
        None => "a node was reached, but no fusion of this venue answers: it has just stopped, or its venue file has another `name`".to_owned(),
    }
}

/// A running edge in lock-step.
pub(super) struct LockStepEdge {
    /// The edge's status.
    pub(super) status: Status,
    /// The tick of the newest boxes given to the pipeline.
    ordered: Option<Tick>,
    /// An incomplete box set.
    coming: Option<(BoxSet, BoxParts)>,
    n_calls: u32,
    /// Calls since the last message of fusion.
    unheard: u32,
    /// Consecutive unreadable messages.
    garbled: u32,
}

impl LockStepEdge {
    /// An edge with the first status `status`.
    pub(super) fn new(status: Status) -> Self {
        Self {
            status,
            ordered: None,
            coming: None,
            n_calls: 0,
            unheard: 0,
            garbled: 0,
        }
    }

    /// Works until fusion ends the run or runs live.
    ///
    /// # Errors
    /// If a file differs from fusion's, fusion fails or disconnects, or the pipeline fails.
    pub(super) async fn run(
        &mut self,
        ends: &mut EdgeEnds,
        worker: &mut EdgeWorker,
        stop: &CancellationToken,
    ) -> Result<LockStepEnding, NodeError> {
        let mut calls = interval(CALL_EVERY);
        calls.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = stop.cancelled() => return Ok(LockStepEnding::End(Ending::Interrupted)),
                incoming = ends.incoming.recv() => {
                    let incoming = incoming.context("the subscriptions have ended").map_err(NodeError::Failed)?;
                    if let Some(turn) = self.receive(incoming, worker)? {
                        return Ok(turn);
                    }
                }
                done = worker.done.recv() => {
                    let done = done.context("the pipeline has ended").and_then(|done| done);
                    self.status.tick = Some(done.map_err(NodeError::Failed)?);
                }
                _ = calls.tick() => self.call(ends),
            }
        }
    }

    /// Records the end of the edge, and the error if it fails, cut to the length of a status.
    pub(super) fn leaves(&mut self, error: Option<&NodeError>) {
        self.status.ready = false;
        self.status.failure = error.map(|error| wire::cut_text(error.to_string()));
    }

    /// Sends the status.
    pub(super) fn send_status(&self, ends: &EdgeEnds) {
        if ends
            .outgoing
            .try_send(EdgeOutgoing::Status(wire::encode_as(
                &self.status,
                ends.spoken.get(),
            )))
            .is_err()
        {
            debug!("a status was not sent: the queue is full");
        }
    }

    fn call(&mut self, ends: &EdgeEnds) {
        self.status.ready = *ends.matched.borrow();
        if self.ordered.is_none() || self.n_calls.is_multiple_of(CALLS_PER_STATUS) {
            self.send_status(ends);
        }
        self.n_calls = self.n_calls.wrapping_add(1);
        self.unheard = self.unheard.saturating_add(1);
        if self.ordered.is_none() && is_reminder_due(self.unheard) {
            let name = &self.status.node;
            say(format_args!(
                "{name}: {}",
                silence(name, &self.status.health)
            ));
        }
    }

    fn receive(
        &mut self,
        incoming: EdgeIncoming,
        worker: &EdgeWorker,
    ) -> Result<Option<LockStepEnding>, NodeError> {
        if matches!(incoming, EdgeIncoming::Boxes(_) | EdgeIncoming::Fusion(_)) {
            (self.garbled, self.unheard) = (0, 0);
        }
        match incoming {
            incoming if self.ordered.is_none() && is_live(&incoming) => {
                Ok(Some(LockStepEnding::Live(incoming)))
            }
            EdgeIncoming::Boxes(boxes) => {
                let ending = self.process(boxes, worker).map_err(NodeError::Failed)?;
                Ok(ending.map(LockStepEnding::End))
            }
            EdgeIncoming::Fusion(fusion) => self.compare(&fusion).map(|()| None),
            // Before the first boxes nothing is lost: fusion may restart.
            EdgeIncoming::FusionGone if self.ordered.is_none() => Ok(None),
            EdgeIncoming::FusionGone => Err(NodeError::Failed(anyhow!(
                "fusion has left{}",
                self.at_tick()
            ))),
            EdgeIncoming::Unreadable(key, error) => self.cannot_read(&key, &error).map(|()| None),
        }
    }

    /// Before the run unreadable messages are tolerated. During a run a missing message is an
    /// error.
    fn cannot_read(&mut self, key: &str, error: &WireError) -> Result<(), NodeError> {
        self.status.unreadable += 1;
        self.garbled += 1;
        if self.ordered.is_none() && self.garbled < MAX_GARBLED {
            debug!(%key, "not readable");
            return Ok(());
        }
        Err(NodeError::Failed(anyhow!(
            "a message on {key} cannot be read: {error}"
        )))
    }

    fn process(&mut self, boxes: BoxSet, worker: &EdgeWorker) -> anyhow::Result<Option<Ending>> {
        if boxes.order == Order::End {
            return Ok(Some(Ending::Done));
        }
        let Some(boxes) = self.joined(boxes) else {
            return Ok(None);
        };
        if self.ordered.is_some_and(|ordered| boxes.tick <= ordered) {
            debug!(tick = boxes.tick.0, "boxes for a tick that is done");
            return Ok(None);
        }
        self.ordered = Some(boxes.tick);
        worker.step(boxes)?;
        Ok(None)
    }

    /// The complete set, once its last message is there. In lock-step no message is lost.
    fn joined(&mut self, mut message: BoxSet) -> Option<BoxSet> {
        let is_next = |(set, _): &&mut (BoxSet, BoxParts)| {
            (set.session, set.tick) == (message.session, message.tick)
        };
        if let Some((set, parts)) = self.coming.as_mut().filter(is_next) {
            parts.add(set, &message);
        } else {
            let parts = BoxParts::begin(&mut message, None);
            self.coming = Some((message, parts));
        }
        let is_whole = |(_, parts): &mut (BoxSet, BoxParts)| parts.is_whole();
        self.coming.take_if(is_whole).map(|(set, _)| set)
    }

    fn compare(&self, fusion: &Status) -> Result<(), NodeError> {
        compare_files(&self.status, fusion)?;
        match &fusion.failure {
            Some(failure) => Err(NodeError::Failed(anyhow!(
                "fusion has ended the run{}: {failure}",
                self.at_tick()
            ))),
            None => Ok(()),
        }
    }

    fn at_tick(&self) -> String {
        self.ordered
            .map_or_else(String::new, |tick| format!(" at tick {tick}"))
    }
}

/// Compares the fingerprints of this edge's files with fusion's.
///
/// # Errors
/// [`NodeError::Refused`] with the first difference.
pub(super) fn compare_files(own: &Status, fusion: &Status) -> Result<(), NodeError> {
    let Some(OtherFile { what, theirs, ours }) = OwnFiles::from(own).other_file(fusion) else {
        return Ok(());
    };
    Err(NodeError::Refused(anyhow!(
        "fusion holds another {what} than viewpoint {}: its fingerprint there is {theirs}, here {ours}; start this edge with --from-fusion to fetch it, or copy the same file to both",
        own.node
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(calibration_hash: &str) -> Status {
        Status {
            node: "ne".to_owned(),
            process: 7,
            viewpoint: None,
            release: String::new(),
            ready: true,
            venue_hash: "v".to_owned(),
            calibration_hash: calibration_hash.to_owned(),
            network_hash: String::new(),
            backend: String::new(),
            ticks: None,
            tick: None,
            unreadable: 0,
            failure: None,
            stages: Vec::new(),
            live: None,
            health: NodeHealth::default(),
            agreement: Vec::new(),
        }
    }

    #[test]
    fn another_calibration_than_fusions_is_refused_by_name() {
        let edge = LockStepEdge::new(status("here"));
        edge.compare(&status("here")).unwrap();
        let error = edge.compare(&status("there")).unwrap_err();
        assert!(matches!(error, NodeError::Refused(_)));
        let text = error.to_string();
        assert!(
            text.contains("calibration") && text.contains("viewpoint ne") && text.contains("there"),
            "{text}"
        );
    }

    #[test]
    fn unreadable_messages_before_the_run_are_tolerated_up_to_a_limit() {
        // Symptom to prevent: one message ended every edge, also live ones, which wait here for
        // fusion.
        let newer = WireError::Version { got: 99 };
        let mut edge = LockStepEdge::new(status("here"));
        for _ in 1..MAX_GARBLED {
            edge.cannot_read("hall/box/ne", &newer).unwrap();
        }
        assert_eq!(edge.status.unreadable, u64::from(MAX_GARBLED) - 1);
        let error = edge.cannot_read("hall/box/ne", &newer);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("version") && error.contains("hall/box/ne"));
        let mut edge = LockStepEdge::new(status("here"));
        edge.ordered = Some(Tick(7));
        edge.cannot_read("hall/box/ne", &newer).unwrap_err();
    }

    #[test]
    fn a_silent_fusion_is_reported_with_a_remedy() {
        let keys = NodeHealth {
            certificate_ends_s: Some(7),
            ..NodeHealth::default()
        };
        assert!(silence("ne", &keys).contains("--renew ne"));
        assert!(silence("ne", &NodeHealth::default()).contains("`name`"));
        let reminders: Vec<u32> = (0..300).filter(|&n| is_reminder_due(n)).collect();
        assert_eq!(reminders, [50, 150, 250]);
    }

    #[test]
    fn a_long_failure_is_cut_and_readable_by_fusion() {
        let mut edge = LockStepEdge::new(status("here"));
        let error = NodeError::Failed(anyhow!("tick 7: {}", "\u{2026}".repeat(5000)));
        edge.leaves(Some(&error));
        let received: Status = wire::decode(&wire::encode(&edge.status)).unwrap();
        assert!(received.failure.unwrap().starts_with("tick 7: \u{2026}"));
        edge.leaves(None);
        assert_eq!(edge.status.failure, None);
    }
}
