//! Traffic of the links: bytes and messages per viewpoint, counted as payload.

use std::collections::BTreeMap;

use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::identity_event::{IdentityEvent, IdentityEventSet};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

use crate::export::summary::{EventCounts, LinkSummary};

/// Payload of all links since the start of a run.
#[derive(Debug, Clone, Default)]
pub(in crate::node) struct Tally {
    names: Vec<String>,
    links: Vec<LinkSummary>,
    /// Bytes of the poses, counted once for all subscribers.
    pub(in crate::node) pose_bytes: u64,
    /// Messages of another tick, or repeated.
    pub(in crate::node) refused: u64,
    /// Readable patches with invalid contents.
    pub(in crate::node) unusable: u64,
    events: EventCounts,
}

/// Payload since the start of a run, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::node) struct PassedBytes {
    /// In both directions, poses included.
    pub(in crate::node) total: u64,
    /// Sent by the edges: patches and sightings.
    pub(in crate::node) from_edges: u64,
}

impl Tally {
    pub(in crate::node) fn new(venue: &Venue) -> Self {
        let names: Vec<String> = venue.viewpoints.iter().map(|v| v.name.clone()).collect();
        let links = vec![LinkSummary::default(); names.len()];
        Self {
            names,
            links,
            pose_bytes: 0,
            unusable: 0,
            events: EventCounts::default(),
            refused: 0,
        }
    }

    pub(in crate::node) fn patches(
        &mut self,
        viewpoint: ViewpointIndex,
        persons: usize,
        bytes: u64,
    ) {
        if let Some(link) = self.links.get_mut(usize::from(viewpoint.0)) {
            link.patch_messages += 1;
            link.patch_bytes += bytes;
            link.patches += persons as u64;
        }
    }

    pub(in crate::node) fn sightings(&mut self, viewpoint: ViewpointIndex, bytes: u64) {
        if let Some(link) = self.links.get_mut(usize::from(viewpoint.0)) {
            link.sighting_messages += 1;
            link.sighting_bytes += bytes;
        }
    }

    pub(in crate::node) fn boxes(&mut self, viewpoint: ViewpointIndex, bytes: u64) {
        if let Some(link) = self.links.get_mut(usize::from(viewpoint.0)) {
            link.box_messages += 1;
            link.box_bytes += bytes;
        }
    }

    /// Counts identity events of `tick`; returns their message, if there are any.
    pub(in crate::node) fn events(
        &mut self,
        session: SessionId,
        tick: Tick,
        events: Vec<IdentityEvent>,
    ) -> Option<IdentityEventSet> {
        self.events.count(&events);
        (!events.is_empty()).then_some(IdentityEventSet {
            session,
            tick,
            events,
        })
    }

    /// Counts of the events.
    pub(in crate::node) fn event_counts(&self) -> &EventCounts {
        &self.events
    }

    /// Bytes so far.
    pub(in crate::node) fn bytes(&self) -> PassedBytes {
        let from_edges = self.links.iter().map(|l| l.patch_bytes + l.sighting_bytes);
        let from_edges: u64 = from_edges.sum();
        let boxes: u64 = self.links.iter().map(|l| l.box_bytes).sum();
        PassedBytes {
            total: from_edges + boxes + self.pose_bytes,
            from_edges,
        }
    }

    /// By name of the viewpoint.
    pub(in crate::node) fn links(&self) -> BTreeMap<String, LinkSummary> {
        self.names
            .iter()
            .cloned()
            .zip(self.links.iter().copied())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::live::tests::venue;

    /// Symptom: the demo counted boxes and poses as sent by viewpoints, five times too much.
    #[test]
    fn bytes_of_the_edges_are_counted_apart_from_those_of_fusion() {
        let mut tally = Tally::new(&venue());
        tally.patches(ViewpointIndex(0), 4, 1_000);
        tally.sightings(ViewpointIndex(1), 200);
        tally.boxes(ViewpointIndex(1), 30);
        tally.pose_bytes += 4;
        let expected = PassedBytes {
            total: 1_234,
            from_edges: 1_200,
        };
        assert_eq!(tally.bytes(), expected);
    }
}
