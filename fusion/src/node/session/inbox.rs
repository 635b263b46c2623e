//! Where messages wait, live: a bounded place for each node that sends them, emptied in turn, so that one that floods
//! takes nobody else's place.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// Messages that wait, by sender.
#[derive(Debug)]
pub(super) struct Inbox<T> {
    waiting: Mutex<Waiting<T>>,
    came: Notify,
    /// Places of each sender.
    places: usize,
}

#[derive(Debug)]
struct Waiting<T> {
    of_sender: Vec<VecDeque<T>>,
    /// Whose turn it is.
    turn: usize,
}

impl<T> Inbox<T> {
    /// With so many `places` for each of `senders`.
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

    /// Puts a message of the sender of this index into its place; whether its oldest was lost for it. Waits for nobody.
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

    /// The next message: of each sender that has one, in turn. Can be called off at any time; for one listener.
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
        // Whatever a thread that panicked left undone, the queues are whole.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn one_that_floods_loses_its_own_and_nobody_elses() {
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
        assert!(inbox.put(3, (3, 0)), "there is no such sender");
    }

    #[tokio::test]
    async fn whoever_waits_is_woken() {
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
