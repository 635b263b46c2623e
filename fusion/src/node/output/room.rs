//! Waits out a full disk, and says so once.

use std::fmt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use farfield_node::process::say;

use crate::export::full_disk::FullDisk;

/// How often a disk that was full is asked again.
const RETRY: Duration = Duration::from_secs(1);

/// Tries of a disk that stays full between two calls of what may make room.
const MAKE_ROOM_EVERY: u32 = 60;

/// What may make room on a disk that is full.
type MakeRoom = Box<dyn Fn() + Send + Sync>;

/// What finds no room waits for it, from [`WaitForRoom::start`] to [`WaitForRoom::stop`].
#[derive(Default)]
pub(in crate::node) struct WaitForRoom {
    make_room: Option<MakeRoom>,
    tries: AtomicU32,
    is_patient: Mutex<bool>,
    changed: Condvar,
    /// Whether it has been said that something waits.
    told: AtomicBool,
}

impl fmt::Debug for WaitForRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WaitForRoom")
            .field("is_patient", &self.is_patient)
            .field("told", &self.told)
            .finish_non_exhaustive()
    }
}

impl WaitForRoom {
    /// On a disk that is full, `make_room` is called at once and then every minute: whoever waits for the room cannot.
    pub(in crate::node) fn by(make_room: impl Fn() + Send + Sync + 'static) -> Self {
        Self {
            make_room: Some(Box::new(make_room)),
            ..Self::default()
        }
    }

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
        if !*self.lock() {
            return false;
        }
        let tries = self.tries.fetch_add(1, Ordering::Relaxed);
        if let Some(make_room) = self.make_room.as_ref()
            && tries.is_multiple_of(MAKE_ROOM_EVERY)
        {
            make_room();
        }
        if !self.told.swap(true, Ordering::Relaxed) {
            say(format_args!(
                "{}: the disk is full; what is to be written waits until there is room",
                path.display()
            ));
        }
        let waited = self
            .changed
            .wait_timeout_while(self.lock(), RETRY, |is_patient| *is_patient);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        // Also at the end once more: there may be room by now.
        true
    }

    fn took(&self, path: &Path) {
        // What still fits in at the end is not worth a word.
        if self.told.load(Ordering::Relaxed) && *self.lock() {
            self.told.store(false, Ordering::Relaxed);
            self.tries.store(0, Ordering::Relaxed);
            say(format_args!(
                "{}: there is room again, and writing goes on",
                path.display()
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn what_can_be_deleted_is_deleted_before_anything_waits() {
        let called = Arc::new(AtomicU32::new(0));
        let counts = Arc::clone(&called);
        let room = WaitForRoom::by(move || {
            counts.fetch_add(1, Ordering::Relaxed);
        });
        let path = Path::new("a.mcap");
        assert!(!room.try_again(path), "nobody waits before the start");
        assert_eq!(called.load(Ordering::Relaxed), 0);
        room.start();
        assert!(room.try_again(path) && room.try_again(path));
        assert_eq!(called.load(Ordering::Relaxed), 1);
        room.took(path);
        assert!(room.try_again(path));
        assert_eq!(
            called.load(Ordering::Relaxed),
            2,
            "the next time it is full"
        );
    }
}
