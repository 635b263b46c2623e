//! Transfer of a used picture from the pipeline's thread to the thumbnail thread.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use farfield_proto::tick::Tick;

use crate::picture::Picture;
use crate::source::{Frame, FrameContent};

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
