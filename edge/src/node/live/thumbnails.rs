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
use crate::thumbnail::{MIN_THUMBNAIL_BYTES, ThumbnailMaker};

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
        if room() < MIN_THUMBNAIL_BYTES || !shared.has_thumbnail_subscriber() {
            return;
        }
        let patience = Duration::from_micros(patience_us.unsigned_abs());
        let taken = shared
            .picture_slot
            .take(at, patience, || shared.is_stopped());
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
const MAX_SLEEP: Duration = Duration::from_millis(50);

/// A slot in which the pipeline's thread puts one requested picture after use.
#[derive(Debug, Default)]
pub(super) struct PictureSlot {
    state: Mutex<SlotState>,
    changed: Condvar,
}

#[derive(Debug, Default)]
enum SlotState {
    #[default]
    Empty,
    /// A picture of the camera at this index is requested.
    Requested(usize),
    /// The requested picture.
    Picture(Tick, Picture),
}

impl PictureSlot {
    /// Passes on the requested picture, if it is among these no longer needed `frames`.
    pub(super) fn offer(&self, frames: &mut [Option<Frame>]) {
        let mut state = self.lock();
        let SlotState::Requested(at) = *state else {
            return;
        };
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
            *state = SlotState::Picture(tick, picture);
            drop(state);
            self.changed.notify_all();
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
        let mut state = self.lock();
        *state = SlotState::Requested(at);
        let naps = patience.as_millis() / MAX_SLEEP.as_millis();
        for _ in 0..naps.max(1) {
            let waited = self.changed.wait_timeout(state, MAX_SLEEP);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
            if matches!(*state, SlotState::Picture(..)) || shall_stop() {
                break;
            }
        }
        match std::mem::take(&mut *state) {
            SlotState::Picture(tick, picture) => Some((tick, picture)),
            SlotState::Empty | SlotState::Requested(_) => None,
        }
    }

    fn lock(&self) -> MutexGuard<'_, SlotState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
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
        let slot = PictureSlot::default();
        let mut frames = pictures(1);
        slot.offer(&mut frames);
        assert!(frames.iter().all(Option::is_some));
        *slot.lock() = SlotState::Requested(1);
        slot.offer(&mut frames);
        assert_eq!(frames.each_ref().map(Option::is_some), [true, false]);
        let mut later = pictures(2);
        slot.offer(&mut later);
        assert!(later.iter().all(Option::is_some));
        assert!(matches!(*slot.lock(), SlotState::Picture(Tick(1), _)));
    }

    #[test]
    fn other_content_stays_and_waiting_for_a_picture_ends() {
        let slot = PictureSlot::default();
        *slot.lock() = SlotState::Requested(0);
        let keypoints = FrameContent::Keypoints(KeypointFrame::default());
        let mut frames = [Some(frame(1, keypoints))];
        slot.offer(&mut frames);
        slot.offer(&mut []);
        assert!(frames[0].is_some());
        assert_eq!(slot.take(0, MAX_SLEEP, || false), None);
        assert_eq!(slot.take(0, Duration::from_hours(1), || true), None);
        assert!(matches!(*slot.lock(), SlotState::Empty));
    }
}
