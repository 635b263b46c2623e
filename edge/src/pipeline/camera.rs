//! The cameras of a viewpoint, and the checks before the first tick and at each tick.

use std::fmt;

use farfield_proto::camera::CameraModel;
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::patch::{MAX_KEYPOINTS, MAX_SIDE};
use farfield_proto::venue::Venue;

use super::batch::Batch;
use super::error::PipelineError;
use crate::crop::CropShape;
use crate::source::FrameContent;

/// How to draw the maps of a camera without pictures.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drawing {
    pub(super) shape: CropShape,
    pub(super) sigma_cells: f64,
}

/// One camera of the viewpoint.
#[derive(Clone)]
pub(super) struct EdgeCamera {
    pub(super) index: CameraIndex,
    pub(super) model: CameraModel,
    pub(super) drawing: Option<Drawing>,
    /// Content with people that was not used.
    pub(super) beyond_view: BeyondView,
}

impl EdgeCamera {
    /// The mismatch of a frame with this camera, if any.
    pub(super) fn mismatch(&self, content: &FrameContent, n_keypoints: usize) -> Option<String> {
        match (content, self.drawing.is_some()) {
            (FrameContent::Image(picture), false) => {
                let (got, expected) = (picture.size_px(), self.model.size_px());
                (got != expected).then(|| {
                    let ([w, h], [calibrated_w, calibrated_h]) = (got, expected);
                    format!("its frame is {w} x {h} pixels, its calibration {calibrated_w} x {calibrated_h}")
                })
            }
            (FrameContent::Keypoints(keypoints), true) => {
                let of_persons = keypoints.persons.iter().map(Vec::len);
                let wrong = of_persons
                    .chain([keypoints.peaks.len()])
                    .find(|&n| n != n_keypoints);
                wrong.map(|n| format!("its frame has {n} keypoints, expected {n_keypoints}"))
            }
            (FrameContent::Painted(_), true) => None,
            (FrameContent::Painted(_), false) => {
                Some("maps came from a source of pictures".to_owned())
            }
            (FrameContent::Image(_), true) => {
                Some("a picture came from a source of keypoints".to_owned())
            }
            (FrameContent::Keypoints(_), false) => {
                Some("keypoints came from a source of pictures".to_owned())
            }
        }
    }
}

/// The cameras of a viewpoint, in the venue's order.
pub(super) fn cameras_of(
    venue: &Venue,
    viewpoint: ViewpointIndex,
) -> Result<Vec<EdgeCamera>, PipelineError> {
    let unknown = || PipelineError::UnknownViewpoint { index: viewpoint };
    let viewpoint = venue
        .viewpoints
        .get(usize::from(viewpoint.0))
        .ok_or_else(unknown)?;
    let camera = |&index: &CameraIndex| {
        let camera = venue.camera(index).ok_or_else(unknown)?;
        let drawing = camera.source.drawing().map(|(grid, sigma_cells)| Drawing {
            shape: CropShape::of_grid(grid),
            sigma_cells,
        });
        Ok(EdgeCamera {
            index,
            model: camera.model.clone(),
            drawing,
            beyond_view: BeyondView::default(),
        })
    };
    viewpoint.cameras.iter().map(camera).collect()
}

/// Refuses venues that cannot be sent or processed: maps that are too large, pictures without a
/// network, keypoints of two kinds.
pub(super) fn check_shapes(
    venue: &Venue,
    cameras: &[EdgeCamera],
    keypoints: &KeypointSet,
    batch: Option<&Batch>,
) -> Result<(), PipelineError> {
    let fits = |what, got: usize, limit: usize| {
        if got > limit {
            Err(PipelineError::TooLarge { what, got, limit })
        } else {
            Ok(())
        }
    };
    fits(
        "the network's number of keypoints",
        keypoints.len(),
        MAX_KEYPOINTS,
    )?;
    for side in batch.iter().flat_map(|b| b.shape().cells) {
        fits("a side of the network's maps", side.into(), MAX_SIDE)?;
    }
    for camera in cameras {
        let name = || camera.model.name().to_owned();
        match &camera.drawing {
            None if batch.is_none() => return Err(PipelineError::NoNetwork { camera: name() }),
            Some(_) if *keypoints != venue.keypoints => {
                return Err(PipelineError::OtherKeypoints { camera: name() });
            }
            Some(drawing) => {
                for side in drawing.shape.cells {
                    fits("a side of a source's `grid`", side.into(), MAX_SIDE)?;
                }
            }
            None => {}
        }
    }
    Ok(())
}

/// Content left out since the start, because it was beyond the used part of a camera's view
/// ([`farfield_proto::camera::FISHEYE_HALF_VIEW_RAD`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BeyondView {
    /// Detections completely outside the used view.
    pub detections: u64,
    /// Keypoints of detected people.
    pub keypoints: u64,
}

impl BeyondView {
    /// Whether nothing was left out.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for BeyondView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} detections and {} keypoints beyond 120 degrees of view (60 off its axis) were left out",
            self.detections, self.keypoints,
        )
    }
}
