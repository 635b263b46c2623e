//! The runtime of a node and its shutdown.

use std::time::Duration;

use anyhow::Context as _;

use crate::process::{NodeError, raise_handle_limit};
use crate::service_manager;

/// How long threads of the runtime may still wait after the work is done.
const SHUTDOWN: Duration = Duration::from_millis(200);

/// Runs `work` on a runtime of `threads` threads, which then shuts down. A camera without frames,
/// an absent fusion or a congested network does not delay the end.
///
/// # Errors
/// As `work`, and [`NodeError::Failed`] when no thread can be started.
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
