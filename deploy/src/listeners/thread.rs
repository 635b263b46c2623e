//! The thread that serves pages and streams; threads with fusion's messages do none of this work.

use std::sync::Arc;
use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow};
use farfield_node::process::NodeError;
use tokio::runtime::Builder;
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

/// A thread with its own runtime, which ends when this value is dropped.
#[derive(Debug)]
pub(super) struct ServingThread {
    stop: CancellationToken,
    thread: Option<JoinHandle<()>>,
}

impl ServingThread {
    /// Runs `open` on a new thread and keeps the result open until this value is dropped; then runs `close`.
    ///
    /// # Errors
    /// The error of `open`; no thread available.
    pub(super) async fn start<T, K, Open, Close>(
        open: impl FnOnce() -> Open + Send + 'static,
        close: impl FnOnce(K) -> Close + Send + 'static,
    ) -> Result<(T, Arc<Self>), NodeError>
    where
        T: Send + 'static,
        Open: Future<Output = Result<(T, K), NodeError>>,
        Close: Future<Output = ()>,
    {
        let stop = CancellationToken::new();
        let (sender, opened) = oneshot::channel();
        let until = stop.clone();
        let serve = move || {
            let runtime = Builder::new_current_thread().enable_all().build();
            let runtime = match runtime.context("starting the runtime of page and streams") {
                Ok(runtime) => runtime,
                Err(error) => {
                    drop(sender.send(Err(NodeError::Failed(error))));
                    return;
                }
            };
            runtime.block_on(async move {
                match open().await {
                    Err(error) => drop(sender.send(Err(error))),
                    Ok((opened, kept)) => {
                        // Without a receiver it ends at once.
                        if sender.send(Ok(opened)).is_ok() {
                            until.cancelled().await;
                        }
                        close(kept).await;
                    }
                }
            });
        };
        let thread = std::thread::Builder::new().name("page-and-streams".to_owned());
        let thread = thread
            .spawn(serve)
            .context("starting the thread of page and streams")
            .map_err(NodeError::Failed)?;
        let serving = Arc::new(Self {
            stop,
            thread: Some(thread),
        });
        let opened = opened.await;
        let ended = || NodeError::Failed(anyhow!("the thread of page and streams has ended"));
        Ok((opened.map_err(|_| ended())??, serving))
    }
}

impl Drop for ServingThread {
    fn drop(&mut self) {
        self.stop.cancel();
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was printed already; its tasks end within two seconds.
            drop(thread.join());
        }
    }
}
