//! The loop of a live run: it receives messages, steps the core when a tick is due, and sends poses and boxes.
//!
//! It never waits for the network, nor for an edge past a tick's deadline. Its messages go into a bounded queue, and are
//! dropped if that is full.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::align::TickGroup;
use farfield_fusion::export::summary::CameraSummary;
use farfield_fusion::live::cameras::Cameras;
use farfield_fusion::live::common_plan::CommonPlan;
use farfield_fusion::live::edge::Edge;
use farfield_fusion::live::edge::common_clock::CommonClock;
use farfield_fusion::live::gather::LiveGather;
use farfield_fusion::live::horizon::LONGEST;
use farfield_fusion::live::late_detections::LateDetections;
use farfield_fusion::live::membership::Membership;
use farfield_fusion::live::pace::Pace;
use farfield_fusion::live::queue::{Next, TickQueue, Waiting};
use farfield_fusion::live::target_latency::{LongestWaits, TargetLatency, are_enough, needed};
use farfield_fusion::live::tick_time::TickTime;
use farfield_fusion::live::{Micros, SECOND_US};
use farfield_node::process::Ending;
use farfield_node::service_manager;
use farfield_proto::id::{PersonId, SessionId, ViewpointIndex};
use farfield_proto::message::decision::Decision;
use farfield_proto::message::{BoxSet, PatchSet, StageTime, Status};
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use farfield_proto::wire;
use tokio::time::{MissedTickBehavior, interval, sleep_until};

use super::super::config::FusionConfig;
use super::super::recording::RecordingsOnDemand;
use super::super::venue_checks::is_recorded;
use super::super::worker::{FusionWorker, Job};
use super::LiveContext;
use super::agreement::AgreementJudge;
use super::delays::Delays;
use super::handover::Handover;
use super::missed_target::MissedTarget;
use super::overload::{FloodWatch, LiveShedding};
use super::start::LiveStart;
use crate::output::disk_watch::DiskWatch;
use crate::output::summary::Lost;
use crate::output::tally::Tally;
use crate::session::interceptor::Interceptor;
use crate::session::link::FusionEnds;
use crate::session::messages::FusionOutgoing;
use crate::session::other_fusion::OtherFusionWatch;
use crate::session::wiretap::CopiedStep;

/// Interval of the periodic work.
const BEAT: Duration = Duration::from_millis(100);
/// Beats per status: one a second.
const BEATS_PER_STATUS: u32 = 10;
/// Time without a finished tick after which the newest boxes are sent again: edges estimate the clock from them.
const RESEND_AFTER_US: Micros = SECOND_US / 10;
/// Range of open ticks, and range in which late messages are distinguished from repeated ones, seconds.
const OPEN_S: f64 = 2.0;
const LATE_S: f64 = 10.0;
/// Time after the first tick to wait for the edges' first messages: at that tick all have a detection pass.
const FIRST_WORD_US: Micros = SECOND_US / 2;
/// Most messages received before the loop checks ticks again.
const AT_ONCE: usize = 64;

/// A tick in the core.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "all are times")]
pub(super) struct InFlight {
    pub(super) captured_us: Micros,
    pub(super) arrived_us: Option<Micros>,
    /// When the core received it.
    pub(super) begun_us: Micros,
    /// Time from the capture of its first picture to the tick; `None` without patches.
    pub(super) early_us: Option<Micros>,
}

/// A live run in progress.
pub(super) struct LiveFusion<'a> {
    pub(super) config: &'a FusionConfig,
    pub(super) interceptor: &'a Interceptor,
    pub(super) session: SessionId,
    pub(super) first: Tick,
    pub(super) time: TickTime,
    pub(super) members: Membership,
    pub(super) edges: Vec<Edge>,
    pub(super) present: BTreeSet<String>,
    pub(super) gather: LiveGather,
    pub(super) queue: TickQueue,
    pub(super) target: TargetLatency,
    /// Problems with the target latency, in words.
    pub(super) missed_target: MissedTarget,
    /// Per open tick, the arrival of its last message.
    pub(super) arrived: BTreeMap<Tick, Micros>,
    pub(super) late: Vec<PatchSet>,
    pub(super) in_flight: Option<InFlight>,
    /// Running mean of the time from a tick to sending its boxes, microseconds.
    pub(super) publish_us: f64,
    pub(super) newest: Vec<BoxSet>,
    /// Buffer: for each view of each person, the expected time from a tick to its patches.
    pub(super) patches_come: Vec<(PersonId, Option<Micros>)>,
    /// The last next tick with enough sightings, and the time since when it has enough.
    pub(super) enough_sightings: Option<(Tick, Micros)>,
    pub(super) sent_us: Micros,
    /// Traffic of the links.
    pub(super) tally: Tally,
    pub(super) delays: Delays,
    pub(super) core_stages: Vec<StageTime>,
    /// The last finished tick.
    pub(super) last: Option<Tick>,
    /// Ticks stepped without input because the core was behind.
    pub(super) without_input: u64,
    pub(super) shedding: LiveShedding,
    /// Unreadable messages of unknown senders.
    pub(super) unreadable: u64,
    /// Messages dropped because the send queue was full.
    pub(super) unsent: u64,
    pub(super) refusals: Vec<Option<String>>,
    pub(super) cameras: Cameras,
    pub(super) flood: FloodWatch,
    /// Viewpoints whose expiring certificate was reported.
    pub(super) reported_certificates: BTreeSet<String>,
    pub(super) handover: Option<Handover>,
    /// Recordings on demand, if they are possible.
    pub(super) on_demand: Option<&'a RecordingsOnDemand>,
    /// The judge of the cameras' agreement; `None` before the run.
    pub(super) agreement: Option<AgreementJudge>,
    /// Disagreements of the cameras, in words.
    pub(super) disagreements: Vec<String>,
    /// The disks that the run writes to.
    pub(super) disks: Vec<Arc<DiskWatch>>,
    /// The ticks that all edges work on, and the reason if these are not all.
    pub(super) plan: CommonPlan,
    pub(super) plan_words: Option<String>,
    pub(super) common_clock: CommonClock,
    pub(super) is_own_clock_suspected: bool,
    /// The watch for another fusion of the venue, and whether one was reported.
    pub(super) others: OtherFusionWatch,
    pub(super) is_other_reported: bool,
    /// End of waiting for edges that have sent nothing yet.
    pub(super) expect_until_us: Micros,
    /// Results of detection passes that came too late.
    pub(super) late_detections: Vec<LateDetections>,
}

impl<'a> LiveFusion<'a> {
    pub(super) fn new(context: &LiveContext<'a>, start: LiveStart) -> Self {
        let config = context.config;
        let venue = &config.venue;
        let bound_ms = venue.parameters.link.clock_bound_ms;
        let names = venue.viewpoints.iter().map(|v| &v.name);
        let pace = Pace::new(venue.parameters.link.budget_bytes_per_s, venue.rate_hz);
        let ticks_per_pass = venue.parameters.births.ticks_per_look(venue.rate_hz);
        let edge = |name| {
            let edge = Edge::new(name, bound_ms).with_pass_every(ticks_per_pass);
            edge.at_pace(pace.clone())
        };
        let mut edges: Vec<Edge> = names.map(|name| edge(name)).collect();
        let ticks = |seconds: f64| (seconds * venue.rate_hz).ceil() as usize;
        let LiveStart {
            time,
            first,
            members,
            present,
        } = start;
        let expect_until_us = time.at(first) + FIRST_WORD_US;
        let expect = |edge: &mut Edge| edge.expect(expect_until_us);
        edges.iter_mut().for_each(expect);
        context
            .reporter
            .started(first, config_end(config, &members));
        Self {
            config,
            interceptor: context.interceptor,
            session: context.session,
            first,
            time,
            members,
            present,
            gather: LiveGather::new(
                context.session,
                first,
                edges.len(),
                [ticks(LATE_S), ticks(OPEN_S)],
            ),
            refusals: vec![None; edges.len()],
            edges,
            queue: TickQueue::default(),
            target: TargetLatency::new(venue.parameters.link.target_latency_ms),
            missed_target: MissedTarget::default(),
            arrived: BTreeMap::new(),
            late: Vec::new(),
            in_flight: None,
            publish_us: 0.0,
            newest: Vec::new(),
            patches_come: Vec::new(),
            enough_sightings: None,
            sent_us: 0,
            tally: Tally::new(venue),
            delays: Delays::new(venue),
            core_stages: Vec::new(),
            last: None,
            cameras: Cameras::default(),
            flood: FloodWatch::default(),
            reported_certificates: BTreeSet::new(),
            handover: None,
            on_demand: context.on_demand,
            agreement: None,
            disagreements: Vec::new(),
            disks: Vec::new(),
            plan: CommonPlan::default(),
            plan_words: None,
            common_clock: CommonClock::default(),
            is_own_clock_suspected: false,
            others: context.others.clone(),
            is_other_reported: false,
            without_input: 0,
            shedding: LiveShedding::default(),
            unreadable: 0,
            unsent: 0,
            expect_until_us,
            late_detections: vec![LateDetections::default(); venue.viewpoints.len()],
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
        self.send_boxes(first, ends);
        let mut beats = interval(BEAT);
        beats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut n_beats = 0u32;
        loop {
            let wake_us = self.advance(worker, ends)?;
            if self.in_flight.is_none() && self.is_over() {
                return Ok(Ending::Done);
            }
            let wake = self.interceptor.clock.instant_at(wake_us.unwrap_or(0));
            tokio::select! {
                () = stop.cancelled() => return Ok(Ending::Interrupted),
                stepped = worker.done.recv() => {
                    let stepped = stepped.context("the core has ended")?;
                    service_manager::note_work();
                    let bytes = self.publish(stepped, ends);
                    if let Some((poses, bytes)) = bytes {
                        reporter.tick(&poses, bytes);
                    }
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
                    self.beat(ends);
                    if n_beats.is_multiple_of(BEATS_PER_STATUS) {
                        self.interceptor.clock.discipline();
                        self.weigh_clocks();
                        self.plan_ticks();
                        self.check_floods();
                        self.check_certificates();
                        self.check_agreement();
                        self.check_other_fusion();
                        self.check_target();
                        let now_us = self.interceptor.clock.now_us();
                        let status = self.status(self.config, now_us);
                        service_manager::report(&self.status_line(&status));
                        let links = status.live.as_ref().map(|live| live.edges.clone());
                        let edges = links.unwrap_or_default();
                        self.send(ends, FusionOutgoing::Status(Box::new(status)));
                        let recent = self.delays.take_recent();
                        self.report_refusals(&edges);
                        reporter.links(recent.map(|r| (r.p50_us, r.p99_us)), edges);
                        self.shedding.report();
                    }
                }
            }
        }
    }

    /// The end of the ticks, if there is one.
    pub(super) fn end(&self) -> Option<Tick> {
        config_end(self.config, &self.members)
    }

    /// Steps the next tick if it is due; otherwise returns when to check again.
    fn advance(
        &mut self,
        worker: &FusionWorker,
        ends: &FusionEnds,
    ) -> anyhow::Result<Option<Micros>> {
        if self.in_flight.is_some() || self.is_over() {
            return Ok(None);
        }
        let tick = self.gather.next();
        let now_us = self.interceptor.clock.now_us();
        let waiting = self.waiting(tick, now_us);
        let next = self.queue.next(self.time.at(tick), waiting, now_us);
        if let Next::WaitUntil(us) = next {
            return Ok(Some(us));
        }
        self.note_missing(tick);
        self.note_left_out(tick, now_us);
        let mut group = self.gather.take();
        let mut arrived_us = self.arrived.remove(&tick);
        if next == Next::StepWithoutInput {
            self.without_input += 1;
            let sets = std::mem::take(&mut group.patch_sets);
            group.sighting_sets.clear();
            for set in sets {
                self.keep_late(set);
            }
            arrived_us = None;
        }
        self.shedding
            .trim(&mut group, self.edges.len(), self.time.period_us());
        self.queue.stepped();
        let earliest_us = earliest_capture_us(&group);
        self.in_flight = Some(InFlight {
            captured_us: self.time.at(tick) + earliest_us.unwrap_or(0),
            arrived_us,
            begun_us: now_us,
            early_us: earliest_us.map(|us| -us),
        });
        let (publish_us, period_us) = (self.publish_us, self.time.period_us());
        // If a tick is later than usual, as after a detection pass, its boxes are made for ticks later by the same amount.
        let later_us = ((now_us - self.time.at(tick)) as f64 - publish_us).max(0.0);
        let later_ticks = (later_us / period_us).floor();
        let edges = self.edges.iter_mut();
        let horizons = edges
            .map(|edge| edge.horizon_ticks(publish_us, period_us) + later_ticks)
            .map(|ticks| ticks.min(LONGEST as f64))
            .collect();
        let job = Job {
            group,
            late: std::mem::take(&mut self.late),
            horizons,
        };
        let step = CopiedStep {
            group: &job.group,
            late: &job.late,
            horizons: &job.horizons,
        };
        self.interceptor.decided(self.session, step);
        let decision = Decision {
            horizons_ticks: job.horizons.clone(),
            ..job.group.decision(self.session, self.first)
        };
        self.send(ends, FusionOutgoing::Decision(wire::encode(&decision)));
        worker.step(job)?;
        Ok(None)
    }

    fn is_over(&self) -> bool {
        self.end().is_some_and(|end| self.gather.next() >= end)
    }

    /// Whether viewpoint `index` takes part: its files match and its clock is near enough.
    pub(super) fn takes_part(&self, index: usize) -> bool {
        self.members.is_welcome(index) && self.edges[index].is_on_time()
    }

    fn waiting(&mut self, tick: Tick, now_us: Micros) -> Waiting {
        let most = self.needed_waits(tick, now_us);
        let waits = self.target.longest_waits(most, now_us);
        let edges = 0..self.edges.len();
        let deadlines = edges.filter_map(|index| self.deadline_of(index, tick, now_us, waits));
        deadlines.max().map_or(Waiting::ForNone, Waiting::Until)
    }

    /// How long `tick` waits for enough views of each person and enough sightings.
    fn needed_waits(&mut self, tick: Tick, now_us: Micros) -> LongestWaits {
        let (most_us, period_us) = (self.longest_wait_us(), self.time.period_us() as Micros);
        let mut arrivals = std::mem::take(&mut self.patches_come);
        arrivals.clear();
        for set in &self.newest {
            let index = usize::from(set.viewpoint.0);
            if set.persons.is_empty() || !self.is_awaited(index, now_us) {
                continue;
            }
            let us = self.edges[index].patches_come_us(now_us);
            arrivals.extend(set.persons.iter().map(|boxes| (boxes.person, us)));
        }
        let patches_us = needed(&mut arrivals, period_us, most_us);
        self.patches_come = arrivals;
        LongestWaits {
            patches_us,
            detections_us: most_us,
            enough_since_us: self.enough_sightings_since_us(tick, now_us),
        }
    }

    fn enough_sightings_since_us(&mut self, tick: Tick, now_us: Micros) -> Option<Micros> {
        let edges = self.edges.iter().enumerate();
        let detecting = edges
            .filter(|(index, edge)| edge.looks_at(tick) && self.is_awaited(*index, now_us))
            .map(|(index, _)| {
                self.gather
                    .has_sightings(tick, ViewpointIndex(index as u16))
            });
        let (all, arrived) = detecting.fold((0, 0), |(all, arrived), has_all| {
            (all + 1, arrived + usize::from(has_all))
        });
        if !are_enough(arrived, all) {
            return None;
        }
        let (last, since_us) = self.enough_sightings.unwrap_or((tick, now_us));
        let since_us = if last == tick { since_us } else { now_us };
        self.enough_sightings = Some((tick, since_us));
        Some(since_us)
    }

    /// The longest wait for a tick, microseconds.
    fn longest_wait_us(&self) -> Micros {
        (self.config.venue.parameters.link.deadline_ms * 1e3) as Micros
    }

    /// Whether to wait for messages of the edge of viewpoint `index`.
    fn is_awaited(&self, index: usize, now_us: Micros) -> bool {
        self.members.is_welcome(index) && self.edges[index].is_awaited(now_us)
    }

    /// The deadline for the edge of viewpoint `index`; `None` if it is not awaited or has sent everything.
    fn deadline_of(
        &mut self,
        index: usize,
        tick: Tick,
        now_us: Micros,
        waits: LongestWaits,
    ) -> Option<Micros> {
        let viewpoint = ViewpointIndex(index as u16);
        let has_all = self.gather.has_all(tick, viewpoint);
        let is_missing = self.is_awaited(index, now_us) && !has_all;
        // If the other edges suffice, an edge that will be too late is not awaited at all.
        let is_bounded = waits.patches_us < self.longest_wait_us();
        let edge = &mut self.edges[index];
        let is_hopeless =
            is_bounded && !edge.looks_at(tick) && edge.is_later_than(waits.patches_us, now_us);
        let is_missing = is_missing && !is_hopeless && edge.works_on(tick);
        is_missing.then(|| edge.deadline_us(tick, &self.time, now_us, waits))
    }

    /// Records the edges that a tick over at `now_us` did not wait for.
    fn note_left_out(&mut self, tick: Tick, now_us: Micros) {
        let (waits, edges) = (
            LongestWaits::same(self.longest_wait_us()),
            0..self.edges.len(),
        );
        let mut is_left_out = |index| {
            let until_us = self.deadline_of(index, tick, now_us, waits);
            let is_left_out = until_us.is_some_and(|us| us > now_us);
            self.is_awaited(index, now_us).then_some(is_left_out)
        };
        let left_out: Vec<Option<bool>> = edges.map(&mut is_left_out).collect();
        self.target.over(&left_out);
    }

    fn note_missing(&mut self, tick: Tick) {
        for (index, edge) in self.edges.iter_mut().enumerate() {
            if !self.gather.has_any(tick, ViewpointIndex(index as u16)) {
                edge.miss(tick);
            }
        }
    }

    fn beat(&mut self, ends: &FusionEnds) {
        let now_us = self.interceptor.clock.now_us();
        if now_us - self.sent_us >= RESEND_AFTER_US {
            self.send_newest(ends, true);
        }
        // Discard arrivals of ticks that are never stepped.
        let next = self.gather.next();
        self.arrived.retain(|tick, _| *tick >= next);
    }

    /// The newest statuses of the edges.
    pub(super) fn first_words(&self) -> Vec<Status> {
        self.members.last_words().cloned().collect()
    }

    /// Messages that no step used.
    pub(super) fn lost(&self) -> Lost {
        let sum = |of: fn(&Edge) -> u64| self.edges.iter().map(of).sum::<u64>();
        Lost {
            unreadable: sum(|edge| edge.unreadable) + self.unreadable,
            late: sum(|edge| edge.late),
            missing: sum(|edge| edge.missing),
            refused: self.tally.refused,
            unsent: self.unsent,
            shed: self.shedding.shed,
        }
    }

    /// Summaries of the cameras, by name.
    pub(super) fn camera_summaries(&self) -> BTreeMap<String, CameraSummary> {
        let named = self.cameras.records().filter_map(|(index, record)| {
            let camera = self.config.venue.camera(index)?;
            let summary = CameraSummary {
                health: record.health,
                frames_per_s: record.frames_per_s,
                troubles: record.troubles,
                reason: record.reason.clone(),
            };
            Some((camera.model.name().to_owned(), summary))
        });
        named.collect()
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

/// The earliest capture of a tick's pictures relative to the tick; `None` without patches.
fn earliest_capture_us(group: &TickGroup) -> Option<Micros> {
    let patches = group.patch_sets.iter().flat_map(|set| &set.persons);
    let earliest = patches.map(|patch| patch.capture_offset_us).min();
    earliest.map(Micros::from)
}
