//! The thread that writes the pose files, so that a hanging or full disk delays no other thread.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_fusion::export::disk_policy::DiskPolicy;
use farfield_fusion::export::run_clock::RunEnd;
use farfield_fusion::export::summary::PosesSummary;
use farfield_node::clock;
use farfield_node::process::{LineKind, say_as};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PoseSet;
use farfield_proto::venue::Venue;

use super::disk_watch::DiskWatch;
use super::exporter::{Exported, Exporter};
use super::pose_queue::{FinalPoses, PoseQueue, Taken};
use crate::session::messages::RunMode;

/// Interval of syncing the files of persons. `poses.jsonl`, which has the same data, is synced with every chunk.
const SYNC_PERSONS: Duration = Duration::from_secs(10);

/// The handle of the thread. In a live run it never waits, and counts the ticks that find no place. In lock-step and in a replay
/// it waits for a place, and loses nothing. Dropping it completes the files with the ticks handed over so far.
pub(crate) struct ExportThread {
    mode: RunMode,
    shared: Arc<Shared>,
    /// `None` after joining.
    thread: Option<JoinHandle<Exported>>,
    /// Whether any tick was handed over.
    has_begun: bool,
    /// Ticks that found no place.
    refused: u64,
    refused_smoothed: u64,
}

/// Shared by handle and thread.
#[derive(Debug)]
struct Shared {
    queue: PoseQueue,
    has_failed: AtomicBool,
    /// Whether the files are to be removed.
    is_discarded: AtomicBool,
    /// Ticks that found no place in the queue.
    refused: Arc<AtomicU64>,
    disk: Arc<DiskWatch>,
}

impl ExportThread {
    /// Starts the files in `folder`, which must exist, and the thread.
    ///
    /// # Errors
    /// A file cannot be created, or no thread starts.
    pub(crate) fn start(
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

    /// Hands over final ticks, in order.
    pub(crate) fn write(&mut self, finished: Vec<PoseSet>, smoothed: Vec<PoseSet>) {
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
            say_as(
                LineKind::Error,
                format_args!(
                    "the disk is too slow for the poses: some ticks will be missing from the files"
                ),
            );
        }
        self.shared.refused.fetch_add(1, Ordering::Relaxed);
        match refused {
            FinalPoses::Live(_) => self.refused += 1,
            FinalPoses::Smoothed(_) => self.refused_smoothed += 1,
        }
    }

    /// The watch of the files' disk.
    pub(crate) fn disk_watch(&self) -> Arc<DiskWatch> {
        Arc::clone(&self.shared.disk)
    }

    /// Whether writing has failed for good.
    pub(crate) fn has_failed(&self) -> bool {
        self.shared.has_failed.load(Ordering::Relaxed)
    }

    /// Hands over the last ticks, waits until they are written if there is room, and completes the files.
    ///
    /// # Errors
    /// The thread has panicked.
    pub(crate) fn finish(
        mut self,
        finished: Vec<PoseSet>,
        smoothed: Vec<PoseSet>,
    ) -> anyhow::Result<Exported> {
        // The thread no longer waits for a full disk, so every tick finds a place.
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

    /// Removes the files of a run without ticks.
    ///
    /// # Errors
    /// The thread has panicked.
    pub(crate) fn discard(mut self) -> anyhow::Result<()> {
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
            // The caller that drops it has another failure to report.
            drop(self.join());
        }
    }
}

/// The failure of a run whose files are incomplete.
pub(crate) fn missing(poses: &PosesSummary) -> anyhow::Error {
    let n_ticks = poses.unwritten_ticks;
    let smoothed = match poses.unwritten_smoothed_ticks {
        0 => String::new(),
        n => format!(", and the smoothed ones of {n}"),
    };
    let reason = poses.failure.as_deref();
    let reason = reason.unwrap_or("the disk was too slow");
    anyhow!("the poses of {n_ticks} ticks{smoothed} could not be written: {reason}")
}

/// The state of the thread.
struct ExportWork {
    exporter: Exporter,
    folder: PathBuf,
    mode: RunMode,
    /// Interval of syncing the lines.
    chunk: Duration,
    shared: Arc<Shared>,
}

/// Releases waiting callers, however the thread ends.
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
                    self.check(written);
                }
                Taken::Nothing => {}
                Taken::End => break,
            }
            let now = clock::now();
            if now >= lines_at {
                let _writing = shared.disk.writing(&self.folder);
                let synced = self.exporter.sync_lines();
                self.check(synced);
                lines_at = clock::now() + self.chunk;
            }
            if now >= persons_at {
                let _writing = shared.disk.writing(&self.folder);
                let synced = self.exporter.sync_persons();
                self.check(synced);
                persons_at = clock::now() + SYNC_PERSONS;
            }
        }
        if self.shared.is_discarded.load(Ordering::Relaxed) {
            return Exported::default();
        }
        self.exporter.finish()
    }

    /// Records a failure. A live run continues without its files and prints the failure; others end with it.
    fn check(&self, written: anyhow::Result<()>) {
        if let Err(error) = written
            && !self.shared.has_failed.swap(true, Ordering::Relaxed)
            && self.mode == RunMode::Live
        {
            say_as(
                LineKind::Error,
                format_args!("no more poses are written: {error:#}"),
            );
        }
    }
}

#[cfg(test)]
#[path = "export_thread_tests.rs"]
mod tests;
