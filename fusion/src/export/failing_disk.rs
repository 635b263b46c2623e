//! Simulated disk errors for tests, per thread: work on files of a given name fails a number of
//! times.

use std::cell::RefCell;
use std::io;
use std::path::Path;

/// The work that fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Work {
    Write,
    Sync,
    Join,
}

/// The system's "Input/output error".
const EIO: i32 = 5;

thread_local! {
    static FAILING: RefCell<Option<(&'static str, Work, u32)>> = const { RefCell::new(None) };
}

/// Makes the next `times` of `work` on files whose name begins with `name` fail.
pub(crate) fn fail(name: &'static str, work: Work, times: u32) {
    FAILING.set(Some((name, work, times)));
}

/// Fails if requested.
pub(crate) fn check(path: &Path, work: Work) -> io::Result<()> {
    FAILING.with_borrow_mut(|failing| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match failing {
            Some((begins, fails, times))
                if *times > 0 && *fails == work && name.starts_with(*begins) =>
            {
                *times -= 1;
                Err(io::Error::from_raw_os_error(EIO))
            }
            _ => Ok(()),
        }
    })
}
