//! One view of one person at one tick: the decoded maps, and where they have data.
//!
//! Outside a crop, and where a crop exceeds the image, there is no information. That is not a
//! probability of zero: [`View::knows`] reports it, and the lattice uses a view only for keypoints
//! that are predicted where the view has data. This module does not judge maps; it locates their
//! cells.

mod edit;
mod expected;
mod map_peaks;
mod packed_maps;
mod seen_cells;
#[cfg(test)]
mod tests;

use farfield_proto::camera::CameraModel;
use farfield_proto::grid::CellGrid;
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::message::PersonPatch;
use farfield_proto::model_card::PEAK_SIGMA_OF_WIDTH;
use farfield_proto::patch::{Decoder, Maps, PatchError};
use nalgebra::{Matrix3, Matrix3x4, Vector2, Vector3};

pub(crate) use self::edit::Notch;
pub(crate) use self::expected::ExpectedKeypoint;
pub(crate) use self::map_peaks::{MapPeak, MapPeaks};
pub(crate) use self::packed_maps::PackedMap;
use self::packed_maps::PackedMaps;
#[cfg(test)]
pub(crate) use self::packed_maps::packed;
use self::seen_cells::SeenCells;

/// Why a patch is no evidence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EvidenceError {
    /// The maps cannot be decoded.
    #[error("maps: {0}")]
    Maps(#[from] PatchError),
    /// A grid is not finite or does not have the maps' size.
    #[error("crop {crop} does not fit maps of {width} x {height} cells")]
    Grid {
        /// Which crop.
        crop: usize,
        /// Columns of the maps.
        width: usize,
        /// Rows of the maps.
        height: usize,
    },
    /// A keypoint without a crop.
    #[error("keypoint {keypoint} has no crop")]
    NoCrop {
        /// Which keypoint.
        keypoint: usize,
    },
}

/// A crop of the view, and which of its cells the camera sees.
#[derive(Debug, Clone)]
struct Crop {
    grid: CellGrid,
    seen: SeenCells,
    /// World metres to homogeneous cells.
    cell_from_world: Matrix3x4<f64>,
}

/// Decodes patches, with reused buffers.
#[derive(Debug, Clone, Default)]
pub struct PatchReader {
    decoder: Decoder,
    maps: Maps,
}

/// One decoded view of one person in one camera at one tick. Reused from tick to tick:
/// [`View::fill`] allocates only if the written part of the maps grows.
#[derive(Debug, Clone)]
pub struct View {
    /// The sender.
    pub viewpoint: ViewpointIndex,
    /// The camera that the edge chose.
    pub camera: CameraIndex,
    /// Capture instant minus the tick's time, seconds.
    pub capture_offset_s: f64,
    /// Per keypoint: the occlusion weight w of eq. (9), 0 to 1. Set by the caller; 1 after a fill.
    pub occlusion: Vec<f64>,
    /// Sigma of a peak as a share of the width of the maps. Set by the caller; a fill does not
    /// change it.
    pub peak_sigma_of_width: f64,
    maps: PackedMaps,
    /// Per keypoint: where it is expected; `None` (as after a fill) if unknown, or without data
    /// there.
    expected: Vec<Option<ExpectedKeypoint>>,
    /// Per keypoint: the peaks of its map around that place.
    peaks: Vec<MapPeaks>,
    crops: Vec<Crop>,
    n_crops: usize,
    crop_of_keypoint: Vec<u8>,
    pixel_from_world: Matrix3x4<f64>,
    center_m: Vector3<f64>,
}

impl Default for View {
    fn default() -> Self {
        Self {
            viewpoint: ViewpointIndex(0),
            camera: CameraIndex(0),
            capture_offset_s: 0.0,
            occlusion: Vec::new(),
            peak_sigma_of_width: PEAK_SIGMA_OF_WIDTH,
            maps: PackedMaps::default(),
            expected: Vec::new(),
            peaks: Vec::new(),
            crops: Vec::new(),
            n_crops: 0,
            crop_of_keypoint: Vec::new(),
            pixel_from_world: Matrix3x4::zeros(),
            center_m: Vector3::zeros(),
        }
    }
}

impl View {
    /// Decodes `patch`, which `viewpoint` made with the camera `model`, into this view.
    ///
    /// # Errors
    /// [`EvidenceError`]; the view must not be used until it is filled again.
    pub fn fill(
        &mut self,
        reader: &mut PatchReader,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        model: &CameraModel,
    ) -> Result<(), EvidenceError> {
        let PatchReader { decoder, maps } = reader;
        decoder.decode(&patch.maps, maps)?;
        self.place(maps, patch, viewpoint, model)
    }

    /// A view of maps that are already decoded; `patch.maps` is not used.
    ///
    /// # Errors
    /// As [`View::fill`], except for decoding.
    pub fn from_maps(
        mut maps: Maps,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        model: &CameraModel,
    ) -> Result<Self, EvidenceError> {
        let mut view = Self::default();
        view.place(&mut maps, patch, viewpoint, model)?;
        Ok(view)
    }

    /// Positions the maps in the camera's image.
    fn place(
        &mut self,
        maps: &mut Maps,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        model: &CameraModel,
    ) -> Result<(), EvidenceError> {
        let (width, height, keypoints) = (maps.width(), maps.height(), maps.keypoints());
        for (crop, grid) in patch.crops.iter().enumerate() {
            if !grid.is_valid()
                || usize::from(grid.width) != width
                || usize::from(grid.height) != height
            {
                return Err(EvidenceError::Grid {
                    crop,
                    width,
                    height,
                });
            }
        }
        let crop_of = |k: usize| {
            patch
                .crop_of_keypoint
                .get(k)
                .map_or(usize::MAX, |&c| usize::from(c))
        };
        if let Some(keypoint) = (0..keypoints).find(|&k| crop_of(k) >= patch.crops.len()) {
            return Err(EvidenceError::NoCrop { keypoint });
        }
        self.viewpoint = viewpoint;
        self.camera = patch.camera;
        self.capture_offset_s = f64::from(patch.capture_offset_us) * 1e-6;
        self.pixel_from_world = model.projection_matrix();
        self.center_m = model.center().coordinates_m().coords;
        self.crop_of_keypoint.clear();
        self.crop_of_keypoint
            .extend_from_slice(&patch.crop_of_keypoint[..keypoints]);
        self.expected.clear();
        self.expected.resize(keypoints, None);
        self.peaks.clear();
        self.peaks.resize(keypoints, MapPeaks::default());
        self.occlusion.clear();
        self.occlusion.resize(keypoints, 1.0);
        self.n_crops = patch.crops.len();
        for (index, &grid) in patch.crops.iter().enumerate() {
            if index == self.crops.len() {
                self.crops.push(Crop {
                    grid,
                    seen: SeenCells::default(),
                    cell_from_world: Matrix3x4::zeros(),
                });
            }
            let crop = &mut self.crops[index];
            crop.grid = grid;
            crop.cell_from_world = cell_from_pixel(&grid) * self.pixel_from_world;
            crop.seen.find_seen(&grid, model);
        }
        for (keypoint, &crop) in self.crop_of_keypoint.iter().enumerate() {
            let seen = &self.crops[usize::from(crop)].seen;
            if !seen.stands_for_itself(maps.written(keypoint)) {
                seen.extend(maps.cells_mut(keypoint));
            }
        }
        self.maps.pack(maps);
        Ok(())
    }

    /// How many keypoints the maps have.
    pub fn n_keypoints(&self) -> usize {
        self.crop_of_keypoint.len()
    }

    /// Columns and rows of the maps.
    pub fn map_size(&self) -> (usize, usize) {
        self.maps.size()
    }

    /// World metres to homogeneous undistorted pixels of the camera, eq. (A.1).
    pub fn pixel_from_world(&self) -> &Matrix3x4<f64> {
        &self.pixel_from_world
    }

    /// The camera's centre, world, metres.
    pub fn center_m(&self) -> Vector3<f64> {
        self.center_m
    }

    /// The grids of the view's crops.
    pub fn crops(&self) -> impl Iterator<Item = &CellGrid> {
        self.crops[..self.n_crops].iter().map(|crop| &crop.grid)
    }

    /// The grid of the map of `keypoint`.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub fn grid(&self, keypoint: usize) -> &CellGrid {
        &self.crop(keypoint).grid
    }

    /// The map of `keypoint`, value = cell/255. Cells that the camera does not see have the value
    /// of the nearest seen cell.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub(crate) fn map(&self, keypoint: usize) -> PackedMap<'_> {
        self.maps.map(keypoint)
    }

    /// World metres to homogeneous cells of the map of `keypoint`; the third row is the depth in
    /// metres.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub fn cell_from_world(&self, keypoint: usize) -> &Matrix3x4<f64> {
        &self.crop(keypoint).cell_from_world
    }

    /// Whether the view has data about `keypoint` at this cell of its map.
    pub fn knows(&self, keypoint: usize, cell: Vector2<f64>) -> bool {
        let (width, height) = self.map_size();
        let inside = |x: f64, n: usize| (-0.5..n as f64 - 0.5).contains(&x);
        if keypoint >= self.n_keypoints() || !inside(cell.x, width) || !inside(cell.y, height) {
            return false;
        }
        // Inside the map both are at least -0.5, and a cast is cheap, unlike `round`.
        let (column, row) = ((cell.x + 0.5) as usize, (cell.y + 0.5) as usize);
        let (column, row) = (column.min(width - 1), row.min(height - 1));
        self.crop(keypoint).seen.knows(column, row)
    }

    /// Raises the cells of one map to `value(x, y)`; clears them if that is negative.
    #[cfg(test)]
    pub(crate) fn draw_for_test(&mut self, keypoint: usize, value: impl Fn(f64, f64) -> f64) {
        self.peaks[keypoint] = MapPeaks::default();
        let (width, mut cells) = (self.map_size().0, self.cells_for_test(keypoint));
        for (i, cell) in cells.iter_mut().enumerate() {
            let new = value((i % width) as f64, (i / width) as f64);
            *cell = if new < 0.0 {
                0
            } else {
                (*cell).max((new * 255.0).round() as u8)
            };
        }
        self.maps.replace_for_test(keypoint, &cells);
    }

    /// The map of `keypoint`, row by row.
    #[cfg(test)]
    pub(crate) fn cells_for_test(&self, keypoint: usize) -> Vec<u8> {
        let mut cells = Vec::new();
        self.map(keypoint).write_unpacked(&mut cells);
        cells
    }

    fn crop(&self, keypoint: usize) -> &Crop {
        &self.crops[usize::from(self.crop_of_keypoint[keypoint])]
    }
}

/// Undistorted pixels to cells of a grid, homogeneous.
fn cell_from_pixel(grid: &CellGrid) -> Matrix3<f64> {
    let (sx, sy) = (f64::from(grid.step_px[0]), f64::from(grid.step_px[1]));
    let (ox, oy) = (f64::from(grid.origin_px[0]), f64::from(grid.origin_px[1]));
    let norm = sx * sx + sy * sy;
    let (c, s) = (sx / norm, sy / norm);
    Matrix3::new(
        c,
        s,
        -(c * ox + s * oy), //
        -s,
        c,
        s * ox - c * oy, //
        0.0,
        0.0,
        1.0,
    )
}
