//! Detection passes: detection of people without boxes, at regular ticks on all cameras, else on
//! cameras that fusion names.

use std::borrow::Cow;

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Distorted, Pixel};
use farfield_proto::id::CameraIndex;
use farfield_proto::message::{CameraBox, Sighting};
use farfield_proto::tick::Tick;

use super::sighting::{self, Pending};
use super::tracked::moved_on;
use super::{EdgePipeline, PipelineError, StepRequest};
use crate::inference::{CameraDetections, Detection};
use crate::source::{Frame, FrameContent};

impl EdgePipeline {
    /// The cameras of a regular detection pass at `tick`: all of them; none at other ticks.
    pub fn regular_detection_cameras(&self, tick: Tick) -> Vec<CameraIndex> {
        if tick.0.rem_euclid(self.ticks_per_pass) == 0 {
            self.cameras.iter().map(|camera| camera.index).collect()
        } else {
            Vec::new()
        }
    }

    /// Ticks between two regular passes.
    pub fn ticks_per_pass(&self) -> i64 {
        self.ticks_per_pass
    }

    /// Whether this edge can detect people without boxes; `detections` are those of the request, if
    /// any.
    pub(super) fn can_sight(&self, detections: Option<&[CameraDetections]>) -> bool {
        let reads_pictures =
            self.batch.is_some() && (self.detector.is_some() || detections.is_some());
        self.cameras
            .iter()
            .any(|c| c.drawing.is_some() || reads_pictures)
    }

    /// Adds the crops of detected people to the batch: from the request's detections, or from a run
    /// of the detector now.
    pub(super) fn detect(
        &mut self,
        frames: &[Option<Frame>],
        request: &StepRequest<'_>,
    ) -> Result<Vec<Pending>, PipelineError> {
        let mut pending = Vec::new();
        let asked = request.detection_cameras;
        let detections = match (request.detections, &mut self.detector) {
            (Some(detections), _) => Cow::Borrowed(detections),
            (None, Some(detector)) => {
                Cow::Owned(detector.detect(frames, asked, request.tick, request.tick)?)
            }
            (None, None) => return Ok(pending),
        };
        let Some(batch) = &mut self.batch else {
            return Ok(pending);
        };
        let with_frames = self.cameras.iter_mut().zip(frames).enumerate();
        for (at, (camera, frame)) in with_frames {
            let mut detections = detections.iter().filter(|_| asked.contains(&camera.index));
            let detected = detections.find(|detected| detected.camera == camera.index);
            let content = frame.as_ref().map(|frame| &frame.content);
            if let (Some(detected), Some(FrameContent::Image(_))) = (detected, content) {
                pending.extend(sighting::enqueue(
                    &moved_with_boxes(detected, request, &camera.model),
                    at,
                    camera.index,
                    &camera.model,
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
            sightings.extend(sighting::from_persons(
                &given,
                camera.index,
                &camera.model,
                &mut camera.beyond_view,
            ));
        }
        sighting::bounded(sightings)
    }
}

/// The detected people, moved to the tick of the request: a person with a box moves with it.
/// Otherwise a crop from an old detection would show an empty place, in which a network still sees
/// a person.
fn moved_with_boxes<'a>(
    detected: &'a CameraDetections,
    request: &StepRequest<'_>,
    model: &CameraModel,
) -> Cow<'a, [Detection]> {
    if detected.tick == request.tick {
        return Cow::Borrowed(&detected.people);
    }
    let of_people = request.boxes.persons.iter().flat_map(|p| &p.cameras);
    let of_camera = of_people.filter(|b| b.camera == detected.camera);
    let at = |b: &CameraBox, tick| moved_on(b, tick - request.boxes.tick).bounding_box;
    let moves: Vec<[BoundingBox; 2]> = of_camera
        .map(|b| [at(b, detected.tick), at(b, request.tick)])
        .collect();
    let moved = detected
        .people
        .iter()
        .map(|it| moved_with(it, &moves, model));
    moved.collect()
}

/// A detection, moved like the nearest box around it from the box's first to its second position;
/// unchanged without such a box.
fn moved_with(detection: &Detection, moves: &[[BoundingBox; 2]], model: &CameraModel) -> Detection {
    let middle = [0, 1].map(|i| f64::from(detection.min_px[i].midpoint(detection.max_px[i])));
    let Some(seen) = model.undistort(Pixel::<Distorted>::new(middle[0], middle[1])) else {
        return *detection;
    };
    let seen = [seen.x() as f32, seen.y() as f32];
    let off_px = |b: &BoundingBox| [0, 1].map(|i| (seen[i] - b.center_px[i]).abs());
    let around = moves.iter().filter(|[before, _]| {
        let off_px = off_px(before);
        (0..2).all(|i| off_px[i] <= before.size_px[i] / 2.0)
    });
    let distance_px = |[before, _]: &[BoundingBox; 2]| {
        let [x, y] = off_px(before);
        x.hypot(y)
    };
    let Some([before, now]) = around.min_by(|a, b| distance_px(a).total_cmp(&distance_px(b)))
    else {
        return *detection;
    };
    let there = [0, 1].map(|i| f64::from(seen[i] + now.center_px[i] - before.center_px[i]));
    let Some(there) = model.distort(Pixel::new(there[0], there[1])) else {
        return *detection;
    };
    let by_px = [there.x() - middle[0], there.y() - middle[1]];
    let moved = |p: [f32; 2]| [0, 1].map(|i| p[i] + by_px[i] as f32);
    Detection {
        min_px: moved(detection.min_px),
        max_px: moved(detection.max_px),
        score: detection.score,
    }
}
