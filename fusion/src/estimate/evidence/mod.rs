//! One view of one person at one tick: the decoded maps, and what they can and cannot say.
//!
//! Outside a crop, and where a crop reaches past the image, there is no information. That is not a
//! probability of zero: [`View::knows`] says so, and the lattice asks a view only about
//! keypoints that are predicted where the view knows something. This module never judges a map; it
//! knows where its cells lie.

mod edit;
mod seen_cells;

use farfield_proto::camera::CameraModel;
use farfield_proto::grid::CellGrid;
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::message::PersonPatch;
use farfield_proto::model_card::PEAK_SIGMA_OF_WIDTH;
use farfield_proto::patch::{Decoder, Maps, PatchError};
use nalgebra::{Matrix3, Matrix3x4, Vector2, Vector3};

pub(crate) use self::edit::Notch;
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
    #[error("keypoint {keypoint} lies on no crop")]
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
}

/// One person in one camera at one tick, decoded. Reused from tick to tick: [`View::fill`]
/// allocates only when maps grow.
#[derive(Debug, Clone)]
pub struct View {
    /// Who sent it.
    pub viewpoint: ViewpointIndex,
    /// The camera that the edge chose.
    pub camera: CameraIndex,
    /// Capture instant less the tick's time, seconds.
    pub capture_offset_s: f64,
    /// Per keypoint: where it is predicted at the capture instant, world, metres. For the caller to
    /// set; NaN (as after a fill) means no prediction, and the view does not take part.
    pub predicted_m: Vec<Vector3<f64>>,
    /// Per keypoint: the occlusion weight w of eq. (9), 0 to 1. For the caller to set; 1 after a fill.
    pub occlusion: Vec<f64>,
    /// Sigma of a peak as a share of the width of the maps. For the caller to set; a fill leaves it.
    pub peak_sigma_of_width: f64,
    maps: Maps,
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
            predicted_m: Vec::new(),
            occlusion: Vec::new(),
            peak_sigma_of_width: PEAK_SIGMA_OF_WIDTH,
            maps: Maps::new(1, 1, 0),
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
    /// [`EvidenceError`]; the view is then not to be used until it is filled again.
    pub fn fill(
        &mut self,
        decoder: &mut Decoder,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        model: &CameraModel,
    ) -> Result<(), EvidenceError> {
        decoder.decode(&patch.maps, &mut self.maps)?;
        self.place(patch, viewpoint, model)
    }

    /// A view of maps that are already decoded; `patch.maps` is not looked at.
    ///
    /// # Errors
    /// As [`View::fill`], but for decoding.
    pub fn from_maps(
        maps: Maps,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        model: &CameraModel,
    ) -> Result<Self, EvidenceError> {
        let mut view = Self {
            maps,
            ..Self::default()
        };
        view.place(patch, viewpoint, model)?;
        Ok(view)
    }

    /// Lays the maps over the camera's image.
    fn place(
        &mut self,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        model: &CameraModel,
    ) -> Result<(), EvidenceError> {
        let (width, height, keypoints) =
            (self.maps.width(), self.maps.height(), self.maps.keypoints());
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
        self.predicted_m.clear();
        self.predicted_m
            .resize(keypoints, Vector3::repeat(f64::NAN));
        self.occlusion.clear();
        self.occlusion.resize(keypoints, 1.0);
        self.n_crops = patch.crops.len();
        for (index, &grid) in patch.crops.iter().enumerate() {
            if index == self.crops.len() {
                self.crops.push(Crop {
                    grid,
                    seen: SeenCells::default(),
                });
            }
            let crop = &mut self.crops[index];
            crop.grid = grid;
            crop.seen.look_through(&grid, model);
        }
        for (keypoint, &crop) in self.crop_of_keypoint.iter().enumerate() {
            let seen = &self.crops[usize::from(crop)].seen;
            seen.extend(self.maps.cells_mut(keypoint));
        }
        Ok(())
    }

    /// How many keypoints the maps have.
    pub fn n_keypoints(&self) -> usize {
        self.crop_of_keypoint.len()
    }

    /// Columns and rows of the maps.
    pub fn map_size(&self) -> (usize, usize) {
        (self.maps.width(), self.maps.height())
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

    /// The grid that the map of `keypoint` lies on.
    ///
    /// # Panics
    /// When the view has no such keypoint.
    pub fn grid(&self, keypoint: usize) -> &CellGrid {
        &self.crop(keypoint).grid
    }

    /// The map of `keypoint`, row by row, value = cell/255. Cells that the camera does not see hold
    /// the value of the nearest cell that it sees.
    ///
    /// # Panics
    /// When the view has no such keypoint.
    pub fn cells(&self, keypoint: usize) -> &[u8] {
        self.maps.cells(keypoint)
    }

    /// World metres to homogeneous cells of the map of `keypoint`; the third row is the depth in
    /// metres.
    ///
    /// # Panics
    /// When the view has no such keypoint.
    pub fn cell_from_world(&self, keypoint: usize) -> Matrix3x4<f64> {
        let grid = self.grid(keypoint);
        let (sx, sy) = (f64::from(grid.step_px[0]), f64::from(grid.step_px[1]));
        let (ox, oy) = (f64::from(grid.origin_px[0]), f64::from(grid.origin_px[1]));
        let norm = sx * sx + sy * sy;
        let (c, s) = (sx / norm, sy / norm);
        let cell_from_pixel = Matrix3::new(
            c,
            s,
            -(c * ox + s * oy), //
            -s,
            c,
            s * ox - c * oy, //
            0.0,
            0.0,
            1.0,
        );
        cell_from_pixel * self.pixel_from_world
    }

    /// Whether the view knows anything about `keypoint` at this cell of its map.
    pub fn knows(&self, keypoint: usize, cell: Vector2<f64>) -> bool {
        let (width, height) = self.map_size();
        let inside = |x: f64, n: usize| (-0.5..n as f64 - 0.5).contains(&x);
        if keypoint >= self.n_keypoints() || !inside(cell.x, width) || !inside(cell.y, height) {
            return false;
        }
        let (column, row) = (
            cell.x.round().max(0.0) as usize,
            cell.y.round().max(0.0) as usize,
        );
        let (column, row) = (column.min(width - 1), row.min(height - 1));
        self.crop(keypoint).seen.knows(column, row)
    }

    /// Raises the cells of one map to `value(x, y)`; where that is negative, clears them.
    #[cfg(test)]
    pub(crate) fn draw_for_test(&mut self, keypoint: usize, value: impl Fn(f64, f64) -> f64) {
        let width = self.maps.width();
        for (i, cell) in self.maps.cells_mut(keypoint).iter_mut().enumerate() {
            let new = value((i % width) as f64, (i / width) as f64);
            *cell = if new < 0.0 {
                0
            } else {
                (*cell).max((new * 255.0).round() as u8)
            };
        }
    }

    fn crop(&self, keypoint: usize) -> &Crop {
        &self.crops[usize::from(self.crop_of_keypoint[keypoint])]
    }
}

/// A map (rows of `size.0` cells) at a fractional cell, clamped to its border, 0 to 1.
pub(crate) fn bilinear(cells: &[u8], size: (usize, usize), cell: Vector2<f64>) -> f64 {
    let (width, height) = size;
    let x = cell.x.max(0.0).min((width - 1) as f64);
    let y = cell.y.max(0.0).min((height - 1) as f64);
    // Plain casts round towards zero, and x and y are not negative.
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let (fx, fy) = (x - x0 as f64, y - y0 as f64);
    let at = |x: usize, y: usize| f64::from(cells[y * width + x]);
    let upper = at(x0, y0) + fx * (at(x1, y0) - at(x0, y0));
    let lower = at(x0, y1) + fx * (at(x1, y1) - at(x0, y1));
    (upper + fy * (lower - upper)) * (1.0 / 255.0)
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Distortion, Intrinsics};
    use farfield_proto::frames::{Pixel, Transform, Undistorted};
    use farfield_proto::id::PersonId;
    use farfield_proto::patch::EncodedMaps;
    use farfield_proto::tick::Tick;
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    use super::*;

    const WIDTH: u16 = 12;
    const HEIGHT: u16 = 16;

    /// A camera of 200 x 100 pixels at the world's origin, looking along +z.
    fn model() -> CameraModel {
        let intrinsics = Intrinsics {
            fx_px: 100.0,
            fy_px: 100.0,
            cx_px: 99.5,
            cy_px: 49.5,
        };
        CameraModel::new(
            "test",
            [200, 100],
            intrinsics,
            Distortion::default(),
            Transform::new(Isometry3::identity()),
        )
        .unwrap()
    }

    fn patch(origin_px: [f32; 2], step_px: [f32; 2]) -> PersonPatch {
        PersonPatch {
            person: PersonId(1),
            camera: CameraIndex(3),
            box_tick: Tick(0),
            capture_offset_us: -2500,
            crops: vec![CellGrid {
                origin_px,
                step_px,
                width: WIDTH,
                height: HEIGHT,
            }],
            crop_of_keypoint: vec![0; 2],
            maps: EncodedMaps {
                width: WIDTH,
                height: HEIGHT,
                keypoints: 2,
                bytes: Vec::new(),
            },
        }
    }

    fn maps() -> Maps {
        let mut maps = Maps::new(usize::from(WIDTH), usize::from(HEIGHT), 2);
        for (i, cell) in maps.cells_mut(1).iter_mut().enumerate() {
            *cell = (i % 12 * 10 + i / 12 * 4) as u8;
        }
        maps
    }

    fn view(patch: &PersonPatch) -> Result<View, EvidenceError> {
        View::from_maps(maps(), patch, ViewpointIndex(2), &model())
    }

    /// The map at a pixel, 0 to 1; `None` where the view knows nothing.
    fn sample(view: &View, keypoint: usize, pixel: Pixel<Undistorted>) -> Option<f64> {
        let cell = view.grid(0).cell(pixel);
        view.knows(keypoint, cell)
            .then(|| bilinear(view.cells(keypoint), view.map_size(), cell))
    }

    proptest! {
        #[test]
        fn between_cells_a_plane_is_read_as_a_plane(x in 0.0f64..11.0, y in 0.0f64..15.0, angle in -3.0f32..3.0) {
            let patch = patch([100.0, 50.0], [1.5 * angle.cos(), 1.5 * angle.sin()]);
            let view = view(&patch).unwrap();
            let pixel = patch.crops[0].pixel(x, y);
            let value = sample(&view, 1, pixel).unwrap();
            // Grids travel in single precision.
            prop_assert!((value * 255.0 - (x * 10.0 + y * 4.0)).abs() < 0.01);
        }

        #[test]
        fn world_to_cells_is_projection_and_then_the_grid(
            p in prop::array::uniform3(-1.0f64..1.0), angle in -3.0f32..3.0,
        ) {
            let p_m = Vector3::new(p[0], p[1], p[2] + 3.0);
            let patch = patch([80.0, 40.0], [0.7 * angle.cos(), 0.7 * angle.sin()]);
            let h = view(&patch).unwrap().cell_from_world(0) * p_m.push(1.0);
            let pixel = Pixel::new(p_m.x / p_m.z * 100.0 + 99.5, p_m.y / p_m.z * 100.0 + 49.5);
            prop_assert!((Vector2::new(h.x, h.y) / h.z - patch.crops[0].cell(pixel)).norm() < 1e-9);
            prop_assert!((h.z - p_m.z).abs() < 1e-12);
        }

        #[test]
        fn no_cell_that_the_camera_does_not_see_counts_as_known(
            origin in prop::array::uniform2(-60.0f32..220.0), angle in -3.0f32..3.0, step in 0.5f32..8.0,
        ) {
            let patch = patch(origin, [step * angle.cos(), step * angle.sin()]);
            let (view, model) = (view(&patch).unwrap(), model());
            for i in 0..usize::from(WIDTH) * usize::from(HEIGHT) {
                let (x, y) = ((i % 12) as f64, (i / 12) as f64);
                let known = view.knows(0, Vector2::new(x, y));
                // A corner of the image that pokes in between asked cells is not noticed: one
                // asking step of slack.
                let near_image = (-4..=4).any(|dx| (-4..=4).any(|dy| {
                    model.sees(patch.crops[0].pixel(x + f64::from(dx), y + f64::from(dy)))
                }));
                prop_assert!(!known || near_image);
            }
        }
    }

    #[test]
    fn outside_the_crop_nothing_is_known_and_that_is_not_zero() {
        let patch = patch([100.0, 50.0], [1.0, 0.0]);
        let view = view(&patch).unwrap();
        assert_eq!(sample(&view, 0, Pixel::new(100.0, 50.0)), Some(0.0));
        assert_eq!(sample(&view, 0, Pixel::new(99.4, 50.0)), None);
        assert_eq!(sample(&view, 0, Pixel::new(100.0, 65.6)), None);
        assert_eq!(
            sample(&view, 2, Pixel::new(100.0, 50.0)),
            None,
            "no such keypoint"
        );
    }

    #[test]
    fn beyond_the_image_a_crop_knows_nothing_and_maps_go_on_with_their_last_value() {
        // Columns 6 to 11 lie right of the image's edge at 199.5.
        let patch = patch([194.0, 20.0], [1.0, 0.0]);
        let view = view(&patch).unwrap();
        assert!(sample(&view, 1, Pixel::new(196.0, 25.0)).is_some());
        assert_eq!(sample(&view, 1, Pixel::new(203.0, 25.0)), None);
        let row = &view.cells(1)[5 * 12..6 * 12];
        let last_known = (0..12)
            .rev()
            .find(|&x| view.knows(1, Vector2::new(f64::from(x), 5.0)))
            .unwrap() as usize;
        assert!(
            row[last_known..]
                .iter()
                .all(|&cell| cell == row[last_known]),
            "{row:?}"
        );
    }

    #[test]
    fn a_view_takes_over_who_and_when_and_forgets_the_last_tick() {
        let view = view(&patch([100.0, 50.0], [1.0, 0.0])).unwrap();
        assert_eq!(
            (view.viewpoint, view.camera, view.n_keypoints()),
            (ViewpointIndex(2), CameraIndex(3), 2)
        );
        assert!((view.capture_offset_s + 0.0025).abs() < 1e-12);
        assert!(view.predicted_m.iter().all(|p| p.x.is_nan()) && view.predicted_m.len() == 2);
        assert!(view.occlusion.iter().all(|&w| w >= 1.0) && view.occlusion.len() == 2);
    }

    #[test]
    fn grids_and_crops_that_do_not_fit_are_refused() {
        let mut wrong = patch([100.0, 50.0], [1.0, 0.0]);
        wrong.crops[0].width = 13;
        assert_eq!(
            view(&wrong).unwrap_err(),
            EvidenceError::Grid {
                crop: 0,
                width: 12,
                height: 16
            }
        );
        let mut wrong = patch([f32::NAN, 50.0], [1.0, 0.0]);
        assert!(matches!(view(&wrong), Err(EvidenceError::Grid { .. })));
        wrong = patch([100.0, 50.0], [1.0, 0.0]);
        wrong.crop_of_keypoint = vec![0, 1];
        assert_eq!(
            view(&wrong).unwrap_err(),
            EvidenceError::NoCrop { keypoint: 1 }
        );
        wrong.crop_of_keypoint = vec![0];
        assert_eq!(
            view(&wrong).unwrap_err(),
            EvidenceError::NoCrop { keypoint: 1 }
        );
    }
}
