//! All streams of a run: started, fed and stopped together.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use farfield_export::edits::Identities;
use farfield_proto::message::PoseSet;
use thiserror::Error;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::frame::{Frame, FrameMaker, VenueFacts};
#[cfg(feature = "zenoh")]
use crate::over_zenoh;
use crate::slot::{Counters, Shell, Slot};
use crate::spec::{StreamKind, StreamSpec};
use crate::{foxglove, lsl, psn, qtm, vmc, websocket};

/// Maximum time for streams to say goodbye to their clients.
const GRACE: Duration = Duration::from_secs(2);

/// Why streams cannot start.
#[derive(Debug, Error)]
pub enum StreamError {
    /// The address is not available.
    #[error("stream `{spec}`: {problem}: {why}")]
    Open {
        /// The stream.
        spec: StreamSpec,
        /// The operation that failed.
        problem: &'static str,
        /// The error of the operating system.
        why: io::Error,
    },
    /// Two streams with the same protocol and address.
    #[error("stream `{0}`: found twice, expected once")]
    Twice(StreamSpec),
}

/// Status of a stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamReport {
    /// The specification.
    pub spec: StreamSpec,
    /// Actual address of a server (with the assigned port if 0 was requested), or target of a
    /// sender.
    pub address: SocketAddr,
    /// Connected clients; for `vmc` the number of ports in use; for PosiStageNet always 1.
    pub clients: usize,
    /// Number of sent frames, over all clients.
    pub sent: u64,
    /// Number of frames that clients missed because they or this machine were too slow, over all
    /// clients.
    pub skipped: u64,
    /// Number of errors after which the stream continued: refused or lost clients, failed
    /// datagrams.
    pub failed: u64,
    /// The last of these errors.
    pub last_error: Option<String>,
}

#[derive(Debug)]
struct Running {
    spec: StreamSpec,
    address: SocketAddr,
    counters: Arc<Counters>,
}

/// The newest poses, and the number published so far.
#[derive(Debug, Clone, Default)]
struct Newest {
    number: u64,
    poses: Option<Arc<PoseSet>>,
}

/// Running streams. Dropping it also stops them, without goodbyes.
#[derive(Debug)]
pub struct Streams {
    running: Vec<Running>,
    poses: watch::Sender<Newest>,
    people: watch::Sender<Identities>,
    slot: Arc<Slot>,
    unreadable: Arc<AtomicU64>,
    tasks: TaskTracker,
    stop: CancellationToken,
}

impl Streams {
    /// Opens all streams. Must be called inside a tokio runtime with I/O and time, which runs the
    /// streams' tasks.
    ///
    /// # Errors
    /// The first stream whose address is not available; then no stream runs.
    pub async fn start(specs: &[StreamSpec], facts: VenueFacts) -> Result<Self, StreamError> {
        for (i, spec) in specs.iter().enumerate() {
            // Port 0 is a different port each time.
            let is_same = |other: &StreamSpec| {
                let is_there = (other.address, other.interface) == (spec.address, spec.interface);
                other.kind == spec.kind && is_there && spec.address.port() != 0
            };
            if specs.iter().take(i).any(is_same) {
                return Err(StreamError::Twice(*spec));
            }
        }
        let mut streams = Self {
            running: Vec::new(),
            poses: watch::Sender::new(Newest::default()),
            people: watch::Sender::new(Identities::default()),
            slot: Arc::new(Slot::new()),
            unreadable: Arc::default(),
            tasks: TaskTracker::new(),
            stop: CancellationToken::new(),
        };
        for spec in specs {
            streams.open(*spec, &facts).await?;
        }
        streams.make_frames(FrameMaker::new(facts));
        Ok(streams)
    }

    async fn open(&mut self, spec: StreamSpec, facts: &VenueFacts) -> Result<(), StreamError> {
        let counters = Arc::new(Counters::default());
        let shell = Shell {
            tasks: self.tasks.clone(),
            stop: self.stop.clone(),
            feed: self.slot.feed(&counters),
            counters: Arc::clone(&counters),
        };
        let opened = match spec.kind {
            StreamKind::Qtm => qtm::serve(spec.address, shell).await,
            StreamKind::Vmc => vmc::send(spec.address, shell).await,
            StreamKind::WebSocket => websocket::serve(spec.address, &shell),
            StreamKind::Foxglove => {
                let venue = foxglove::Venue {
                    name: facts.venue.clone(),
                    cameras: facts.cameras.clone(),
                };
                foxglove::serve(spec.address, venue, &shell)
            }
            #[cfg(feature = "zenoh")]
            StreamKind::Zenoh => over_zenoh::serve_json(spec.address, &facts.venue, &shell).await,
            #[cfg(feature = "zenoh")]
            StreamKind::Ros2 => over_zenoh::send_ros2(spec.address, &shell),
            #[cfg(not(feature = "zenoh"))]
            StreamKind::Zenoh | StreamKind::Ros2 => Err(io::Error::new(
                io::ErrorKind::Unsupported,
                "this program was built without Zenoh streams",
            )),
            StreamKind::Psn => psn::send(spec.address, spec.interface, &shell),
            StreamKind::Lsl => lsl::serve(spec.address, facts, &shell).await,
        };
        let address = opened.map_err(|why| StreamError::Open {
            spec,
            problem: if spec.kind.is_server() {
                "cannot listen there"
            } else {
                "cannot send there"
            },
            why,
        })?;
        self.running.push(Running {
            spec,
            address,
            counters,
        });
        Ok(())
    }

    /// Creates frames from the newest poses, outside the publisher's task.
    fn make_frames(&self, mut maker: FrameMaker) {
        let (mut poses, slot) = (self.poses.subscribe(), Arc::clone(&self.slot));
        let mut people = self.people.subscribe();
        let (stop, unreadable) = (self.stop.clone(), Arc::clone(&self.unreadable));
        self.tasks.spawn(async move {
            let mut last = 0;
            loop {
                tokio::select! {
                    biased;
                    () = stop.cancelled() => break,
                    changed = poses.changed() => if changed.is_err() { break },
                }
                if people.has_changed().unwrap_or(false) {
                    maker.edit(people.borrow_and_update().clone());
                }
                let newest = poses.borrow_and_update().clone();
                if let Some(poses) = newest.poses {
                    let missed = newest.number.saturating_sub(last + 1);
                    last = newest.number;
                    slot.put(Arc::new(maker.frame(&poses)), missed);
                    unreadable.store(maker.unreadable(), Ordering::Relaxed);
                }
            }
        });
    }

    /// Streams these poses. Never blocks; poses that no stream has read yet are replaced.
    pub fn poses(&self, poses: impl Into<Arc<PoseSet>>) {
        self.poses.send_modify(|newest| {
            newest.number += 1;
            newest.poses = Some(poses.into());
        });
    }

    /// Applies edits of people from the next poses on; a person without a name is `person_<id>`.
    /// Never blocks.
    pub fn set_people(&self, people: Identities) {
        self.people.send_replace(people);
    }

    /// Streams a frame made elsewhere. Never blocks.
    pub fn tick(&self, frame: Arc<Frame>) {
        self.slot.put(frame, 0);
    }

    /// Status of every stream, in the order of the specifications.
    pub fn report(&self) -> Vec<StreamReport> {
        let report = |stream: &Running| {
            let counted = stream.counters.read();
            StreamReport {
                spec: stream.spec,
                address: stream.address,
                clients: counted.clients,
                sent: counted.sent,
                skipped: counted.skipped,
                failed: counted.failed,
                last_error: counted.last_error,
            }
        };
        self.running.iter().map(report).collect()
    }

    /// Number of poses that do not match the body model and were not streamed.
    pub fn unreadable_poses(&self) -> u64 {
        self.unreadable.load(Ordering::Relaxed)
    }

    /// Says goodbye to clients and stops all tasks, within two seconds.
    pub async fn stop(self) {
        self.stop.cancel();
        self.tasks.close();
        // Remaining tasks are abandoned: each ends at its next await or time limit.
        drop(tokio::time::timeout(GRACE, self.tasks.wait()).await);
    }
}

impl Drop for Streams {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}
