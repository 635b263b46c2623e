//! Recordings that somebody starts and stops while a live run goes on: the button of the live page.
//!
//! Such a recording begins in the middle of a run. It holds who was there then and all that passes from then on, and can be
//! looked at as any other. Solved again, people are found anew, and recognised by place and body
//! ([`crate::recording::replay::PatchOwners::ByPlace`]). Edges are not asked for what it lacks.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, RwLock, Weak};
use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow, ensure};
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
use crate::identity::known::KnownPeople;
use crate::node::output::disk_watch::DiskWatch;
use crate::node::session::mode::RunMode;
use crate::node::session::wiretap::{CopiedMessage, CopiedStep, Wiretap};
use crate::node::subjects::KnownSubjects;
use crate::recording::channels;
use crate::recording::expected::ExpectedPeople;
use crate::recording::writer::Head;

/// The recordings of a live run that are started and stopped while it goes on; one at a time.
pub struct RecordingsOnDemand {
    venue: String,
    folder: PathBuf,
    session: SessionId,
    parameters: RecordingParameters,
    /// Made when the run begins: its files may be edited while it goes on.
    head: Result<Head, String>,
    /// The tick of the session's first boxes.
    first: OnceLock<Tick>,
    /// Who is there, as of the last second.
    people: Mutex<Option<KnownPeople>>,
    /// Who is told of recordings that begin; they may know this one, and must not be kept by it. Empty before the run.
    listeners: OnceLock<Vec<Weak<dyn Wiretap>>>,
    /// The one that goes on, for those who must not wait for one that begins or ends.
    current: RwLock<Option<Current>>,
    recording: Mutex<Known>,
}

/// What is needed of the one that goes on at every message.
struct Current {
    file: PathBuf,
    queue: Arc<RecordingQueue>,
    disk: Arc<DiskWatch>,
}

/// What is known of recordings.
#[derive(Default)]
struct Known {
    running: Option<Running>,
    last: Option<RecordingOnDemand>,
    /// Those that have been stopped and are not whole yet: a disk may hang.
    closing: Vec<JoinHandle<()>>,
    /// The recording that goes on from the beginning of the run to its end.
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

/// How it stands with a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingOnDemand {
    /// Its file.
    pub file: PathBuf,
    /// Whether it goes on.
    pub is_running: bool,
    /// When it began, microseconds of Unix time.
    pub since_us: Micros,
    /// Bytes on the disk.
    pub bytes: u64,
    /// Messages that found no place in its queue.
    pub lost: u64,
    /// Why it has ended early.
    pub failure: Option<String>,
}

impl RecordingsOnDemand {
    /// The recordings of a run of `venue`, whose file is at `path`, in `session`; they go to `folder`.
    pub(in crate::node) fn of_run(
        (venue, path): (&Venue, &Path),
        keypoints: &KeypointSet,
        session: SessionId,
        folder: PathBuf,
        subjects: &KnownSubjects,
    ) -> Self {
        let head = head((venue, path), keypoints, FUSION, subjects);
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

    /// Says that `recording` goes on for as long as the run does.
    pub(in crate::node) fn leave_it_to(&self, recording: &RecordingThread) {
        self.known().of_run = Some(OfRun {
            file: recording.file().to_owned(),
            queue: recording.queue(),
            since_us: now_us(),
        });
    }

    /// Tells `listeners` of every recording that begins; none begins before. Called once.
    pub(in crate::node) fn tell(&self, listeners: &[Arc<dyn Wiretap>]) {
        self.listeners
            .get_or_init(|| listeners.iter().map(Arc::downgrade).collect());
    }

    /// Says who is there: a recording that begins soon begins with them.
    pub(in crate::node) fn knows(&self, people: &KnownPeople) {
        *whole(self.people.lock()) = Some(people.clone());
    }

    /// What the operator must know of the one that goes on: that its disk is full, or too slow. Never waits.
    pub(in crate::node) fn notice(&self) -> Option<String> {
        let current = whole(self.current.read());
        let current = current.as_ref()?;
        current.disk.notice().or_else(|| {
            let lost = Some(current.queue.state().lost()).filter(|lost| *lost > 0)?;
            let file = current.file.display();
            Some(format!(
                "{file} lacks {lost} messages: the disk is too slow"
            ))
        })
    }

    /// Begins one, in a new file named after venue and time.
    ///
    /// # Errors
    /// When one goes on already, the run has not begun or is over, or none can be written: nothing is left behind then.
    pub fn start(&self) -> anyhow::Result<PathBuf> {
        let mut known = self.known();
        ensure!(!known.is_over, "the run is over");
        let listeners = self.listeners.get();
        let listeners = listeners.context("the run has not begun yet: try again")?;
        if let Some(of_run) = &known.of_run
            && of_run.queue.failure().is_none()
        {
            return Err(anyhow!(
                "{} goes on since the run began (`--record`)",
                of_run.file.display()
            ));
        }
        known.of_run = None;
        if let Some(running) = known.running.take() {
            let so_far = running.thread.so_far();
            if so_far.failure.is_none() {
                known.running = Some(running);
                return Err(anyhow!("{} goes on already", so_far.file.display()));
            }
            // Its writer has ended, and said why.
            known.last = Some(running.finish());
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
        *whole(self.current.write()) = Some(Current {
            file: file.clone(),
            queue,
            disk: thread.disk_watch(),
        });
        known.running = Some(Running {
            thread,
            since_us: now_us(),
        });
        for listener in listeners.iter().filter_map(Weak::upgrade) {
            listener.recording_begins(&file);
        }
        Ok(file)
    }

    /// Ends the one that goes on. Its file is whole when a thread of its own has written what is left.
    ///
    /// # Errors
    /// When none goes on that can be ended, or the system has no thread.
    pub fn stop(self: &Arc<Self>) -> anyhow::Result<()> {
        let mut known = self.known();
        let Some(running) = known.running.take() else {
            return Err(match &known.of_run {
                Some(of_run) => anyhow!("{} ends with the run (`--record`)", of_run.file.display()),
                None => anyhow!("no recording goes on"),
            });
        };
        *whole(self.current.write()) = None;
        known.last = Some(RecordingOnDemand {
            is_running: false,
            ..running.now()
        });
        known.closing.retain(|closing| !closing.is_finished());
        let this = Arc::clone(self);
        let thread = std::thread::Builder::new().name("recorder's end".to_owned());
        let closing = thread.spawn(move || {
            let last = running.finish();
            this.known().last = Some(last);
        });
        known.closing.push(closing.context("ending the recording")?);
        Ok(())
    }

    /// Ends the one that goes on, if any, waits for those that are being ended, and returns the last; none begins any more.
    pub(in crate::node) fn end(&self) -> Option<RecordingOnDemand> {
        let mut known = self.known();
        known.is_over = true;
        let (running, closing) = (known.running.take(), std::mem::take(&mut known.closing));
        *whole(self.current.write()) = None;
        drop(known);
        let last = running.map(Running::finish);
        for closing in closing {
            // One that panicked has said so.
            drop(closing.join());
        }
        let mut known = self.known();
        if last.is_some() {
            known.last = last;
        }
        known.last.clone()
    }

    /// How it stands with the one that goes on, else with the last; `None`: there was none.
    pub fn now(&self) -> Option<RecordingOnDemand> {
        let known = self.known();
        if let Some(of_run) = &known.of_run {
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
        let running = known.running.as_ref().map(Running::now);
        running.or_else(|| known.last.clone())
    }

    /// A new recording under way; nothing is left of one that cannot be begun.
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

    /// Who is there, as a session notes it that expects people of the one before.
    fn people_as_json(&self) -> anyhow::Result<Option<Vec<u8>>> {
        let Some(known) = whole(self.people.lock()).clone() else {
            return Ok(None);
        };
        let session = self.session;
        let json = serde_json::to_vec(&ExpectedPeople { session, known });
        json.context("writing people as JSON").map(Some)
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        whole(self.recording.lock())
    }

    fn with_queue<T>(&self, tell: impl FnOnce(&RecordingQueue) -> T) -> Option<T> {
        let current = whole(self.current.read());
        current.as_ref().map(|current| tell(&current.queue))
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

    /// Waits until the file is whole.
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

/// What a lock guards, though a thread with it may have died: everything here is replaced as a whole.
fn whole<T>(locked: Result<T, PoisonError<T>>) -> T {
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
    fn one_at_a_time_goes_on_and_all_are_whole_when_the_run_is() {
        let folder = tempfile::tempdir().unwrap();
        let recordings = recordings(folder.path());
        let early = recordings.start().unwrap_err();
        assert!(early.to_string().contains("not begun"), "{early}");
        recordings.tell(&[]);
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
    fn one_that_cannot_be_begun_leaves_nothing_and_can_be_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("gone");
        std::fs::write(&missing, "no folder").unwrap();
        let recordings = recordings(&missing);
        recordings.tell(&[]);
        assert!(recordings.start().is_err());
        assert!(recordings.now().is_none());
        std::fs::remove_file(&missing).unwrap();
        std::fs::create_dir(&missing).unwrap();
        let file = recordings.start().unwrap();
        assert!(file.starts_with(&missing), "{}", file.display());
        assert!(recordings.end().is_some());
    }
}
