//! Waits out a full disk, and says so once.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use farfield_node::process::say;

use crate::export::full_disk::FullDisk;

/// How often a disk that was full is asked again.
const RETRY: Duration = Duration::from_secs(1);

/// What finds no room waits for it, from [`WaitForRoom::start`] to [`WaitForRoom::stop`].
#[derive(Debug, Default)]
pub(in crate::node) struct WaitForRoom {
    is_patient: Mutex<bool>,
    changed: Condvar,
    /// Whether it has been said that something waits.
    told: AtomicBool,
}

impl WaitForRoom {
    /// From now on what finds no room waits.
    pub(in crate::node) fn start(&self) {
        *self.lock() = true;
    }

    /// From now on what finds no room is an error, also what waits already.
    pub(in crate::node) fn stop(&self) {
        *self.lock() = false;
        self.changed.notify_all();
    }

    /// Whether something has been told to wait.
    #[cfg(test)]
    pub(super) fn is_awaited(&self) -> bool {
        self.told.load(Ordering::Relaxed)
    }

    fn lock(&self) -> MutexGuard<'_, bool> {
        self.is_patient
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

impl FullDisk for WaitForRoom {
    fn try_again(&self, path: &Path) -> bool {
        let is_patient = self.lock();
        if !*is_patient {
            return false;
        }
        if !self.told.swap(true, Ordering::Relaxed) {
            say(format_args!(
                "{}: the disk is full; what is to be written waits until there is room",
                path.display()
            ));
        }
        let waited = self
            .changed
            .wait_timeout_while(is_patient, RETRY, |is_patient| *is_patient);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        // Also at the end once more: there may be room by now.
        true
    }

    fn took(&self, path: &Path) {
        // What still fits in at the end is not worth a word.
        if self.told.load(Ordering::Relaxed) && *self.lock() {
            self.told.store(false, Ordering::Relaxed);
            say(format_args!(
                "{}: there is room again, and writing goes on",
                path.display()
            ));
        }
    }
}
