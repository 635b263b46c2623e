//! Works on several cameras at once, until an interruption.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use anyhow::anyhow;
use farfield_node::process::Ending;
use tokio::runtime::Runtime;

use crate::signals::Signals;

/// Receives the request to stop.
pub(super) struct Interrupt {
    requested: Arc<AtomicBool>,
    /// Receives signals as long as it exists.
    _runtime: Runtime,
}

impl Interrupt {
    /// Catches signals: from here on Ctrl-C no longer ends the process.
    ///
    /// # Errors
    /// When signals cannot be caught.
    pub(super) fn catch() -> std::io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()?;
        let mut signals = {
            let _entered = runtime.enter();
            Signals::catch()?
        };
        let requested = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&requested);
        runtime.handle().spawn(async move {
            signals.next().await;
            flag.store(true, Ordering::Relaxed);
        });
        Ok(Self {
            requested,
            _runtime: runtime,
        })
    }

    /// Whether to stop.
    pub(super) fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }
}

/// Calls `record` for each of `n` cameras, as many at once as there are cores. Stops at the first failure.
///
/// # Errors
/// The first error of a camera.
pub(super) fn each_camera(
    n: usize,
    interrupt: &Interrupt,
    record: impl Fn(usize) -> anyhow::Result<Ending> + Sync,
) -> anyhow::Result<Ending> {
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let work = || -> anyhow::Result<Ending> {
        loop {
            let camera = next.fetch_add(1, Ordering::Relaxed);
            if camera >= n || failed.load(Ordering::Relaxed) {
                return Ok(Ending::Done);
            }
            if interrupt.is_requested() {
                return Ok(Ending::Interrupted);
            }
            match record(camera) {
                Ok(Ending::Done) => {}
                Ok(Ending::Interrupted) => return Ok(Ending::Interrupted),
                Err(error) => {
                    failed.store(true, Ordering::Relaxed);
                    return Err(error);
                }
            }
        }
    };
    let threads = thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let ends: Vec<anyhow::Result<Ending>> = thread::scope(|scope| {
        let threads: Vec<_> = (0..threads.min(n)).map(|_| scope.spawn(work)).collect();
        let join = |thread: thread::ScopedJoinHandle<'_, anyhow::Result<Ending>>| {
            let panicked = |_| Err(anyhow!("a camera has panicked"));
            thread.join().unwrap_or_else(panicked)
        };
        threads.into_iter().map(join).collect()
    });
    let mut ending = Ending::Done;
    for end in ends {
        if end? == Ending::Interrupted {
            ending = Ending::Interrupted;
        }
    }
    Ok(ending)
}
