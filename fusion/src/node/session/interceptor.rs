//! What every message passes on its way in or out: who may say it, when it passed, and a copy for who records.

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

/// Who sends: the viewpoints, by their index, and behind them all others as one.
#[derive(Debug, Clone)]
pub(in crate::node) struct Senders {
    names: Arc<[String]>,
    quotas: Arc<[Quota]>,
    clock: VenueClock,
}

impl Senders {
    /// Those of `venue`; how fast they send is measured by `clock`.
    pub(in crate::node) fn new(venue: &Venue, clock: VenueClock) -> Self {
        let budget = venue.parameters.link.budget_bytes_per_s;
        Self {
            names: venue.viewpoints.iter().map(|v| v.name.clone()).collect(),
            quotas: (0..=venue.viewpoints.len())
                .map(|_| Quota::new(budget))
                .collect(),
            clock,
        }
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.quotas.len()
    }

    /// Who may publish under `key`.
    pub(super) fn index(&self, key: &str) -> usize {
        let node = key.rsplit('/').next();
        let own = self.names.iter().position(|name| node == Some(name));
        own.unwrap_or(self.names.len())
    }

    /// Whether a message of `bytes` may come from `sender` now; counted where not.
    pub(super) fn admit(&self, sender: usize, bytes: usize) -> bool {
        let quota = self.quotas.get(sender);
        quota.is_some_and(|quota| quota.admits(bytes, self.clock.now_us()))
    }

    /// Counts a message of `sender` that found no place.
    pub(super) fn count_lost(&self, sender: usize) {
        if let Some(quota) = self.quotas.get(sender) {
            quota.count_lost();
        }
    }
}

/// What every message passes on its way in or out: the clock, and whoever listens in.
#[derive(Debug, Clone)]
pub(in crate::node) struct Interceptor {
    pub(in crate::node) clock: VenueClock,
    pub(in crate::node) wiretap: WiretapHandle,
    senders: Senders,
    /// What the edge of each viewpoint is spoken to in.
    spoken: Arc<[SpokenVersion]>,
    venue_hash: Arc<str>,
    /// Whose each camera is.
    cameras: Arc<[ViewpointIndex]>,
    sets: Arc<RecordedSets>,
}

impl Interceptor {
    /// Goes by the clock of `senders`, and copies to `wiretap`.
    pub(in crate::node) fn new(venue: &Venue, senders: Senders, wiretap: WiretapHandle) -> Self {
        Self {
            clock: senders.clock.clone(),
            wiretap,
            senders,
            spoken: venue
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

    /// Whether who may publish under `key` may speak for `viewpoint`.
    pub(super) fn may_speak(&self, key: &str, viewpoint: ViewpointIndex) -> bool {
        let name = self.senders.names.get(usize::from(viewpoint.0));
        name.is_some_and(|name| key.rsplit('/').next() == Some(name))
    }

    /// Whether who may publish under `key` may say `status`. Who holds another venue file may count its
    /// viewpoints in another way: it is refused for that, by name.
    pub(super) fn may_say(&self, key: &str, status: &Status) -> bool {
        let index = self
            .senders
            .names
            .iter()
            .position(|name| *name == status.node);
        let same_index = status.viewpoint.map(|v| usize::from(v.0)) == index;
        key.rsplit('/').next() == Some(&status.node)
            && (same_index || status.venue_hash != *self.venue_hash)
    }

    /// Whether who may publish under `key` may show a picture of the camera that `thumbnail` names.
    pub(super) fn may_show(&self, key: &str, thumbnail: &Thumbnail) -> bool {
        let of_camera = self.cameras.get(usize::from(thumbnail.camera.0));
        of_camera == Some(&thumbnail.viewpoint) && self.may_speak(key, thumbnail.viewpoint)
    }

    /// Notes what version the node reads whose status has come under `key`.
    pub(super) fn heard_status(&self, key: &str, status: &[u8], reads: Option<u8>) {
        let own = self
            .senders
            .names
            .iter()
            .position(|name| key.rsplit('/').next() == Some(name));
        if let Some(spoken) = own.and_then(|index| self.spoken.get(index)) {
            spoken.hear(status, reads);
        }
    }

    /// The version of messages in which the edge of the viewpoint of this index is spoken to.
    pub(in crate::node) fn spoken(&self, index: usize) -> u8 {
        self.spoken.get(index).map_or(VERSION, SpokenVersion::get)
    }

    /// The newest version that all edges read.
    pub(super) fn spoken_by_all(&self) -> u8 {
        self.spoken
            .iter()
            .map(SpokenVersion::get)
            .min()
            .unwrap_or(VERSION)
    }

    /// How a message of these bytes has come: now.
    pub(super) fn arrived(&self, bytes: &[u8]) -> Arrival {
        Arrival {
            bytes: bytes.len() as u64,
            at_us: self.clock.now_us(),
        }
    }

    /// Notes a message that has come and can be read.
    pub(super) fn received(&self, key: &str, bytes: &[u8], Arrival { at_us, .. }: Arrival) {
        self.wiretap.received(CopiedMessage { key, bytes, at_us });
    }

    /// Notes a message of a set: one that comes again, or of another time or session, as what cannot be read.
    pub(super) fn received_set(
        &self,
        key: &str,
        bytes: &[u8],
        (set, arrival): (&SetMessage, Arrival),
    ) {
        if self.sets.is_new(set) {
            self.received(key, bytes, arrival);
        } else {
            self.received_unusable(key, bytes, arrival);
        }
    }

    /// Notes that the core steps a tick of `session`.
    pub(in crate::node) fn decided(&self, session: SessionId, step: CopiedStep<'_>) {
        self.sets.worked_on(session, step.group.tick);
        self.wiretap.decided(step);
    }

    /// Passes a thumbnail on to who looks at such.
    pub(super) fn showed(&self, key: &str, bytes: &[u8], Arrival { at_us, .. }: Arrival) {
        self.wiretap.thumbnail(CopiedMessage { key, bytes, at_us });
    }

    /// Notes a message that has come and is of no use: of each node one a second.
    pub(super) fn received_unusable(&self, key: &str, bytes: &[u8], arrival: Arrival) {
        let quota = self.senders.quotas.get(self.senders.index(key));
        if quota.is_some_and(|quota| quota.records_unusable(arrival.at_us)) {
            self.received(key, bytes, arrival);
        }
    }

    /// Messages of the viewpoint of this index that were over what may come from it.
    pub(in crate::node) fn refused(&self, index: usize) -> u64 {
        self.senders.quotas.get(index).map_or(0, Quota::refused)
    }

    /// Messages of the viewpoint of this index that found no place, or were over what may come from it.
    pub(in crate::node) fn dropped(&self, index: usize) -> u64 {
        self.senders.quotas.get(index).map_or(0, Quota::dropped)
    }

    /// Notes a message that goes out.
    pub(super) fn published(&self, key: &str, bytes: &[u8]) {
        let at_us = self.clock.now_us();
        self.wiretap.published(CopiedMessage { key, bytes, at_us });
    }
}
