//! Maps painted by a simulator for each crop: cameras of a simulated venue without pixels.

use std::fmt::Debug;

use farfield_proto::camera::CameraModel;
use farfield_proto::grid::CellGrid;
use farfield_proto::message::CameraBox;
use farfield_proto::patch::Maps;

use super::KeypointCandidate;

/// A crop whose maps are asked for.
#[derive(Debug, Clone, Copy)]
pub struct MapCrop<'a> {
    /// The box of the person whose crop it is, at the frame's tick.
    pub region: &'a CameraBox,
    /// Where the cells lie, in undistorted pixels of `camera`.
    pub grid: &'a CellGrid,
    /// Sigma that the source asks for, cells.
    pub sigma_cells: f64,
    /// The camera.
    pub camera: &'a CameraModel,
    /// Cells below this value (0 to 255) are dropped after painting, so the painter may leave them out.
    pub floor: u8,
}

/// What one camera saw at one tick, as the maps that a network would have made of it.
///
/// In the keypoints of [`farfield_proto::keypoints::COCO17`]. The same crop gives the same maps,
/// whatever was painted before.
pub trait MapPainter: Debug + Send + Sync {
    /// Paints the 17 maps of `crop` into `into`, which has the grid's size and is 0 everywhere.
    fn paint(&self, crop: &MapCrop<'_>, into: &mut Maps);

    /// For the camera's health: a hash that repeats only when the picture does, and the picture's mean brightness, 0 to
    /// 255; `None` where there is none.
    fn picture_sample(&self) -> Option<(u64, f64)> {
        None
    }

    /// The people that a detector finds in the whole picture: `[person][keypoint]`, 17 each, `None`
    /// where one was not found.
    fn persons(&self) -> Vec<Vec<Option<KeypointCandidate>>>;
}
