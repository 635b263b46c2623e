//! The detector of a viewpoint, run over the pictures of some of its cameras, in the windows of the
//! tile plan.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::CameraIndex;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};

use crate::inference::{CameraDetections, Detection, NetworkError, PersonDetector};
use crate::picture::Picture;
use crate::source::{Frame, FrameContent};
use crate::tiles::{self, TilePlan};

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

/// Detects people in the pictures of a venue, window by window.
pub(super) struct TiledDetector {
    detector: Box<dyn PersonDetector>,
    /// For every camera of the venue with pictures.
    plans: Vec<(CameraIndex, TilePlan)>,
}

impl TiledDetector {
    /// Plans the windows of all cameras of the venue with pictures.
    pub(super) fn new(venue: &Venue, detector: Box<dyn PersonDetector>) -> Self {
        let cameras: Vec<(CameraIndex, &CameraModel)> = (0..)
            .map(CameraIndex)
            .zip(&venue.cameras)
            .filter(|(_, camera): &(_, &VenueCamera)| camera.source.gives_pictures())
            .map(|(index, camera)| (index, &camera.model))
            .collect();
        let models: Vec<&CameraModel> = cameras.iter().map(|(_, model)| *model).collect();
        let births = &venue.parameters.births;
        let plans = tiles::plan(
            &models,
            &venue.field,
            detector.input(),
            births.tiles_per_look as usize,
        );
        Self {
            detector,
            plans: cameras.iter().map(|(index, _)| *index).zip(plans).collect(),
        }
    }

    /// The people in a picture of `camera`, highest score first. Detection pass `number` covers one
    /// cell of the field, the next pass the next cell.
    ///
    /// # Errors
    /// [`NetworkError`] if the detector fails.
    pub(super) fn detect_in(
        &mut self,
        picture: &Picture,
        camera: CameraIndex,
        number: i64,
    ) -> Result<Vec<Detection>, NetworkError> {
        let Some((_, plan)) = self.plans.iter().find(|(index, _)| *index == camera) else {
            return Ok(Vec::new());
        };
        let found = plan
            .windows(number)
            .map(|window| Ok((window, self.detector.detect(picture, &window)?)))
            .collect::<Result<Vec<_>, NetworkError>>()?;
        Ok(tiles::merged(
            &found,
            self.detector.input().size_px,
            picture.size_px(),
        ))
    }
}
