//! What a live edge starts with, and its threads.

use std::sync::Arc;

use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::venue::Venue;
use tokio::sync::oneshot;

use super::camera::Camera;
use super::shared::Shared;
use super::ticker::Ticker;
use crate::live::Micros;
use crate::node::ring::RingHandle;
use crate::pipeline::EdgePipeline;
use crate::source::Sources;

/// Everything that the threads of a live edge own.
pub(in crate::node) struct LiveWork {
    pub(in crate::node) venue: Arc<Venue>,
    pub(in crate::node) viewpoint: ViewpointIndex,
    pub(in crate::node) cameras: Vec<CameraIndex>,
    pub(in crate::node) sources: Arc<dyn Sources>,
    pub(in crate::node) pipeline: EdgePipeline,
    /// How far the clock is wrong on purpose.
    pub(in crate::node) clock_shift_us: Micros,
    /// What keeps its sets, if anything does.
    pub(in crate::node) ring: Option<RingHandle>,
}

impl LiveWork {
    /// Starts the threads, which end when `shared` is stopped. Those of cameras may still wait for a
    /// frame then, so nobody waits for them.
    pub(super) fn spawn(
        self,
        shared: &Arc<Shared>,
        failed: oneshot::Sender<anyhow::Error>,
    ) -> std::io::Result<()> {
        for (at, &index) in self.cameras.iter().enumerate() {
            let camera = Camera {
                shared: Arc::clone(shared),
                venue: Arc::clone(&self.venue),
                sources: Arc::clone(&self.sources),
                index,
                at,
            };
            std::thread::Builder::new()
                .name(format!("camera {at}"))
                .spawn(move || camera.run())?;
        }
        let mut ticker = Ticker::new(Arc::clone(shared), self.pipeline, self.viewpoint);
        let work = move || {
            if let Err(error) = ticker.run() {
                drop(failed.send(error));
            }
        };
        std::thread::Builder::new()
            .name("pipeline".to_owned())
            .spawn(work)
            .map(drop)
    }
}
