//! Maps that a simulator paints for each crop: simulated cameras without pixels.

use std::fmt::Debug;

use farfield_proto::camera::CameraModel;
use farfield_proto::grid::CellGrid;
use farfield_proto::message::CameraBox;
use farfield_proto::patch::Maps;

use super::KeypointCandidate;

/// A crop for which maps are painted.
#[derive(Debug, Clone, Copy)]
pub struct MapCrop<'a> {
    /// The person's box at the frame's tick.
    pub region: &'a CameraBox,
    /// Positions of the cells, in undistorted pixels of `camera`.
    pub grid: &'a CellGrid,
    /// Requested sigma, cells.
    pub sigma_cells: f64,
    /// The camera.
    pub camera: &'a CameraModel,
    /// Cells below this value (0 to 255) are dropped after painting, so the painter can skip them.
    pub floor: u8,
}

/// What one camera saw at one tick, as the maps that a network would return.
///
/// The maps are those of the keypoints of [`farfield_proto::keypoints::COCO17`]. Equal crops give
/// equal maps, independent of earlier calls.
pub trait MapPainter: Debug + Send + Sync {
    /// Paints the 17 maps of `crop` into `into`, which has the grid's size and contains only zeros.
    fn paint(&self, crop: &MapCrop<'_>, into: &mut Maps);

    /// For the camera's health: a hash of the picture and its mean brightness, 0 to 255; `None`
    /// without a picture.
    fn picture_sample(&self) -> Option<(u64, f64)> {
        None
    }

    /// The people that a detector returns for the whole picture: `[person][keypoint]`, 17 each,
    /// `None` for a missing keypoint.
    fn persons(&self) -> Vec<Vec<Option<KeypointCandidate>>>;
}
