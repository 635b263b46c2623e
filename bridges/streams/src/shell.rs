//! What a stream is given to run with: tasks, the word to stop, counters, frames.

use std::sync::Arc;

use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::slot::{Counters, Feed};

/// What a stream's tasks share.
#[derive(Debug, Clone)]
pub(crate) struct Shell {
    pub(crate) tasks: TaskTracker,
    pub(crate) stop: CancellationToken,
    pub(crate) counters: Arc<Counters>,
    /// Not read by its owner: every task takes its own.
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
    pub(crate) fn spawn_to_its_end(&self, task: impl Future<Output = ()> + Send + 'static) {
        self.tasks.spawn(task);
    }
}
