//! The newest-value slot between the one who makes frames and the streams: who is slow skips, nobody waits, nothing queues.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::watch;

use crate::frame::Frame;

/// What a stream counts, for [`StreamReport`](crate::StreamReport).
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

    /// Frames that a client did not get.
    pub(crate) fn skipped(&self, frames: u64) {
        self.skipped.fetch_add(frames, Ordering::Relaxed);
    }

    pub(crate) fn set_clients(&self, clients: usize) {
        self.clients.store(clients, Ordering::Relaxed);
    }

    /// Counts a client until the guard is dropped; `None` when there are `most` already.
    pub(crate) fn client(self: &Arc<Self>, most: usize) -> Option<ClientGuard> {
        let taken = self
            .clients
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| {
                (n < most).then_some(n + 1)
            });
        taken.ok().map(|_| ClientGuard(Arc::clone(self)))
    }

    /// Something that a stream could not do, and goes on without.
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

/// What was counted by now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Counted {
    pub(crate) clients: usize,
    pub(crate) sent: u64,
    pub(crate) skipped: u64,
    pub(crate) failed: u64,
    pub(crate) last_error: Option<String>,
}

/// A client that is counted.
#[derive(Debug)]
pub(crate) struct ClientGuard(Arc<Counters>);

impl Drop for ClientGuard {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A frame and how many were published before it.
#[derive(Debug, Clone, Default)]
struct Published {
    number: u64,
    frame: Option<Arc<Frame>>,
}

/// Where frames are put.
#[derive(Debug)]
pub(crate) struct Slot(watch::Sender<Published>);

impl Slot {
    pub(crate) fn new() -> Self {
        Self(watch::Sender::new(Published::default()))
    }

    /// Replaces the frame that is there, before which `missed` frames were not made; never waits.
    pub(crate) fn put(&self, frame: Arc<Frame>, missed: u64) {
        self.0.send_modify(|published| {
            published.number += 1 + missed;
            published.frame = Some(frame);
        });
    }

    /// A view of the slot for one who counts there.
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
    /// Another reader, for whom all that was published by now is read.
    pub(crate) fn fresh(&self) -> Self {
        let mut fresh = self.clone();
        fresh.catch_up();
        fresh
    }

    /// Waits for a frame that was not read yet; frames between it and the last are counted as skipped. `None` when no
    /// more will come. May be cancelled.
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

    /// Counts what was published and not read by now as skipped: its reader gives up.
    pub(crate) fn miss(&mut self) {
        let number = self.receiver.borrow_and_update().number;
        let skipped = number.saturating_sub(self.last);
        self.last = number;
        self.counters.skipped.fetch_add(skipped, Ordering::Relaxed);
    }

    /// Takes all that was published by now as read, without counting it.
    pub(crate) fn catch_up(&mut self) {
        self.last = self.receiver.borrow_and_update().number;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[tokio::test]
    async fn who_is_slow_gets_the_newest_and_the_skipped_are_counted() {
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
        // Poses that were replaced before anybody came to them.
        slot.put(synthetic::frame(8), 2);
        assert_eq!(feed.next().await.unwrap().tick.0, 8);
        assert_eq!(counters.read().skipped, 6);
        drop(slot);
        assert!(feed.next().await.is_none());
    }

    #[test]
    fn clients_are_counted_and_bounded() {
        let counters = Arc::new(Counters::default());
        let first = counters.client(1);
        assert!(first.is_some());
        assert!(counters.client(1).is_none());
        assert_eq!(counters.read().clients, 1);
        drop(first);
        assert_eq!(counters.read().clients, 0);
    }
}
