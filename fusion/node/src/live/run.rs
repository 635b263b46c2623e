//! The loop of a live run: it receives messages, steps the core when a tick is due, and sends poses and boxes.
//!
//! It never waits for the network, nor for an edge past a tick's deadline. Its messages go into a bounded queue, and are
//! dropped if that is full.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::live::edge::Edge;
use farfield_fusion::live::membership::Membership;
use farfield_fusion::live::{Micros, SECOND_US};
use farfield_node::process::Ending;
use farfield_node::service_manager;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::{BoxSet, PoseSet, StageTime, Status};
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use tokio::time::{MissedTickBehavior, interval, sleep_until, timeout};
use tracing::warn;

use super::super::config::FusionConfig;
use super::super::recording::RecordingsOnDemand;
use super::super::venue_checks::is_recorded;
use super::super::worker::{FusionWorker, Stepped};
use super::LiveContext;
use super::delays::Delays;
use super::handover::Handover;
use super::start::LiveStart;
use super::ticks::{NextTick, OpenTicks};
use super::viewpoints::Viewpoints;
use super::watches::Watches;
use crate::output::summary::Lost;
use crate::output::tally::{PassedBytes, Tally};
use crate::session::interceptor::Interceptor;
use crate::session::link::FusionEnds;
use crate::session::messages::{FusionIncoming, FusionOutgoing, Liveliness};
use crate::session::outbox::Outbox;

/// Interval of the periodic work.
const BEAT: Duration = Duration::from_millis(100);
/// Beats per second.
const BEATS_PER_SECOND: u32 = 10;
/// Time without a finished tick after which the newest boxes are sent again: edges estimate the clock from them.
const RESEND_AFTER_US: Micros = SECOND_US / 10;
/// Most messages received before the loop checks ticks again.
const AT_ONCE: usize = 64;
/// Time for the edges to send their last status.
const FAREWELL: Duration = Duration::from_secs(3);
/// Interval of repeating the end order to edges that are still present.
const END_EVERY: Duration = Duration::from_millis(100);

/// A live run in progress.
pub(super) struct LiveFusion<'a> {
    pub(super) config: &'a FusionConfig,
    pub(super) interceptor: &'a Interceptor,
    pub(super) session: SessionId,
    pub(super) first: Tick,
    pub(super) viewpoints: Viewpoints<'a>,
    pub(super) ticks: OpenTicks,
    pub(super) outbox: Outbox<'a>,
    /// The last boxes of every viewpoint, and when they were sent.
    newest: Vec<BoxSet>,
    sent_us: Micros,
    pub(super) delays: Delays,
    pub(super) core_stages: Vec<StageTime>,
    pub(super) watches: Watches,
    pub(super) handover: Option<Handover>,
    /// Recordings on demand, if they are possible.
    pub(super) on_demand: Option<&'a RecordingsOnDemand>,
}

impl<'a> LiveFusion<'a> {
    pub(super) fn new(
        context: &LiveContext<'a>,
        start: LiveStart,
        watches: Watches,
        handover: Option<Handover>,
    ) -> Self {
        let config = context.config;
        let venue = &config.venue;
        let first = start.first;
        let end = config_end(config, &start.members);
        context.reporter.started(first, end);
        let (interceptor, session) = (context.interceptor, context.session);
        let outgoing = context.ends.outgoing.clone();
        Self {
            config,
            interceptor,
            session,
            first,
            ticks: OpenTicks::new(venue, session, start.time, first),
            viewpoints: Viewpoints::new(venue, start),
            outbox: Outbox::new(interceptor, session, first, outgoing, Tally::new(venue)),
            newest: Vec::new(),
            sent_us: 0,
            delays: Delays::new(venue),
            core_stages: Vec::new(),
            watches,
            handover,
            on_demand: context.on_demand,
        }
    }

    /// Runs from the first boxes to the last tick.
    ///
    /// # Errors
    /// The core or the subscriptions have ended.
    pub(super) async fn run(
        &mut self,
        first: Vec<BoxSet>,
        worker: &mut FusionWorker,
        context: &mut LiveContext<'_>,
    ) -> anyhow::Result<Ending> {
        let LiveContext {
            ends,
            reporter,
            stop,
            ..
        } = context;
        self.send_boxes(first);
        let mut beats = interval(BEAT);
        beats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut n_beats = 0u32;
        loop {
            let wake_us = self.advance(worker)?;
            if !self.ticks.is_in_core() && self.is_over() {
                return Ok(Ending::Done);
            }
            let wake = self.interceptor.clock.instant_at(wake_us.unwrap_or(0));
            tokio::select! {
                () = stop.cancelled() => return Ok(Ending::Interrupted),
                stepped = worker.done.recv() => {
                    let stepped = stepped.context("the core has ended")?;
                    service_manager::note_work();
                    let (poses, bytes) = self.publish(stepped);
                    reporter.tick(&poses, bytes);
                }
                incoming = ends.incoming.recv() => {
                    self.receive(incoming.context("the subscriptions have ended")?);
                    for _ in 0..AT_ONCE {
                        let Ok(incoming) = ends.incoming.try_recv() else { break };
                        self.receive(incoming);
                    }
                }
                () = sleep_until(wake.into()), if wake_us.is_some() => {}
                _ = beats.tick() => {
                    n_beats = n_beats.wrapping_add(1);
                    if self.interceptor.clock.now_us() - self.sent_us >= RESEND_AFTER_US {
                        self.send_newest(true);
                    }
                    self.ticks.forget_arrivals();
                    if n_beats.is_multiple_of(BEATS_PER_SECOND) {
                        self.every_second(reporter);
                    }
                }
            }
        }
    }

    /// The end of the ticks, if there is one.
    pub(super) fn end(&self) -> Option<Tick> {
        config_end(self.config, &self.viewpoints.members)
    }

    fn is_over(&self) -> bool {
        self.end()
            .is_some_and(|end| self.ticks.gather.next() >= end)
    }

    /// Steps the next tick if it is due; otherwise returns when to check again.
    fn advance(&mut self, worker: &FusionWorker) -> anyhow::Result<Option<Micros>> {
        if self.is_over() {
            return Ok(None);
        }
        let now_us = self.interceptor.clock.now_us();
        match self.ticks.next(&mut self.viewpoints, &self.newest, now_us) {
            NextTick::InCore => Ok(None),
            NextTick::At(us) => Ok(Some(us)),
            NextTick::Due(job) => {
                self.outbox.decided(&job);
                worker.step(job)?;
                Ok(None)
            }
        }
    }

    /// Publishes a tick: boxes first, as edges wait for them. Returns the poses and the bytes so far.
    fn publish(&mut self, mut stepped: Stepped) -> (PoseSet, PassedBytes) {
        if let Some(cost) = stepped.cost {
            self.ticks.shedding.stepped(cost);
        }
        let tick = stepped.poses.tick;
        self.ticks.last = Some(tick);
        if let Some(stages) = stepped.stages.take() {
            self.core_stages = stages;
        }
        if let Some(people) = stepped.people.take() {
            if let Some(on_demand) = self.on_demand {
                on_demand.set_people(&people);
            }
            if let Some(handover) = &self.handover {
                handover.save(tick, people);
            }
        }
        if let Some(samples) = stepped.agreement.take() {
            self.watches.agreement.judge(samples);
        }
        self.send_boxes(std::mem::take(&mut stepped.boxes));
        self.outbox.results(&mut stepped);
        let now_us = self.interceptor.clock.now_us();
        self.ticks.posed(tick, now_us, &mut self.delays);
        (stepped.poses, self.outbox.tally.bytes())
    }

    fn send_boxes(&mut self, sets: Vec<BoxSet>) {
        self.newest = sets;
        self.send_newest(false);
    }

    /// Sends the newest boxes; `again` as a sign of life, also to edges that are not due.
    fn send_newest(&mut self, again: bool) {
        let now_us = self.interceptor.clock.now_us();
        self.sent_us = now_us;
        for set in &mut self.newest {
            let index = usize::from(set.viewpoint.0);
            if !self.viewpoints.members.is_welcome(index) {
                // A refused edge still gets the clock and the reason.
                set.persons.clear();
                set.detection_cameras.clear();
            }
            let edge = &mut self.viewpoints.edges[index];
            if !again && !edge.is_sent(set) {
                continue;
            }
            set.live = Some(edge.send(set, &self.ticks.time, now_us));
            edge.sent_bytes(self.outbox.boxes(set));
        }
    }

    /// Announces that no more ticks follow, so that silence while files are finished is not taken for a failure.
    pub(super) fn announce_end(&mut self) {
        let links = self.viewpoints.links(self.interceptor.clock.now_us());
        let status = Status {
            ready: false,
            ..self.status(links)
        };
        self.outbox.send(FusionOutgoing::Status(Box::new(status)));
    }

    /// Sends the end order to the edges, and waits for their last statuses.
    pub(super) async fn end_edges(&mut self, ends: &mut FusionEnds) -> Vec<Status> {
        let all: BTreeSet<String> = self.viewpoints.names().map(str::to_owned).collect();
        self.send_end(&all);
        let mut last_words: BTreeMap<String, Status> = BTreeMap::new();
        let mut repeats = interval(END_EVERY);
        repeats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        repeats.reset();
        let last_statuses = async {
            while !self.viewpoints.present.is_empty() {
                tokio::select! {
                    // The link may lose the order.
                    _ = repeats.tick() => {
                        let present = self.viewpoints.present.clone();
                        self.send_end(&present);
                    }
                    incoming = ends.incoming.recv() => match incoming {
                        Some(FusionIncoming::Status(status)) if status.viewpoint.is_some() => {
                            last_words.insert(status.node.clone(), *status);
                        }
                        Some(FusionIncoming::Alive(node, Liveliness::Gone)) => {
                            self.viewpoints.present.remove(&node);
                        }
                        Some(_) => {}
                        None => break,
                    }
                }
            }
        };
        if timeout(FAREWELL, last_statuses).await.is_err() {
            warn!(still = ?self.viewpoints.present, "not every edge has left");
        }
        for status in self.viewpoints.last_words() {
            last_words.entry(status.node.clone()).or_insert(status);
        }
        last_words.into_values().collect()
    }

    fn send_end(&mut self, to: &BTreeSet<String>) {
        let tick = self.ticks.gather.next();
        for (index, name) in self.viewpoints.names().enumerate() {
            if !to.contains(name) {
                continue;
            }
            let mut order = (self.outbox).end_order(ViewpointIndex(index as u16), tick);
            let now_us = self.interceptor.clock.now_us();
            let edge = &mut self.viewpoints.edges[index];
            order.live = Some(edge.send(&order, &self.ticks.time, now_us));
            self.outbox.end(&order);
        }
    }

    /// Messages that no step used.
    pub(super) fn lost(&self) -> Lost {
        let edges = &self.viewpoints.edges;
        let sum = |of: fn(&Edge) -> u64| edges.iter().map(of).sum::<u64>();
        Lost {
            unreadable: sum(|edge| edge.unreadable) + self.viewpoints.unreadable,
            late: sum(|edge| edge.late),
            missing: sum(|edge| edge.missing),
            refused: self.outbox.tally.refused,
            unsent: self.outbox.unsent,
            shed: self.ticks.shedding.shed,
        }
    }

    /// Delays of the messages, by node.
    pub(super) fn paths(&self) -> Vec<(String, StageTime)> {
        let own = self.delays.own().into_iter();
        let own = own.map(|time| (FUSION.to_owned(), time));
        let edges = self.delays.by_edge();
        own.chain(edges.map(|(name, time)| (name.to_owned(), time)))
            .collect()
    }
}

/// The end of the requested or recorded ticks.
fn config_end(config: &FusionConfig, members: &Membership) -> Option<Tick> {
    let requested = config.ticks.as_ref().map(|ticks| ticks.end);
    let recorded = || members.recorded().filter(|_| is_recorded(&config.venue));
    requested.or_else(|| recorded().map(|ticks| ticks.end))
}
