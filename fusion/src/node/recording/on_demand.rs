//! Recordings that somebody starts and stops while a live run goes on: the button of the live page.
//!
//! Such a recording begins in the middle of a run. It holds who was there then and all that passes from then on, and can be
//! looked at as any other. Solved again, people are found anew, and recognised by place and body
//! ([`crate::recording::replay::PatchOwners::ByPlace`]). Edges are not asked for what it lacks.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, RwLock, Weak};

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
use crate::node::session::mode::RunMode;
use crate::node::session::wiretap::{CopiedMessage, CopiedStep, Wiretap};
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
    /// Who is told of recordings that begin; they may know this one, and must not be kept by it.
    listeners: OnceLock<Vec<Weak<dyn Wiretap>>>,
    /// Where messages go; apart from the recording itself, so that nobody waits for one that begins or ends.
    queue: RwLock<Option<Arc<RecordingQueue>>>,
    recording: Mutex<Known>,
}

/// What is known of recordings.
#[derive(Default)]
struct Known {
    running: Option<Running>,
    last: Option<RecordingOnDemand>,
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
    wiretap: Arc<dyn Wiretap>,
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
    ) -> Self {
        let head = head(venue, path, keypoints, FUSION);
        Self {
            venue: venue.name.clone(),
            folder,
            session,
            parameters: venue.parameters.recording.clone(),
            head: head.map_err(|error| format!("{error:#}")),
            first: OnceLock::new(),
            people: Mutex::default(),
            listeners: OnceLock::new(),
            queue: RwLock::default(),
            recording: Mutex::default(),
        }
    }

    /// Says that `recording` goes on for as long as the run does.
    pub(in crate::node) fn leave_it_to(&self, recording: &RecordingThread) {
        self.known().of_run = Some(OfRun {
            file: recording.so_far().file,
            wiretap: recording.wiretap(),
            since_us: now_us(),
        });
    }

    /// Tells `listeners` of every recording that begins. Called once.
    pub(in crate::node) fn tell(&self, listeners: &[Arc<dyn Wiretap>]) {
        self.listeners
            .get_or_init(|| listeners.iter().map(Arc::downgrade).collect());
    }

    /// Says who is there: a recording that begins soon begins with them.
    pub(in crate::node) fn knows(&self, people: &KnownPeople) {
        *whole(self.people.lock()) = Some(people.clone());
    }

    /// Begins one, in a new file named after venue and time.
    ///
    /// # Errors
    /// When one goes on already, or none can be written.
    pub fn start(&self) -> anyhow::Result<PathBuf> {
        let mut known = self.known();
        ensure!(!known.is_over, "the run is over");
        if let Some(of_run) = &known.of_run {
            return Err(anyhow!(
                "{} goes on since the run began (`--record`)",
                of_run.file.display()
            ));
        }
        if let Some(running) = &known.running {
            let file = running.thread.so_far().file;
            return Err(anyhow!("{} goes on already", file.display()));
        }
        let head = self.head.as_ref().map_err(|error| anyhow!("{error}"))?;
        let head = Head {
            started_ns: u64::try_from(clock::unix_time().as_nanos()).unwrap_or(u64::MAX),
            ..head.clone()
        };
        let file = RecordingFile::make(&self.folder, &self.venue)?;
        let (session, mode) = (self.session, RunMode::Live);
        let thread = RecordingThread::start(file, head, session, mode, &self.parameters)?;
        let queue = thread.queue();
        if let Some(first) = self.first.get() {
            queue.begins_after(*first);
        }
        self.note_people(&queue)?;
        *whole(self.queue.write()) = Some(queue);
        let file = thread.so_far().file;
        for listener in self.listeners.get().into_iter().flatten() {
            if let Some(listener) = listener.upgrade() {
                listener.recording_begins(&file);
            }
        }
        known.running = Some(Running {
            thread,
            since_us: now_us(),
        });
        Ok(file)
    }

    /// Ends the one that goes on, and waits until its file is whole.
    ///
    /// # Errors
    /// When none goes on, or it has failed.
    pub fn stop(&self) -> anyhow::Result<RecordingOnDemand> {
        let mut known = self.known();
        if let Some(of_run) = &known.of_run {
            return Err(anyhow!(
                "{} ends with the run (`--record`)",
                of_run.file.display()
            ));
        }
        let running = known.running.take().context("no recording goes on")?;
        *whole(self.queue.write()) = None;
        let summary = running.thread.finish_waiting()?;
        let last = RecordingOnDemand {
            is_running: false,
            since_us: running.since_us,
            bytes: bytes_of(&summary.file),
            lost: summary.lost,
            failure: summary.failure,
            file: summary.file,
        };
        known.last = Some(last.clone());
        match &last.failure {
            Some(failure) => Err(anyhow!("{failure}")),
            None => Ok(last),
        }
    }

    /// Ends the one that goes on, if any; none begins any more.
    pub(in crate::node) fn end(&self) -> Option<anyhow::Result<RecordingOnDemand>> {
        let mut known = self.known();
        known.is_over = true;
        let is_running = known.running.is_some();
        drop(known);
        is_running.then(|| self.stop())
    }

    /// How it stands with the one that goes on, else with the last; `None`: there was none.
    pub fn now(&self) -> Option<RecordingOnDemand> {
        let known = self.known();
        if let Some(of_run) = &known.of_run {
            let failure = of_run.wiretap.failure();
            return Some(RecordingOnDemand {
                bytes: bytes_of(&of_run.file),
                file: of_run.file.clone(),
                is_running: failure.is_none(),
                since_us: of_run.since_us,
                lost: 0,
                failure,
            });
        }
        let running = known.running.as_ref().map(|running| {
            let so_far = running.thread.so_far();
            RecordingOnDemand {
                bytes: bytes_of(&so_far.file),
                file: so_far.file,
                is_running: so_far.failure.is_none(),
                since_us: running.since_us,
                lost: so_far.lost,
                failure: so_far.failure,
            }
        });
        running.or_else(|| known.last.clone())
    }

    /// Notes who is there, as a session does that expects people of the one before.
    fn note_people(&self, queue: &RecordingQueue) -> anyhow::Result<()> {
        let Some(known) = whole(self.people.lock()).clone() else {
            return Ok(());
        };
        let session = self.session;
        let json = serde_json::to_vec(&ExpectedPeople { session, known });
        let json = json.context("writing people as JSON")?;
        queue.note(&channels::expected(&self.venue), &json, now_us());
        Ok(())
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        whole(self.recording.lock())
    }

    fn with_queue<T>(&self, tell: impl FnOnce(&RecordingQueue) -> T) -> Option<T> {
        whole(self.queue.read()).as_deref().map(tell)
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
