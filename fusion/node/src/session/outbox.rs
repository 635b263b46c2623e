//! What fusion sends: boxes, decisions and the results of every tick, with a count of their bytes.
//!
//! Sending never waits: the queue is bounded, and a message for which it has no room is counted and dropped.

use farfield_fusion::align::TickGroup;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::decision::Decision;
use farfield_proto::message::naming::NamingSet;
use farfield_proto::message::parts::box_messages;
use farfield_proto::message::{BoxSet, Order};
use farfield_proto::tick::Tick;
use farfield_proto::wire;
use tokio::sync::mpsc;

use super::interceptor::Interceptor;
use super::messages::FusionOutgoing;
use super::wiretap::CopiedStep;
use crate::output::tally::Tally;
use crate::worker::{Job, Stepped};

/// The sending side of a run.
pub(crate) struct Outbox<'a> {
    interceptor: &'a Interceptor,
    session: SessionId,
    first: Tick,
    queue: mpsc::Sender<FusionOutgoing>,
    /// Traffic of the links.
    pub(crate) tally: Tally,
    /// Messages for which the queue had no room.
    pub(crate) unsent: u64,
}

impl<'a> Outbox<'a> {
    /// For a run from the tick `first`.
    pub(crate) fn new(
        interceptor: &'a Interceptor,
        session: SessionId,
        first: Tick,
        queue: mpsc::Sender<FusionOutgoing>,
        tally: Tally,
    ) -> Self {
        Self {
            interceptor,
            session,
            first,
            queue,
            tally,
            unsent: 0,
        }
    }

    /// Sends `message`.
    pub(crate) fn send(&mut self, message: FusionOutgoing) {
        if self.queue.try_send(message).is_err() {
            self.unsent += 1;
        }
    }

    /// Sends boxes; returns their bytes.
    pub(crate) fn boxes(&mut self, set: &BoxSet) -> usize {
        let index = usize::from(set.viewpoint.0);
        let mut sent = 0;
        for bytes in box_messages(set, self.interceptor.version_for(index)) {
            sent += bytes.len();
            self.tally.boxes(set.viewpoint, bytes.len() as u64);
            self.send(FusionOutgoing::Boxes(index, bytes));
        }
        sent
    }

    /// Publishes which messages the step of `job` uses.
    pub(crate) fn decided(&mut self, job: &Job) {
        let Job {
            group,
            late,
            horizons,
        } = job;
        let step = CopiedStep {
            group,
            late,
            horizons,
        };
        self.interceptor.decided(self.session, step);
        let decision = Decision {
            horizons_ticks: horizons.clone(),
            ..TickGroup::decision(group, self.session, self.first)
        };
        self.send(FusionOutgoing::Decision(wire::encode(&decision)));
    }

    /// Publishes the poses of a tick, and what belongs to them, but not the boxes.
    pub(crate) fn results(&mut self, stepped: &mut Stepped) {
        let tick = stepped.poses.tick;
        self.tally.unusable += u64::from(stepped.unusable);
        let poses = wire::encode(&stepped.poses);
        self.tally.pose_bytes += poses.len() as u64;
        self.send(FusionOutgoing::Poses(poses));
        for set in &stepped.smoothed {
            self.send(FusionOutgoing::Smooth(wire::encode(set)));
        }
        let events = std::mem::take(&mut stepped.events);
        if let Some(events) = self.tally.events(self.session, tick, events) {
            self.send(FusionOutgoing::Events(wire::encode(&events)));
        }
        let namings = std::mem::take(&mut stepped.namings);
        if let Some(namings) = NamingSet::of(self.session, tick, namings) {
            self.send(FusionOutgoing::Namings(wire::encode(&namings)));
        }
    }

    /// Sends an end order. It is not counted: it belongs to no tick.
    pub(crate) fn end(&mut self, order: &BoxSet) {
        let index = usize::from(order.viewpoint.0);
        let bytes = wire::encode_as(order, self.interceptor.version_for(index));
        self.send(FusionOutgoing::Boxes(index, bytes));
    }

    /// The end order for `viewpoint`; `tick` is the first that is not computed.
    pub(crate) fn end_order(&self, viewpoint: ViewpointIndex, tick: Tick) -> BoxSet {
        BoxSet {
            session: self.session,
            tick,
            viewpoint,
            part: 0,
            parts: 1,
            order: Order::End,
            live: None,
            detection_cameras: Vec::new(),
            persons: Vec::new(),
        }
    }
}
