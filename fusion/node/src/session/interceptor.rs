//! The checks that every message passes: the right of the sender, the time, and copies to the observers.

use std::sync::Arc;

use farfield_node::clock::VenueClock;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::Status;
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::venue::Venue;
use farfield_proto::wire::{SpokenVersion, VERSION};

use super::messages::Arrival;
use super::quota::Quota;
use super::recorded_sets::{RecordedSets, SetMessage};
use super::wiretap::{CopiedMessage, CopiedStep, WiretapHandle};

/// The senders: the viewpoints by index, and then all others as one.
#[derive(Debug, Clone)]
pub(crate) struct Senders {
    names: Arc<[String]>,
    quotas: Arc<[Quota]>,
    clock: VenueClock,
}

impl Senders {
    /// The senders of `venue`; `clock` measures their rates.
    pub(crate) fn new(venue: &Venue, clock: VenueClock) -> Self {
        let budget = venue.parameters.link.budget_bytes_per_s;
        Self {
            names: venue.viewpoints.iter().map(|v| v.name.clone()).collect(),
            quotas: (0..=venue.viewpoints.len())
                .map(|_| Quota::new(budget))
                .collect(),
            clock,
        }
    }

    /// The number of senders.
    pub(super) fn len(&self) -> usize {
        self.quotas.len()
    }

    /// The sender that may publish under `key`.
    pub(super) fn index(&self, key: &str) -> usize {
        let node = key.rsplit('/').next();
        let own = self.names.iter().position(|name| node == Some(name));
        own.unwrap_or(self.names.len())
    }

    /// Whether a message of `bytes` from `sender` is within its quota; refusals are counted.
    pub(super) fn admit(&self, sender: usize, bytes: usize) -> bool {
        let quota = self.quotas.get(sender);
        quota.is_some_and(|quota| quota.admits(bytes, self.clock.now_us()))
    }

    /// Counts a message of `sender` that was dropped from a full queue.
    pub(super) fn count_lost(&self, sender: usize) {
        if let Some(quota) = self.quotas.get(sender) {
            quota.count_lost();
        }
    }
}

/// Checks and copies all messages.
#[derive(Debug, Clone)]
pub(crate) struct Interceptor {
    pub(crate) clock: VenueClock,
    pub(crate) wiretap: WiretapHandle,
    senders: Senders,
    /// The version of the messages to each edge.
    versions: Arc<[SpokenVersion]>,
    venue_hash: Arc<str>,
    /// The viewpoint of each camera.
    cameras: Arc<[ViewpointIndex]>,
    sets: Arc<RecordedSets>,
}

impl Interceptor {
    /// Uses the clock of `senders`, and copies to `wiretap`.
    pub(crate) fn new(venue: &Venue, senders: Senders, wiretap: WiretapHandle) -> Self {
        Self {
            clock: senders.clock.clone(),
            wiretap,
            senders,
            versions: venue
                .viewpoints
                .iter()
                .map(|_| SpokenVersion::default())
                .collect(),
            venue_hash: venue.hashes.venue.as_str().into(),
            sets: Arc::new(RecordedSets::new(venue.viewpoints.len(), venue.rate_hz)),
            cameras: venue
                .cameras
                .iter()
                .map(|camera| camera.viewpoint)
                .collect(),
        }
    }

    /// Whether the sender of `key` may send for `viewpoint`.
    pub(super) fn may_send_for(&self, key: &str, viewpoint: ViewpointIndex) -> bool {
        let name = self.senders.names.get(usize::from(viewpoint.0));
        name.is_some_and(|name| key.rsplit('/').next() == Some(name))
    }

    /// Whether the sender of `key` may send `status`. An edge with another venue file may number its viewpoints differently: it is
    /// accepted here, and refused by name for its file.
    pub(super) fn may_send_status(&self, key: &str, status: &Status) -> bool {
        let index = self
            .senders
            .names
            .iter()
            .position(|name| *name == status.node);
        let same_index = status.viewpoint.map(|v| usize::from(v.0)) == index;
        key.rsplit('/').next() == Some(&status.node)
            && (same_index || status.venue_hash != *self.venue_hash)
    }

    /// Whether the sender of `key` may send a picture of the camera that `thumbnail` names.
    pub(super) fn may_send_thumbnail(&self, key: &str, thumbnail: &Thumbnail) -> bool {
        let of_camera = self.cameras.get(usize::from(thumbnail.camera.0));
        of_camera == Some(&thumbnail.viewpoint) && self.may_send_for(key, thumbnail.viewpoint)
    }

    /// Records the version that the sender of a status under `key` reads.
    pub(super) fn note_version(&self, key: &str, status: &[u8], reads: Option<u8>) {
        let own = self
            .senders
            .names
            .iter()
            .position(|name| key.rsplit('/').next() == Some(name));
        if let Some(version) = own.and_then(|index| self.versions.get(index)) {
            version.note_status(status, reads);
        }
    }

    /// The version of the messages to the edge of the viewpoint with this index.
    pub(crate) fn version_for(&self, index: usize) -> u8 {
        self.versions.get(index).map_or(VERSION, SpokenVersion::get)
    }

    /// The newest version that all edges read.
    pub(super) fn common_version(&self) -> u8 {
        self.versions
            .iter()
            .map(SpokenVersion::get)
            .min()
            .unwrap_or(VERSION)
    }

    /// The arrival of a message, now.
    pub(super) fn arrived(&self, bytes: &[u8]) -> Arrival {
        Arrival {
            bytes: bytes.len() as u64,
            at_us: self.clock.now_us(),
        }
    }

    /// Copies a readable message.
    pub(super) fn received(&self, key: &str, bytes: &[u8], Arrival { at_us, .. }: Arrival) {
        self.wiretap.received(CopiedMessage { key, bytes, at_us });
    }

    /// Copies a message of a set. One that is repeated, or of another time or session, counts as unusable.
    pub(super) fn received_set(&self, key: &str, bytes: &[u8], set: &SetMessage, arrival: Arrival) {
        if self.sets.is_new(set) {
            self.received(key, bytes, arrival);
        } else {
            self.received_unusable(key, bytes, arrival);
        }
    }

    /// Copies the step of a tick of `session`.
    pub(crate) fn decided(&self, session: SessionId, step: CopiedStep<'_>) {
        self.sets.worked_on(session, step.group.tick);
        self.wiretap.decided(step);
    }

    /// Copies a thumbnail to the observers that want it.
    pub(super) fn copy_thumbnail(&self, key: &str, bytes: &[u8], Arrival { at_us, .. }: Arrival) {
        self.wiretap.thumbnail(CopiedMessage { key, bytes, at_us });
    }

    /// Copies an unusable message, one per node and second.
    pub(super) fn received_unusable(&self, key: &str, bytes: &[u8], arrival: Arrival) {
        let quota = self.senders.quotas.get(self.senders.index(key));
        if quota.is_some_and(|quota| quota.records_unusable(arrival.at_us)) {
            self.received(key, bytes, arrival);
        }
    }

    /// Messages of the viewpoint of this index that exceeded its quota.
    pub(crate) fn refused(&self, index: usize) -> u64 {
        self.senders.quotas.get(index).map_or(0, Quota::refused)
    }

    /// Messages of the viewpoint of this index that exceeded its quota or were dropped from a full queue.
    pub(crate) fn dropped(&self, index: usize) -> u64 {
        self.senders.quotas.get(index).map_or(0, Quota::dropped)
    }

    /// Copies a message that is sent.
    pub(super) fn published(&self, key: &str, bytes: &[u8]) {
        let at_us = self.clock.now_us();
        self.wiretap.published(CopiedMessage { key, bytes, at_us });
    }
}
