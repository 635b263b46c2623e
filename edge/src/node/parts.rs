//! What an edge works with, in lock-step as live.

use std::sync::Arc;

use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::venue::Venue;

use super::workers::Workers;
use crate::pipeline::EdgePipeline;
use crate::source::Sources;

/// The cameras of a viewpoint, what opens them, and what works on their frames.
pub(super) struct Parts {
    pub(super) venue: Arc<Venue>,
    pub(super) viewpoint: ViewpointIndex,
    /// The cameras of the viewpoint, in file order.
    pub(super) cameras: Vec<CameraIndex>,
    pub(super) sources: Arc<dyn Sources>,
    pub(super) pipeline: EdgePipeline,
    /// What was measured of the network, where the edge may run live.
    pub(super) workers: Option<Workers>,
}
