//! What passed over the links: bytes and messages per viewpoint, counted as payload.

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
    /// Bytes of the poses, to whoever listens.
    pub(in crate::node) pose_bytes: u64,
    /// Messages that did not belong to the tick, or came twice.
    pub(in crate::node) refused: u64,
    /// Patches that were readable, but made no sense.
    pub(in crate::node) unusable: u64,
    events: EventCounts,
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

    /// Counts what changed who is who at `tick`; the message that says it, when anything did.
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

    /// How often which event happened.
    pub(in crate::node) fn event_counts(&self) -> &EventCounts {
        &self.events
    }

    /// Bytes in both directions, poses included.
    pub(in crate::node) fn total_bytes(&self) -> u64 {
        let links = self
            .links
            .iter()
            .map(|l| l.patch_bytes + l.sighting_bytes + l.box_bytes);
        links.sum::<u64>() + self.pose_bytes
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
