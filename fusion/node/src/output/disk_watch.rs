//! Watches a disk: waits for room on a full disk, repeats refused writes, and reports problems.
//!
//! Each problem is printed once, and stays in the status while it lasts.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use farfield_node::clock;
use farfield_node::process::{LineKind, say, say_as};

use farfield_fusion::export::disk_policy::{DiskPolicy, is_full};

/// Interval of attempts on a full disk, or one that takes no file.
const RETRY: Duration = Duration::from_secs(1);

/// Attempts on a full disk between two calls that may make room.
const MAKE_ROOM_EVERY: u32 = 60;

/// Interval of repeating a refused write, and the time from the first refusal to giving up: a bus is reset within a second.
const REFUSED_RETRY: Duration = Duration::from_millis(100);
const REFUSED_FOR: Duration = Duration::from_millis(1500);

/// A longer write is reported. A disk that wakes up is faster, and the queues hold many times as much.
const STALLED_AFTER: Duration = Duration::from_secs(2);

/// The reason for waiting on a full disk.
const FULL: &str = "the disk is full";

/// May make room on a full disk.
type MakeRoom = Box<dyn Fn() + Send + Sync>;

/// A watched disk. Writes that find no room wait from [`DiskWatch::start`] to [`DiskWatch::stop`].
pub(crate) struct DiskWatch {
    make_room: Option<MakeRoom>,
    /// The number of lost items of the writer's queue since the start, and their name.
    lost: Arc<AtomicU64>,
    unit: &'static str,
    is_patient: Mutex<bool>,
    changed: Condvar,
    state: Mutex<DiskState>,
}

#[derive(Debug, Default)]
struct DiskState {
    /// The waiting file and the reason.
    waits: Option<(PathBuf, String)>,
    /// Attempts since the disk is full.
    tries: u32,
    /// Time of the first refusal.
    refused_since: Option<Instant>,
    /// The last permanent refusal, and their number.
    refused: Option<(String, usize)>,
    /// The current write.
    work: Option<Work>,
}

#[derive(Debug)]
struct Work {
    path: PathBuf,
    since: Instant,
    lost_before: u64,
    is_reported: bool,
}

impl Work {
    fn stalled(&self, now: Instant) -> Option<Duration> {
        let lasts = now.duration_since(self.since);
        (lasts >= STALLED_AFTER).then_some(lasts)
    }
}

/// A piece of work on the disk, which ends on drop.
pub(crate) struct Writing<'a>(&'a DiskWatch);

impl fmt::Debug for DiskWatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DiskWatch")
            .field("is_patient", &self.is_patient)
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}

impl DiskWatch {
    /// Watches a disk that a queue of `unit` is written to; `lost` counts those lost by the queue.
    pub(crate) fn of_queue(unit: &'static str, lost: Arc<AtomicU64>) -> Self {
        Self {
            make_room: None,
            lost,
            unit,
            is_patient: Mutex::default(),
            changed: Condvar::new(),
            state: Mutex::default(),
        }
    }

    /// Calls `make_room` when the disk is full, at once and then every minute; the waiting thread itself cannot make room.
    pub(crate) fn making_room(self, make_room: impl Fn() + Send + Sync + 'static) -> Self {
        let make_room: Option<MakeRoom> = Some(Box::new(make_room));
        Self { make_room, ..self }
    }

    /// From now on writes that find no room wait.
    pub(crate) fn start(&self) {
        *self.lock() = true;
    }

    /// From now on writes that find no room fail, including those that wait.
    pub(crate) fn stop(&self) {
        *self.lock() = false;
        self.changed.notify_all();
    }

    /// Marks `path` as being written until the result is dropped.
    pub(crate) fn writing(&self, path: &Path) -> Writing<'_> {
        self.state().work = Some(self.work_on(path));
        Writing(self)
    }

    fn work_on(&self, path: &Path) -> Work {
        Work {
            path: path.to_owned(),
            since: clock::now(),
            lost_before: self.lost(),
            is_reported: false,
        }
    }

    /// Describes the current problem, if any. Call it once a second: it also prints a write that does not return.
    pub(crate) fn notice(&self) -> Option<String> {
        let mut state = self.state();
        if let Some((path, why)) = &state.waits {
            return Some(in_words(path, why));
        }
        if let Some(work) = &mut state.work
            && let Some(lasts) = work.stalled(clock::now())
        {
            let (lost, unit) = (self.lost() - work.lost_before, self.unit);
            let notice = format!(
                "{}: the disk has not answered for {} s, {lost} {unit} are lost so far; all writes wait for it",
                work.path.display(),
                lasts.as_secs()
            );
            let is_new = !std::mem::replace(&mut work.is_reported, true);
            drop(state);
            if is_new {
                say(format_args!("{notice}"));
            }
            return Some(notice);
        }
        let (refusal, n) = state.refused.as_ref()?;
        Some(match n {
            1 => refusal.clone(),
            _ => format!("{refusal} ({n} files so far)"),
        })
    }

    fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    fn state(&self) -> MutexGuard<'_, DiskState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, bool> {
        self.is_patient
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for `span`, or until [`Self::stop`].
    fn pause(&self, span: Duration) {
        let waited = self
            .changed
            .wait_timeout_while(self.lock(), span, |is_patient| *is_patient);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    /// Reports that the disk answers again after a reported stall.
    fn report_answer(&self, work: &Work) {
        if work.is_reported {
            let lasted = clock::now().duration_since(work.since);
            let (lost, unit) = (self.lost() - work.lost_before, self.unit);
            say(format_args!(
                "{}: the disk answers again after {} s; {lost} {unit} were lost meanwhile",
                work.path.display(),
                lasted.as_secs()
            ));
        }
    }

    /// Reports once that `path` waits.
    fn report_waiting(&self, path: &Path, why: &str) {
        let waits = (path.to_owned(), why.to_owned());
        if self.state().waits.replace(waits).is_none() {
            say(format_args!("{}", in_words(path, why)));
        }
    }
}

impl Drop for Writing<'_> {
    fn drop(&mut self) {
        let work = self.0.state().work.take();
        if let Some(work) = work {
            self.0.report_answer(&work);
        }
    }
}

impl DiskPolicy for DiskWatch {
    fn try_again(&self, path: &Path, error: &std::io::Error) -> bool {
        if !is_full(error) {
            let now = clock::now();
            let since = *self.state().refused_since.get_or_insert(now);
            let may_pass = now.duration_since(since) < REFUSED_FOR;
            if may_pass {
                std::thread::sleep(REFUSED_RETRY);
            }
            return may_pass;
        }
        if !*self.lock() {
            return false;
        }
        let tries = self.state().tries;
        self.state().tries += 1;
        self.report_waiting(path, FULL);
        if let Some(make_room) = self.make_room.as_ref()
            && tries.is_multiple_of(MAKE_ROOM_EVERY)
        {
            make_room();
        }
        self.pause(RETRY);
        // At the end it is tried once more: there may be room by now.
        true
    }

    fn wait(&self, path: &Path, error: &std::io::Error) -> bool {
        if !*self.lock() {
            return false;
        }
        self.report_waiting(path, &error.to_string());
        self.pause(RETRY);
        true
    }

    fn took(&self, path: &Path) {
        // A success at the end is not reported.
        let is_patient = *self.lock();
        let mut state = self.state();
        state.refused_since = None;
        let waited = state.waits.take();
        if waited.is_some() {
            state.tries = 0;
        }
        let next = state.work.as_ref().map(|work| self.work_on(&work.path));
        let work = std::mem::replace(&mut state.work, next);
        drop(state);
        if let Some((_, why)) = waited {
            // A full disk has always answered.
            if is_patient {
                let room = if why == FULL {
                    "there is room again, and "
                } else {
                    ""
                };
                say(format_args!("{}: {room}writing goes on", path.display()));
            }
        } else if let Some(work) = work {
            self.report_answer(&work);
        }
    }

    fn refused(&self, refusal: &str) {
        let mut state = self.state();
        let n = state.refused.as_ref().map_or(0, |(_, n)| *n);
        state.refused = Some((refusal.to_owned(), n + 1));
        drop(state);
        say_as(LineKind::Error, format_args!("{refusal}"));
    }
}

fn in_words(path: &Path, why: &str) -> String {
    format!(
        "{}: {why}; writing waits until it is possible",
        path.display()
    )
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};
    use std::sync::atomic::AtomicU32;

    use super::*;

    fn watch() -> DiskWatch {
        DiskWatch::of_queue("messages", Arc::default())
    }

    #[test]
    fn room_is_made_before_writes_wait() {
        let called = Arc::new(AtomicU32::new(0));
        let counts = Arc::clone(&called);
        let disk = watch().making_room(move || {
            counts.fetch_add(1, Ordering::Relaxed);
        });
        let (path, full) = (Path::new("a.mcap"), Error::from(ErrorKind::StorageFull));
        assert!(
            !disk.try_again(path, &full),
            "no write waits before the start"
        );
        assert_eq!(called.load(Ordering::Relaxed), 0);
        disk.start();
        assert!(disk.try_again(path, &full) && disk.try_again(path, &full));
        assert_eq!(called.load(Ordering::Relaxed), 1);
        let notice = disk.notice().unwrap();
        assert!(notice.starts_with("a.mcap: the disk is full"), "{notice}");
        disk.took(path);
        assert_eq!(disk.notice(), None);
        assert!(disk.try_again(path, &full));
        assert_eq!(
            called.load(Ordering::Relaxed),
            2,
            "the next time it is full"
        );
    }

    #[test]
    fn a_stalled_write_is_reported_with_its_losses() {
        let disk = watch();
        let writing = disk.writing(Path::new("a.mcap"));
        assert_eq!(disk.notice(), None, "not yet");
        let long_ago = clock::now().checked_sub(Duration::from_secs(22)).unwrap();
        let work = |change: fn(&mut Work, Instant)| {
            change(disk.state().work.as_mut().unwrap(), long_ago);
        };
        work(|work, since| work.since = since);
        disk.lost.fetch_add(7, Ordering::Relaxed);
        let notice = disk.notice().unwrap();
        let words = "a.mcap: the disk has not answered for 22 s, 7 messages";
        assert!(notice.starts_with(words), "{notice}");
        // One piece of work is many writes; each that returns is an answer.
        disk.took(Path::new("a.mcap"));
        assert_eq!(disk.notice(), None);
        work(|work, since| work.since = since);
        assert!(disk.notice().unwrap().contains(", 0 messages"));
        drop(writing);
        assert_eq!(disk.notice(), None);
    }

    #[test]
    fn a_refused_write_is_repeated_and_files_share_the_time() {
        let disk = watch();
        let error = Error::from_raw_os_error(5);
        let from = clock::now();
        while disk.try_again(Path::new("a"), &error) {}
        let took = clock::now().duration_since(from);
        assert!(took >= REFUSED_FOR && took < 2 * REFUSED_FOR, "{took:?}");
        assert!(!disk.try_again(Path::new("b"), &error), "the disk is known");
        disk.took(Path::new("c"));
        assert!(disk.try_again(Path::new("b"), &error));
        disk.refused("b: no");
        disk.refused("c: no");
        assert_eq!(disk.notice().unwrap(), "c: no (2 files so far)");
    }
}
