//! The queue of incoming messages in a live run: bounded places per sender, emptied in turn, so that a flooding node takes no
//! places of others.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// Queued messages, by sender.
#[derive(Debug)]
pub(super) struct Inbox<T> {
    waiting: Mutex<Waiting<T>>,
    came: Notify,
    /// Places per sender.
    places: usize,
}

#[derive(Debug)]
struct Waiting<T> {
    of_sender: Vec<VecDeque<T>>,
    /// The sender whose turn it is.
    turn: usize,
}

impl<T> Inbox<T> {
    /// An empty queue with `places` for each of `senders`.
    pub(super) fn new(senders: usize, places: usize) -> Self {
        let waiting = Waiting {
            of_sender: (0..senders).map(|_| VecDeque::new()).collect(),
            turn: 0,
        };
        Self {
            waiting: Mutex::new(waiting),
            came: Notify::new(),
            places,
        }
    }

    /// Adds a message of the sender with this index. Returns whether its oldest was dropped for it. Never waits.
    pub(super) fn put(&self, sender: usize, message: T) -> bool {
        let mut waiting = self.lock();
        let Some(queue) = waiting.of_sender.get_mut(sender) else {
            return true;
        };
        let is_full = queue.len() >= self.places;
        if is_full {
            queue.pop_front();
        }
        queue.push_back(message);
        drop(waiting);
        self.came.notify_one();
        is_full
    }

    /// The next message, in turn over the senders that have one. It is safe to cancel; for one receiver.
    pub(super) async fn next(&self) -> T {
        loop {
            if let Some(message) = self.take() {
                return message;
            }
            self.came.notified().await;
        }
    }

    fn take(&self) -> Option<T> {
        let mut waiting = self.lock();
        let senders = waiting.of_sender.len();
        let order = (0..senders).map(|i| (waiting.turn + i) % senders);
        let sender = order
            .into_iter()
            .find(|&sender| !waiting.of_sender[sender].is_empty())?;
        waiting.turn = sender + 1;
        waiting.of_sender[sender].pop_front()
    }

    fn lock(&self) -> MutexGuard<'_, Waiting<T>> {
        // A thread that panicked leaves the queues consistent.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_flooding_sender_loses_only_its_own_messages() {
        let inbox = Inbox::new(3, 4);
        inbox.put(1, (1, 0));
        let lost = (0..100).filter(|&i| inbox.put(0, (0, i))).count();
        inbox.put(1, (1, 1));
        assert_eq!(lost, 96);
        let mut taken = Vec::new();
        for _ in 0..6 {
            taken.push(inbox.next().await);
        }
        assert_eq!(taken, [(0, 96), (1, 0), (0, 97), (1, 1), (0, 98), (0, 99)]);
        assert!(inbox.take().is_none());
        assert!(inbox.put(3, (3, 0)), "an unknown sender");
    }

    #[tokio::test]
    async fn a_waiting_receiver_is_woken() {
        let inbox = std::sync::Arc::new(Inbox::new(1, 2));
        let listener = std::sync::Arc::clone(&inbox);
        let first = tokio::task::spawn_blocking(move || {
            std::thread::sleep(std::time::Duration::from_millis(20));
            listener.put(0, 7)
        });
        assert_eq!(inbox.next().await, 7);
        assert!(!first.await.unwrap());
    }
}
