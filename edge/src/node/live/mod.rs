//! An edge that runs live: nobody waits for anybody.
//!
//! A thread per camera puts frames into the [`frames`] store as they come (recordings as their ticks come), a thread
//! runs the pipeline on the frames of a tick and the newest boxes, and the loop here hears what fusion
//! says and tells once a second how the edge is. What they share is locked for microseconds.

mod camera;
mod frames;
mod ledger;
mod mouths;
mod shared;
mod ticker;
mod work;

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_proto::live::LiveStatus;
use farfield_proto::message::{Order, Status};
use farfield_proto::wire;
use tokio::sync::oneshot;
use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use super::compare::compare_files;
use super::link::{Ends, Heard};
use super::process::{Ending, NodeError, say};
use crate::live::newest_boxes::Arrival;
use crate::live::rate::Message;

use self::shared::Shared;

pub(super) use self::mouths::Mouths;
pub(super) use self::work::LiveWork;

/// How often an edge says how it is.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// An edge at work, live.
pub(super) struct Live {
    /// What the edge says of itself.
    pub(super) status: Status,
    shared: Arc<Shared>,
    /// Why fusion refuses the viewpoint, as it was said last.
    refused: Option<String>,
    failed: oneshot::Receiver<anyhow::Error>,
}

impl Live {
    /// Starts cameras and pipeline.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn spawn(work: LiveWork, status: Status, mouths: Mouths) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::new(&work, mouths));
        let (failed_tx, failed) = oneshot::channel();
        work.spawn(&shared, failed_tx)?;
        Ok(Self {
            status,
            shared,
            refused: None,
            failed,
        })
    }

    /// Whether the link's budget lets so many bytes pass beside the patches now.
    pub(super) fn admission(&self) -> impl Fn(usize) -> bool + Send + use<> {
        let shared = Arc::clone(&self.shared);
        move |bytes| shared.admits(bytes)
    }

    /// Takes a message; says how the run has ended, if it has.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub(super) fn hear(&mut self, heard: Heard) -> Result<Option<Ending>, NodeError> {
        match heard {
            Heard::Boxes(boxes) if boxes.order == Order::End => return Ok(Some(Ending::Done)),
            Heard::Boxes(boxes) if boxes.live.is_none() => {
                return Err(NodeError::Failed(anyhow!(
                    "fusion runs in lock-step now: start the edge again"
                )));
            }
            Heard::Boxes(boxes) if Some(boxes.viewpoint) != self.status.viewpoint => {
                self.status.unreadable += 1;
            }
            Heard::Boxes(boxes) => {
                if self.shared.hear(boxes) == Arrival::NewSession {
                    // Fusion uses nothing of an edge before it knows what files it holds.
                    self.say();
                }
            }
            Heard::Fusion(fusion) => self.compare(&fusion)?,
            // It comes back, and finds the cameras open.
            Heard::FusionGone => {}
            Heard::Unreadable(_) => self.status.unreadable += 1,
        }
        Ok(None)
    }

    /// Works until fusion says that the run is over, or somebody stops the edge.
    ///
    /// # Errors
    /// When a file differs from fusion's, another node speaks for the viewpoint, fusion runs in lock-step all
    /// of a sudden, or the pipeline fails.
    pub(super) async fn run(
        &mut self,
        ends: &mut Ends,
        stop: &CancellationToken,
    ) -> Result<Ending, NodeError> {
        let mut statuses = interval(STATUS_EVERY);
        statuses.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = stop.cancelled() => return Ok(Ending::Interrupted),
                heard = ends.heard.recv() => {
                    let heard = heard.context("the subscriptions have ended").map_err(NodeError::Failed)?;
                    if let Some(ending) = self.hear(heard)? {
                        return Ok(ending);
                    }
                }
                failed = &mut self.failed => {
                    let error = failed.unwrap_or_else(|_| anyhow!("the pipeline has ended"));
                    return Err(NodeError::Failed(error));
                }
                _ = statuses.tick() => {
                    self.shared.clock.discipline();
                    self.say();
                }
            }
        }
    }

    /// Ends cameras and pipeline, and says so: why, if the edge gives up.
    pub(super) fn leave(&mut self, error: Option<&NodeError>) {
        self.shared.stop();
        self.refused = None;
        self.status.failure = error.map(|error| wire::cut_text(error.to_string()));
        self.say();
    }

    /// Sends the status now.
    fn say(&mut self) {
        let now_us = self.shared.clock.now_us();
        self.status.ready = !self.shared.is_stopped() && self.refused.is_none();
        self.status.stages = self.shared.stages();
        self.status.live = Some(LiveStatus {
            cameras: self.shared.frames.status(now_us),
            recording_failure: self.shared.ring_failure().map(wire::cut_text),
            ..self.shared.describe(now_us)
        });
        self.status.tick = self.shared.last_tick();
        self.shared
            .send(Message::Status, wire::encode(&self.status));
    }

    fn compare(&mut self, fusion: &Status) -> Result<(), NodeError> {
        compare_files(&self.status, fusion)?;
        let mut edges = fusion.live.iter().flat_map(|live| &live.edges);
        let link = edges.find(|edge| edge.viewpoint == self.status.node);
        if link.is_some_and(|link| link.refuses_process(self.status.process)) {
            return Err(NodeError::Failed(anyhow!(
                "another node speaks for viewpoint {}: end one of the two",
                self.status.node
            )));
        }
        // What is said while the edge takes part is of another of its name.
        let refused = link.filter(|link| !link.live);
        let refused = refused.and_then(|link| link.refused.clone());
        // Numbers in the reason change all the time.
        if refused.is_some() != self.refused.is_some() {
            let name = &self.status.node;
            match &refused {
                Some(why) => say(format_args!("{name}: refused by fusion: {why}")),
                None => say(format_args!("{name}: taken again by fusion")),
            }
        }
        let failure = refused
            .as_ref()
            .map(|why| format!("refused by fusion: {why}"));
        self.status.failure = failure.map(wire::cut_text);
        self.refused = refused;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
