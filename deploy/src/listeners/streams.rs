//! Streams of a run in the protocols of other programs.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use farfield_fusion::node::{CopiedMessage, CopiedStep, RunAtItsStart, Wiretap};
use farfield_node::process::NodeError;
use farfield_proto::key::Keys;
use farfield_proto::message::PoseSet;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use farfield_streams::{StreamError, StreamSpec, Streams, VenueFacts};
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::warn;

use super::thread::ServingThread;

/// How often what went wrong with streams is logged.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// What streams say of where poses come from.
pub(super) fn facts(run: &RunAtItsStart<'_>) -> VenueFacts {
    VenueFacts {
        venue: run.venue.name.clone(),
        rate_hz: run.venue.rate_hz,
        names: BTreeMap::new(),
        cameras: run
            .venue
            .cameras
            .iter()
            .map(|it| it.model.clone())
            .collect(),
    }
}

/// Starts the streams of a run; what the operator is told of them goes to `said`.
///
/// # Errors
/// The first whose address cannot be had.
pub(super) async fn start(
    specs: &[StreamSpec],
    facts: VenueFacts,
    said: &mut Vec<String>,
) -> Result<RunningStreams, NodeError> {
    let streams = Streams::start(specs, facts).await;
    let streams = streams.map_err(|error| match error {
        // What holds the port may let go of it; a service is started again.
        StreamError::Open { .. } => NodeError::failed(error),
        StreamError::Twice(_) => NodeError::refused(error),
    })?;
    for stream in streams.report() {
        let what = if stream.spec.kind.is_server() {
            "waits for clients at"
        } else {
            "goes to"
        };
        let open = if stream.spec.leaves_this_machine() {
            ": whoever can reach it sees where people are, it has no keys"
        } else {
            ""
        };
        let (name, address) = (stream.spec.kind.name(), stream.address);
        said.push(format!("stream {name} {what} {address}{open}"));
    }
    let streams = Arc::new(streams);
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    let (until, told) = (stop.clone(), Arc::clone(&streams));
    tasks.spawn(async move {
        until.run_until_cancelled(tell_of_failures(&told)).await;
    });
    Ok(RunningStreams {
        streams,
        tasks,
        stop,
    })
}

/// Streams, and who tells of their failures.
pub(super) struct RunningStreams {
    pub(super) streams: Arc<Streams>,
    tasks: TaskTracker,
    stop: CancellationToken,
}

impl RunningStreams {
    /// Says goodbye to clients, where the tap has let go of the streams; else they end without.
    pub(super) async fn stop(self) {
        self.stop.cancel();
        self.tasks.close();
        self.tasks.wait().await;
        if let Some(streams) = Arc::into_inner(self.streams) {
            streams.stop().await;
        }
    }
}

/// Task: logs what goes wrong with streams.
async fn tell_of_failures(streams: &Streams) {
    let mut told: Vec<u64> = Vec::new();
    loop {
        sleep(TELL_EVERY).await;
        let report = streams.report();
        told.resize(report.len(), 0);
        for (stream, told) in report.iter().zip(&mut told) {
            if stream.failed > *told {
                *told = stream.failed;
                let why = stream.last_error.as_deref().unwrap_or_default();
                warn!(
                    stream = stream.spec.kind.name(),
                    failed = stream.failed,
                    "{why}"
                );
            }
        }
    }
}

/// Gives the streams what fusion publishes of people.
pub(super) struct StreamTap {
    streams: Arc<Streams>,
    pose_key: String,
    _thread: Arc<ServingThread>,
}

impl StreamTap {
    pub(super) fn new(venue: &Venue, streams: Arc<Streams>, thread: Arc<ServingThread>) -> Self {
        Self {
            streams,
            pose_key: Keys::new(&venue.name).pose(),
            _thread: thread,
        }
    }
}

impl Wiretap for StreamTap {
    fn received(&self, _: CopiedMessage<'_>) {}

    fn published(&self, message: CopiedMessage<'_>) {
        // What fusion encoded a moment ago can be read again.
        if message.key == self.pose_key
            && let Ok(poses) = wire::decode::<PoseSet>(message.bytes)
        {
            self.streams.poses(poses);
        }
    }

    fn decided(&self, _: CopiedStep<'_>) {}
}
