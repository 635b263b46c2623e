//! The thread that owns the ring: it stores messages and answers requests.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use farfield_node::clock;
use farfield_node::process::say;
use farfield_proto::message::fill::{FillRequest, Filled};
use tokio::sync::oneshot;
use tracing::{debug, warn};

use super::store::{Ring, Stored};
use crate::ring::record::Label;

/// Messages waiting for the disk: some seconds of a busy viewpoint.
const QUEUE: usize = 1024;
/// Pause after a failed write: a full disk may be cleared.
const RETRY_AFTER: Duration = Duration::from_secs(5);
/// The reason if messages only came too fast.
const TOO_SLOW: &str = "the disk was too slow";

enum Command {
    Store(Label, Vec<u8>),
    Answer(FillRequest, oneshot::Sender<Filled>),
    End,
}

/// A running ring.
pub(in crate::node) struct RingThread {
    handle: RingHandle,
    thread: JoinHandle<()>,
}

/// Passes messages and requests to the ring.
#[derive(Clone)]
pub(in crate::node) struct RingHandle {
    commands: SyncSender<Command>,
    state: Arc<RingState>,
}

/// State shared by the ring's thread and its handles.
#[derive(Debug, Default)]
struct RingState {
    /// Messages not stored since the start.
    lost: AtomicU64,
    /// The reason of the last failure, if the disk was not just too slow.
    reason: Mutex<Option<String>>,
}

impl RingThread {
    /// Opens the ring in `folder`, of at most `bytes`.
    ///
    /// # Errors
    /// If it cannot be opened, or no thread starts.
    pub(in crate::node) fn start(folder: &Path, bytes: u64) -> anyhow::Result<Self> {
        let ring = Ring::open(folder, bytes);
        let ring = ring.with_context(|| format!("opening the ring in {}", folder.display()))?;
        debug!(records = ring.len(), torn = ring.torn, "the ring is open");
        let (commands, to_do) = sync_channel(QUEUE);
        let state = Arc::<RingState>::default();
        let mut keeper = Keeper {
            ring,
            state: Arc::clone(&state),
            try_at: None,
        };
        let thread = std::thread::Builder::new().name("ring".to_owned());
        let thread = thread.spawn(move || keeper.work(&to_do));
        Ok(Self {
            handle: RingHandle { commands, state },
            thread: thread.context("starting the ring's thread")?,
        })
    }

    /// A handle for messages and requests.
    pub(in crate::node) fn handle(&self) -> RingHandle {
        self.handle.clone()
    }

    /// Writes the queued messages and ends the thread.
    pub(in crate::node) fn finish(self) {
        if let Some(failure) = self.handle.failure() {
            warn!("{failure}");
        }
        // If the ring has failed, its thread is already gone.
        drop(self.handle.commands.send(Command::End));
        if self.thread.join().is_err() {
            warn!("the ring has panicked");
        }
    }
}

impl RingHandle {
    /// Stores a message without waiting; a message without room in the queue is counted as lost.
    pub(in crate::node) fn store(&self, label: Label, message: &[u8]) {
        let command = Command::Store(label, message.to_owned());
        if let Err(TrySendError::Full(_)) = self.commands.try_send(command) {
            self.state.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The stored messages of the requested ticks; `None` if the ring is busy or gone.
    pub(in crate::node) async fn answer(&self, request: FillRequest) -> Option<Filled> {
        let (reply, answer) = oneshot::channel();
        self.commands
            .try_send(Command::Answer(request, reply))
            .ok()?;
        answer.await.ok()
    }

    /// Number of messages not stored, and the reason; `None` if all are stored.
    pub(in crate::node) fn failure(&self) -> Option<String> {
        let lost = self.state.lost.load(Ordering::Relaxed);
        let reason = self.state.reason();
        (lost > 0).then(|| {
            let reason = reason.as_deref().unwrap_or(TOO_SLOW);
            format!("{lost} sets were not stored for fusion to fetch after an outage: {reason}")
        })
    }
}

impl RingState {
    /// Counts a message that is not stored.
    fn lose(&self, reason: &str) {
        self.lost.fetch_add(1, Ordering::Relaxed);
        let mut known = self.reason.lock().unwrap_or_else(PoisonError::into_inner);
        if known.as_deref() != Some(reason) {
            *known = Some(reason.to_owned());
        }
    }

    fn reason(&self) -> Option<String> {
        let reason = self.reason.lock().unwrap_or_else(PoisonError::into_inner);
        reason.clone()
    }
}

/// The data of the thread.
struct Keeper {
    ring: Ring,
    state: Arc<RingState>,
    /// After a failed write, the time of the next attempt.
    try_at: Option<Instant>,
}

impl Keeper {
    fn work(&mut self, to_do: &Receiver<Command>) {
        while let Ok(command) = to_do.recv() {
            match command {
                Command::Store(label, message) => self.store(label, &message, clock::now()),
                // The sender may have given up while the disk was busy.
                Command::Answer(_, reply) if reply.is_closed() => {}
                Command::Answer(request, reply) => drop(reply.send(self.ring.answer(&request))),
                Command::End => return,
            }
        }
    }

    /// Stores a message, unless a write failed shortly before `now`.
    fn store(&mut self, label: Label, message: &[u8], now: Instant) {
        if self.try_at.is_some_and(|try_at| now < try_at) {
            let reason = self.state.reason().unwrap_or_default();
            self.state.lose(&reason);
            return;
        }
        match self.ring.store(label, message) {
            Ok(Stored::Kept) => {
                if self.try_at.take().is_some() {
                    say(format_args!("sets are kept again"));
                }
            }
            Ok(Stored::TooLarge) => {
                let too_large = format!(
                    "a set of {} bytes is too large for the ring: raise `ring_mib` in [recording]",
                    message.len()
                );
                self.state.lose(&too_large);
            }
            Err(error) => {
                self.state.lose(&error.to_string());
                if self.try_at.replace(now + RETRY_AFTER).is_none() {
                    say(format_args!("sets are not kept for now: {error}"));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::SessionId;
    use farfield_proto::message::fill::SetKind;
    use farfield_proto::tick::Tick;

    use super::*;

    fn label(tick: i64) -> Label {
        Label {
            session: SessionId(1),
            tick: Tick(tick),
            kind: SetKind::Patches,
        }
    }

    fn keeper(folder: &Path) -> (Keeper, RingHandle) {
        let state = Arc::<RingState>::default();
        let keeper = Keeper {
            ring: Ring::open(folder, 64 << 10).unwrap(),
            state: Arc::clone(&state),
            try_at: None,
        };
        let (commands, _) = sync_channel(1);
        (keeper, RingHandle { commands, state })
    }

    #[test]
    fn a_message_that_is_too_large_loses_only_itself() {
        let dir = tempfile::tempdir().unwrap();
        let (mut keeper, handle) = keeper(dir.path());
        let now = clock::now();
        keeper.store(label(1), &[0; 100], now);
        assert_eq!(handle.failure(), None);
        keeper.store(label(2), &vec![0; 60_000], now);
        keeper.store(label(3), &[0; 100], now);
        assert_eq!(keeper.ring.len(), 2);
        let failure = handle.failure().unwrap();
        assert!(failure.starts_with("1 sets were not stored") && failure.contains("ring_mib"));
    }

    #[test]
    fn a_failed_disk_is_retried_and_losses_are_counted() {
        let dir = tempfile::tempdir().unwrap();
        let (mut keeper, handle) = keeper(dir.path());
        let now = clock::now();
        // Every segment is open for reading only, so all writes fail.
        keeper.ring.refuse_writes(dir.path(), true);
        for (tick, after) in [(1, 0), (2, 1), (3, 4), (4, 5)] {
            keeper.store(label(tick), &[0; 100], now + Duration::from_secs(after));
        }
        let failure = handle.failure().unwrap();
        assert!(failure.starts_with("4 sets"), "{failure}");
        keeper.ring.refuse_writes(dir.path(), false);
        keeper.store(label(5), &[0; 100], now + Duration::from_secs(9));
        keeper.store(label(6), &[0; 100], now + Duration::from_secs(10));
        keeper.store(label(7), &[0; 100], now + Duration::from_secs(10));
        assert_eq!(keeper.ring.len(), 2, "it works again");
        assert!(handle.failure().unwrap().starts_with("5 sets"));
    }
}
