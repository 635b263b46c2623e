//! What is done when a disk has no room: a write that found none is tried again, or given up.
//!
//! Beneath every buffer, so that what is written goes on exactly where it stopped, and nothing is torn.

use std::fmt::Debug;
use std::io::{self, ErrorKind};
use std::path::Path;

/// What is done when a disk has no room. Shells decide: here nothing can wait.
pub trait FullDisk: Debug + Send + Sync {
    /// `path` has found no room. Returns after a while whether to try again.
    fn try_again(&self, path: &Path) -> bool;

    /// `path` has been written to.
    fn took(&self, path: &Path);
}

/// A full disk is an error like another.
#[derive(Debug, Clone, Copy)]
pub struct GiveUp;

impl FullDisk for GiveUp {
    fn try_again(&self, _path: &Path) -> bool {
        false
    }

    fn took(&self, _path: &Path) {}
}

/// Does what writes to `path`, for as long as only room is missing and `disk` has patience.
///
/// # Errors
/// Those of `work`.
pub(super) fn patiently<T>(
    disk: &dyn FullDisk,
    path: &Path,
    mut work: impl FnMut() -> io::Result<T>,
) -> io::Result<T> {
    loop {
        match work() {
            Err(error) if is_full(&error) && disk.try_again(path) => {}
            Ok(done) => {
                disk.took(path);
                return Ok(done);
            }
            Err(error) => return Err(error),
        }
    }
}

/// Whether there would be no error if somebody deleted something.
fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded
    )
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    /// Waits so many times.
    #[derive(Debug)]
    struct Waits(AtomicU32);

    impl FullDisk for Waits {
        fn try_again(&self, _path: &Path) -> bool {
            self.0
                .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| {
                    left.checked_sub(1)
                })
                .is_ok()
        }

        fn took(&self, _path: &Path) {}
    }

    fn tried(errors: &[ErrorKind], patience: u32) -> (usize, Option<ErrorKind>) {
        let mut n = 0;
        let done = patiently(&Waits(patience.into()), Path::new("x"), || {
            n += 1;
            errors.get(n - 1).map_or(Ok(()), |&kind| Err(kind.into()))
        });
        (n, done.err().map(|error| error.kind()))
    }

    #[test]
    fn only_missing_room_is_waited_for_and_only_while_there_is_patience() {
        use ErrorKind::{PermissionDenied, QuotaExceeded, StorageFull};
        assert_eq!(tried(&[StorageFull, QuotaExceeded], 5), (3, None));
        assert_eq!(tried(&[StorageFull; 9], 5), (6, Some(StorageFull)));
        assert_eq!(tried(&[PermissionDenied], 5), (1, Some(PermissionDenied)));
    }
}
