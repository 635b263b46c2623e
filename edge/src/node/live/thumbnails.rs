//! The thread that makes thumbnails, of each camera in turn, at most one per camera and second.
//!
//! It requests a picture from the pipeline's thread, which passes on a used one and only takes a
//! lock. The picture is reduced in this thread. Without a subscriber, or without room on the link,
//! no thumbnail is made.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::message::thumbnail::{THUMBNAILS_PER_S, Thumbnail};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

use super::shared::Shared;
use crate::live::{Micros, SECOND_US};
use crate::picture::Picture;
use crate::source::{Frame, FrameContent};
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

/// Longest time until a waiting thread notices that it must stop.
const NAP: Duration = Duration::from_millis(50);

/// A slot in which the pipeline's thread puts one requested picture after use.
#[derive(Debug, Default)]
pub(super) struct PictureDesk {
    on_it: Mutex<OnDesk>,
    came: Condvar,
}

#[derive(Debug, Default)]
enum OnDesk {
    #[default]
    Nothing,
    /// A picture of the camera at this index is requested.
    Wanted(usize),
    /// The requested picture.
    Picture(Tick, Picture),
}

impl PictureDesk {
    /// Passes on the requested picture, if it is among these no longer needed `frames`.
    pub(super) fn offer(&self, frames: &mut [Option<Frame>]) {
        let mut on_it = self.lock();
        let OnDesk::Wanted(at) = *on_it else { return };
        let is_picture = |frame: &mut Frame| matches!(frame.content, FrameContent::Image(_));
        let frame = frames
            .get_mut(at)
            .and_then(|frame| frame.take_if(is_picture));
        if let Some(Frame {
            tick,
            content: FrameContent::Image(picture),
            ..
        }) = frame
        {
            *on_it = OnDesk::Picture(tick, picture);
            drop(on_it);
            self.came.notify_all();
        }
    }

    /// Requests a picture of the camera at index `at`. Waits for at most the given time, or until
    /// `shall_stop`.
    pub(super) fn take(
        &self,
        at: usize,
        patience: Duration,
        shall_stop: impl Fn() -> bool,
    ) -> Option<(Tick, Picture)> {
        let mut on_it = self.lock();
        *on_it = OnDesk::Wanted(at);
        let naps = patience.as_millis() / NAP.as_millis();
        for _ in 0..naps.max(1) {
            let waited = self.came.wait_timeout(on_it, NAP);
            on_it = waited.unwrap_or_else(PoisonError::into_inner).0;
            if matches!(*on_it, OnDesk::Picture(..)) || shall_stop() {
                break;
            }
        }
        match std::mem::take(&mut *on_it) {
            OnDesk::Picture(tick, picture) => Some((tick, picture)),
            OnDesk::Nothing | OnDesk::Wanted(_) => None,
        }
    }

    fn lock(&self) -> MutexGuard<'_, OnDesk> {
        self.on_it.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use image::RgbImage;

    use super::*;
    use crate::source::KeypointFrame;

    fn frame(tick: i64, content: FrameContent) -> Frame {
        Frame {
            tick: Tick(tick),
            capture_offset_us: 0,
            content,
        }
    }

    fn pictures(tick: i64) -> [Option<Frame>; 2] {
        [0, 1].map(|_| Some(frame(tick, FrameContent::Image(RgbImage::new(2, 2).into()))))
    }

    #[test]
    fn only_a_requested_picture_is_passed_on_and_only_once() {
        let desk = PictureDesk::default();
        let mut frames = pictures(1);
        desk.offer(&mut frames);
        assert!(frames.iter().all(Option::is_some));
        *desk.lock() = OnDesk::Wanted(1);
        desk.offer(&mut frames);
        assert_eq!(frames.each_ref().map(Option::is_some), [true, false]);
        let mut later = pictures(2);
        desk.offer(&mut later);
        assert!(later.iter().all(Option::is_some));
        assert!(matches!(*desk.lock(), OnDesk::Picture(Tick(1), _)));
    }

    #[test]
    fn other_content_stays_and_waiting_for_a_picture_ends() {
        let desk = PictureDesk::default();
        *desk.lock() = OnDesk::Wanted(0);
        let keypoints = FrameContent::Keypoints(KeypointFrame::default());
        let mut frames = [Some(frame(1, keypoints))];
        desk.offer(&mut frames);
        desk.offer(&mut []);
        assert!(frames[0].is_some());
        assert_eq!(desk.take(0, NAP, || false), None);
        assert_eq!(desk.take(0, Duration::from_hours(1), || true), None);
        assert!(matches!(*desk.lock(), OnDesk::Nothing));
    }
}
