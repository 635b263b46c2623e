//! The thread that makes thumbnails, of each camera in turn, at most one per camera and second.
//!
//! It requests a picture from the pipeline's thread, which passes on a used one and only takes a
//! lock. The picture is reduced in this thread. Without a subscriber, or without room on the link,
//! no thumbnail is made.

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
    /// The cameras of the viewpoint, in file order.
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
            // A clock change or a slow picture causes no burst.
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

    /// Sends a thumbnail of `camera`, at index `at`, if there are a subscriber and room. Waits for
    /// a picture for at most `patience_us`.
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
        if room() < LEAST_THUMBNAIL_BYTES || !shared.has_thumbnail_subscriber() {
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
