//! The detector of an edge and where in its pictures it looks.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::CameraIndex;
use farfield_proto::venue::{Venue, VenueCamera};
use image::RgbImage;

use crate::inference::{Detection, NetworkError, PersonDetector};
use crate::tiles::{self, TilePlan};

/// Looks for people in the pictures of a venue.
pub(super) struct TiledDetector {
    detector: Box<dyn PersonDetector>,
    /// Of every camera of the venue that gives pictures.
    plans: Vec<(CameraIndex, TilePlan)>,
}

impl TiledDetector {
    /// Plans where to look in the pictures of all cameras.
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

    /// Who is in a picture of `camera`, the surest first; the cells of the field take turns by the `number`
    /// of the look.
    ///
    /// # Errors
    /// [`NetworkError`] when the detector fails.
    pub(super) fn detect_in(
        &mut self,
        image: &RgbImage,
        camera: CameraIndex,
        number: i64,
    ) -> Result<Vec<Detection>, NetworkError> {
        let Some((_, plan)) = self.plans.iter().find(|(index, _)| *index == camera) else {
            return Ok(Vec::new());
        };
        let found = plan
            .windows(number)
            .map(|window| Ok((window, self.detector.detect(image, &window)?)))
            .collect::<Result<Vec<_>, NetworkError>>()?;
        let picture_px = [image.width(), image.height()];
        Ok(tiles::merged(
            &found,
            self.detector.input().size_px,
            picture_px,
        ))
    }
}
