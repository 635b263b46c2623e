//! Sending in a live run: boxes and poses of every tick, and the end order.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use farfield_fusion::live::target_latency::PosedTick;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::naming::NamingSet;
use farfield_proto::message::parts::box_messages;
use farfield_proto::message::{BoxSet, Order, PoseSet, Status};
use farfield_proto::wire;
use tokio::time::{MissedTickBehavior, interval, timeout};
use tracing::warn;

use super::super::worker::Stepped;
use super::run::LiveFusion;
use crate::output::tally::PassedBytes;
use crate::session::link::FusionEnds;
use crate::session::messages::{FusionIncoming, FusionOutgoing, Liveliness};

/// Weight of one tick in the mean time from a tick to sending its boxes.
const WEIGHT: f64 = 0.05;
/// Time for the edges to send their last status.
const FAREWELL: Duration = Duration::from_secs(3);
/// Interval of repeating the end order to edges that are still present.
const END_EVERY: Duration = Duration::from_millis(100);

impl LiveFusion<'_> {
    /// Publishes a tick: boxes first, as edges wait for them. Returns the poses and the bytes so far.
    pub(super) fn publish(
        &mut self,
        stepped: Stepped,
        ends: &FusionEnds,
    ) -> Option<(PoseSet, PassedBytes)> {
        let Stepped {
            poses,
            smoothed,
            events,
            namings,
            boxes,
            unusable,
            stages,
            cost,
            people,
            agreement,
        } = stepped;
        if let Some(cost) = cost {
            self.shedding.stepped(cost);
        }
        let tick = poses.tick;
        self.last = Some(tick);
        self.tally.unusable += u64::from(unusable);
        if let Some(stages) = stages {
            self.core_stages = stages;
        }
        if let Some(people) = people {
            if let Some(on_demand) = self.on_demand {
                on_demand.set_people(&people);
            }
            if let Some(handover) = &self.handover {
                handover.save(tick, people);
            }
        }
        if let (Some(judge), Some(samples)) = (&self.agreement, agreement) {
            judge.judge(samples);
        }
        self.send_boxes(boxes, ends);
        let bytes = wire::encode(&poses);
        self.tally.pose_bytes += bytes.len() as u64;
        self.send(ends, FusionOutgoing::Poses(bytes));
        for set in &smoothed {
            self.send(ends, FusionOutgoing::Smooth(wire::encode(set)));
        }
        if let Some(events) = self.tally.events(self.session, tick, events) {
            self.send(ends, FusionOutgoing::Events(wire::encode(&events)));
        }
        if let Some(namings) = NamingSet::of(self.session, tick, namings) {
            self.send(ends, FusionOutgoing::Namings(wire::encode(&namings)));
        }
        let now_us = self.interceptor.clock.now_us();
        let after_us = (now_us - self.time.at(tick)) as f64;
        let weight = if self.publish_us > 0.0 { WEIGHT } else { 1.0 };
        self.publish_us += weight * (after_us - self.publish_us);
        let flight = self.in_flight.take()?;
        self.delays
            .pose(flight.captured_us, flight.arrived_us, now_us);
        if let Some(early_us) = flight.early_us {
            let posed = PosedTick {
                latency_us: now_us - flight.captured_us,
                solving_us: now_us - flight.begun_us,
                early_us,
            };
            self.target.posed(posed, now_us);
        }
        Some((poses, self.tally.bytes()))
    }

    pub(super) fn send_boxes(&mut self, sets: Vec<BoxSet>, ends: &FusionEnds) {
        self.newest = sets;
        self.send_newest(ends, false);
    }

    /// Sends the newest boxes; `again` as a sign of life, also to edges that are not due.
    pub(super) fn send_newest(&mut self, ends: &FusionEnds, again: bool) {
        let now_us = self.interceptor.clock.now_us();
        self.sent_us = now_us;
        let mut sets = std::mem::take(&mut self.newest);
        for set in &mut sets {
            let index = usize::from(set.viewpoint.0);
            if !self.members.is_welcome(index) {
                // A refused edge still gets the clock and the reason.
                set.persons.clear();
                set.detection_cameras.clear();
            }
            if !again && !self.edges[index].is_sent(set) {
                continue;
            }
            set.live = Some(self.edges[index].send(set, &self.time, now_us));
            for bytes in box_messages(set, self.interceptor.version_for(index)) {
                self.edges[index].sent_bytes(bytes.len());
                self.tally.boxes(set.viewpoint, bytes.len() as u64);
                self.send(ends, FusionOutgoing::Boxes(index, bytes));
            }
        }
        self.newest = sets;
    }

    pub(super) fn send(&mut self, ends: &FusionEnds, message: FusionOutgoing) {
        if ends.outgoing.try_send(message).is_err() {
            self.unsent += 1;
        }
    }

    /// Announces that no more ticks follow, so that silence while files are finished is not taken for a failure.
    pub(super) fn announce_end(&mut self, ends: &FusionEnds) {
        let now_us = self.interceptor.clock.now_us();
        let status = Status {
            ready: false,
            ..self.status(self.config, now_us)
        };
        self.send(ends, FusionOutgoing::Status(Box::new(status)));
    }

    /// Sends the end order to the edges, and waits for their last statuses.
    pub(super) async fn end_edges(&mut self, ends: &mut FusionEnds) -> Vec<Status> {
        let all: BTreeSet<String> = self.names().map(str::to_owned).collect();
        self.send_end(&all, ends);
        let mut last_words: BTreeMap<String, Status> = BTreeMap::new();
        let mut repeats = interval(END_EVERY);
        repeats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        repeats.reset();
        let last_statuses = async {
            while !self.present.is_empty() {
                tokio::select! {
                    // The link may lose the order.
                    _ = repeats.tick() => {
                        let present = self.present.clone();
                        self.send_end(&present, ends);
                    }
                    incoming = ends.incoming.recv() => match incoming {
                        Some(FusionIncoming::Status(status)) if status.viewpoint.is_some() => {
                            last_words.insert(status.node.clone(), *status);
                        }
                        Some(FusionIncoming::Alive(node, Liveliness::Gone)) => drop(self.present.remove(&node)),
                        Some(_) => {}
                        None => break,
                    }
                }
            }
        };
        if timeout(FAREWELL, last_statuses).await.is_err() {
            warn!(still = ?self.present, "not every edge has left");
        }
        for status in self.last_words() {
            last_words.entry(status.node.clone()).or_insert(status);
        }
        last_words.into_values().collect()
    }

    /// The last statuses of the edges, by name.
    pub(super) fn last_words(&self) -> Vec<Status> {
        let mut words: Vec<Status> = self.members.last_words().cloned().collect();
        words.sort_by(|a, b| a.node.cmp(&b.node));
        words
    }

    fn send_end(&mut self, to: &BTreeSet<String>, ends: &FusionEnds) {
        let tick = self.gather.next();
        for index in 0..self.edges.len() {
            if !to.contains(&self.config.venue.viewpoints[index].name) {
                continue;
            }
            let mut set = BoxSet {
                session: self.session,
                tick,
                viewpoint: ViewpointIndex(index as u16),
                part: 0,
                parts: 1,
                order: Order::End,
                live: None,
                detection_cameras: Vec::new(),
                persons: Vec::new(),
            };
            let now_us = self.interceptor.clock.now_us();
            set.live = Some(self.edges[index].send(&set, &self.time, now_us));
            let bytes = wire::encode_as(&set, self.interceptor.version_for(index));
            self.send(ends, FusionOutgoing::Boxes(index, bytes));
        }
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        let viewpoints = &self.config.venue.viewpoints;
        viewpoints.iter().map(|viewpoint| viewpoint.name.as_str())
    }
}
