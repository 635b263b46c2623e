//! Observers of a fusion node: they receive copies of all its messages.
//!
//! Fusion does not depend on pages or streams. The command that starts it passes in an [`OpenListeners`], which opens them before
//! the first message. Each observer is a [`Wiretap`]: it gets copies and never delays fusion.

use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;

use farfield_node::process::NodeError;
use farfield_proto::id::SessionId;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::tick::Tick;
use farfield_proto::transport::Identity;
use farfield_proto::venue::Venue;

use super::recording::RecordingsOnDemand;
use super::session::wiretap::Wiretap;

/// Facts about a run, for its observers.
#[derive(Clone, Copy)]
pub struct RunAtItsStart<'a> {
    /// The venue.
    pub venue: &'a Venue,
    /// The keypoints of its network, in the order of poses and maps.
    pub keypoints: &'a KeypointSet,
    /// Whether the run is live; otherwise it is in lock-step.
    pub is_live: bool,
    /// Fusion's identity; `None` without TLS.
    pub identity: Option<&'a Identity>,
    /// The folder of its results.
    pub out: &'a Path,
    /// The file for names of people that a restarted fusion recognises ([`Wiretap::expected`]); `None` if there is none.
    pub restarts: Option<&'a Path>,
    /// Starts and stops recordings; `None` in lock-step.
    pub recordings: Option<&'a Arc<RecordingsOnDemand>>,
    /// The Zenoh endpoints of fusion.
    pub listens_at: &'a [String],
    /// The recording in a replay; `None` otherwise.
    pub replays: Option<ReplayedRecording<'a>>,
}

/// A recording that is replayed.
#[derive(Debug, Clone, Copy)]
pub struct ReplayedRecording<'a> {
    /// The file.
    pub file: &'a Path,
    /// The session that is replayed.
    pub session: SessionId,
    /// Whether the ids are those of the recorded poses.
    pub keeps_ids: bool,
    /// The first and the last replayed tick.
    pub ticks: [Tick; 2],
}

/// The open observers.
#[derive(Default)]
pub struct Listeners {
    /// Receivers of the copies; dropped at the end of the run.
    pub wiretaps: Vec<Arc<dyn Wiretap>>,
    /// Lines for the operator, such as addresses.
    pub notices: Vec<String>,
    /// Whether a page is open. Its users can start recordings, and a replay stays open at its end until it is stopped.
    pub has_viewers: bool,
    /// Whether the observers need the timing of the run: a replay then publishes ticks at the venue's rate, otherwise as fast as
    /// it solves them.
    pub is_real_time: bool,
}

/// The future of opening the observers. The run does not begin if it fails.
pub type Opening<'a> = Pin<Box<dyn Future<Output = Result<Listeners, NodeError>> + Send + 'a>>;

/// Opens the observers of a run.
pub trait OpenListeners: Send {
    /// Refuses invalid settings before anything is opened. `identity` is that of fusion.
    ///
    /// # Errors
    /// A setting is invalid.
    fn check(&self, identity: Option<&Identity>) -> Result<(), NodeError>;

    /// Opens the observers. Called once, on the node's runtime, after all checks.
    fn open(self: Box<Self>, run: RunAtItsStart<'_>) -> Opening<'_>;
}

/// No observers.
#[derive(Debug, Clone, Copy)]
pub struct NoListeners;

impl OpenListeners for NoListeners {
    fn check(&self, _identity: Option<&Identity>) -> Result<(), NodeError> {
        Ok(())
    }

    fn open(self: Box<Self>, run: RunAtItsStart<'_>) -> Opening<'_> {
        let mut listeners = Listeners::default();
        let streams = run.venue.streams.iter().map(|stream| stream.to.as_str());
        let streams: Vec<&str> = streams.collect();
        if !streams.is_empty() {
            listeners.notices.push(format!(
                "streams of the venue file are not opened ({}): `farfield fusion` opens them",
                streams.join(", ")
            ));
        }
        Box::pin(async { Ok(listeners) })
    }
}
