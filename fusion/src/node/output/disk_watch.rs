//! Watches a disk that is written to: waits for room where it is full, tries again what it refuses, and reports what is wrong.
//!
//! Each thing is reported once on the terminal, and in the status for as long as it lasts.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use farfield_node::clock;
use farfield_node::process::say;

use crate::export::disk_policy::{DiskPolicy, is_full};

/// How often a disk that was full, or takes no file, is asked again.
const RETRY: Duration = Duration::from_secs(1);

/// Tries of a disk that stays full between two calls of what may make room.
const MAKE_ROOM_EVERY: u32 = 60;

/// How often a write that was refused is tried again, and for how long after the first refusal: a bus is reset within a second.
const REFUSED_RETRY: Duration = Duration::from_millis(100);
const REFUSED_FOR: Duration = Duration::from_millis(1500);

/// A write that takes longer is reported: a disk that wakes up takes no longer, and the queues hold many times as much.
const STALLED_AFTER: Duration = Duration::from_secs(2);

/// Why what finds no room waits.
const FULL: &str = "the disk is full";

/// What may make room on a disk that is full.
type MakeRoom = Box<dyn Fn() + Send + Sync>;

/// What finds no room waits for it, from [`DiskWatch::start`] to [`DiskWatch::stop`].
pub(in crate::node) struct DiskWatch {
    make_room: Option<MakeRoom>,
    /// What finds no place in the queue of who writes, since the start, and what it is.
    lost: Arc<AtomicU64>,
    unit: &'static str,
    is_patient: Mutex<bool>,
    changed: Condvar,
    state: Mutex<DiskState>,
}

#[derive(Debug, Default)]
struct DiskState {
    /// The file that waits, and why.
    waits: Option<(PathBuf, String)>,
    /// Tries to find room, since it is full.
    tries: u32,
    /// Since when writes are refused.
    refused_since: Option<Instant>,
    /// The last that was refused for good, and how many there were.
    refused: Option<(String, usize)>,
    /// What is being written.
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

/// A piece of work on the disk, until it is dropped.
pub(in crate::node) struct Writing<'a>(&'a DiskWatch);

impl fmt::Debug for DiskWatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DiskWatch")
            .field("is_patient", &self.is_patient)
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}

impl DiskWatch {
    /// Of a disk to which a queue of so many `unit` is written; `lost` counts those that find no place in it.
    pub(in crate::node) fn of_queue(unit: &'static str, lost: Arc<AtomicU64>) -> Self {
        Self {
            make_room: None,
            lost,
            unit,
            is_patient: Mutex::default(),
            changed: Condvar::new(),
            state: Mutex::default(),
        }
    }

    /// On a disk that is full, `make_room` is called at once and then every minute: the thread that waits for the room cannot.
    pub(in crate::node) fn making_room(self, make_room: impl Fn() + Send + Sync + 'static) -> Self {
        let make_room: Option<MakeRoom> = Some(Box::new(make_room));
        Self { make_room, ..self }
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

    /// Says that `path` is written to, until what it returns is dropped.
    pub(in crate::node) fn writing(&self, path: &Path) -> Writing<'_> {
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

    /// What is wrong with the disk, in words, while something is. Called once a second: a write that does not return is reported
    /// on the terminal here.
    pub(in crate::node) fn notice(&self) -> Option<String> {
        let mut state = self.state();
        if let Some((path, why)) = &state.waits {
            return Some(in_words(path, why));
        }
        if let Some(work) = &mut state.work
            && let Some(lasts) = work.stalled(clock::now())
        {
            let (lost, unit) = (self.lost() - work.lost_before, self.unit);
            let notice = format!(
                "{}: the disk has not answered for {} s, {lost} {unit} are lost so far; what is to be written waits for it",
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

    /// Reports that a disk has answered which had not for long.
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
        // Also at the end once more: there may be room by now.
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
        // What still fits in at the end is not worth a word.
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
            // A disk that was full has answered all the time.
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
        say(format_args!("error: {refusal}"));
    }
}

fn in_words(path: &Path, why: &str) -> String {
    format!(
        "{}: {why}; what is to be written waits until it can be",
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
    fn what_can_be_deleted_is_deleted_before_anything_waits() {
        let called = Arc::new(AtomicU32::new(0));
        let counts = Arc::clone(&called);
        let disk = watch().making_room(move || {
            counts.fetch_add(1, Ordering::Relaxed);
        });
        let (path, full) = (Path::new("a.mcap"), Error::from(ErrorKind::StorageFull));
        assert!(
            !disk.try_again(path, &full),
            "nothing waits before the start"
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
    fn a_write_that_does_not_return_is_reported_with_what_is_lost_meanwhile() {
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
        let words = "a.mcap: the disk has not answered for 22 s, 7 messages are lost so far";
        assert!(notice.starts_with(words), "{notice}");
        // A piece of work is many writes: each that returns is an answer.
        disk.took(Path::new("a.mcap"));
        assert_eq!(disk.notice(), None);
        work(|work, since| work.since = since);
        assert!(disk.notice().unwrap().contains(", 0 messages"));
        drop(writing);
        assert_eq!(disk.notice(), None);
    }

    #[test]
    fn a_write_that_is_refused_is_tried_for_a_while_and_files_share_it() {
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
