//! Reception in a live run: every message counts for the clock and the delays of its edge. Sets of edges that take part wait for
//! their tick.

use farfield_fusion::align::Refused;
use farfield_fusion::live::Micros;
use farfield_fusion::live::cameras::in_words;
use farfield_fusion::live::edge::Came;
use farfield_fusion::live::gather::Taken;
use farfield_fusion::live::membership::StatusChange;
use farfield_node::process::say;
use farfield_proto::message::{PatchSet, SightingSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use tracing::debug;

use super::run::LiveFusion;
use super::start::note_present;
use crate::session::link::FusionEnds;
use crate::session::messages::{Arrival, FusionIncoming, Liveliness};

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
                note_present(&self.config.venue, &mut self.viewpoints.present, node);
            }
            FusionIncoming::Alive(node, Liveliness::Gone) => {
                self.viewpoints.present.remove(&node);
                if let Some(index) = self.viewpoints.members.leave(&node) {
                    self.viewpoints.edges[index].leave();
                    say(format_args!("viewpoint {node} has left"));
                }
            }
            FusionIncoming::Unreadable(key, error) => {
                let node = key.rsplit('/').next().unwrap_or_default();
                let viewpoint = self.config.venue.viewpoint_named(node);
                match viewpoint.and_then(|v| self.viewpoints.edges.get_mut(usize::from(v.0))) {
                    Some(edge) => edge.cannot_read(&error),
                    None => self.viewpoints.unreadable += 1,
                }
            }
        }
    }

    fn receive_patches(&mut self, set: PatchSet, arrival: Arrival) {
        let (index, tick) = (usize::from(set.viewpoint.0), set.tick);
        if set.session != self.session || index >= self.viewpoints.edges.len() {
            self.outbox.tally.refused += 1;
            return;
        }
        let came = as_came(arrival);
        self.outbox
            .tally
            .patches(set.viewpoint, set.persons.len(), came.bytes);
        let trip = self.viewpoints.edges[index].receive_patches(&set, came, &self.ticks.time);
        self.delays.trip(index, trip);
        if tick < self.first {
            // The edges started before the first tick: only the clock data are useful.
            return;
        }
        if !self.viewpoints.takes_part(index) {
            self.outbox.tally.refused += 1;
            return;
        }
        let was_missing = !self.ticks.gather.has_any(tick, set.viewpoint);
        match self.ticks.gather.add_patches(set, came.bytes) {
            Taken::Open => self.ticks.note_arrival(tick, came.at_us),
            Taken::Late(set) => {
                let edge = &mut self.viewpoints.edges[index];
                edge.late += 1;
                if was_missing {
                    edge.missing = edge.missing.saturating_sub(1);
                }
                self.ticks.keep_late(set);
            }
            Taken::Refused(reason) => self.refuse(reason),
        }
    }

    fn receive_sightings(&mut self, set: SightingSet, arrival: Arrival) {
        let (index, tick) = (usize::from(set.viewpoint.0), set.tick);
        if set.session != self.session || index >= self.viewpoints.edges.len() {
            self.outbox.tally.refused += 1;
            return;
        }
        let came = as_came(arrival);
        self.outbox.tally.sightings(set.viewpoint, came.bytes);
        self.viewpoints.edges[index].receive_sightings(&set, came, &self.ticks.time);
        if tick < self.first {
            return;
        }
        if !self.viewpoints.takes_part(index) {
            self.outbox.tally.refused += 1;
            return;
        }
        match self.ticks.gather.add_sightings(set, came.bytes) {
            Taken::Open => self.ticks.note_arrival(tick, came.at_us),
            Taken::Late(_) => {
                self.viewpoints.edges[index].late += 1;
                self.report_late_detection(tick, index, came.at_us);
            }
            Taken::Refused(reason) => self.refuse(reason),
        }
    }

    /// Reports once that an edge's detection passes come too late: without them no tracks start.
    fn report_late_detection(&mut self, tick: Tick, index: usize, at_us: Micros) {
        let after_ms = (at_us - self.ticks.time.at(tick)) / 1000;
        let deadline_ms = self.config.venue.parameters.link.deadline_ms;
        let Some(late) = self.viewpoints.late_detections.get_mut(index) else {
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
        self.outbox.tally.refused += 1;
    }

    fn receive_status(&mut self, status: &Status) {
        let cameras = status.live.as_ref().map(|live| live.cameras.as_slice());
        let cameras = cameras.unwrap_or_default();
        match self
            .viewpoints
            .members
            .update(status, self.interceptor.clock.now_us())
        {
            StatusChange::Nothing => {}
            StatusChange::NewNode(index) => {
                self.viewpoints.edges[index].start_again();
                self.viewpoints.edges[index].expect(self.viewpoints.expect_until_us);
                self.viewpoints.cameras.begin(cameras);
                debug!(node = status.node, "another process of this node");
                if let Some(warning) = self.viewpoints.members.other_backend(index) {
                    say(format_args!("viewpoint {}: {warning}", status.node));
                }
            }
            StatusChange::Unknown => {
                debug!(node = status.node, "not a viewpoint of the venue");
                return;
            }
        }
        for notice in self.viewpoints.cameras.update(cameras) {
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
}

fn as_came(arrival: Arrival) -> Came {
    Came {
        at_us: arrival.at_us,
        bytes: arrival.bytes,
    }
}
