//! What names hear of a run: whom it expects, recordings that begin, edits of other programs, and whom fusion takes for a subject of the venue.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::node::{CopiedMessage, CopiedStep, Wiretap};
use farfield_node::process::{NodeError, say};
use farfield_proto::key::Keys;
use farfield_proto::message::naming::NamingSet;
use farfield_proto::venue::Venue;
use farfield_proto::wire;

use super::names::GivenNames;

/// Sets of namings that wait for the disk. A venue has at most two of a person, and few people at a tick.
const QUEUE: usize = 256;

/// How often is looked whether somebody else has edited the list.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Tells names what becomes of the run. Files are written on a thread of their own: who hears messages must not wait.
pub(super) struct NamesTap {
    given: Arc<GivenNames>,
    naming_key: String,
    queue: Option<SyncSender<NamingSet>>,
    thread: Option<JoinHandle<()>>,
}

impl NamesTap {
    /// Of the names `given` in a run of `venue`.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn start(venue: &Venue, given: Arc<GivenNames>) -> Result<Self, NodeError> {
        let (queue, namings) = sync_channel(QUEUE);
        let names = Arc::clone(&given);
        let thread = thread::Builder::new()
            .name("names".to_owned())
            .spawn(move || take(&names, &namings))
            .context("starting the thread of names")
            .map_err(NodeError::Failed)?;
        Ok(Self {
            given,
            naming_key: Keys::new(&venue.name).naming(),
            queue: Some(queue),
            thread: Some(thread),
        })
    }
}

/// Until the run is over.
fn take(given: &GivenNames, namings: &Receiver<NamingSet>) {
    loop {
        match namings.recv_timeout(LOOK_EVERY) {
            Ok(set) => set.namings.iter().for_each(|naming| given.guess(naming)),
            Err(RecvTimeoutError::Timeout) => given.look_again(),
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

impl Drop for NamesTap {
    /// What was said is written when the run is over.
    fn drop(&mut self) {
        drop(self.queue.take());
        if let Some(thread) = self.thread.take() {
            // A thread that died has said so.
            drop(thread.join());
        }
    }
}

impl Wiretap for NamesTap {
    fn received(&self, _: CopiedMessage<'_>) {}

    fn published(&self, message: CopiedMessage<'_>) {
        // What fusion encoded a moment ago can be read again.
        if message.key == self.naming_key
            && let Ok(set) = wire::decode::<NamingSet>(message.bytes)
            && let Some(queue) = &self.queue
            && let Err(TrySendError::Full(set)) = queue.try_send(set)
        {
            let n = set.namings.len();
            say(format_args!("the disk is too slow: {n} names are lost"));
        }
    }

    fn decided(&self, _: CopiedStep<'_>) {}

    fn recording_begins(&self, path: &Path) {
        self.given.recording_begins(path);
    }

    fn expected(&self, ids: &[u32]) {
        self.given.expected(ids);
    }
}
