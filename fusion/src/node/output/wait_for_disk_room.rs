//! Waiting for room on a disk that is full, and saying so: once, and in the status for as long as it lasts.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
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

/// What finds no room waits for it, from [`WaitForDiskRoom::start`] to [`WaitForDiskRoom::stop`].
#[derive(Default)]
pub(in crate::node) struct WaitForDiskRoom {
    make_room: Option<MakeRoom>,
    tries: AtomicU32,
    is_patient: Mutex<bool>,
    changed: Condvar,
    /// The file of which it has been said that it waits.
    told: Mutex<Option<PathBuf>>,
}

impl fmt::Debug for WaitForDiskRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WaitForDiskRoom")
            .field("is_patient", &self.is_patient)
            .field("told", &self.told)
            .finish_non_exhaustive()
    }
}

impl WaitForDiskRoom {
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

    /// What waits, in words, while something does.
    pub(in crate::node) fn notice(&self) -> Option<String> {
        self.lock_told().as_deref().map(in_words)
    }

    fn lock_told(&self) -> MutexGuard<'_, Option<PathBuf>> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, bool> {
        self.is_patient
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

impl FullDisk for WaitForDiskRoom {
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
        let before = self.lock_told().replace(path.to_owned());
        if before.is_none() {
            say(format_args!("{}", in_words(path)));
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
        if *self.lock() && self.lock_told().take().is_some() {
            self.tries.store(0, Ordering::Relaxed);
            say(format_args!(
                "{}: there is room again, and writing goes on",
                path.display()
            ));
        }
    }
}

fn in_words(path: &Path) -> String {
    format!(
        "{}: the disk is full; what is to be written waits until there is room",
        path.display()
    )
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn what_can_be_deleted_is_deleted_before_anything_waits() {
        let called = Arc::new(AtomicU32::new(0));
        let counts = Arc::clone(&called);
        let room = WaitForDiskRoom::by(move || {
            counts.fetch_add(1, Ordering::Relaxed);
        });
        let path = Path::new("a.mcap");
        assert!(!room.try_again(path), "nobody waits before the start");
        assert_eq!(called.load(Ordering::Relaxed), 0);
        room.start();
        assert!(room.try_again(path) && room.try_again(path));
        assert_eq!(called.load(Ordering::Relaxed), 1);
        let notice = room.notice().unwrap();
        assert!(notice.starts_with("a.mcap: the disk is full"), "{notice}");
        room.took(path);
        assert_eq!(room.notice(), None);
        assert!(room.try_again(path));
        assert_eq!(
            called.load(Ordering::Relaxed),
            2,
            "the next time it is full"
        );
    }
}
