//! Copies, for whoever records: of every message that comes or goes, and of what each step was made of.
//!
//! With the decisions in the order of their ticks, a run can be solved again bit for bit:
//! [`crate::pipeline::Pipeline::first_boxes`] at the first one's tick, then per decision the late sets, the
//! horizons (where there are any), and the step.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use farfield_proto::message::PatchSet;

use crate::align::TickGroup;

/// A message as it was on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CopiedMessage<'a> {
    /// Its Zenoh key.
    pub key: &'a str,
    /// Its payload.
    pub bytes: &'a [u8],
    /// When it came or went, microseconds of Unix time by fusion's clock.
    pub at_us: i64,
}

/// What one step of the core is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CopiedStep<'a> {
    /// The tick, and the messages that its step uses. The ticks of a run follow each other without a gap.
    pub group: &'a TickGroup,
    /// Sets of earlier ticks, given to the smoother before this step, in this order.
    pub late: &'a [PatchSet],
    /// What [`crate::pipeline::Pipeline::set_horizons`] is given before this step; empty: it is not
    /// called.
    pub horizons: &'a [f64],
}

/// Someone who listens in. Called from the threads that carry messages and from the loop: it must not
/// wait for anything, and drop (and count) what it has no room for.
pub trait Wiretap: Send + Sync {
    /// A message has come, readable or not.
    fn received(&self, message: CopiedMessage<'_>);

    /// A message goes out.
    fn published(&self, message: CopiedMessage<'_>);

    /// The core steps a tick.
    fn decided(&self, decided: CopiedStep<'_>);

    /// Whether [`Self::thumbnail`] is wanted: while nobody wants them, edges make none.
    fn looks_at_thumbnails(&self) -> bool {
        false
    }

    /// A thumbnail of a camera has come, for people to look at: checked
    /// ([`farfield_proto::message::thumbnail::Thumbnail`]), and passed on as it is. It is none of the messages of
    /// [`Self::received`], so that who records those has no pictures, and must not be recorded.
    fn thumbnail(&self, _message: CopiedMessage<'_>) {}

    /// A recording of the run begins, a file at `path`.
    fn recording_begins(&self, _path: &Path) {}

    /// The people with these ids are known from the fusion before: whoever is recognised keeps the id. With none, ids
    /// begin anew.
    fn expected(&self, _ids: &[u32]) {}

    /// Why it listens no more, if it does not.
    fn failure(&self) -> Option<String> {
        None
    }
}

/// The wiretaps of a run.
#[derive(Clone, Default)]
pub(in crate::node) struct WiretapHandle(Arc<[Arc<dyn Wiretap>]>);

impl WiretapHandle {
    pub(in crate::node) fn new(wiretaps: impl IntoIterator<Item = Arc<dyn Wiretap>>) -> Self {
        Self(wiretaps.into_iter().collect())
    }

    pub(in crate::node) fn received(&self, message: CopiedMessage<'_>) {
        for wiretap in self.0.iter() {
            wiretap.received(message);
        }
    }

    pub(in crate::node) fn published(&self, message: CopiedMessage<'_>) {
        for wiretap in self.0.iter() {
            wiretap.published(message);
        }
    }

    pub(in crate::node) fn looks_at_thumbnails(&self) -> bool {
        self.0.iter().any(|wiretap| wiretap.looks_at_thumbnails())
    }

    pub(in crate::node) fn thumbnail(&self, message: CopiedMessage<'_>) {
        for wiretap in self.0.iter() {
            wiretap.thumbnail(message);
        }
    }

    pub(in crate::node) fn decided(&self, decided: CopiedStep<'_>) {
        for wiretap in self.0.iter() {
            wiretap.decided(decided);
        }
    }

    pub(in crate::node) fn recording_begins(&self, path: &Path) {
        for wiretap in self.0.iter() {
            wiretap.recording_begins(path);
        }
    }

    pub(in crate::node) fn expected(&self, ids: &[u32]) {
        for wiretap in self.0.iter() {
            wiretap.expected(ids);
        }
    }
}

impl WiretapHandle {
    /// Why one of them listens no more.
    pub(in crate::node) fn failure(&self) -> Option<String> {
        self.0.iter().find_map(|wiretap| wiretap.failure())
    }
}

impl fmt::Debug for WiretapHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("WiretapHandle").field(&self.0.len()).finish()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[derive(Default)]
    struct Kept(Mutex<Vec<(String, Vec<u8>)>>);

    impl Wiretap for Kept {
        fn received(&self, message: CopiedMessage<'_>) {
            let kept = (message.key.to_owned(), message.bytes.to_vec());
            self.0.lock().unwrap().push(kept);
        }
        fn published(&self, message: CopiedMessage<'_>) {
            self.received(message);
        }
        fn decided(&self, _: CopiedStep<'_>) {}
    }

    #[test]
    fn every_listener_gets_every_message() {
        let kept = [Arc::new(Kept::default()), Arc::new(Kept::default())];
        let handle = WiretapHandle::new(kept.clone().map(|it| it as Arc<dyn Wiretap>));
        let message = |bytes| CopiedMessage {
            key: "hall/pose",
            bytes,
            at_us: 7,
        };
        handle.received(message(&[1, 2]));
        handle.published(message(&[3]));
        for kept in kept {
            let kept = kept.0.lock().unwrap();
            let bytes: Vec<_> = kept.iter().map(|(_, bytes)| bytes.clone()).collect();
            assert_eq!(bytes, [vec![1, 2], vec![3]]);
        }
        assert_eq!(handle.failure(), None);
    }
}
