//! All streams of a run: started together, given a tick at a time, stopped together.

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
use crate::shell::Shell;
use crate::slot::{Counters, Slot};
use crate::spec::{StreamKind, StreamSpec};
use crate::{foxglove, lsl, psn, qtm, vmc, websocket};

/// How long streams may take to say goodbye to their clients.
const GRACE: Duration = Duration::from_secs(2);

/// Why streams cannot start.
#[derive(Debug, Error)]
pub enum StreamError {
    /// The address cannot be had.
    #[error("stream `{spec}`: {problem}: {why}")]
    Open {
        /// The stream.
        spec: StreamSpec,
        /// What was tried.
        problem: &'static str,
        /// What the system says.
        why: io::Error,
    },
    /// Two streams of one protocol at one address.
    #[error("stream `{0}`: found twice, expected once")]
    Twice(StreamSpec),
}

/// How a stream does.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamReport {
    /// What was asked for.
    pub spec: StreamSpec,
    /// Where a server listens (the port that it got, where port 0 was asked for), or where a sender sends to.
    pub address: SocketAddr,
    /// Connected clients; of the stream of avatars, ports that are sent to; of PosiStageNet always 1.
    pub clients: usize,
    /// Frames that were sent, over all clients.
    pub sent: u64,
    /// Frames that clients did not get because they, or this machine, were too slow, over all clients.
    pub skipped: u64,
    /// What went wrong and was gone on without: refused or lost clients, datagrams that could not be sent.
    pub failed: u64,
    /// The last of these.
    pub last_error: Option<String>,
}

#[derive(Debug)]
struct Running {
    spec: StreamSpec,
    address: SocketAddr,
    counters: Arc<Counters>,
}

/// The newest poses, and how many were published by then.
#[derive(Debug, Clone, Default)]
struct Newest {
    number: u64,
    poses: Option<Arc<PoseSet>>,
}

/// Running streams. Dropping it stops them too, without goodbyes.
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
    /// Opens all streams. Must be called inside a tokio runtime with I/O and time; the streams' tasks run there.
    ///
    /// # Errors
    /// The first stream whose address cannot be had; nothing runs then.
    pub async fn start(specs: &[StreamSpec], facts: VenueFacts) -> Result<Self, StreamError> {
        for (i, spec) in specs.iter().enumerate() {
            // Port 0 is another one each time.
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
                "this program was built without Zenoh's streams",
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

    /// Makes frames of the newest poses, away from who publishes them.
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

    /// Streams these poses. Never waits: poses that the streams have not come to yet are replaced.
    pub fn poses(&self, poses: impl Into<Arc<PoseSet>>) {
        self.poses.send_modify(|newest| {
            newest.number += 1;
            newest.poses = Some(poses.into());
        });
    }

    /// From the next poses on people are whom `people` says, and called so; who has no name is `person_<id>`. Never waits.
    pub fn set_people(&self, people: Identities) {
        self.people.send_replace(people);
    }

    /// Streams a frame that was made elsewhere. Never waits.
    pub fn tick(&self, frame: Arc<Frame>) {
        self.slot.put(frame, 0);
    }

    /// How every stream does, in the order in which they were asked for.
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

    /// Poses that had not the numbers of the body model, and were not streamed.
    pub fn unreadable_poses(&self) -> u64 {
        self.unreadable.load(Ordering::Relaxed)
    }

    /// Says goodbye to clients and stops all tasks, within two seconds.
    pub async fn stop(self) {
        self.stop.cancel();
        self.tasks.close();
        // Who is not done by then is left: every task ends at its next await, or with its own limit of time.
        drop(tokio::time::timeout(GRACE, self.tasks.wait()).await);
    }
}

impl Drop for Streams {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}
