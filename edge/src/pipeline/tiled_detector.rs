//! The detector, run over the windows of a picture in the tile plan.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::CameraIndex;
use farfield_proto::venue::{Venue, VenueCamera};

use crate::inference::{Detection, NetworkError, PersonDetector};
use crate::picture::Picture;
use crate::tiles::{self, TilePlan};

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
