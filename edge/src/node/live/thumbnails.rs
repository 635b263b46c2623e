//! The thread that makes thumbnails: of one camera after the other, each once a second at most.
//!
//! It asks the pipeline's thread for a picture. That hands over one with which it is done, which takes it no longer than
//! a lock; making it small is nobody's business but this thread's. While nobody subscribes to them, or the link has no room, nothing
//! is made.

use std::sync::Arc;
use std::time::Duration;

use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::message::thumbnail::{THUMBNAILS_PER_S, Thumbnail};
use farfield_proto::venue::Venue;

use super::shared::Shared;
use crate::live::{Micros, SECOND_US};
use crate::thumbnail::{LEAST_THUMBNAIL_BYTES, ThumbnailMaker};

/// Makes thumbnails of the cameras of a viewpoint.
pub(super) struct Thumbnails {
    pub(super) shared: Arc<Shared>,
    pub(super) venue: Arc<Venue>,
    pub(super) viewpoint: ViewpointIndex,
    /// Those of the viewpoint, in file order.
    pub(super) cameras: Vec<CameraIndex>,
}

impl Thumbnails {
    /// Works until the edge ends.
    pub(super) fn run(self) {
        let n_cameras = Micros::try_from(self.cameras.len()).unwrap_or(1).max(1);
        let each_us = SECOND_US / Micros::from(THUMBNAILS_PER_S) / n_cameras;
        let mut maker = ThumbnailMaker::default();
        let mut turn = 0;
        let mut due_us = self.shared.clock.now_us();
        loop {
            // A clock that was set, or a picture that took long, makes no burst.
            let now_us = self.shared.clock.now_us();
            due_us = (due_us + each_us).clamp(now_us, now_us + each_us);
            if !self.shared.sleep_until(due_us) {
                return;
            }
            turn = (turn + 1) % self.cameras.len().max(1);
            if let Some(&camera) = self.cameras.get(turn) {
                self.make(&mut maker, turn, camera, each_us);
            }
        }
    }

    /// Sends a thumbnail of `camera`, at position `at`, where somebody looks and there is room; waits for a picture for
    /// `patience_us` at most.
    fn make(
        &self,
        maker: &mut ThumbnailMaker,
        at: usize,
        camera: CameraIndex,
        patience_us: Micros,
    ) {
        let shared = &self.shared;
        let room = || shared.ledger().thumbnail_room(shared.clock.now_us());
        let Some(session) = shared.session() else {
            return;
        };
        if room() < LEAST_THUMBNAIL_BYTES || !shared.somebody_looks() {
            return;
        }
        let patience = Duration::from_micros(patience_us.unsigned_abs());
        let taken = shared.desk.take(at, patience, || shared.is_stopped());
        let (Some((tick, picture)), Some(known)) = (taken, self.venue.camera(camera)) else {
            return;
        };
        let Some(jpeg) = maker.make(&picture, &known.model, room()) else {
            return;
        };
        shared.send_thumbnail(&Thumbnail {
            session,
            tick,
            viewpoint: self.viewpoint,
            camera,
            jpeg,
        });
    }
}
