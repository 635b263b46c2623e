//! The thread that owns the ring: it writes what it is handed, and answers questions.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use anyhow::Context as _;
use farfield_proto::fill::{FillRequest, Filled};
use tokio::sync::oneshot;
use tracing::{debug, warn};

use super::super::process::say;
use super::store::Ring;
use crate::ring::record::Label;

/// Messages that wait for the disk: some seconds of a busy viewpoint.
const QUEUE: usize = 1024;

enum Command {
    Store(Label, Vec<u8>),
    Answer(FillRequest, oneshot::Sender<Filled>),
    End,
}

/// A ring at work.
pub(in crate::node) struct RingThread {
    handle: RingHandle,
    thread: JoinHandle<()>,
}

/// Hands messages and questions to the ring.
#[derive(Clone)]
pub(in crate::node) struct RingHandle {
    commands: SyncSender<Command>,
    lost: Arc<AtomicU64>,
}

impl RingThread {
    /// Opens the ring in `folder`, of at most `bytes`.
    ///
    /// # Errors
    /// When it cannot be opened, or no thread starts.
    pub(in crate::node) fn start(folder: &Path, bytes: u64) -> anyhow::Result<Self> {
        let ring = Ring::open(folder, bytes);
        let ring = ring.with_context(|| format!("opening the ring in {}", folder.display()))?;
        debug!(records = ring.len(), torn = ring.torn, "the ring is open");
        let (commands, to_do) = sync_channel(QUEUE);
        let thread = std::thread::Builder::new().name("ring".to_owned());
        let thread = thread.spawn(move || work(ring, &to_do));
        Ok(Self {
            handle: RingHandle {
                commands,
                lost: Arc::default(),
            },
            thread: thread.context("starting the ring's thread")?,
        })
    }

    /// Where messages and questions go.
    pub(in crate::node) fn handle(&self) -> RingHandle {
        self.handle.clone()
    }

    /// Writes what has been handed over, and ends.
    pub(in crate::node) fn finish(self) {
        let lost = self.handle.lost.load(Ordering::Relaxed);
        if lost > 0 {
            warn!(lost, "sets not kept: the disk was too slow");
        }
        // A ring that has failed is gone already.
        drop(self.handle.commands.send(Command::End));
        if self.thread.join().is_err() {
            warn!("the ring has panicked");
        }
    }
}

impl RingHandle {
    /// Keeps a message. Waits for nothing: what finds no place is counted.
    pub(in crate::node) fn store(&self, label: Label, message: &[u8]) {
        let command = Command::Store(label, message.to_owned());
        if let Err(TrySendError::Full(_)) = self.commands.try_send(command) {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// What there is of the ticks that are asked for; `None` when the ring is busy or gone.
    pub(in crate::node) async fn answer(&self, request: FillRequest) -> Option<Filled> {
        let (reply, answer) = oneshot::channel();
        self.commands
            .try_send(Command::Answer(request, reply))
            .ok()?;
        answer.await.ok()
    }
}

fn work(mut ring: Ring, to_do: &Receiver<Command>) {
    // After a write has failed the ring is only read: the disk is full, or gone.
    let mut works = true;
    while let Ok(command) = to_do.recv() {
        match command {
            Command::Store(label, message) if works => {
                if let Err(error) = ring.store(label, &message) {
                    works = false;
                    say(format_args!("sets are not kept any more: {error}"));
                }
            }
            Command::Store(..) => {}
            Command::Answer(request, reply) => match ring.answer(&request) {
                // Who asked may have gone.
                Ok(filled) => drop(reply.send(filled)),
                Err(error) => warn!(%error, "the ring cannot be read"),
            },
            Command::End => return,
        }
    }
}
