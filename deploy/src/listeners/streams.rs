//! Streams of a run in the protocols of other programs.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use farfield_fusion_node::{CopiedMessage, CopiedStep, RunAtItsStart, Wiretap};
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

/// Interval of log messages on stream failures.
const LOG_INTERVAL: Duration = Duration::from_secs(5);

/// Facts on the venue that streams send.
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

/// Starts the streams of a run; adds a line for the operator on each to `lines`.
///
/// # Errors
/// The first stream whose address cannot be used.
pub(super) async fn start(
    specs: &[StreamSpec],
    facts: VenueFacts,
    lines: &mut Vec<String>,
) -> Result<RunningStreams, NodeError> {
    let streams = Streams::start(specs, facts).await;
    let streams = streams.map_err(|error| match error {
        // The port may become free later; a service is restarted.
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
            "; it has no keys: everyone who can reach it sees where people are"
        } else {
            ""
        };
        let (name, address) = (stream.spec.kind.name(), stream.address);
        lines.push(format!("stream {name} {what} {address}{open}"));
    }
    let streams = Arc::new(streams);
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    let (until, observed) = (stop.clone(), Arc::clone(&streams));
    tasks.spawn(async move {
        until.run_until_cancelled(log_failures(&observed)).await;
    });
    Ok(RunningStreams {
        streams,
        tasks,
        stop,
    })
}

/// Running streams with the task that logs their failures.
pub(super) struct RunningStreams {
    pub(super) streams: Arc<Streams>,
    tasks: TaskTracker,
    stop: CancellationToken,
}

impl RunningStreams {
    /// Closes the connections to clients if the tap has dropped the streams; otherwise they end without a goodbye.
    pub(super) async fn stop(self) {
        self.stop.cancel();
        self.tasks.close();
        self.tasks.wait().await;
        if let Some(streams) = Arc::into_inner(self.streams) {
            streams.stop().await;
        }
    }
}

/// Task: logs failures of streams.
async fn log_failures(streams: &Streams) {
    let mut logged: Vec<u64> = Vec::new();
    loop {
        sleep(LOG_INTERVAL).await;
        let report = streams.report();
        logged.resize(report.len(), 0);
        for (stream, logged) in report.iter().zip(&mut logged) {
            if stream.failed > *logged {
                *logged = stream.failed;
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

/// Passes the poses that fusion publishes to the streams.
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
        // Fusion has just encoded it, so it can be decoded.
        if message.key == self.pose_key
            && let Ok(poses) = wire::decode::<PoseSet>(message.bytes)
        {
            self.streams.poses(poses);
        }
    }

    fn decided(&self, _: CopiedStep<'_>) {}
}
