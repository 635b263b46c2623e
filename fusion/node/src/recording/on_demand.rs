//! Recordings that are started and stopped during a live run, with the button of the live page.
//!
//! Such a recording begins in the middle of a run. It contains the people present then and all later messages, and can be viewed
//! like any other. A replay detects the people anew, and recognises them by place and body
//! ([`farfield_fusion::recording::replay::PatchOwners::ByPlace`]). Its holes are not filled from the edges.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, RwLock, Weak};
use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow, ensure};
use farfield_fusion::identity::known::KnownPeople;
use farfield_fusion::recording::channels;
use farfield_fusion::recording::expected::ExpectedPeople;
use farfield_fusion::recording::writer::Head;
use farfield_node::clock;
use farfield_proto::id::SessionId;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::tick::{Micros, Tick};
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;
use farfield_proto::venue::parameters::RecordingParameters;

use super::file::RecordingFile;
use super::head::head;
use super::queue::RecordingQueue;
use super::thread::RecordingThread;
use crate::output::disk_watch::DiskWatch;
use crate::session::messages::RunMode;
use crate::session::wiretap::{CopiedMessage, CopiedStep, Wiretap};
use crate::subjects::KnownSubjects;

/// The recordings on demand of a live run; one at a time.
pub struct RecordingsOnDemand {
    venue: String,
    folder: PathBuf,
    session: SessionId,
    parameters: RecordingParameters,
    /// Read when the run begins, because its files may be edited later.
    head: Result<Head, String>,
    /// The tick of the session's first boxes.
    first: OnceLock<Tick>,
    /// The people present in the last second.
    people: Mutex<Option<KnownPeople>>,
    /// Notified of recordings that begin. Weak, because they may hold this object. Empty before the run.
    listeners: OnceLock<Vec<Weak<dyn Wiretap>>>,
    /// The current recording, for callers that must not wait for one that begins or ends.
    current: RwLock<Option<Current>>,
    recording: Mutex<RecordingState>,
}

/// The parts of the current recording that each message needs.
struct Current {
    file: PathBuf,
    queue: Arc<RecordingQueue>,
    disk: Arc<DiskWatch>,
}

/// The state of the recordings.
#[derive(Default)]
struct RecordingState {
    running: Option<Running>,
    last: Option<RecordingOnDemand>,
    /// Threads that finish stopped recordings: a disk may hang.
    closing: Vec<JoinHandle<()>>,
    /// The recording of the whole run, if there is one.
    of_run: Option<OfRun>,
    /// Whether the run is over.
    is_over: bool,
}

struct Running {
    thread: RecordingThread,
    since_us: Micros,
}

struct OfRun {
    file: PathBuf,
    queue: Arc<RecordingQueue>,
    since_us: Micros,
}

/// The state of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingOnDemand {
    /// Its file.
    pub file: PathBuf,
    /// Whether it is running.
    pub is_running: bool,
    /// Its start, microseconds of Unix time.
    pub since_us: Micros,
    /// Bytes on the disk.
    pub bytes: u64,
    /// Messages lost because the queue was full.
    pub lost: u64,
    /// The reason of an early end.
    pub failure: Option<String>,
}

impl RecordingsOnDemand {
    /// The recordings of a run of `venue`, read from `path`, in `session`; their files go to `folder`.
    pub(crate) fn of_run(
        venue: &Venue,
        path: &Path,
        keypoints: &KeypointSet,
        session: SessionId,
        folder: PathBuf,
        subjects: &KnownSubjects,
    ) -> Self {
        let head = head(venue, path, keypoints, FUSION, subjects);
        Self {
            venue: venue.name.clone(),
            folder,
            session,
            parameters: venue.parameters.recording.clone(),
            head: head.map_err(|error| format!("{error:#}")),
            first: OnceLock::new(),
            people: Mutex::default(),
            listeners: OnceLock::new(),
            current: RwLock::default(),
            recording: Mutex::default(),
        }
    }

    /// Registers the recording of the whole run.
    pub(crate) fn set_run_recording(&self, recording: &RecordingThread) {
        self.state().of_run = Some(OfRun {
            file: recording.file().to_owned(),
            queue: recording.queue(),
            since_us: now_us(),
        });
    }

    /// Notifies `listeners` of every recording from now on. None begins before. Called once.
    pub(crate) fn set_listeners(&self, listeners: &[Arc<dyn Wiretap>]) {
        self.listeners
            .get_or_init(|| listeners.iter().map(Arc::downgrade).collect());
    }

    /// Sets the people present now: a recording that begins next contains them.
    pub(crate) fn set_people(&self, people: &KnownPeople) {
        *unpoisoned(self.people.lock()) = Some(people.clone());
    }

    /// Problems of the current recording for the operator: a full or slow disk. Never waits.
    pub(crate) fn notice(&self) -> Option<String> {
        let current = unpoisoned(self.current.read());
        let current = current.as_ref()?;
        current.disk.notice().or_else(|| {
            let lost = Some(current.queue.state().lost()).filter(|lost| *lost > 0)?;
            let file = current.file.display();
            Some(format!(
                "{file} lacks {lost} messages: the disk is too slow"
            ))
        })
    }

    /// Begins a recording in a new file named after venue and time.
    ///
    /// # Errors
    /// A recording is running, the run has not begun or is over, or the file cannot be written. Nothing is left behind then.
    pub fn start(&self) -> anyhow::Result<PathBuf> {
        let mut state = self.state();
        ensure!(!state.is_over, "the run is over");
        let listeners = self.listeners.get();
        let listeners = listeners.context("the run has not begun yet: try again")?;
        if let Some(of_run) = &state.of_run
            && of_run.queue.failure().is_none()
        {
            return Err(anyhow!(
                "{} is running since the run began (`--record`)",
                of_run.file.display()
            ));
        }
        state.of_run = None;
        if let Some(running) = state.running.take() {
            let so_far = running.thread.so_far();
            if so_far.failure.is_none() {
                state.running = Some(running);
                return Err(anyhow!("{} is running already", so_far.file.display()));
            }
            // Its writer has failed, and has reported why.
            state.last = Some(running.finish());
        }
        let people = self.people_as_json()?;
        let thread = self.open()?;
        let queue = thread.queue();
        if let Some(first) = self.first.get() {
            queue.begins_after(*first);
        }
        if let Some(people) = people {
            queue.note(&channels::expected(&self.venue), &people, now_us());
        }
        let file = thread.file().to_owned();
        *unpoisoned(self.current.write()) = Some(Current {
            file: file.clone(),
            queue,
            disk: thread.disk_watch(),
        });
        state.running = Some(Running {
            thread,
            since_us: now_us(),
        });
        for listener in listeners.iter().filter_map(Weak::upgrade) {
            listener.recording_begins(&file);
        }
        Ok(file)
    }

    /// Stops the current recording. A separate thread completes its file.
    ///
    /// # Errors
    /// No recording that can be stopped is running, or the system cannot start a thread.
    pub fn stop(self: &Arc<Self>) -> anyhow::Result<()> {
        let mut state = self.state();
        let Some(running) = state.running.take() else {
            return Err(match &state.of_run {
                Some(of_run) => anyhow!("{} ends with the run (`--record`)", of_run.file.display()),
                None => anyhow!("no recording is running"),
            });
        };
        *unpoisoned(self.current.write()) = None;
        state.last = Some(RecordingOnDemand {
            is_running: false,
            ..running.now()
        });
        state.closing.retain(|closing| !closing.is_finished());
        let this = Arc::clone(self);
        let thread = std::thread::Builder::new().name("recorder's end".to_owned());
        let closing = thread.spawn(move || {
            let last = running.finish();
            this.state().last = Some(last);
        });
        state.closing.push(closing.context("ending the recording")?);
        Ok(())
    }

    /// Stops the current recording, if any, waits until all files are complete, and returns the last one. No further recording
    /// begins.
    pub(crate) fn end(&self) -> Option<RecordingOnDemand> {
        let mut state = self.state();
        state.is_over = true;
        let (running, closing) = (state.running.take(), std::mem::take(&mut state.closing));
        *unpoisoned(self.current.write()) = None;
        drop(state);
        let last = running.map(Running::finish);
        for closing in closing {
            // A thread that panicked has reported it.
            drop(closing.join());
        }
        let mut state = self.state();
        if last.is_some() {
            state.last = last;
        }
        state.last.clone()
    }

    /// The state of the current recording, otherwise of the last; `None` if there was none.
    pub fn now(&self) -> Option<RecordingOnDemand> {
        let state = self.state();
        if let Some(of_run) = &state.of_run {
            let failure = of_run.queue.failure();
            return Some(RecordingOnDemand {
                bytes: bytes_of(&of_run.file),
                file: of_run.file.clone(),
                is_running: failure.is_none(),
                since_us: of_run.since_us,
                lost: of_run.queue.state().lost(),
                failure,
            });
        }
        let running = state.running.as_ref().map(Running::now);
        running.or_else(|| state.last.clone())
    }

    /// Creates a recording; leaves nothing behind if that fails.
    fn open(&self) -> anyhow::Result<RecordingThread> {
        let head = self.head.as_ref().map_err(|error| anyhow!("{error}"))?;
        let head = Head {
            started_ns: u64::try_from(clock::unix_time().as_nanos()).unwrap_or(u64::MAX),
            ..head.clone()
        };
        let file = RecordingFile::make(&self.folder, &self.venue)?;
        let (session, mode) = (self.session, RunMode::Live);
        RecordingThread::start(file, head, session, mode, &self.parameters)
    }

    /// The people present, in the format for a session that expects people of an earlier one.
    fn people_as_json(&self) -> anyhow::Result<Option<Vec<u8>>> {
        let Some(known) = unpoisoned(self.people.lock()).clone() else {
            return Ok(None);
        };
        let session = self.session;
        let json = serde_json::to_vec(&ExpectedPeople { session, known });
        json.context("writing people as JSON").map(Some)
    }

    fn state(&self) -> MutexGuard<'_, RecordingState> {
        unpoisoned(self.recording.lock())
    }

    fn with_queue<T>(&self, use_queue: impl FnOnce(&RecordingQueue) -> T) -> Option<T> {
        let current = unpoisoned(self.current.read());
        current.as_ref().map(|current| use_queue(&current.queue))
    }
}

impl Running {
    fn now(&self) -> RecordingOnDemand {
        let so_far = self.thread.so_far();
        RecordingOnDemand {
            bytes: bytes_of(&so_far.file),
            file: so_far.file,
            is_running: so_far.failure.is_none(),
            since_us: self.since_us,
            lost: so_far.lost,
            failure: so_far.failure,
        }
    }

    /// Waits until the file is complete.
    fn finish(self) -> RecordingOnDemand {
        let before = self.now();
        let (failure, lost) = match self.thread.finish_waiting() {
            Ok(summary) => (summary.failure, summary.lost),
            Err(error) => (Some(format!("{error:#}")), before.lost),
        };
        RecordingOnDemand {
            is_running: false,
            bytes: bytes_of(&before.file),
            lost,
            failure,
            ..before
        }
    }
}

/// Ignores a poisoned lock: all data here are replaced as a whole, so a thread that panicked left them consistent.
fn unpoisoned<T>(locked: Result<T, PoisonError<T>>) -> T {
    locked.unwrap_or_else(PoisonError::into_inner)
}

impl Wiretap for RecordingsOnDemand {
    fn received(&self, message: CopiedMessage<'_>) {
        self.with_queue(|queue| queue.received(message));
    }

    fn published(&self, message: CopiedMessage<'_>) {
        self.with_queue(|queue| queue.published(message));
    }

    fn decided(&self, decided: CopiedStep<'_>) {
        self.first.get_or_init(|| decided.group.tick);
        self.with_queue(|queue| queue.decided(decided));
    }

    fn failure(&self) -> Option<String> {
        self.with_queue(Wiretap::failure).flatten()
    }
}

fn bytes_of(file: &Path) -> u64 {
    std::fs::metadata(file).map_or(0, |facts| facts.len())
}

fn now_us() -> Micros {
    Micros::try_from(clock::unix_time().as_micros()).unwrap_or(Micros::MAX)
}

#[cfg(test)]
mod tests {
    use super::super::thread::tests as thread_tests;
    use super::*;

    fn recordings(folder: &Path) -> Arc<RecordingsOnDemand> {
        Arc::new(RecordingsOnDemand {
            venue: "hall".to_owned(),
            folder: folder.to_owned(),
            session: SessionId(7),
            parameters: RecordingParameters::default(),
            head: Ok(thread_tests::head()),
            first: OnceLock::new(),
            people: Mutex::default(),
            listeners: OnceLock::new(),
            current: RwLock::default(),
            recording: Mutex::default(),
        })
    }

    #[test]
    fn one_recording_runs_at_a_time_and_all_become_complete() {
        let folder = tempfile::tempdir().unwrap();
        let recordings = recordings(folder.path());
        let early = recordings.start().unwrap_err();
        assert!(early.to_string().contains("not begun"), "{early}");
        recordings.set_listeners(&[]);
        assert!(recordings.stop().is_err(), "there is none");
        let first = recordings.start().unwrap();
        let twice = recordings.start().unwrap_err().to_string();
        assert!(twice.contains(first.to_str().unwrap()), "{twice}");
        assert!(recordings.now().is_some_and(|now| now.is_running));
        recordings.stop().unwrap();
        assert!(recordings.now().is_some_and(|now| !now.is_running));
        let second = recordings.start().unwrap();
        assert_ne!(first, second);
        let last = recordings.end().unwrap();
        assert_eq!((last.file, last.failure), (second.clone(), None));
        assert!(recordings.start().is_err(), "the run is over");
        for file in [first, second] {
            let bytes = std::fs::read(file).unwrap();
            assert!(bytes.ends_with(mcap::MAGIC), "whole");
        }
    }

    #[test]
    fn a_recording_that_cannot_begin_leaves_nothing_and_can_be_retried() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("gone");
        std::fs::write(&missing, "no folder").unwrap();
        let recordings = recordings(&missing);
        recordings.set_listeners(&[]);
        assert!(recordings.start().is_err());
        assert!(recordings.now().is_none());
        std::fs::remove_file(&missing).unwrap();
        std::fs::create_dir(&missing).unwrap();
        let file = recordings.start().unwrap();
        assert!(file.starts_with(&missing), "{}", file.display());
        assert!(recordings.end().is_some());
    }
}
