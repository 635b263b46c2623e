//! The parts of an edge, in lock-step and live.

use std::sync::Arc;

use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::venue::Venue;

use super::workers::Workers;
use crate::pipeline::EdgePipeline;
use crate::source::Sources;

/// The cameras of a viewpoint, their sources, and the pipeline.
pub(super) struct Parts {
    pub(super) venue: Arc<Venue>,
    pub(super) viewpoint: ViewpointIndex,
    /// The cameras of the viewpoint, in file order.
    pub(super) cameras: Vec<CameraIndex>,
    pub(super) sources: Arc<dyn Sources>,
    pub(super) pipeline: EdgePipeline,
    /// Measured speed of the network, if the edge may run live.
    pub(super) workers: Option<Workers>,
}
