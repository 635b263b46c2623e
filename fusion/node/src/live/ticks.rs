//! The open ticks of a live run: which messages wait for their tick, and when the next tick is due.
//!
//! A tick is due when enough views of every person and enough sightings have arrived, or at a deadline learnt from delays.

use std::collections::BTreeMap;

use farfield_fusion::align::TickGroup;
use farfield_fusion::live::Micros;
use farfield_fusion::live::edge::Edge;
use farfield_fusion::live::gather::LiveGather;
use farfield_fusion::live::horizon::LONGEST;
use farfield_fusion::live::queue::{Next, TickQueue, Waiting};
use farfield_fusion::live::target_latency::{
    LongestWaits, PosedTick, TargetLatency, are_enough, needed,
};
use farfield_fusion::live::tick_time::TickTime;
use farfield_proto::id::{PersonId, SessionId, ViewpointIndex};
use farfield_proto::message::{BoxSet, PatchSet};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

use super::delays::Delays;
use super::overload::LiveShedding;
use super::viewpoints::Viewpoints;
use crate::worker::Job;

/// Range of open ticks, and range in which late messages are distinguished from repeated ones, seconds.
const OPEN_S: f64 = 2.0;
const LATE_S: f64 = 10.0;
/// Late sets queued for the smoother's next step; if there are more, the newest are dropped.
const MAX_LATE: usize = 256;
/// Weight of one tick in the mean time from a tick to sending its boxes.
const WEIGHT: f64 = 0.05;

/// A tick in the core.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "all are times")]
struct InFlight {
    captured_us: Micros,
    arrived_us: Option<Micros>,
    /// When the core received it.
    begun_us: Micros,
    /// Time from the capture of its first picture to the tick; `None` without patches.
    early_us: Option<Micros>,
}

/// The next tick.
pub(super) enum NextTick {
    /// It is in the core, and there is nothing to wait for.
    InCore,
    /// It is not due before this time.
    At(Micros),
    /// It is due, for the core.
    Due(Job),
}

/// The ticks that are not stepped yet.
pub(super) struct OpenTicks {
    pub(super) time: TickTime,
    pub(super) gather: LiveGather,
    queue: TickQueue,
    pub(super) target: TargetLatency,
    /// The longest wait for a tick.
    deadline_us: Micros,
    /// Per open tick, the arrival of its last message.
    arrived: BTreeMap<Tick, Micros>,
    /// Sets of earlier ticks, for the smoother.
    late: Vec<PatchSet>,
    pub(super) shedding: LiveShedding,
    in_flight: Option<InFlight>,
    /// Running mean of the time from a tick to sending its boxes, microseconds.
    publish_us: f64,
    /// Buffer: for each view of each person, the expected time from a tick to its patches.
    patches_come: Vec<(PersonId, Option<Micros>)>,
    /// The last next tick with enough sightings, and the time since when it has enough.
    enough_sightings: Option<(Tick, Micros)>,
    /// The last finished tick.
    pub(super) last: Option<Tick>,
    /// Ticks stepped without input because the core was behind.
    pub(super) without_input: u64,
}

impl OpenTicks {
    pub(super) fn new(venue: &Venue, session: SessionId, time: TickTime, first: Tick) -> Self {
        let ticks = |seconds: f64| (seconds * venue.rate_hz).ceil() as usize;
        let n_viewpoints = venue.viewpoints.len();
        let ranges = [ticks(LATE_S), ticks(OPEN_S)];
        let link = &venue.parameters.link;
        Self {
            time,
            gather: LiveGather::new(session, first, n_viewpoints, ranges),
            queue: TickQueue::default(),
            target: TargetLatency::new(link.target_latency_ms),
            deadline_us: (link.deadline_ms * 1e3) as Micros,
            arrived: BTreeMap::new(),
            late: Vec::new(),
            shedding: LiveShedding::default(),
            in_flight: None,
            publish_us: 0.0,
            patches_come: Vec::new(),
            enough_sightings: None,
            last: None,
            without_input: 0,
        }
    }

    /// Whether the core works on a tick.
    pub(super) fn is_in_core(&self) -> bool {
        self.in_flight.is_some()
    }

    /// Records that a message of `tick` has arrived.
    pub(super) fn note_arrival(&mut self, tick: Tick, at_us: Micros) {
        let last_us = self.arrived.entry(tick).or_insert(at_us);
        *last_us = at_us.max(*last_us);
    }

    /// Keeps a set that came after its tick for the smoother.
    pub(super) fn keep_late(&mut self, set: PatchSet) {
        if self.late.len() < MAX_LATE {
            self.late.push(set);
        }
    }

    /// Discards the arrivals of ticks that are never stepped.
    pub(super) fn forget_arrivals(&mut self) {
        let next = self.gather.next();
        self.arrived.retain(|tick, _| *tick >= next);
    }

    /// The next tick at `now_us`; `newest` are the last boxes.
    pub(super) fn next(
        &mut self,
        viewpoints: &mut Viewpoints<'_>,
        newest: &[BoxSet],
        now_us: Micros,
    ) -> NextTick {
        if self.in_flight.is_some() {
            return NextTick::InCore;
        }
        let tick = self.gather.next();
        let waiting = self.waiting(tick, viewpoints, newest, now_us);
        let next = self.queue.next(self.time.at(tick), waiting, now_us);
        if let Next::WaitUntil(us) = next {
            return NextTick::At(us);
        }
        for (index, edge) in viewpoints.edges.iter_mut().enumerate() {
            if !self.gather.has_any(tick, ViewpointIndex(index as u16)) {
                edge.miss(tick);
            }
        }
        self.note_left_out(tick, viewpoints, now_us);
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
        let period_us = self.time.period_us();
        (self.shedding).trim(&mut group, viewpoints.edges.len(), period_us);
        self.queue.stepped();
        let earliest_us = earliest_capture_us(&group);
        self.in_flight = Some(InFlight {
            captured_us: self.time.at(tick) + earliest_us.unwrap_or(0),
            arrived_us,
            begun_us: now_us,
            early_us: earliest_us.map(|us| -us),
        });
        NextTick::Due(Job {
            group,
            late: std::mem::take(&mut self.late),
            horizons: self.horizons(&mut viewpoints.edges, tick, now_us),
        })
    }

    /// Ticks ahead of which the boxes are made, by viewpoint.
    fn horizons(&self, edges: &mut [Edge], tick: Tick, now_us: Micros) -> Vec<f64> {
        let (publish_us, period_us) = (self.publish_us, self.time.period_us());
        // If a tick is later than usual, as after a detection pass, its boxes are made for ticks later by the same amount.
        let later_us = ((now_us - self.time.at(tick)) as f64 - publish_us).max(0.0);
        let later_ticks = (later_us / period_us).floor();
        let horizons = edges
            .iter_mut()
            .map(|edge| edge.horizon_ticks(publish_us, period_us) + later_ticks)
            .map(|ticks| ticks.min(LONGEST as f64));
        horizons.collect()
    }

    /// Records that the results of `tick` were sent at `now_us`.
    pub(super) fn posed(&mut self, tick: Tick, now_us: Micros, delays: &mut Delays) {
        let after_us = (now_us - self.time.at(tick)) as f64;
        let weight = if self.publish_us > 0.0 { WEIGHT } else { 1.0 };
        self.publish_us += weight * (after_us - self.publish_us);
        let Some(flight) = self.in_flight.take() else {
            return;
        };
        delays.pose(flight.captured_us, flight.arrived_us, now_us);
        if let Some(early_us) = flight.early_us {
            let posed = PosedTick {
                latency_us: now_us - flight.captured_us,
                solving_us: now_us - flight.begun_us,
                early_us,
            };
            self.target.posed(posed, now_us);
        }
    }

    fn waiting(
        &mut self,
        tick: Tick,
        viewpoints: &mut Viewpoints<'_>,
        newest: &[BoxSet],
        now_us: Micros,
    ) -> Waiting {
        let most = self.needed_waits(tick, viewpoints, newest, now_us);
        let waits = self.target.longest_waits(most, now_us);
        let edges = 0..viewpoints.edges.len();
        let deadlines =
            edges.filter_map(|index| self.deadline_of(index, tick, viewpoints, now_us, waits));
        deadlines.max().map_or(Waiting::ForNone, Waiting::Until)
    }

    /// How long `tick` waits for enough views of each person and enough sightings.
    fn needed_waits(
        &mut self,
        tick: Tick,
        viewpoints: &mut Viewpoints<'_>,
        newest: &[BoxSet],
        now_us: Micros,
    ) -> LongestWaits {
        let period_us = self.time.period_us() as Micros;
        let mut arrivals = std::mem::take(&mut self.patches_come);
        arrivals.clear();
        for set in newest {
            let index = usize::from(set.viewpoint.0);
            if set.persons.is_empty() || !viewpoints.is_awaited(index, now_us) {
                continue;
            }
            let us = viewpoints.edges[index].patches_come_us(now_us);
            arrivals.extend(set.persons.iter().map(|boxes| (boxes.person, us)));
        }
        let patches_us = needed(&mut arrivals, period_us, self.deadline_us);
        self.patches_come = arrivals;
        LongestWaits {
            patches_us,
            detections_us: self.deadline_us,
            enough_since_us: self.enough_sightings_since_us(tick, viewpoints, now_us),
        }
    }

    fn enough_sightings_since_us(
        &mut self,
        tick: Tick,
        viewpoints: &Viewpoints<'_>,
        now_us: Micros,
    ) -> Option<Micros> {
        let edges = viewpoints.edges.iter().enumerate();
        let detecting = edges
            .filter(|(index, edge)| edge.looks_at(tick) && viewpoints.is_awaited(*index, now_us))
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

    /// The deadline for the edge of viewpoint `index`; `None` if it is not awaited or has sent everything.
    fn deadline_of(
        &self,
        index: usize,
        tick: Tick,
        viewpoints: &mut Viewpoints<'_>,
        now_us: Micros,
        waits: LongestWaits,
    ) -> Option<Micros> {
        let viewpoint = ViewpointIndex(index as u16);
        let has_all = self.gather.has_all(tick, viewpoint);
        let is_missing = viewpoints.is_awaited(index, now_us) && !has_all;
        // If the other edges suffice, an edge that will be too late is not awaited at all.
        let is_bounded = waits.patches_us < self.deadline_us;
        let edge = &mut viewpoints.edges[index];
        let is_hopeless =
            is_bounded && !edge.looks_at(tick) && edge.is_later_than(waits.patches_us, now_us);
        let is_missing = is_missing && !is_hopeless && edge.works_on(tick);
        is_missing.then(|| edge.deadline_us(tick, &self.time, now_us, waits))
    }

    /// Records the edges that a tick over at `now_us` did not wait for.
    fn note_left_out(&mut self, tick: Tick, viewpoints: &mut Viewpoints<'_>, now_us: Micros) {
        let waits = LongestWaits::same(self.deadline_us);
        let n_edges = viewpoints.edges.len();
        let mut is_left_out = |index| {
            let until_us = self.deadline_of(index, tick, viewpoints, now_us, waits);
            let is_left_out = until_us.is_some_and(|us| us > now_us);
            (viewpoints.is_awaited(index, now_us)).then_some(is_left_out)
        };
        let left_out: Vec<Option<bool>> = (0..n_edges).map(&mut is_left_out).collect();
        self.target.over(&left_out);
    }
}

/// The earliest capture of a tick's pictures relative to the tick; `None` without patches.
fn earliest_capture_us(group: &TickGroup) -> Option<Micros> {
    let patches = group.patch_sets.iter().flat_map(|set| &set.persons);
    let earliest = patches.map(|patch| patch.capture_offset_us).min();
    earliest.map(Micros::from)
}
