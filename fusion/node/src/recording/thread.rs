//! The thread that writes a recording: messages in, chunks of a second out.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use farfield_fusion::export::disk_policy::DiskPolicy;
use farfield_fusion::export::summary::RecordingSummary;
use farfield_fusion::export::unfinished::PatientFile;
use farfield_fusion::recording::channels::Content;
use farfield_fusion::recording::holes::Holes;
use farfield_fusion::recording::writer::{Head, PassedMessage, RecordingWriter};
use farfield_node::clock::{self, VenueClock};
use farfield_node::process::{LineKind, say, say_as};
use farfield_proto::id::SessionId;
use farfield_proto::message::Status;
use farfield_proto::message::decision::Decision;
use farfield_proto::message::fill::SetKind;
use farfield_proto::venue::parameters::RecordingParameters;
use farfield_proto::wire;
use tracing::warn;

use super::file::RecordingFile;
use super::filler::{Fillers, SharedHoles};
use super::queue::{Note, QueueState, RecordingQueue};
use super::retention::delete_old;
use crate::output::disk_watch::DiskWatch;
use crate::session::messages::RunMode;
use crate::session::wiretap::Wiretap;

/// Time after a tick was stepped until a missing set counts as a hole: longer than any live set takes.
const SETTLE_S: f64 = 2.0;
/// Interval of deleting old recordings.
const CLEAN_EVERY: Duration = Duration::from_hours(1);

/// A recording in progress.
pub(crate) struct RecordingThread {
    file: PathBuf,
    session: SessionId,
    holes: SharedHoles,
    filled: Arc<AtomicU64>,
    queue: Arc<RecordingQueue>,
    disk: Arc<DiskWatch>,
    /// `None` after joining.
    thread: Option<JoinHandle<()>>,
}

impl RecordingThread {
    /// Begins to record fusion's messages of `session` in `file`. In a live run it waits for a full disk, and messages beyond the
    /// queue are lost; in lock-step it ends.
    ///
    /// # Errors
    /// The head cannot be written, or no thread starts. The file is removed then.
    pub(crate) fn start(
        file: RecordingFile,
        head: Head,
        session: SessionId,
        mode: RunMode,
        parameters: &RecordingParameters,
    ) -> anyhow::Result<Self> {
        let RecordingFile { path, file, made } = file;
        let begun = Self::begin(path.clone(), file, head, session, mode, parameters);
        if begun.is_ok() {
            made.keep();
        } else {
            // A partial head is no recording.
            drop(std::fs::remove_file(path));
        }
        begun
    }

    fn begin(
        path: PathBuf,
        file: File,
        head: Head,
        session: SessionId,
        mode: RunMode,
        parameters: &RecordingParameters,
    ) -> anyhow::Result<Self> {
        let (venue, recorder) = (head.venue.clone(), head.venue.clone() + "/recorder");
        let (n_viewpoints, rate_hz) = (head.viewpoints.len(), head.rate_hz);
        let (queue, notes) = RecordingQueue::open(&head.venue, session);
        let disk = {
            let (path, venue, days) = (path.clone(), venue.clone(), parameters.retention_days);
            let watch = DiskWatch::of_queue("messages", queue.state().lost_counter());
            Arc::new(watch.making_room(move || {
                drop(delete_old(&path, &venue, days));
            }))
        };
        let file = PatientFile::new(file, &path, Arc::clone(&disk) as Arc<dyn DiskPolicy>);
        let writer = RecordingWriter::create(BufWriter::new(file), head);
        let writer = writer.with_context(|| format!("writing the recording {}", path.display()))?;
        let state = Arc::clone(queue.state());
        let file = path.clone();
        let settle = (SETTLE_S * rate_hz).ceil() as i64;
        let holes = SharedHoles::new(Holes::new(session, n_viewpoints, settle));
        let filled = Arc::<AtomicU64>::default();
        let work = RecordingWork {
            venue,
            recorder,
            chunk: Duration::try_from_secs_f64(parameters.chunk_s)?,
            retention_days: parameters.retention_days,
            state,
            disk: Arc::clone(&disk),
            file: path,
            lost: 0,
            holes: holes.clone(),
            filled: Arc::clone(&filled),
            rings: BTreeSet::new(),
        };
        if mode == RunMode::Live {
            disk.start();
        }
        let thread = std::thread::Builder::new().name("recorder".to_owned());
        let thread = thread.spawn(move || work.run(writer, &notes));
        Ok(Self {
            file,
            session,
            holes,
            filled,
            queue: Arc::new(queue),
            disk,
            thread: Some(thread.context("starting the recorder's thread")?),
        })
    }

    /// The file.
    pub(crate) fn file(&self) -> &Path {
        &self.file
    }

    /// The observer that records messages.
    pub(crate) fn wiretap(&self) -> Arc<dyn Wiretap> {
        Arc::clone(&self.queue) as Arc<dyn Wiretap>
    }

    /// The watch of the file's disk.
    pub(crate) fn disk_watch(&self) -> Arc<DiskWatch> {
        Arc::clone(&self.disk)
    }

    /// The queue of messages.
    pub(crate) fn queue(&self) -> Arc<RecordingQueue> {
        Arc::clone(&self.queue)
    }

    /// The tasks that fetch missing sets, with this `clock`.
    pub(crate) fn fillers(&self, clock: &VenueClock) -> Fillers {
        Fillers {
            session: self.session,
            queue: Arc::clone(&self.queue),
            holes: self.holes.clone(),
            clock: clock.clone(),
        }
    }

    /// The summary of the recording so far.
    pub(crate) fn so_far(&self) -> RecordingSummary {
        RecordingSummary {
            file: self.file.clone(),
            lost: self.queue.state().lost(),
            filled: self.filled.load(Ordering::Relaxed),
            holes: self.holes.lock().left(),
            failure: self.queue.state().failure(),
        }
    }

    /// As [`Self::finish_waiting`], without blocking the runtime.
    ///
    /// # Errors
    /// The thread has panicked.
    pub(crate) async fn finish(self) -> anyhow::Result<RecordingSummary> {
        let finished = tokio::task::spawn_blocking(move || self.finish_waiting()).await;
        finished.context("waiting for the recorder")?
    }

    /// Writes the queued messages and the end of the file, and returns the summary. A failure at the very end is included.
    ///
    /// # Errors
    /// The thread has panicked.
    pub(super) fn finish_waiting(mut self) -> anyhow::Result<RecordingSummary> {
        self.disk.stop();
        self.queue.end();
        let joined = self.thread.take().map_or(Ok(()), JoinHandle::join);
        joined.map_err(|_| anyhow!("the recorder has panicked"))?;
        // The holes are final only after all is written.
        self.holes.lock().over();
        Ok(self.so_far())
    }
}

struct RecordingWork {
    /// The venue whose old recordings are deleted.
    venue: String,
    /// Topic of the recorder's own messages.
    recorder: String,
    chunk: Duration,
    retention_days: f64,
    state: Arc<QueueState>,
    disk: Arc<DiskWatch>,
    file: PathBuf,
    /// Losses that the recording already contains.
    lost: u64,
    holes: SharedHoles,
    filled: Arc<AtomicU64>,
    /// Viewpoints whose ring has failed.
    rings: BTreeSet<usize>,
}

impl RecordingWork {
    fn run(mut self, mut writer: RecordingWriter<BufWriter<PatientFile>>, notes: &Receiver<Note>) {
        let written = self.write_all(&mut writer, notes);
        let written = written.and_then(|()| writer.finish().map(drop));
        if let Err(error) = written {
            let reason = format!(
                "the recording {} has ended: {error}; all that was written before can be read",
                self.file.display()
            );
            say_as(LineKind::Error, format_args!("{reason}"));
            self.state.fail(reason);
        }
    }

    /// Writes until the end of the queue.
    fn write_all(
        &mut self,
        writer: &mut RecordingWriter<BufWriter<PatientFile>>,
        notes: &Receiver<Note>,
    ) -> io::Result<()> {
        let (mut flush_at, mut clean_at) = (clock::now() + self.chunk, clock::now());
        loop {
            let now = clock::now();
            if now >= clean_at {
                delete_old(&self.file, &self.venue, self.retention_days);
                clean_at = now + CLEAN_EVERY;
            }
            if now >= flush_at {
                let disk = Arc::clone(&self.disk);
                let _writing = disk.writing(&self.file);
                self.record_losses(writer)?;
                writer.flush()?;
                flush_at = now + self.chunk;
            }
            match notes.recv_timeout(until(flush_at.min(clean_at), now)) {
                Ok(Note::Passed(passed)) => {
                    let disk = Arc::clone(&self.disk);
                    let _writing = disk.writing(&self.file);
                    let content = writer.write(&PassedMessage {
                        topic: &passed.topic,
                        bytes: &passed.bytes,
                        log_ns: passed.at_ns,
                    })?;
                    if let Some(content) = content {
                        self.count(content, &passed.bytes);
                    }
                    self.state.taken(passed.cost());
                }
                Ok(Note::End) | Err(RecvTimeoutError::Disconnected) => {
                    return self.record_losses(writer);
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Updates the counts of filled sets and holes.
    fn count(&mut self, content: Content, bytes: &[u8]) {
        if let Content::Filled(_) = content {
            self.filled.fetch_add(1, Ordering::Relaxed);
        }
        match content {
            // A set counts, on either path, only when it is written.
            Content::Sets(SetKind::Patches) | Content::Filled(SetKind::Patches) => {
                if let Ok(set) = wire::decode(bytes) {
                    self.holes.lock().patches(&set);
                }
            }
            Content::Sets(SetKind::Sightings) | Content::Filled(SetKind::Sightings) => {
                if let Ok(set) = wire::decode(bytes) {
                    self.holes.lock().sightings(&set);
                }
            }
            Content::Decisions => {
                if let Ok(decision) = wire::decode::<Decision>(bytes) {
                    self.holes.lock().worked_on(decision.tick);
                }
            }
            Content::Status => {
                if let Ok(status) = wire::decode::<Status>(bytes)
                    && let (Some(viewpoint), Some(live)) = (status.viewpoint, status.live)
                {
                    let index = usize::from(viewpoint.0);
                    let nth = live.every_nth_tick;
                    self.holes.lock().works_on_every(index, nth);
                    self.report_ring(index, &status.node, live.recording_failure.as_deref());
                }
            }
            _ => {}
        }
    }

    /// Reports once that an edge's ring has failed: an outage then leaves holes.
    fn report_ring(&mut self, index: usize, name: &str, failure: Option<&str>) {
        match failure {
            None => drop(self.rings.remove(&index)),
            // Reported once, as its numbers change. Without keys, statuses may be forged with any viewpoint.
            Some(failure) => {
                let is_known = index < self.holes.lock().viewpoints();
                if is_known && self.rings.insert(index) {
                    say(format_args!("viewpoint {name}: {failure}"));
                }
            }
        }
    }

    /// Records the number of lost messages.
    fn record_losses(
        &mut self,
        writer: &mut RecordingWriter<BufWriter<PatientFile>>,
    ) -> io::Result<()> {
        let lost = self.state.lost();
        if lost == self.lost {
            return Ok(());
        }
        let more = lost - self.lost;
        warn!(more, lost, file = %self.file.display(), "messages are not recorded: the disk is too slow");
        self.lost = lost;
        let log_ns = u64::try_from(clock::unix_time().as_nanos()).unwrap_or(u64::MAX);
        let json = format!("{{\"lost\":{lost}}}");
        writer.write(&PassedMessage {
            topic: &self.recorder,
            bytes: json.as_bytes(),
            log_ns,
        })?;
        Ok(())
    }
}

fn until(then: Instant, now: Instant) -> Duration {
    then.saturating_duration_since(now)
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::BTreeMap;
    use std::os::fd::OwnedFd;

    use super::*;
    use crate::output::made_folders::MadeFolders;

    /// A minimal head.
    pub(in crate::recording) fn head() -> Head {
        Head {
            venue: "hall".to_owned(),
            viewpoints: vec!["ne".to_owned()],
            rate_hz: 60.0,
            started_ns: 1,
            files: Vec::new(),
            facts: BTreeMap::new(),
            json_poses: None,
        }
    }

    #[tokio::test]
    async fn a_failure_at_the_very_end_is_reported() {
        let (reader, disk) = io::pipe().unwrap();
        let file = RecordingFile {
            path: PathBuf::from("end.mcap"),
            file: File::from(OwnedFd::from(disk)),
            made: MadeFolders::default(),
        };
        let parameters = RecordingParameters {
            chunk_s: 3600.0,
            ..RecordingParameters::default()
        };
        let recording =
            RecordingThread::start(file, head(), SessionId(1), RunMode::LockStep, &parameters);
        let recording = recording.unwrap();
        recording.queue().note("hall/pose", b"x", 0);
        assert_eq!(recording.so_far().failure, None);
        drop(reader);
        let summary = recording.finish().await.unwrap();
        let failure = summary.failure.unwrap();
        assert!(failure.contains("end.mcap has ended"), "{failure}");
    }
}
