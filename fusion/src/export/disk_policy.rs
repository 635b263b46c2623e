//! Handling of disk errors: a write is retried, continues in another file, or is given up.
//!
//! It works below every buffer, so that writing continues exactly where it stopped, and no line is
//! torn.

use std::fmt::Debug;
use std::io::{self, ErrorKind};
use std::path::Path;

/// Decides how disk errors are handled. The shell implements it: code here cannot wait.
pub trait DiskPolicy: Debug + Send + Sync {
    /// `path` was refused with `error`, such as a full disk. Returns, after a while, whether to
    /// retry.
    fn try_again(&self, path: &Path, error: &io::Error) -> bool;

    /// No file can be created to continue the refused one; `path` was tried last. Returns, after a
    /// while, whether to retry.
    fn wait(&self, path: &Path, error: &io::Error) -> bool;

    /// A write to `path` succeeded.
    fn took(&self, path: &Path);

    /// Reports a file that was finally refused, as text.
    fn refused(&self, refusal: &str);
}

/// Every refusal is final.
#[derive(Debug, Clone, Copy)]
pub struct GiveUp;

impl DiskPolicy for GiveUp {
    fn try_again(&self, _path: &Path, _error: &io::Error) -> bool {
        false
    }

    fn wait(&self, _path: &Path, _error: &io::Error) -> bool {
        false
    }

    fn took(&self, _path: &Path) {}

    fn refused(&self, _refusal: &str) {}
}

/// Runs `work`, which writes to `path`, again while `disk` allows it, for errors that `may_pass`.
///
/// # Errors
/// Those of `work`.
pub(super) fn patiently<T>(
    disk: &dyn DiskPolicy,
    path: &Path,
    may_pass: impl Fn(&io::Error) -> bool,
    mut work: impl FnMut() -> io::Result<T>,
) -> io::Result<T> {
    loop {
        match work() {
            Err(error) if may_pass(&error) && disk.try_again(path, &error) => {}
            Ok(done) => {
                disk.took(path);
                return Ok(done);
            }
            Err(error) => return Err(error),
        }
    }
}

/// Whether deleting files would remove the error.
pub fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded
    )
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    /// Waits this many times.
    #[derive(Debug)]
    struct Waits(AtomicU32);

    impl DiskPolicy for Waits {
        fn try_again(&self, _path: &Path, _error: &io::Error) -> bool {
            self.0
                .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| {
                    left.checked_sub(1)
                })
                .is_ok()
        }

        fn wait(&self, _path: &Path, _error: &io::Error) -> bool {
            false
        }

        fn took(&self, _path: &Path) {}

        fn refused(&self, _refusal: &str) {}
    }

    fn tried(errors: &[ErrorKind], patience: u32) -> (usize, Option<ErrorKind>) {
        let mut n = 0;
        let done = patiently(&Waits(patience.into()), Path::new("x"), is_full, || {
            n += 1;
            errors.get(n - 1).map_or(Ok(()), |&kind| Err(kind.into()))
        });
        (n, done.err().map(|error| error.kind()))
    }

    #[test]
    fn only_transient_errors_are_retried_and_only_while_allowed() {
        use ErrorKind::{PermissionDenied, QuotaExceeded, StorageFull};
        assert_eq!(tried(&[StorageFull, QuotaExceeded], 5), (3, None));
        assert_eq!(tried(&[StorageFull; 9], 5), (6, Some(StorageFull)));
        assert_eq!(tried(&[PermissionDenied], 5), (1, Some(PermissionDenied)));
    }
}
