//! Detection passes: finding people without boxes, on the cameras that fusion names.

use std::borrow::Cow;

use farfield_proto::id::CameraIndex;
use farfield_proto::message::Sighting;
use farfield_proto::tick::Tick;

use super::sighting::{self, Pending};
use super::{EdgePipeline, PipelineError};
use crate::source::{Frame, FrameContent};

impl EdgePipeline {
    /// The cameras of a detection pass at `tick` while fusion asks for none: all of them, at the regular ticks.
    pub fn regular_detection_cameras(&self, tick: Tick) -> Vec<CameraIndex> {
        if tick.0.rem_euclid(self.ticks_per_pass) == 0 {
            self.cameras.iter().map(|camera| camera.index).collect()
        } else {
            Vec::new()
        }
    }

    /// Whether this edge can find people without boxes at all.
    pub(super) fn can_sight(&self) -> bool {
        let reads_pictures = self.detector.is_some() && self.batch.is_some();
        self.cameras
            .iter()
            .any(|c| c.drawing.is_some() || reads_pictures)
    }

    /// Runs the detector on the pictures of `cameras` and puts the crops into the batch.
    pub(super) fn detect(
        &mut self,
        frames: &[Option<Frame>],
        cameras: &[CameraIndex],
    ) -> Result<Vec<Pending>, PipelineError> {
        let mut pending = Vec::new();
        let (Some(detector), Some(batch)) = (&mut self.detector, &mut self.batch) else {
            return Ok(pending);
        };
        let with_frames = self.cameras.iter_mut().zip(frames).enumerate();
        let asked = with_frames.filter(|(_, (camera, _))| cameras.contains(&camera.index));
        for (at, (camera, frame)) in asked {
            if let Some(Frame {
                content: FrameContent::Image(image),
                tick,
                ..
            }) = frame
            {
                // Passes that follow each other at once, because of a new person, are on the same cell.
                let number = tick.0.div_euclid(self.ticks_per_pass);
                let detections = detector.detect_in(image, camera.index, number)?;
                pending.extend(sighting::enqueue(
                    &detections,
                    (at, camera.index, &camera.model),
                    batch,
                    &mut camera.beyond_view,
                ));
            }
        }
        Ok(pending)
    }

    /// The sightings of `cameras`, after inference.
    pub(super) fn sightings(
        &mut self,
        pending: &[Pending],
        frames: &[Option<Frame>],
        cameras: &[CameraIndex],
    ) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        let n_keypoints = self.keypoints.len();
        let with_frames = self.cameras.iter_mut().zip(frames);
        for (camera, frame) in with_frames.filter(|(camera, _)| cameras.contains(&camera.index)) {
            if let Some(batch) = &self.batch {
                let (model, beyond) = (&camera.model, &mut camera.beyond_view);
                let of_camera = pending.iter().filter(|p| p.camera() == camera.index);
                sightings.extend(
                    of_camera.map(|p| sighting::read(p, model, batch, n_keypoints, beyond)),
                );
            }
            let given = match frame.as_ref().map(|f| &f.content) {
                Some(FrameContent::Keypoints(keypoints)) => Cow::Borrowed(&keypoints.persons[..]),
                Some(FrameContent::Painted(painter)) => Cow::Owned(painter.persons()),
                Some(FrameContent::Image(_)) | None => continue,
            };
            let of = (camera.index, &camera.model);
            sightings.extend(sighting::from_persons(&given, of, &mut camera.beyond_view));
        }
        sighting::bounded(sightings)
    }
}
