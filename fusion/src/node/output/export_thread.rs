//! The thread that writes the files of poses: a disk that hangs, or is full, holds up nobody else.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_node::clock;
use farfield_node::process::say;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PoseSet;
use farfield_proto::venue::Venue;

use super::disk_watch::DiskWatch;
use super::exporter::{Exported, Exporter};
use super::pose_queue::{FinalPoses, PoseQueue, Taken};
use crate::export::disk_policy::DiskPolicy;
use crate::export::run_clock::RunEnd;
use crate::export::summary::PosesSummary;
use crate::node::session::mode::RunMode;

/// How often the files of persons go to the disk. `poses.jsonl` does with every chunk, and has all that
/// they have.
const SYNC_PERSONS: Duration = Duration::from_secs(10);

/// The handle on the thread. Live it never waits: what finds no place is counted. In lock-step and in
/// a replay it waits for a place, and nothing is lost. Dropped before it is finished, it completes the files
/// of what was handed over.
pub(in crate::node) struct ExportThread {
    mode: RunMode,
    shared: Arc<Shared>,
    /// `None` once it is waited for.
    thread: Option<JoinHandle<Exported>>,
    /// Whether any tick was handed over.
    has_begun: bool,
    /// Ticks that found no place.
    refused: u64,
    refused_smoothed: u64,
}

/// What handle and thread know of each other.
#[derive(Debug)]
struct Shared {
    queue: PoseQueue,
    has_failed: AtomicBool,
    /// Whether the files are not wanted after all.
    is_discarded: AtomicBool,
    /// Ticks that found no place in the queue.
    refused: Arc<AtomicU64>,
    disk: Arc<DiskWatch>,
}

impl ExportThread {
    /// Starts the files in `folder`, which must exist, and the thread.
    ///
    /// # Errors
    /// When a file cannot be made, or no thread starts.
    pub(in crate::node) fn start(
        folder: &Path,
        venue: &Venue,
        keypoints: &KeypointSet,
        mode: RunMode,
    ) -> anyhow::Result<Self> {
        let refused = Arc::<AtomicU64>::default();
        let disk = Arc::new(DiskWatch::of_queue("ticks", Arc::clone(&refused)));
        let shared = Arc::new(Shared {
            queue: PoseQueue::default(),
            has_failed: AtomicBool::new(false),
            is_discarded: AtomicBool::new(false),
            refused,
            disk: Arc::clone(&disk),
        });
        let end = match mode {
            RunMode::Live => RunEnd::Open,
            RunMode::LockStep => RunEnd::Known,
        };
        let exporter =
            Exporter::create(folder, venue, keypoints, end, disk as Arc<dyn DiskPolicy>)?;
        let work = ExportWork {
            exporter,
            folder: folder.to_owned(),
            mode,
            chunk: Duration::try_from_secs_f64(venue.parameters.recording.chunk_s)?,
            shared: Arc::clone(&shared),
        };
        if mode == RunMode::Live {
            shared.disk.start();
        }
        let thread = std::thread::Builder::new().name("exporter".to_owned());
        let thread = thread.spawn(move || work.run());
        Ok(Self {
            mode,
            shared,
            thread: Some(thread.context("starting the thread that writes the poses")?),
            has_begun: false,
            refused: 0,
            refused_smoothed: 0,
        })
    }

    /// Hands over ticks that will not change any more, in order.
    pub(in crate::node) fn write(&mut self, finished: Vec<PoseSet>, smoothed: Vec<PoseSet>) {
        for poses in finished {
            self.hand_over(FinalPoses::Live(poses), self.mode);
        }
        for poses in smoothed {
            self.hand_over(FinalPoses::Smoothed(poses), self.mode);
        }
    }

    fn hand_over(&mut self, poses: FinalPoses, mode: RunMode) {
        self.has_begun = true;
        let handed_over = match mode {
            RunMode::Live => self.shared.queue.offer(poses),
            RunMode::LockStep => self.shared.queue.push(poses),
        };
        let Err(refused) = handed_over else {
            return;
        };
        if self.refused + self.refused_smoothed == 0 {
            say(format_args!(
                "error: the disk does not take the poses in time: some ticks will be missing from the files"
            ));
        }
        self.shared.refused.fetch_add(1, Ordering::Relaxed);
        match refused {
            FinalPoses::Live(_) => self.refused += 1,
            FinalPoses::Smoothed(_) => self.refused_smoothed += 1,
        }
    }

    /// Whether the files wait for room on their disk.
    pub(in crate::node) fn disk_watch(&self) -> Arc<DiskWatch> {
        Arc::clone(&self.shared.disk)
    }

    /// Whether nothing is written any more.
    pub(in crate::node) fn has_failed(&self) -> bool {
        self.shared.has_failed.load(Ordering::Relaxed)
    }

    /// Hands over the last ticks, waits until all are written as far as there is room, and completes the
    /// files.
    ///
    /// # Errors
    /// When the thread has panicked.
    pub(in crate::node) fn finish(
        mut self,
        finished: Vec<PoseSet>,
        smoothed: Vec<PoseSet>,
    ) -> anyhow::Result<Exported> {
        // A full disk is not waited for any more, and so there will be a place for everything.
        self.shared.disk.stop();
        self.mode = RunMode::LockStep;
        self.write(finished, smoothed);
        let (refused, refused_smoothed) = (self.refused, self.refused_smoothed);
        let mut exported = self.join()?;
        if refused + refused_smoothed > 0 {
            let missing = exported.poses.get_or_insert_default();
            missing.unwritten_ticks += refused;
            missing.unwritten_smoothed_ticks += refused_smoothed;
        }
        Ok(exported)
    }

    /// Takes the files away: those of a run without a tick would only be in the way.
    ///
    /// # Errors
    /// When the thread has panicked.
    pub(in crate::node) fn discard(mut self) -> anyhow::Result<()> {
        self.shared.is_discarded.store(true, Ordering::Relaxed);
        self.join().map(drop)
    }

    fn join(&mut self) -> anyhow::Result<Exported> {
        self.shared.disk.stop();
        self.shared.queue.end();
        let joined = self.thread.take().map(JoinHandle::join);
        let joined = joined.unwrap_or_else(|| Ok(Exported::default()));
        joined.map_err(|_| anyhow!("the thread that writes the poses has panicked"))
    }
}

impl Drop for ExportThread {
    fn drop(&mut self) {
        if self.thread.is_some() {
            let is_unwanted = !self.has_begun;
            self.shared
                .is_discarded
                .store(is_unwanted, Ordering::Relaxed);
            // Whoever drops it has another failure to tell.
            drop(self.join());
        }
    }
}

/// Why a run has failed whose files lack something.
pub(in crate::node) fn missing(poses: &PosesSummary) -> anyhow::Error {
    let n_ticks = poses.unwritten_ticks;
    let smoothed = match poses.unwritten_smoothed_ticks {
        0 => String::new(),
        n => format!(", and the smoothed ones of {n}"),
    };
    let why = poses.failure.as_deref();
    let why = why.unwrap_or("the disk was too slow");
    anyhow!("the poses of {n_ticks} ticks{smoothed} could not be written: {why}")
}

/// What the thread owns.
struct ExportWork {
    exporter: Exporter,
    folder: PathBuf,
    mode: RunMode,
    /// How often lines go to the disk.
    chunk: Duration,
    shared: Arc<Shared>,
}

/// However the thread ends, nobody waits for a place any more.
struct Abandon(Arc<Shared>);

impl Drop for Abandon {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.has_failed.store(true, Ordering::Relaxed);
        }
        self.0.queue.abandon();
    }
}

impl ExportWork {
    fn run(mut self) -> Exported {
        let shared = Arc::clone(&self.shared);
        let _abandon = Abandon(Arc::clone(&shared));
        let now = clock::now();
        let (mut lines_at, mut persons_at) = (now + self.chunk, now + SYNC_PERSONS);
        loop {
            match shared.queue.take(lines_at.min(persons_at)) {
                Taken::Poses(poses) => {
                    let _writing = shared.disk.writing(&self.folder);
                    let written = self.exporter.write(&poses);
                    self.note(written);
                }
                Taken::Nothing => {}
                Taken::End => break,
            }
            let now = clock::now();
            if now >= lines_at {
                let _writing = shared.disk.writing(&self.folder);
                let synced = self.exporter.sync_lines();
                self.note(synced);
                lines_at = clock::now() + self.chunk;
            }
            if now >= persons_at {
                let _writing = shared.disk.writing(&self.folder);
                let synced = self.exporter.sync_persons();
                self.note(synced);
                persons_at = clock::now() + SYNC_PERSONS;
            }
        }
        if self.shared.is_discarded.load(Ordering::Relaxed) {
            return Exported::default();
        }
        self.exporter.finish()
    }

    /// A live run goes on without its files, and says so; others end, and say it then.
    fn note(&self, written: anyhow::Result<()>) {
        if let Err(error) = written
            && !self.shared.has_failed.swap(true, Ordering::Relaxed)
            && self.mode == RunMode::Live
        {
            say(format_args!("error: no more poses are written: {error:#}"));
        }
    }
}

#[cfg(test)]
#[path = "export_thread_tests.rs"]
mod tests;
