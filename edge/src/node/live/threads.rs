//! The threads of a live edge: one per camera, one for the pipeline, and one for thumbnails if
//! these may leave the edge.

use std::sync::Arc;

use tokio::sync::oneshot;

use super::camera::LiveCamera;
use super::shared::Shared;
use super::thumbnails::Thumbnails;
use super::ticker::Ticker;
use crate::node::beyond_view::report_beyond_view;
use crate::node::parts::Parts;

/// Starts the threads, which end when `shared` is stopped. Camera threads may still wait for a
/// frame then, so they are not joined.
pub(super) fn spawn(
    parts: Parts,
    shared: &Arc<Shared>,
    failed: oneshot::Sender<anyhow::Error>,
) -> std::io::Result<()> {
    for (at, &index) in parts.cameras.iter().enumerate() {
        let camera = LiveCamera {
            shared: Arc::clone(shared),
            venue: Arc::clone(&parts.venue),
            sources: Arc::clone(&parts.sources),
            index,
            at,
        };
        std::thread::Builder::new()
            .name(format!("camera {at}"))
            .spawn(move || camera.run())?;
    }
    if shared.has_pictures() {
        let thumbnails = Thumbnails {
            shared: Arc::clone(shared),
            venue: Arc::clone(&parts.venue),
            viewpoint: parts.viewpoint,
            cameras: parts.cameras.clone(),
        };
        std::thread::Builder::new()
            .name("thumbnails".to_owned())
            .spawn(move || thumbnails.run())?;
    }
    let Parts {
        venue,
        pipeline,
        workers,
        viewpoint,
        ..
    } = parts;
    let shared = Arc::clone(shared);
    let work = move || {
        let mut ticker = Ticker::new(shared, pipeline, viewpoint, &venue);
        let outcome = ticker.share_work(workers).map(|()| ticker.run());
        report_beyond_view(ticker.pipeline());
        if let Err(error) = outcome {
            drop(failed.send(error));
        }
    };
    std::thread::Builder::new()
        .name("pipeline".to_owned())
        .spawn(work)
        .map(drop)
}
