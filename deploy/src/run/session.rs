//! What a run needs of this process: a runtime, and the signals by which it is asked to stop.

use std::path::Path;

use anyhow::Context as _;
use farfield_node::process::NodeError;
use tokio::runtime::Runtime;

use super::check::RunPlan;
use super::follow::Follow;
use super::verdict::RunEnd;
use super::watch::watch;
use crate::signals::Signals;

/// A process that hears signals: from here on Ctrl-C no longer ends it.
pub(crate) struct Session {
    runtime: Runtime,
    signals: Signals,
}

impl Session {
    /// Starts the runtime and listens.
    ///
    /// # Errors
    /// When the system has no thread left, or signals cannot be listened for.
    pub(crate) fn open() -> Result<Self, NodeError> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build();
        let runtime = runtime
            .context("starting the runtime")
            .map_err(NodeError::Failed)?;
        let entered = runtime.enter();
        let signals = Signals::listen()
            .context("listening for signals")
            .map_err(NodeError::Failed)?;
        drop(entered);
        Ok(Self { runtime, signals })
    }

    /// Runs all nodes of `plan` to their end, with the results in `out`; `follow` hears of every tick.
    ///
    /// # Errors
    /// When a node cannot be started or watched.
    pub(crate) fn watch(
        &mut self,
        plan: &RunPlan,
        out: &Path,
        follow: &mut dyn Follow,
    ) -> Result<RunEnd, NodeError> {
        self.runtime
            .block_on(watch(plan, out, &mut self.signals, follow))
            .map_err(NodeError::Failed)
    }
}
