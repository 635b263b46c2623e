//! Traffic of the links: bytes and messages per viewpoint, counted as payload.

use std::collections::BTreeMap;

use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::identity_event::{IdentityEvent, IdentityEventSet};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

use farfield_fusion::export::summary::{EventCounts, LinkSummary};

/// Payload of all links since the start of a run.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    names: Vec<String>,
    links: Vec<LinkSummary>,
    /// Bytes of the poses, counted once for all subscribers.
    pub(crate) pose_bytes: u64,
    /// Messages of another tick, or repeated.
    pub(crate) refused: u64,
    /// Readable patches with invalid contents.
    pub(crate) unusable: u64,
    events: EventCounts,
}

/// Payload since the start of a run, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PassedBytes {
    /// In both directions, poses included.
    pub(crate) total: u64,
    /// Sent by the edges: patches and sightings.
    pub(crate) from_edges: u64,
}

impl Tally {
    pub(crate) fn new(venue: &Venue) -> Self {
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

    pub(crate) fn patches(&mut self, viewpoint: ViewpointIndex, persons: usize, bytes: u64) {
        if let Some(link) = self.links.get_mut(usize::from(viewpoint.0)) {
            link.patch_messages += 1;
            link.patch_bytes += bytes;
            link.patches += persons as u64;
        }
    }

    pub(crate) fn sightings(&mut self, viewpoint: ViewpointIndex, bytes: u64) {
        if let Some(link) = self.links.get_mut(usize::from(viewpoint.0)) {
            link.sighting_messages += 1;
            link.sighting_bytes += bytes;
        }
    }

    pub(crate) fn boxes(&mut self, viewpoint: ViewpointIndex, bytes: u64) {
        if let Some(link) = self.links.get_mut(usize::from(viewpoint.0)) {
            link.box_messages += 1;
            link.box_bytes += bytes;
        }
    }

    /// Counts identity events of `tick`; returns their message, if there are any.
    pub(crate) fn events(
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
    pub(crate) fn event_counts(&self) -> &EventCounts {
        &self.events
    }

    /// Bytes so far.
    pub(crate) fn bytes(&self) -> PassedBytes {
        let from_edges = self.links.iter().map(|l| l.patch_bytes + l.sighting_bytes);
        let from_edges: u64 = from_edges.sum();
        let boxes: u64 = self.links.iter().map(|l| l.box_bytes).sum();
        PassedBytes {
            total: from_edges + boxes + self.pose_bytes,
            from_edges,
        }
    }

    /// By name of the viewpoint.
    pub(crate) fn links(&self) -> BTreeMap<String, LinkSummary> {
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
    use crate::live::tests::venue;

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
