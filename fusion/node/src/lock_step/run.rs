//! The loop of a lock-step run: gather a tick, step the core, send the boxes of the next.
//!
//! It never waits for the network: its messages go into a bounded queue, and in lock-step only one tick is in progress.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::time::Duration;

use anyhow::{Context as _, anyhow, ensure};
use farfield_fusion::align::Gather;
use farfield_node::process::Ending;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::{BoxSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until, timeout};
use tokio_util::sync::CancellationToken;
use tracing::debug;

use super::readiness::Start;
use crate::output::progress::Reporter;
use crate::output::tally::Tally;
use crate::session::interceptor::Interceptor;
use crate::session::link::FusionEnds;
use crate::session::messages::{FusionIncoming, FusionOutgoing, Liveliness};
use crate::session::outbox::Outbox;
use crate::status::check;
use crate::worker::{FusionWorker, Job, Stepped};

/// Time for the reason of a departure to arrive after a node has left.
const LAST_WORD: Duration = Duration::from_millis(500);

/// The surroundings of a run: incoming messages, progress reports and the stop signal.
pub(crate) struct Outside<'a> {
    pub(crate) ends: &'a mut FusionEnds,
    pub(crate) reporter: &'a mut Reporter,
    pub(crate) stop: &'a CancellationToken,
}

/// A run in progress.
pub(crate) struct LockStepFusion<'a> {
    venue: &'a Venue,
    ticks: Range<Tick>,
    gather: Gather,
    pub(crate) outbox: Outbox<'a>,
    /// The last finished tick.
    pub(crate) last: Option<Tick>,
    /// The viewpoints that have left.
    pub(crate) gone: BTreeSet<String>,
    /// The process of each edge that was ready, by name.
    processes: BTreeMap<String, u64>,
    deadline: Option<Instant>,
}

impl<'a> LockStepFusion<'a> {
    /// A run over the ticks of `start`, which must not be empty.
    pub(crate) fn new(
        venue: &'a Venue,
        session: SessionId,
        start: &Start,
        interceptor: &'a Interceptor,
        outgoing: mpsc::Sender<FusionOutgoing>,
    ) -> Self {
        let ticks = start.ticks.clone();
        let process = |edge: &Status| (edge.node.clone(), edge.process);
        let gather = Gather::new(session, ticks.start, venue.viewpoints.len());
        Self {
            venue,
            outbox: Outbox::new(
                interceptor,
                session,
                ticks.start,
                outgoing,
                Tally::new(venue),
            ),
            ticks,
            gather,
            last: None,
            gone: BTreeSet::new(),
            processes: start.edges.iter().map(process).collect(),
            deadline: None,
        }
    }

    /// Runs from the first boxes to the last tick.
    ///
    /// # Errors
    /// A node leaves, fails, is silent for too long, or sends an unreadable message. The error has its name and the tick.
    pub(crate) async fn run(
        &mut self,
        first: &[BoxSet],
        worker: &mut FusionWorker,
        outside: &mut Outside<'_>,
    ) -> anyhow::Result<Ending> {
        let Outside {
            ends,
            reporter,
            stop,
        } = outside;
        self.send_boxes(first);
        self.check_sent()?;
        loop {
            let deadline = self.deadline;
            tokio::select! {
                () = stop.cancelled() => return Ok(Ending::Interrupted),
                incoming = ends.incoming.recv() => {
                    let incoming = incoming.context("the subscriptions have ended")?;
                    if let Some(failure) = self.receive(incoming)? {
                        return Err(self.with_last_word(failure, ends).await);
                    }
                    if self.deadline.is_some() && self.gather.is_complete() {
                        self.deadline = None;
                        let job = Job {
                            group: self.gather.take(),
                            ..Job::default()
                        };
                        self.outbox.decided(&job);
                        worker.step(job)?;
                    }
                }
                stepped = worker.done.recv() => {
                    let stepped = stepped.context("the core has ended")?;
                    if self.stepped(stepped, reporter)? {
                        return Ok(Ending::Done);
                    }
                }
                () = sleep_until(deadline.unwrap_or_else(Instant::now)), if deadline.is_some() => return Err(self.too_late()),
            }
        }
    }

    /// Sends the end order to every edge.
    pub(crate) fn send_end(&mut self) {
        let tick = self.last.map_or(self.ticks.start, |last| last + 1);
        for viewpoint in 0..self.venue.viewpoints.len() {
            let order = (self.outbox).end_order(ViewpointIndex(viewpoint as u16), tick);
            self.outbox.end(&order);
        }
    }

    /// Processes a message; returns the node if one has left.
    fn receive(&mut self, incoming: FusionIncoming) -> anyhow::Result<Option<String>> {
        let taken = match incoming {
            FusionIncoming::Patches(set, arrival) => {
                self.outbox
                    .tally
                    .patches(set.viewpoint, set.persons.len(), arrival.bytes);
                self.gather.add_patches(set)
            }
            FusionIncoming::Sightings(set, arrival) => {
                self.outbox.tally.sightings(set.viewpoint, arrival.bytes);
                self.gather.add_sightings(set)
            }
            FusionIncoming::Status(status) => {
                self.check_name(&status)?;
                return check(&status).map(|()| None);
            }
            FusionIncoming::Alive(node, Liveliness::Gone)
                if self.venue.viewpoint_named(&node).is_some() =>
            {
                self.gone.insert(node.clone());
                return Ok(Some(node));
            }
            FusionIncoming::Alive(..) => return Ok(None),
            // Without this message the tick would never be complete.
            FusionIncoming::Unreadable(key, error) => {
                return Err(anyhow!(
                    "a message on {key} cannot be read, at tick {}: {error}",
                    self.gather.tick()
                ));
            }
        };
        if let Err(reason) = taken {
            debug!(%reason, "message refused");
            self.outbox.tally.refused += 1;
        }
        Ok(None)
    }

    /// Refuses a second process with the name of a running edge: its patches could not be distinguished.
    fn check_name(&self, status: &Status) -> anyhow::Result<()> {
        let is_another = |&process: &u64| process != status.process;
        ensure!(
            !self.processes.get(&status.node).is_some_and(is_another),
            "two nodes have the name {}",
            status.node
        );
        Ok(())
    }

    /// Publishes a tick's poses and the next boxes; true after the last tick.
    fn stepped(&mut self, mut stepped: Stepped, reporter: &mut Reporter) -> anyhow::Result<bool> {
        let tick = stepped.poses.tick;
        self.last = Some(tick);
        self.outbox.results(&mut stepped);
        let is_over = tick + 1 >= self.ticks.end;
        if !is_over {
            self.send_boxes(&stepped.boxes);
        }
        self.check_sent()?;
        reporter.tick(&stepped.poses, self.outbox.tally.bytes());
        Ok(is_over)
    }

    fn send_boxes(&mut self, sets: &[BoxSet]) {
        for set in sets {
            self.outbox.boxes(set);
        }
        let timeout_s = self.venue.parameters.link.lockstep_timeout_s;
        self.deadline = Some(Instant::now() + Duration::from_secs_f64(timeout_s));
    }

    /// Refuses a lost message: without boxes a tick would never be complete, and no result may be missing.
    fn check_sent(&self) -> anyhow::Result<()> {
        ensure!(
            self.outbox.unsent == 0,
            "the network accepts no more messages"
        );
        Ok(())
    }

    fn too_late(&self) -> anyhow::Error {
        let missing = self.gather.missing();
        let names: Vec<&str> = missing
            .iter()
            .filter_map(|v| self.venue.viewpoints.get(usize::from(v.0)))
            .map(|v| v.name.as_str())
            .collect();
        anyhow!(
            "no message for tick {} from viewpoint {} within {} s (`lockstep_timeout_s`)",
            self.gather.tick(),
            names.join(", "),
            self.venue.parameters.link.lockstep_timeout_s
        )
    }

    /// Waits a moment for the reason why `node` has left.
    async fn with_last_word(&self, node: String, ends: &mut FusionEnds) -> anyhow::Error {
        let last_word = async {
            while let Some(incoming) = ends.incoming.recv().await {
                if let FusionIncoming::Status(status) = incoming
                    && status.node == node
                    && let Err(error) = check(&status)
                {
                    return error;
                }
            }
            anyhow!("the subscriptions have ended")
        };
        let reason = timeout(LAST_WORD, last_word).await;
        reason
            .unwrap_or_else(|_| anyhow!("viewpoint {node} has left at tick {}", self.gather.tick()))
    }
}
