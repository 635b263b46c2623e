//! What every message passes on its way in or out: who may say it, when it passed, and a copy for who records.

use std::sync::Arc;

use farfield_node::clock::VenueClock;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::Status;
use farfield_proto::venue::Venue;
use farfield_proto::wire::{SpokenVersion, VERSION};

use super::messages::Arrival;
use super::wiretap::{CopiedMessage, WiretapHandle};

/// What every message passes on its way in or out: the clock, and whoever listens in.
#[derive(Debug, Clone)]
pub(in crate::node) struct Interceptor {
    pub(in crate::node) clock: VenueClock,
    pub(in crate::node) wiretap: WiretapHandle,
    /// Names of the viewpoints, by index.
    names: Arc<[String]>,
    /// What the edge of each viewpoint is spoken to in.
    spoken: Arc<[SpokenVersion]>,
    venue_hash: Arc<str>,
}

impl Interceptor {
    /// Goes by `clock`, and copies to `wiretap`.
    pub(in crate::node) fn new(venue: &Venue, clock: VenueClock, wiretap: WiretapHandle) -> Self {
        let names = venue.viewpoints.iter().map(|v| v.name.clone());
        Self {
            clock,
            wiretap,
            names: names.collect(),
            spoken: venue
                .viewpoints
                .iter()
                .map(|_| SpokenVersion::default())
                .collect(),
            venue_hash: venue.hashes.venue.as_str().into(),
        }
    }

    /// Whether who may publish under `key` may speak for `viewpoint`.
    pub(super) fn may_speak(&self, key: &str, viewpoint: ViewpointIndex) -> bool {
        let name = self.names.get(usize::from(viewpoint.0));
        name.is_some_and(|name| key.rsplit('/').next() == Some(name))
    }

    /// Whether who may publish under `key` may say `status`. Who holds another venue file may count its
    /// viewpoints in another way: it is refused for that, by name.
    pub(super) fn may_say(&self, key: &str, status: &Status) -> bool {
        let index = self.names.iter().position(|name| *name == status.node);
        let same_index = status.viewpoint.map(|v| usize::from(v.0)) == index;
        key.rsplit('/').next() == Some(&status.node)
            && (same_index || status.venue_hash != *self.venue_hash)
    }

    /// Notes what version the node reads whose status has come under `key`.
    pub(super) fn heard_status(&self, key: &str, status: &[u8], reads: Option<u8>) {
        let own = self
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

    /// Notes a message that has come.
    pub(super) fn received(&self, key: &str, bytes: &[u8]) -> Arrival {
        let at_us = self.clock.now_us();
        self.wiretap.received(CopiedMessage { key, bytes, at_us });
        Arrival {
            bytes: bytes.len() as u64,
            at_us,
        }
    }

    /// Notes a message that goes out.
    pub(super) fn published(&self, key: &str, bytes: &[u8]) {
        let at_us = self.clock.now_us();
        self.wiretap.published(CopiedMessage { key, bytes, at_us });
    }
}
