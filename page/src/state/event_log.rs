//! The last events, numbered, so that every client gets each once.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use tokio::sync::watch;

use super::lock;
use crate::protocol::text::EventLine;

/// Events that are kept.
const MAX_EVENTS: usize = 1000;

/// Events in the order in which they happened.
#[derive(Debug)]
pub(crate) struct EventLog {
    lines: Mutex<VecDeque<Arc<EventLine>>>,
    /// How many there were, ever.
    count: watch::Sender<u64>,
}

impl Default for EventLog {
    fn default() -> Self {
        Self {
            lines: Mutex::default(),
            count: watch::Sender::new(0),
        }
    }
}

impl EventLog {
    pub(crate) fn push(&self, events: Vec<EventLine>) {
        if events.is_empty() {
            return;
        }
        let mut lines = lock(&self.lines);
        let n = events.len() as u64;
        for event in events {
            if lines.len() >= MAX_EVENTS {
                lines.pop_front();
            }
            lines.push_back(Arc::new(event));
        }
        self.count.send_modify(|count| *count += n);
    }

    /// Tells when there are more.
    pub(crate) fn watch(&self) -> watch::Receiver<u64> {
        self.count.subscribe()
    }

    /// Those after the first `told`, at most the last `most`; and how many there were, ever.
    pub(crate) fn after(&self, told: u64, most: usize) -> (Vec<Arc<EventLine>>, u64) {
        let lines = lock(&self.lines);
        let count = *self.count.borrow();
        let new = usize::try_from(count.saturating_sub(told)).unwrap_or(usize::MAX);
        let n = new.min(most).min(lines.len());
        (
            lines.range(lines.len() - n..).map(Arc::clone).collect(),
            count,
        )
    }
}
