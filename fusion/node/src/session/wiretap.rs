//! Copies for observers: of every incoming and outgoing message, and of the input of each step.
//!
//! With the decisions in the order of their ticks, a run can be solved again bit for bit:
//! [`farfield_fusion::pipeline::Pipeline::first_boxes`] at the tick of the first, then per decision the late sets, the horizons (if there
//! are any), and the step.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use farfield_proto::message::PatchSet;

use farfield_fusion::align::TickGroup;

/// A message as it is on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CopiedMessage<'a> {
    /// Its Zenoh key.
    pub key: &'a str,
    /// Its payload.
    pub bytes: &'a [u8],
    /// Its time of arrival or sending, microseconds of Unix time by fusion's clock.
    pub at_us: i64,
}

/// The input of one step of the core.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CopiedStep<'a> {
    /// The tick, and the messages that its step uses. The ticks of a run are consecutive.
    pub group: &'a TickGroup,
    /// Sets of earlier ticks, passed to the smoother before this step, in this order.
    pub late: &'a [PatchSet],
    /// The argument of [`farfield_fusion::pipeline::Pipeline::set_horizons`] before this step; empty: it is not called.
    pub horizons: &'a [f64],
}

/// An observer. It is called from the threads that carry messages and from the loop: it must not wait, and must drop (and count)
/// what it has no room for.
pub trait Wiretap: Send + Sync {
    /// A message has arrived, readable or not.
    fn received(&self, message: CopiedMessage<'_>);

    /// A message is sent.
    fn published(&self, message: CopiedMessage<'_>);

    /// The core steps a tick.
    fn decided(&self, decided: CopiedStep<'_>);

    /// Whether [`Self::thumbnail`] is wanted: if no observer wants thumbnails, edges make none.
    fn wants_thumbnails(&self) -> bool {
        false
    }

    /// A checked thumbnail of a camera ([`farfield_proto::message::thumbnail::Thumbnail`]) has arrived. It is only for display, must
    /// not be recorded, and is not passed to [`Self::received`].
    fn thumbnail(&self, _message: CopiedMessage<'_>) {}

    /// A recording of the run begins, a file at `path`.
    fn recording_begins(&self, _path: &Path) {}

    /// The people with these ids are known from the previous fusion: those who are recognised keep their ids. Without ids, new ids
    /// begin.
    fn expected(&self, _ids: &[u32]) {}

    /// The reason if it has stopped, e.g. by an error.
    fn failure(&self) -> Option<String> {
        None
    }
}

/// The wiretaps of a run.
#[derive(Clone, Default)]
pub(crate) struct WiretapHandle(Arc<[Arc<dyn Wiretap>]>);

impl WiretapHandle {
    pub(crate) fn new(wiretaps: impl IntoIterator<Item = Arc<dyn Wiretap>>) -> Self {
        Self(wiretaps.into_iter().collect())
    }

    pub(crate) fn received(&self, message: CopiedMessage<'_>) {
        for wiretap in self.0.iter() {
            wiretap.received(message);
        }
    }

    pub(crate) fn published(&self, message: CopiedMessage<'_>) {
        for wiretap in self.0.iter() {
            wiretap.published(message);
        }
    }

    pub(crate) fn wants_thumbnails(&self) -> bool {
        self.0.iter().any(|wiretap| wiretap.wants_thumbnails())
    }

    pub(crate) fn thumbnail(&self, message: CopiedMessage<'_>) {
        for wiretap in self.0.iter() {
            wiretap.thumbnail(message);
        }
    }

    pub(crate) fn decided(&self, decided: CopiedStep<'_>) {
        for wiretap in self.0.iter() {
            wiretap.decided(decided);
        }
    }

    pub(crate) fn recording_begins(&self, path: &Path) {
        for wiretap in self.0.iter() {
            wiretap.recording_begins(path);
        }
    }

    pub(crate) fn expected(&self, ids: &[u32]) {
        for wiretap in self.0.iter() {
            wiretap.expected(ids);
        }
    }
}

impl WiretapHandle {
    /// The reason of the first observer that has stopped.
    pub(crate) fn failure(&self) -> Option<String> {
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
    struct Observer(Mutex<Vec<(String, Vec<u8>)>>);

    impl Wiretap for Observer {
        fn received(&self, message: CopiedMessage<'_>) {
            let message = (message.key.to_owned(), message.bytes.to_vec());
            self.0.lock().unwrap().push(message);
        }
        fn published(&self, message: CopiedMessage<'_>) {
            self.received(message);
        }
        fn decided(&self, _: CopiedStep<'_>) {}
    }

    #[test]
    fn every_observer_gets_every_message() {
        let observers = [Arc::new(Observer::default()), Arc::new(Observer::default())];
        let handle = WiretapHandle::new(observers.clone().map(|it| it as Arc<dyn Wiretap>));
        let message = |bytes| CopiedMessage {
            key: "hall/pose",
            bytes,
            at_us: 7,
        };
        handle.received(message(&[1, 2]));
        handle.published(message(&[3]));
        for observer in observers {
            let messages = observer.0.lock().unwrap();
            let bytes: Vec<_> = messages.iter().map(|(_, bytes)| bytes.clone()).collect();
            assert_eq!(bytes, [vec![1, 2], vec![3]]);
        }
        assert_eq!(handle.failure(), None);
    }
}
