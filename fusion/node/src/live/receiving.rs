//! Reception in a live run: every message counts for the clock and the delays of its edge. Sets of edges that take part wait for
//! their tick.

use farfield_fusion::align::Refused;
use farfield_fusion::live::Micros;
use farfield_fusion::live::cameras::in_words;
use farfield_fusion::live::edge::Came;
use farfield_fusion::live::gather::Taken;
use farfield_fusion::live::membership::StatusChange;
use farfield_node::process::say;
use farfield_proto::message::live::EdgeLink;
use farfield_proto::message::{PatchSet, SightingSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use tracing::debug;

use super::run::LiveFusion;
use super::start::note_present;
use crate::session::link::FusionEnds;
use crate::session::messages::{Arrival, FusionIncoming, Liveliness};

/// Late sets queued for the smoother's next step; if there are more, the newest are dropped.
const MAX_LATE: usize = 256;

impl LiveFusion<'_> {
    /// Receives until `done`: a full queue would also delay answers to other requests.
    pub(super) async fn receive_until(
        &mut self,
        ends: &mut FusionEnds,
        done: impl Future<Output = ()>,
    ) {
        tokio::pin!(done);
        loop {
            tokio::select! {
                () = &mut done => return,
                Some(incoming) = ends.incoming.recv() => self.receive(incoming),
            }
        }
    }

    pub(super) fn receive(&mut self, incoming: FusionIncoming) {
        match incoming {
            FusionIncoming::Patches(set, arrival) => self.receive_patches(set, arrival),
            FusionIncoming::Sightings(set, arrival) => self.receive_sightings(set, arrival),
            // Fusion also receives its own status.
            FusionIncoming::Status(status) if status.node == FUSION => {}
            FusionIncoming::Status(status) => self.receive_status(&status),
            FusionIncoming::Alive(node, Liveliness::There) => {
                note_present(&self.config.venue, &mut self.present, node);
            }
            FusionIncoming::Alive(node, Liveliness::Gone) => {
                self.present.remove(&node);
                if let Some(index) = self.members.leave(&node) {
                    self.edges[index].leave();
                    say(format_args!("viewpoint {node} has left"));
                }
            }
            FusionIncoming::Unreadable(key, error) => {
                let node = key.rsplit('/').next().unwrap_or_default();
                let viewpoint = self.config.venue.viewpoint_named(node);
                match viewpoint.and_then(|v| self.edges.get_mut(usize::from(v.0))) {
                    Some(edge) => edge.cannot_read(&error),
                    None => self.unreadable += 1,
                }
            }
        }
    }

    fn receive_patches(&mut self, set: PatchSet, arrival: Arrival) {
        let (index, tick) = (usize::from(set.viewpoint.0), set.tick);
        if set.session != self.session || index >= self.edges.len() {
            self.tally.refused += 1;
            return;
        }
        let came = as_came(arrival);
        self.tally
            .patches(set.viewpoint, set.persons.len(), came.bytes);
        let trip = self.edges[index].receive_patches(&set, came, &self.time);
        self.delays.trip(index, trip);
        if tick < self.first {
            // The edges started before the first tick: only the clock data are useful.
            return;
        }
        if !self.takes_part(index) {
            self.tally.refused += 1;
            return;
        }
        let was_missing = !self.gather.has_any(tick, set.viewpoint);
        match self.gather.add_patches(set, came.bytes) {
            Taken::Open => self.note_arrival(tick, came.at_us),
            Taken::Late(set) => {
                let edge = &mut self.edges[index];
                edge.late += 1;
                if was_missing {
                    edge.missing = edge.missing.saturating_sub(1);
                }
                self.keep_late(set);
            }
            Taken::Refused(reason) => self.refuse(reason),
        }
    }

    fn receive_sightings(&mut self, set: SightingSet, arrival: Arrival) {
        let (index, tick) = (usize::from(set.viewpoint.0), set.tick);
        if set.session != self.session || index >= self.edges.len() {
            self.tally.refused += 1;
            return;
        }
        let came = as_came(arrival);
        self.tally.sightings(set.viewpoint, came.bytes);
        self.edges[index].receive_sightings(&set, came, &self.time);
        if tick < self.first {
            return;
        }
        if !self.takes_part(index) {
            self.tally.refused += 1;
            return;
        }
        match self.gather.add_sightings(set, came.bytes) {
            Taken::Open => self.note_arrival(tick, came.at_us),
            Taken::Late(_) => {
                self.edges[index].late += 1;
                self.report_late_detection(tick, index, came.at_us);
            }
            Taken::Refused(reason) => self.refuse(reason),
        }
    }

    /// Reports once that an edge's detection passes come too late: without them no tracks start.
    fn report_late_detection(&mut self, tick: Tick, index: usize, at_us: Micros) {
        let after_ms = (at_us - self.time.at(tick)) / 1000;
        let deadline_ms = self.config.venue.parameters.link.deadline_ms;
        let Some(late) = self.late_detections.get_mut(index) else {
            return;
        };
        if late.is_warning_due(after_ms as f64, deadline_ms, at_us) {
            let name = &self.config.venue.viewpoints[index].name;
            say(format_args!(
                "viewpoint {name}: the sightings of its detection passes arrive {after_ms} ms after their ticks, but `deadline_ms` in [link] is {deadline_ms:.0}, so they are not used; raise it, or find out why that edge is slow"
            ));
        }
    }

    fn refuse(&mut self, reason: Refused) {
        debug!(%reason, "message refused");
        self.tally.refused += 1;
    }

    fn note_arrival(&mut self, tick: Tick, at_us: Micros) {
        let last_us = self.arrived.entry(tick).or_insert(at_us);
        *last_us = at_us.max(*last_us);
    }

    pub(super) fn keep_late(&mut self, set: PatchSet) {
        if self.late.len() < MAX_LATE {
            self.late.push(set);
        }
    }

    fn receive_status(&mut self, status: &Status) {
        let cameras = status.live.as_ref().map(|live| live.cameras.as_slice());
        let cameras = cameras.unwrap_or_default();
        match self.members.update(status, self.interceptor.clock.now_us()) {
            StatusChange::Nothing => {}
            StatusChange::NewNode(index) => {
                self.edges[index].start_again();
                self.edges[index].expect(self.expect_until_us);
                self.cameras.begin(cameras);
                debug!(node = status.node, "another process of this node");
                if let Some(warning) = self.members.other_backend(index) {
                    say(format_args!("viewpoint {}: {warning}", status.node));
                }
            }
            StatusChange::Unknown => {
                debug!(node = status.node, "not a viewpoint of the venue");
                return;
            }
        }
        for notice in self.cameras.update(cameras) {
            let camera = self.config.venue.camera(notice.camera);
            let name = camera.map_or("?", |camera| camera.model.name());
            let why = notice
                .reason
                .map_or_else(String::new, |why| format!(": {why}"));
            say(format_args!(
                "viewpoint {}: camera {name} {}{why}",
                status.node,
                in_words(notice.health)
            ));
        }
    }

    /// Prints changes of the refusals, once each.
    pub(super) fn report_refusals(&mut self, links: &[EdgeLink]) {
        for (reported, link) in self.refusals.iter_mut().zip(links) {
            // Only the presence is compared: numbers in the reason change all the time.
            if reported.is_some() != link.refused.is_some() {
                match &link.refused {
                    Some(why) => say(format_args!("viewpoint {}: {why}", link.viewpoint)),
                    None => say(format_args!("viewpoint {} is accepted", link.viewpoint)),
                }
                reported.clone_from(&link.refused);
            }
        }
    }
}

fn as_came(arrival: Arrival) -> Came {
    Came {
        at_us: arrival.at_us,
        bytes: arrival.bytes,
    }
}
