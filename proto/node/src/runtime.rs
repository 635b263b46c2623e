//! The runtime of a node, and how it ends.

use std::time::Duration;

use anyhow::Context as _;

use crate::process::{NodeError, raise_handle_limit};
use crate::service_manager;

/// How long threads of the runtime that still wait for something may take when all is done.
const SHUTDOWN: Duration = Duration::from_millis(200);

/// Works `work` off on a runtime of `threads` threads, which then ends: neither a camera that gives no frame, nor a
/// fusion that is not there, nor a congested network must hold up the end.
///
/// # Errors
/// As `work`, and [`NodeError::Failed`] when the system has no thread left.
pub fn block_on<T>(
    threads: usize,
    work: impl Future<Output = Result<T, NodeError>>,
) -> Result<T, NodeError> {
    raise_handle_limit();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(threads)
        .enable_all()
        .build();
    let runtime = runtime
        .context("starting the runtime")
        .map_err(NodeError::Failed)?;
    runtime.spawn(service_manager::watch());
    let outcome = runtime.block_on(work);
    runtime.shutdown_timeout(SHUTDOWN);
    outcome
}
