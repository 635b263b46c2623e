//! An edge in live mode: no part waits for another one.
//!
//! A thread per camera puts frames into the [`frames`] store as they arrive (recordings at their
//! ticks). Another thread runs the pipeline on the frames of a tick and the newest boxes. The loop
//! here receives fusion's messages and sends the edge's status once a second. If pictures may leave
//! the edge, one more thread makes thumbnails. Shared data are locked for microseconds.

mod camera;
mod detection;
mod frames;
mod fusion_presence;
mod ledger;
mod shared;
mod thumbnails;
mod ticker;
mod work_watch;

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::certificate::ending_notice;
use farfield_node::clock::{self, VenueClock};
use farfield_node::process::{Ending, NodeError, say};
use farfield_node::service_manager;
use farfield_proto::id::SessionId;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::live::{EdgeLink, LiveStatus};
use farfield_proto::message::{Order, Status};
use farfield_proto::wire::{self, SpokenVersion, WireError};
use tokio::sync::oneshot;
use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use self::camera::LiveCamera;
use self::fusion_presence::FusionPresence;
use self::shared::Shared;
use self::thumbnails::Thumbnails;
use self::ticker::Ticker;
use super::acceleration::Workers;
use super::link::{EdgeEnds, EdgeIncoming};
use super::lockstep::compare_files;
use super::ring::RingHandle;
use super::worker::{Parts, report_beyond_view};
use crate::live::failures::RepeatedRefusal;
use crate::live::newest_boxes::BoxSetArrival;
use crate::live::rate::MessageKind;

pub(super) use self::shared::EdgePublishers;

/// Interval of the edge's status.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// A running edge in live mode.
pub(super) struct LiveEdge {
    /// The edge's status.
    pub(super) status: Status,
    shared: Arc<Shared>,
    /// Why fusion refuses the viewpoint, as last reported.
    refused: Option<String>,
    /// Why the edge should end, from fusion's last message.
    objection: Option<NodeError>,
    refusal: RepeatedRefusal,
    /// The backend's text before the number of workers is known.
    backend: String,
    /// Problems since the start.
    notices: Vec<String>,
    /// Whether the computer is reported as too slow.
    is_overloaded: bool,
    /// The last followed session of fusion.
    followed: Option<SessionId>,
    /// Whether fusion is reported as present.
    presence: FusionPresence,
    /// Why fusion's messages are unreadable, as last reported.
    foreign: Option<WireError>,
    failed: oneshot::Receiver<anyhow::Error>,
}

impl LiveEdge {
    /// Starts cameras and pipeline. `status` is the first status, `clock` the venue's clock; `ring`
    /// stores the sets, if present.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub(super) fn spawn(
        parts: Parts,
        status: Status,
        clock: VenueClock,
        publishers: (EdgePublishers, Arc<SpokenVersion>),
        ring: Option<RingHandle>,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::new(&parts, clock, publishers, ring));
        let (failed_tx, failed) = oneshot::channel();
        spawn_threads(parts, &shared, failed_tx)?;
        Ok(Self {
            backend: status.backend.clone(),
            notices: status.health.notices.clone(),
            is_overloaded: false,
            status,
            shared,
            refused: None,
            objection: None,
            refusal: RepeatedRefusal::default(),
            followed: None,
            presence: FusionPresence::default(),
            foreign: None,
            failed,
        })
    }

    /// Whether the link's budget has room for this many bytes in addition to the patches.
    pub(super) fn admission(&self) -> impl Fn(usize) -> bool + Send + use<> {
        let shared = Arc::clone(&self.shared);
        move |bytes| shared.admits(bytes)
    }

    /// Processes a message; returns the end of the run, if it ended. Without keys, any program on
    /// the machine can send messages. A message that would end the edge therefore counts only from
    /// the followed session, or if it is repeated.
    ///
    /// # Errors
    /// See [`Self::run`].
    pub(super) fn receive(&mut self, incoming: EdgeIncoming) -> Result<Option<Ending>, NodeError> {
        match incoming {
            // A fusion in lock-step is also recognised by its status.
            EdgeIncoming::Boxes(boxes)
                if boxes.live.is_none() || Some(boxes.viewpoint) != self.status.viewpoint =>
            {
                self.status.unreadable += 1;
            }
            EdgeIncoming::Boxes(boxes)
                if boxes.order == Order::End && self.shared.session() == Some(boxes.session) =>
            {
                return Ok(Some(Ending::Done));
            }
            EdgeIncoming::Boxes(boxes) => match self.shared.take_boxes(boxes) {
                // Fusion uses no data of an edge before it knows the edge's files.
                BoxSetArrival::NewSession => {
                    self.report_return();
                    self.report_followed_session();
                    self.send_status();
                }
                BoxSetArrival::Foreign => self.status.unreadable += 1,
                BoxSetArrival::Newer => self.report_return(),
                BoxSetArrival::Part | BoxSetArrival::Stale => {}
            },
            EdgeIncoming::Fusion(fusion) => {
                self.process_status(&fusion);
                return self.give_up();
            }
            // It will return and find the cameras open.
            EdgeIncoming::FusionGone => self.report_absence(),
            EdgeIncoming::Unreadable(_, error) => self.cannot_read(&error),
        }
        Ok(None)
    }

    /// Reports the start and the end of overload.
    fn report_overload(&mut self) {
        let overload = self.shared.overload();
        if overload.is_some() == self.is_overloaded {
            return;
        }
        self.is_overloaded = overload.is_some();
        let message = overload.unwrap_or_else(|| "processes every tick again".to_owned());
        say(format_args!("{}: {message}", self.status.node));
    }

    /// Reports that fusion has gone, if new.
    fn report_absence(&mut self) {
        let silent_us = self.shared.silent_us();
        let now_us = self.shared.clock.now_us();
        if let Some(message) = self.presence.gone(silent_us, now_us) {
            say(format_args!("{}: {message}", self.status.node));
        }
    }

    /// Reports that fusion is back, if it was gone.
    fn report_return(&mut self) {
        if let Some(message) = self.presence.returned(self.shared.clock.now_us()) {
            say(format_args!("{}: {message}", self.status.node));
        }
    }

    /// Reports a change of the followed fusion or its session.
    fn report_followed_session(&mut self) {
        let session = self.shared.session();
        if let (Some(before), Some(now)) = (self.followed, session) {
            say(format_args!(
                "{}: follows another fusion now, session {:x} instead of {:x}: it was started again, or there are two",
                self.status.node, now.0, before.0
            ));
        }
        self.followed = session.or(self.followed);
    }

    /// Works until fusion ends the run, or the edge is stopped.
    ///
    /// # Errors
    /// If a file differs from fusion's, another node has the same viewpoint, fusion changed to
    /// lock-step, or the pipeline fails.
    pub(super) async fn run(
        &mut self,
        ends: &mut EdgeEnds,
        stop: &CancellationToken,
    ) -> Result<Ending, NodeError> {
        let mut statuses = interval(STATUS_EVERY);
        statuses.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = stop.cancelled() => return Ok(Ending::Interrupted),
                incoming = ends.incoming.recv() => {
                    let incoming = incoming.context("the subscriptions have ended").map_err(NodeError::Failed)?;
                    if let Some(ending) = self.receive(incoming)? {
                        return Ok(ending);
                    }
                }
                failed = &mut self.failed => {
                    let error = failed.unwrap_or_else(|_| anyhow!("the pipeline has ended"));
                    return Err(NodeError::Failed(error));
                }
                _ = statuses.tick() => {
                    self.shared.clock.discipline();
                    self.report_overload();
                    self.send_status();
                    let mut trouble = self.shared.trouble().into_iter().flatten();
                    if let Some((words, _)) = trouble.find(|(_, gives_up)| *gives_up) {
                        return Err(NodeError::Failed(anyhow!("{words}")));
                    }
                    if let Some(ending) = self.give_up()? {
                        return Ok(ending);
                    }
                }
            }
        }
    }

    /// Ends cameras and pipeline, and reports it with the error, if any.
    pub(super) fn leave(&mut self, error: Option<&NodeError>) {
        self.shared.stop();
        service_manager::end_work();
        self.refused = None;
        self.status.failure = error.map(|error| wire::cut_text(error.to_string()));
        self.send_status();
    }

    /// Sends the status.
    fn send_status(&mut self) {
        let now_us = self.shared.clock.now_us();
        self.status.ready = !self.shared.is_stopped() && self.refused.is_none();
        self.status.stages = self.shared.stages();
        self.status.live = Some(LiveStatus {
            cameras: self.shared.frames.status(now_us),
            recording_failure: self.shared.ring_failure().map(wire::cut_text),
            ..self.shared.describe(now_us)
        });
        self.status.tick = self.shared.last_tick();
        self.status.health = self.health();
        if let Some(Workers {
            workers,
            crops_per_s,
        }) = self.shared.workers()
        {
            let plural = if workers == 1 { "" } else { "s" };
            let workers = format!("{workers} worker{plural}, {crops_per_s:.0} crops a second");
            self.status.backend = wire::cut_text(format!("{}; {workers}", self.backend));
        }
        let notice = self.status.failure.as_ref();
        let notice = notice.or(self.status.health.notices.first());
        service_manager::report(notice.unwrap_or(&self.status.backend));
        self.shared
            .send(MessageKind::Status, self.shared.encode(&self.status));
    }

    /// The health of the node, without its work.
    fn health(&self) -> NodeHealth {
        let mut health = NodeHealth {
            system_clock: Some(self.shared.clock.system()),
            follows: self.shared.session(),
            certificate_ends_s: self.status.health.certificate_ends_s,
            ..NodeHealth::default()
        };
        let until_s = health.certificate_ends_s.map(u64::cast_signed);
        let ending =
            until_s.and_then(|until_s| ending_notice(&self.status.node, until_s, clock::unix_s()));
        if let Some(text) = ending {
            health.notice(text);
        }
        if let Some(failure) = self.shared.ring_failure() {
            health.notice(failure);
        }
        let trouble = self.shared.trouble().into_iter().flatten();
        let trouble = trouble.map(|(words, _)| words);
        let from_start = self.notices.iter().cloned();
        for notice in trouble.chain(self.shared.overload()).chain(from_start) {
            health.notice(notice);
        }
        health
    }

    /// Counts an unreadable message, and reports once if it has another version.
    fn cannot_read(&mut self, error: &WireError) {
        self.status.unreadable += 1;
        if let WireError::Version { .. } = error
            && self.foreign.as_ref() != Some(error)
        {
            say(format_args!(
                "{}: messages of fusion cannot be read: {error}",
                self.status.node
            ));
            self.foreign = Some(error.clone());
        }
    }

    /// Processes what fusion's status reports about the edge.
    fn process_status(&mut self, fusion: &Status) {
        let mut edges = fusion.live.iter().flat_map(|live| &live.edges);
        let link = edges.find(|edge| edge.viewpoint == self.status.node);
        self.objection = check_fusion(&self.status, fusion, link).err();
        if self.objection.is_some() {
            self.status.unreadable += 1;
            self.refusal.note_refusal(self.shared.clock.now_us());
            return;
        }
        self.refusal.note_acceptance();
        // A refusal while this edge is accepted concerns another edge with its name.
        let refused = link.filter(|link| !link.live);
        let refused = refused.and_then(|link| link.refused.clone());
        // Numbers in the reason change all the time.
        if refused.is_some() != self.refused.is_some() {
            let name = &self.status.node;
            match &refused {
                Some(why) => say(format_args!("{name}: refused by fusion: {why}")),
                None => say(format_args!("{name}: accepted again by fusion")),
            }
        }
        let failure = refused
            .as_ref()
            .map(|why| format!("refused by fusion: {why}"));
        self.status.failure = failure.map(wire::cut_text);
        self.refused = refused;
    }

    /// Ends the edge when fusion's objections are confirmed.
    fn give_up(&mut self) -> Result<Option<Ending>, NodeError> {
        if !self.refusal.is_confirmed(self.shared.clock.now_us()) {
            return Ok(None);
        }
        self.objection.take().map_or(Ok(None), Err)
    }
}

/// Checks that an edge with the status `own` can work with fusion, by fusion's status and its
/// `link` to the edge.
fn check_fusion(own: &Status, fusion: &Status, link: Option<&EdgeLink>) -> Result<(), NodeError> {
    if fusion.live.is_none() {
        return Err(NodeError::Failed(anyhow!(
            "fusion runs in lock-step now: start the edge again"
        )));
    }
    compare_files(own, fusion)?;
    if link.is_some_and(|link| link.refuses_process(own.process)) {
        return Err(NodeError::Failed(anyhow!(
            "another node has viewpoint {}: stop one of the two",
            own.node
        )));
    }
    Ok(())
}

/// Starts the threads, which end when `shared` is stopped. Camera threads may still wait for a
/// frame then, so they are not joined.
fn spawn_threads(
    parts: Parts,
    shared: &Arc<Shared>,
    failed: oneshot::Sender<anyhow::Error>,
) -> std::io::Result<()> {
    for (at, &index) in parts.cameras.iter().enumerate() {
        let camera = LiveCamera {
            shared: Arc::clone(shared),
            venue: Arc::clone(&parts.venue),
            sources: Arc::clone(&parts.sources),
            index,
            at,
        };
        std::thread::Builder::new()
            .name(format!("camera {at}"))
            .spawn(move || camera.run())?;
    }
    if shared.has_pictures() {
        let thumbnails = Thumbnails {
            shared: Arc::clone(shared),
            venue: Arc::clone(&parts.venue),
            viewpoint: parts.viewpoint,
            cameras: parts.cameras.clone(),
        };
        std::thread::Builder::new()
            .name("thumbnails".to_owned())
            .spawn(move || thumbnails.run())?;
    }
    let Parts {
        venue,
        pipeline,
        workers,
        viewpoint,
        ..
    } = parts;
    let shared = Arc::clone(shared);
    let work = move || {
        let mut ticker = Ticker::new(shared, pipeline, viewpoint, &venue);
        let outcome = ticker.share_work(workers).map(|()| ticker.run());
        report_beyond_view(ticker.pipeline());
        if let Err(error) = outcome {
            drop(failed.send(error));
        }
    };
    std::thread::Builder::new()
        .name("pipeline".to_owned())
        .spawn(work)
        .map(drop)
}

#[cfg(test)]
mod tests;
