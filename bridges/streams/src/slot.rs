//! Slot with the newest frame between the frame maker and the streams: slow readers skip frames, no
//! one waits, nothing queues.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::frame::Frame;

/// Counters of a stream, for [`StreamReport`](crate::StreamReport).
#[derive(Debug, Default)]
pub(crate) struct Counters {
    clients: AtomicUsize,
    sent: AtomicU64,
    skipped: AtomicU64,
    failed: AtomicU64,
    last_error: Mutex<Option<String>>,
}

impl Counters {
    pub(crate) fn sent(&self) {
        self.sent.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts frames that a client did not receive.
    pub(crate) fn skipped(&self, frames: u64) {
        self.skipped.fetch_add(frames, Ordering::Relaxed);
    }

    pub(crate) fn set_clients(&self, clients: usize) {
        self.clients.store(clients, Ordering::Relaxed);
    }

    /// Counts a client until the guard is dropped; `None` if there are already `most`.
    pub(crate) fn client(self: &Arc<Self>, most: usize) -> Option<ClientGuard> {
        let taken = self
            .clients
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| {
                (n < most).then_some(n + 1)
            });
        taken.ok().map(|_| ClientGuard(Arc::clone(self)))
    }

    /// Counts and stores an error after which the stream continues.
    pub(crate) fn failed(&self, what: String) {
        self.failed.fetch_add(1, Ordering::Relaxed);
        *self
            .last_error
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = Some(what);
    }

    pub(crate) fn read(&self) -> Counted {
        let last_error = self.last_error.lock();
        Counted {
            clients: self.clients.load(Ordering::Relaxed),
            sent: self.sent.load(Ordering::Relaxed),
            skipped: self.skipped.load(Ordering::Relaxed),
            failed: self.failed.load(Ordering::Relaxed),
            last_error: last_error.unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }
}

/// Current values of the counters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Counted {
    pub(crate) clients: usize,
    pub(crate) sent: u64,
    pub(crate) skipped: u64,
    pub(crate) failed: u64,
    pub(crate) last_error: Option<String>,
}

/// Keeps a client counted until dropped.
#[derive(Debug)]
pub(crate) struct ClientGuard(Arc<Counters>);

impl Drop for ClientGuard {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A frame, and the number of frames published before it.
#[derive(Debug, Clone, Default)]
struct Published {
    number: u64,
    frame: Option<Arc<Frame>>,
}

/// The writing end.
#[derive(Debug)]
pub(crate) struct Slot(watch::Sender<Published>);

impl Slot {
    pub(crate) fn new() -> Self {
        Self(watch::Sender::new(Published::default()))
    }

    /// Replaces the current frame; `missed` frames before it were never made. Never waits.
    pub(crate) fn put(&self, frame: Arc<Frame>, missed: u64) {
        self.0.send_modify(|published| {
            published.number += 1 + missed;
            published.frame = Some(frame);
        });
    }

    /// A reader of the slot with these counters.
    pub(crate) fn feed(&self, counters: &Arc<Counters>) -> Feed {
        Feed {
            receiver: self.0.subscribe(),
            last: self.0.borrow().number,
            counters: Arc::clone(counters),
        }
    }
}

/// One reader of the slot.
#[derive(Debug, Clone)]
pub(crate) struct Feed {
    receiver: watch::Receiver<Published>,
    last: u64,
    counters: Arc<Counters>,
}

impl Feed {
    /// A new reader that considers everything published so far as read.
    pub(crate) fn fresh(&self) -> Self {
        let mut fresh = self.clone();
        fresh.catch_up();
        fresh
    }

    /// Waits for an unread frame, and counts the frames skipped since the last one. `None` if no
    /// more will come. Cancel safe.
    pub(crate) async fn next(&mut self) -> Option<Arc<Frame>> {
        loop {
            self.receiver.changed().await.ok()?;
            let published = self.receiver.borrow_and_update().clone();
            let skipped = published.number.saturating_sub(self.last + 1);
            self.last = published.number;
            self.counters.skipped.fetch_add(skipped, Ordering::Relaxed);
            if let Some(frame) = published.frame {
                return Some(frame);
            }
        }
    }

    /// The newest frame, read or not.
    pub(crate) fn newest(&self) -> Option<Arc<Frame>> {
        self.receiver.borrow().frame.clone()
    }

    /// Counts all unread frames as skipped, since the reader gives up.
    pub(crate) fn miss(&mut self) {
        let number = self.receiver.borrow_and_update().number;
        let skipped = number.saturating_sub(self.last);
        self.last = number;
        self.counters.skipped.fetch_add(skipped, Ordering::Relaxed);
    }

    /// Marks everything published so far as read, without counting.
    pub(crate) fn catch_up(&mut self) {
        self.last = self.receiver.borrow_and_update().number;
    }
}

/// What the tasks of a stream share.
#[derive(Debug, Clone)]
pub(crate) struct Shell {
    pub(crate) tasks: TaskTracker,
    pub(crate) stop: CancellationToken,
    pub(crate) counters: Arc<Counters>,
    /// Template only; every task reads a copy of its own.
    pub(crate) feed: Feed,
}

impl Shell {
    /// Runs a task until it ends or the streams stop.
    pub(crate) fn spawn(&self, task: impl Future<Output = ()> + Send + 'static) {
        let stop = self.stop.clone();
        self.tasks.spawn(async move {
            tokio::select! {
                biased;
                () = stop.cancelled() => {}
                () = task => {}
            }
        });
    }

    /// Runs a task that ends by itself when the streams stop.
    pub(crate) fn spawn_until_done(&self, task: impl Future<Output = ()> + Send + 'static) {
        self.tasks.spawn(task);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[tokio::test]
    async fn slow_readers_get_the_newest_frame_and_skips_are_counted() {
        let (slot, counters) = (Slot::new(), Arc::new(Counters::default()));
        let mut feed = slot.feed(&counters);
        for tick in 0..5 {
            slot.put(synthetic::frame(tick), 0);
        }
        assert_eq!(feed.next().await.unwrap().tick.0, 4);
        assert_eq!(counters.read().skipped, 4);
        slot.put(synthetic::frame(5), 0);
        assert_eq!(feed.next().await.unwrap().tick.0, 5);
        assert_eq!(counters.read().skipped, 4);
        // Poses that were replaced before they were read.
        slot.put(synthetic::frame(8), 2);
        assert_eq!(feed.next().await.unwrap().tick.0, 8);
        assert_eq!(counters.read().skipped, 6);
        drop(slot);
        assert!(feed.next().await.is_none());
    }

    #[test]
    fn clients_are_counted_and_limited() {
        let counters = Arc::new(Counters::default());
        let first = counters.client(1);
        assert!(first.is_some());
        assert!(counters.client(1).is_none());
        assert_eq!(counters.read().clients, 1);
        drop(first);
        assert_eq!(counters.read().clients, 0);
    }
}
