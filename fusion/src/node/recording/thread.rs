//! The thread that writes a recording: what passed in, chunks of a second out.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use farfield_proto::decision::Decision;
use farfield_proto::fill::SetKind;
use farfield_proto::id::SessionId;
use farfield_proto::message::Status;
use farfield_proto::venue::parameters::RecordingParameters;
use farfield_proto::wire;
use tracing::warn;

use super::super::clock::{self, VenueClock};
use super::super::process::say;
use super::super::tap::Tap;
use super::filler::{Fillers, SharedHoles};
use super::place::Place;
use super::queue::{Note, Queue, QueueState};
use super::retention::delete_old;
use crate::export::summary::RecordingSummary;
use crate::recording::channels::Content;
use crate::recording::holes::Holes;
use crate::recording::writer::{Head, Passed, RecordingWriter};

/// How long after its tick was worked on a set is missed: longer than any live one takes.
const SETTLE_S: f64 = 2.0;
/// How often old recordings are looked for.
const CLEAN_EVERY: Duration = Duration::from_hours(1);

/// A recording under way.
pub(in crate::node) struct RecordingThread {
    file: PathBuf,
    session: SessionId,
    holes: SharedHoles,
    filled: Arc<AtomicU64>,
    queue: Arc<Queue>,
    thread: JoinHandle<()>,
}

impl RecordingThread {
    /// Begins to write to `place` what passes fusion in `session`.
    ///
    /// # Errors
    /// When the head cannot be written, or no thread starts.
    pub(in crate::node) fn start(
        place: Place,
        head: Head,
        session: SessionId,
        parameters: &RecordingParameters,
    ) -> anyhow::Result<Self> {
        let Place { path, file } = place;
        let recorder = head.venue.clone() + "/recorder";
        let (n_viewpoints, rate_hz) = (head.viewpoints.len(), head.rate_hz);
        let (queue, notes) = Queue::open(&head.venue, session);
        let writer = RecordingWriter::create(BufWriter::new(file), head);
        let writer = writer.with_context(|| format!("writing the recording {}", path.display()))?;
        let state = Arc::clone(queue.state());
        let file = path.clone();
        let settle = (SETTLE_S * rate_hz).ceil() as i64;
        let holes = SharedHoles::new(Holes::new(session, n_viewpoints, settle));
        let filled = Arc::<AtomicU64>::default();
        let work = Work {
            recorder,
            chunk: Duration::try_from_secs_f64(parameters.chunk_s)?,
            retention_days: parameters.retention_days,
            state,
            file: path,
            lost: 0,
            holes: holes.clone(),
            filled: Arc::clone(&filled),
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned());
        let thread = thread.spawn(move || work.run(writer, &notes));
        Ok(Self {
            file,
            session,
            holes,
            filled,
            queue: Arc::new(queue),
            thread: thread.context("starting the recorder's thread")?,
        })
    }

    /// Where what passes is noted.
    pub(in crate::node) fn tap(&self) -> Arc<dyn Tap> {
        Arc::clone(&self.queue) as Arc<dyn Tap>
    }

    /// Where messages are noted.
    pub(in crate::node) fn queue(&self) -> Arc<Queue> {
        Arc::clone(&self.queue)
    }

    /// Those who fetch what is missing, by `clock`.
    pub(in crate::node) fn fillers(&self, clock: &VenueClock) -> Fillers {
        Fillers {
            session: self.session,
            queue: Arc::clone(&self.queue),
            holes: self.holes.clone(),
            clock: clock.clone(),
        }
    }

    /// What it has come to so far.
    pub(in crate::node) fn so_far(&self) -> RecordingSummary {
        RecordingSummary {
            file: self.file.clone(),
            lost: self.queue.state().lost(),
            filled: self.filled.load(Ordering::Relaxed),
            holes: self.holes.lock().left(),
            failure: self.queue.state().failure(),
        }
    }

    /// Writes what has been noted so far and the file's end.
    ///
    /// # Errors
    /// When the thread has panicked.
    pub(in crate::node) async fn finish(self) -> anyhow::Result<()> {
        let finish = move || {
            self.queue.end();
            self.thread.join()
        };
        let joined = tokio::task::spawn_blocking(finish).await;
        joined
            .context("waiting for the recorder")?
            .map_err(|_| anyhow!("the recorder has panicked"))
    }
}

struct Work {
    /// Topic of what the recorder says of itself.
    recorder: String,
    chunk: Duration,
    retention_days: f64,
    state: Arc<QueueState>,
    file: PathBuf,
    /// Losses that the recording tells of.
    lost: u64,
    holes: SharedHoles,
    filled: Arc<AtomicU64>,
}

impl Work {
    fn run(mut self, mut writer: RecordingWriter<BufWriter<File>>, notes: &Receiver<Note>) {
        let written = self.write_all(&mut writer, notes);
        let written = written.and_then(|()| writer.finish().map(drop));
        if let Err(error) = written {
            let reason = format!(
                "the recording {} has ended: {error}; what was written until then can be read",
                self.file.display()
            );
            say(format_args!("error: {reason}"));
            self.state.fail(reason);
        }
    }

    /// Until the last note has been written.
    fn write_all(
        &mut self,
        writer: &mut RecordingWriter<BufWriter<File>>,
        notes: &Receiver<Note>,
    ) -> io::Result<()> {
        let (mut flush_at, mut clean_at) = (clock::now() + self.chunk, clock::now());
        loop {
            let now = clock::now();
            if now >= clean_at {
                delete_old(&self.file, self.retention_days);
                clean_at = now + CLEAN_EVERY;
            }
            if now >= flush_at {
                self.say_losses(writer)?;
                writer.flush()?;
                flush_at = now + self.chunk;
            }
            match notes.recv_timeout(until(flush_at.min(clean_at), now)) {
                Ok(Note::Passed(passed)) => {
                    self.state.taken(passed.bytes.len());
                    let content = writer.write(&Passed {
                        topic: &passed.topic,
                        bytes: &passed.bytes,
                        log_ns: passed.at_ns,
                    })?;
                    if let Some(content) = content {
                        self.count(content, &passed.bytes);
                    }
                }
                Ok(Note::End) | Err(RecvTimeoutError::Disconnected) => {
                    return self.say_losses(writer);
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Keeps account of what is there, and what is missing.
    fn count(&self, content: Content, bytes: &[u8]) {
        match content {
            Content::Sets(SetKind::Patches) => {
                if let Ok(set) = wire::decode(bytes) {
                    self.holes.lock().patches(&set);
                }
            }
            Content::Sets(SetKind::Sightings) => {
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
                let status = wire::decode::<Status>(bytes).ok();
                let nth = status.and_then(|s| Some((s.viewpoint?, s.live?.every_nth_tick)));
                if let Some((viewpoint, nth)) = nth {
                    let index = usize::from(viewpoint.0);
                    self.holes.lock().works_on_every(index, nth);
                }
            }
            Content::Filled(_) => drop(self.filled.fetch_add(1, Ordering::Relaxed)),
            _ => {}
        }
    }

    /// Notes in the recording itself that it has gaps.
    fn say_losses(&mut self, writer: &mut RecordingWriter<BufWriter<File>>) -> io::Result<()> {
        let lost = self.state.lost();
        if lost == self.lost {
            return Ok(());
        }
        let more = lost - self.lost;
        warn!(more, lost, file = %self.file.display(), "messages not recorded: the disk is too slow");
        self.lost = lost;
        let log_ns = u64::try_from(clock::unix_time().as_nanos()).unwrap_or(u64::MAX);
        let json = format!("{{\"lost\":{lost}}}");
        writer.write(&Passed {
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
