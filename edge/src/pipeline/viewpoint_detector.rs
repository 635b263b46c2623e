//! The detector of a viewpoint, run over the pictures of some of its cameras.

use farfield_proto::id::CameraIndex;
use farfield_proto::tick::Tick;

use super::tiled_detector::TiledDetector;
use crate::inference::{CameraDetections, NetworkError};
use crate::source::{Frame, FrameContent};

/// Detects people in the pictures of a viewpoint.
pub struct ViewpointDetector {
    detector: TiledDetector,
    /// The cameras of the viewpoint, in the venue's order.
    cameras: Vec<CameraIndex>,
    ticks_per_pass: i64,
}

impl ViewpointDetector {
    pub(super) fn new(
        detector: TiledDetector,
        cameras: Vec<CameraIndex>,
        ticks_per_pass: i64,
    ) -> Self {
        Self {
            detector,
            cameras,
            ticks_per_pass,
        }
    }

    /// Runs the detector on the pictures of `cameras` at `tick`, for the detection pass at tick
    /// `pass`, which is `tick` or later. `frames` has one entry per camera of the viewpoint.
    ///
    /// # Errors
    /// [`NetworkError`] if the detector fails.
    pub fn detect(
        &mut self,
        frames: &[Option<Frame>],
        cameras: &[CameraIndex],
        tick: Tick,
        pass: Tick,
    ) -> Result<Vec<CameraDetections>, NetworkError> {
        // Passes in quick succession, because of a new person, use the same cell.
        let number = pass.0.div_euclid(self.ticks_per_pass);
        let with_frames = self.cameras.iter().copied().zip(frames);
        let asked = with_frames.filter(|(camera, _)| cameras.contains(camera));
        let detect = |(camera, frame): (CameraIndex, &Option<Frame>)| {
            let people = match frame.as_ref().map(|f| &f.content) {
                Some(FrameContent::Image(picture)) => {
                    self.detector.detect_in(picture, camera, number)?
                }
                _ => Vec::new(),
            };
            Ok(CameraDetections {
                camera,
                tick,
                people,
            })
        };
        asked.map(detect).collect()
    }
}
