//! The frame of a given tick, from a source that only returns the next frame.

use farfield_proto::tick::Tick;

use crate::source::{Frame, FrameSource, SourceError};

/// Frames of one camera by tick. Requested ticks must not decrease.
pub(super) struct FramesAt {
    source: Box<dyn FrameSource>,
    /// A frame that came before its tick was requested.
    ahead: Option<Frame>,
    ended: bool,
}

impl FramesAt {
    pub(super) fn new(source: Box<dyn FrameSource>) -> Self {
        Self {
            source,
            ahead: None,
            ended: false,
        }
    }

    /// The frame of `tick`; `None` if the camera has none. Earlier frames are dropped.
    ///
    /// # Errors
    /// The error of the source, which is not read again.
    pub(super) fn at(&mut self, tick: Tick) -> Result<Option<Frame>, SourceError> {
        loop {
            match self.ahead.take() {
                Some(frame) if frame.tick == tick => return Ok(Some(frame)),
                Some(frame) if frame.tick > tick => {
                    self.ahead = Some(frame);
                    return Ok(None);
                }
                _ if self.ended => return Ok(None),
                _ => {}
            }
            self.ended = true;
            self.ahead = self.source.next_frame()?;
            self.ended = self.ahead.is_none();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{FrameContent, KeypointFrame};

    struct Recorded(Vec<i64>);

    impl FrameSource for Recorded {
        fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
            if self.0.is_empty() {
                return Ok(None);
            }
            let tick = Tick(self.0.remove(0));
            Ok(Some(Frame {
                tick,
                capture_offset_us: 0,
                content: FrameContent::Keypoints(KeypointFrame::default()),
            }))
        }
    }

    fn ticks_found(recorded: &[i64], asked: &[i64]) -> Vec<Option<i64>> {
        let mut frames = FramesAt::new(Box::new(Recorded(recorded.to_vec())));
        asked
            .iter()
            .map(|&t| frames.at(Tick(t)).unwrap().map(|f| f.tick.0))
            .collect()
    }

    #[test]
    fn a_missing_frame_is_a_gap_and_later_frames_wait() {
        assert_eq!(
            ticks_found(&[1, 2, 5], &[1, 2, 3, 4, 5, 6]),
            [Some(1), Some(2), None, None, Some(5), None]
        );
    }

    #[test]
    fn frames_before_the_tick_are_dropped() {
        assert_eq!(ticks_found(&[1, 2, 3, 4], &[3, 4]), [Some(3), Some(4)]);
    }
}
