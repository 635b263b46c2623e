//! Who else hears what fusion hears and says.
//!
//! Fusion knows neither pages nor streams. The command around it does, and hands in what opens them: before the first
//! message, by what is known of the run. Each listener is a [`Wiretap`]: it gets copies, and nobody waits for it.

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

/// What listeners are told of a run before it begins.
#[derive(Clone, Copy)]
pub struct RunAtItsStart<'a> {
    /// The venue.
    pub venue: &'a Venue,
    /// The keypoints of its network, in the order of poses and maps.
    pub keypoints: &'a KeypointSet,
    /// Whether it runs live; else in lock-step.
    pub is_live: bool,
    /// By which keys fusion proves who it is; `None` without TLS.
    pub identity: Option<&'a Identity>,
    /// The folder of its results.
    pub out: &'a Path,
    /// Where names of people can be kept for a fusion that is started again and gives them their old ids
    /// ([`Wiretap::expected`]); `None` where none is.
    pub restarts: Option<&'a Path>,
    /// What starts and stops recordings; `None` in lock-step.
    pub recordings: Option<&'a Arc<RecordingsOnDemand>>,
    /// Where fusion listens, as Zenoh's endpoints.
    pub listens_at: &'a [String],
    /// The recording that is solved again; `None` of a run of its own.
    pub replays: Option<ReplayedRecording<'a>>,
}

/// A recording that is solved again.
#[derive(Debug, Clone, Copy)]
pub struct ReplayedRecording<'a> {
    /// The file.
    pub file: &'a Path,
    /// Which life of fusion.
    pub session: SessionId,
    /// Whether ids mean the same people as in its poses.
    pub keeps_ids: bool,
    /// The first and the last tick that are solved.
    pub ticks: [Tick; 2],
}

/// Whoever listens, opened.
#[derive(Default)]
pub struct Listeners {
    /// Who gets the copies; let go of when the run is over.
    pub wiretaps: Vec<Arc<dyn Wiretap>>,
    /// What the operator is told of them, a line each: where they can be reached.
    pub said: Vec<String>,
    /// Whether somebody can look, and ask for something: recordings can be begun then, and a replay stays when all is over
    /// until it is told to end.
    pub is_looked_at: bool,
    /// Whether what they get goes on to somebody who wants it as it happened: a replay tells ticks at the venue's rate then, and
    /// else as fast as they are solved.
    pub is_in_time: bool,
}

/// The listeners of a run, or what cannot be opened: the run does not begin then.
pub type Opening<'a> = Pin<Box<dyn Future<Output = Result<Listeners, NodeError>> + Send + 'a>>;

/// Opens the listeners of a run.
pub trait OpenListeners: Send {
    /// Refuses what can be refused of them before anything listens; `identity`: by which keys fusion proves who it is. Opens
    /// nothing.
    ///
    /// # Errors
    /// What cannot be opened as it was asked for.
    fn check(&self, identity: Option<&Identity>) -> Result<(), NodeError>;

    /// Opens them. Called once, on the runtime of the node, after everything that can be refused was.
    fn open(self: Box<Self>, run: RunAtItsStart<'_>) -> Opening<'_>;
}

/// Nobody else listens.
#[derive(Debug, Clone, Copy)]
pub struct NoListeners;

impl OpenListeners for NoListeners {
    fn check(&self, _identity: Option<&Identity>) -> Result<(), NodeError> {
        Ok(())
    }

    fn open(self: Box<Self>, run: RunAtItsStart<'_>) -> Opening<'_> {
        let mut listeners = Listeners::default();
        let asked = run.venue.streams.iter().map(|stream| stream.to.as_str());
        let asked: Vec<&str> = asked.collect();
        if !asked.is_empty() {
            listeners.said.push(format!(
                "streams of the venue file are not opened ({}): `farfield fusion` opens them",
                asked.join(", ")
            ));
        }
        Box::pin(async { Ok(listeners) })
    }
}
