//! Queue of messages into the page, limited in messages and bytes, and the thread that reads it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use farfield_proto::tick::{Micros, SECOND_US};

use super::Shared;
use super::known::context::Topic;
use super::known::{Known, News};

/// Maximum number of waiting messages: one second of eight viewpoints at 60 Hz with eight messages
/// each.
const MAX_WAITING: usize = 4096;
/// Maximum size of waiting messages, bytes.
const MAX_WAITING_BYTES: usize = 16 << 20;
/// Time without a message after which the clock is advanced.
const HEARTBEAT: Duration = Duration::from_millis(250);
const HEARTBEAT_US: Micros = 250_000;

/// A queued message.
struct Waiting {
    topic: Topic,
    bytes: Box<[u8]>,
    at_us: Micros,
}

/// The sending end of the queue.
pub(crate) struct Feed {
    sender: SyncSender<Waiting>,
    waiting_bytes: Arc<AtomicUsize>,
}

impl Feed {
    /// Starts the thread, which ends when the feed is dropped.
    pub(crate) fn start(shared: Arc<Shared>) -> std::io::Result<Self> {
        let (sender, receiver) = sync_channel(MAX_WAITING);
        let waiting_bytes = Arc::<AtomicUsize>::default();
        let bytes = Arc::clone(&waiting_bytes);
        thread::Builder::new()
            .name("page-feed".to_owned())
            .spawn(move || Reading::new(shared).run(&receiver, &bytes))?;
        Ok(Self {
            sender,
            waiting_bytes,
        })
    }

    /// Queues a message; returns whether there was room.
    pub(crate) fn offer(&self, topic: Topic, bytes: &[u8], at_us: Micros) -> bool {
        let n = bytes.len();
        let before = self.waiting_bytes.fetch_add(n, Ordering::Relaxed);
        let has_room = before.saturating_add(n) <= MAX_WAITING_BYTES;
        let waiting = || Waiting {
            topic,
            bytes: bytes.into(),
            at_us,
        };
        let is_taken = has_room && self.sender.try_send(waiting()).is_ok();
        if !is_taken {
            self.waiting_bytes.fetch_sub(n, Ordering::Relaxed);
        }
        is_taken
    }
}

/// The receiving end: the current state, and what was last published.
struct Reading {
    shared: Arc<Shared>,
    known: Known,
    published_us: Option<Micros>,
    published_alarms: BTreeSet<String>,
}

impl Reading {
    fn new(shared: Arc<Shared>) -> Self {
        Self {
            known: Known::new(Arc::clone(&shared.context)),
            shared,
            published_us: None,
            published_alarms: BTreeSet::new(),
        }
    }

    fn run(mut self, receiver: &Receiver<Waiting>, waiting_bytes: &AtomicUsize) {
        loop {
            match receiver.recv_timeout(HEARTBEAT) {
                Ok(waiting) => {
                    waiting_bytes.fetch_sub(waiting.bytes.len(), Ordering::Relaxed);
                    self.take(&waiting);
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.known.wait(HEARTBEAT_US);
                    self.publish_status(true);
                }
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    fn take(&mut self, waiting: &Waiting) {
        match self
            .known
            .take(waiting.topic, &waiting.bytes, waiting.at_us)
        {
            News::Frame(frame) => {
                self.shared.past.push(Arc::clone(&frame));
                self.shared.newest.send_replace(Some(frame));
                self.publish_status(false);
            }
            News::Events(events) => self.shared.events.push(events),
            News::Status => self.publish_status(true),
            News::Nothing => {}
        }
    }

    /// Publishes the status once a second; sooner if `may_be_new` and the set of alarms changed.
    fn publish_status(&mut self, may_be_new: bool) {
        let now_us = self.known.now_us();
        let is_due = self
            .published_us
            .is_none_or(|published_us| now_us.saturating_sub(published_us) >= SECOND_US);
        if now_us == 0 || !(is_due || may_be_new) {
            return;
        }
        let document = self.known.status(&self.shared.external());
        let alarms: BTreeSet<String> = document
            .alarms
            .iter()
            .map(|alarm| alarm.key.clone())
            .collect();
        if !is_due && alarms == self.published_alarms {
            return;
        }
        self.published_us = Some(now_us);
        self.published_alarms = alarms;
        let text: Arc<str> = document.to_json().into();
        if let Some(tick) = self.known.newest_tick() {
            self.shared.past.push_status(tick, Arc::clone(&text));
        }
        self.shared.status.send_replace(text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn without_reader() -> (Feed, Receiver<Waiting>) {
        let (sender, receiver) = sync_channel(MAX_WAITING);
        let waiting_bytes = Arc::default();
        (
            Feed {
                sender,
                waiting_bytes,
            },
            receiver,
        )
    }

    #[test]
    fn a_full_queue_refuses_by_count_and_by_bytes() {
        let (feed, _receiver) = without_reader();
        let taken = (0..MAX_WAITING + 10).filter(|_| feed.offer(Topic::Poses, b"x", 0));
        assert_eq!(taken.count(), MAX_WAITING);
        let (feed, _receiver) = without_reader();
        let large = vec![0; 1 << 20];
        let taken = (0..20).filter(|_| feed.offer(Topic::Poses, &large, 0));
        assert_eq!(taken.count(), 16);
    }

    #[test]
    fn offer_returns_at_once_if_the_reader_is_gone() {
        let (feed, receiver) = without_reader();
        drop(receiver);
        assert!(!feed.offer(Topic::Poses, b"x", 0));
    }
}
