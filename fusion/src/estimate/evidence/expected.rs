//! Where a view expects a keypoint: the start of the search, of peak assignment and of swap
//! detection.

use farfield_proto::frames::{Pixel, Undistorted};
use nalgebra::{Matrix3x4, Vector2, Vector3};

use super::{MapPeaks, View};
use crate::estimate::occlusion::SightCone;

/// Where a view expects a keypoint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExpectedKeypoint {
    /// World, metres, at the view's capture instant.
    pub(crate) position_m: Vector3<f64>,
    /// The homogeneous cell of its map; the third number is the depth in metres.
    pub(crate) homogeneous_cell: Vector3<f64>,
    pub(crate) cell: Vector2<f64>,
    /// Metres per cell there, mean of both axes.
    pub(crate) cell_m: f64,
}

impl ExpectedKeypoint {
    /// Depth in front of the camera, metres: positive.
    pub(crate) fn depth_m(&self) -> f64 {
        self.homogeneous_cell.z
    }
}

impl View {
    /// Sets where `keypoint` is expected at the capture instant, world, metres. If the place is not
    /// finite, or the view has no data there, the view takes no part in this keypoint.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub fn expect(&mut self, keypoint: usize, position_m: Vector3<f64>) {
        self.expected[keypoint] = self.expected_at(keypoint, position_m);
        self.forget_peaks(keypoint);
    }

    /// Where `keypoint` is expected; `None` if unknown, or if the view has no data there.
    pub(crate) fn expected(&self, keypoint: usize) -> Option<&ExpectedKeypoint> {
        self.expected.get(keypoint)?.as_ref()
    }

    /// Maps an offset from the `expected` place of `keypoint` (metres, homogeneous) to homogeneous
    /// cells of its map; the third row is the depth in metres.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub(crate) fn cell_from_offset(
        &self,
        keypoint: usize,
        expected: &ExpectedKeypoint,
    ) -> Matrix3x4<f64> {
        let mut cell_from_offset = *self.cell_from_world(keypoint);
        cell_from_offset.set_column(3, &expected.homogeneous_cell);
        cell_from_offset
    }

    /// The cone around all expected places of keypoints.
    pub(crate) fn sight(&self) -> SightCone {
        let places_m = || self.expected.iter().flatten().map(|e| e.position_m);
        let n = places_m().count().max(1);
        let center_m = places_m().sum::<Vector3<f64>>() / n as f64;
        let reach2 = places_m().fold(0.0, |reach2: f64, place_m| {
            reach2.max((place_m - center_m).norm_squared())
        });
        // Enlarged slightly for rounding errors.
        let reach_m = reach2.sqrt() * (1.0 + 1e-9);
        SightCone::around(&self.center_m(), &center_m, reach_m)
    }

    fn expected_at(&self, keypoint: usize, position_m: Vector3<f64>) -> Option<ExpectedKeypoint> {
        let cell_from_world = self.cell_from_world(keypoint);
        let h = cell_from_world * position_m.push(1.0);
        let cell = Vector2::new(h.x, h.y) / h.z;
        // A position that is NaN has no depth either.
        if !(h.z > 0.0 && cell.iter().all(|v| v.is_finite()) && self.knows(keypoint, cell)) {
            return None;
        }
        let focal_cells = cell_from_world.fixed_view::<2, 3>(0, 0)
            - cell * cell_from_world.fixed_view::<1, 3>(2, 0);
        // Mean of the two axes' cells per radian.
        let cells_per_m = focal_cells.norm() / 2.0f64.sqrt() / h.z;
        Some(ExpectedKeypoint {
            position_m,
            homogeneous_cell: h,
            cell,
            cell_m: 1.0 / cells_per_m,
        })
    }

    /// Finds the unknown peaks of all maps around the expected places; `half_width_m` is that of
    /// the lattice. Any change of a map or its place makes its peaks unknown.
    pub(crate) fn find_peaks(&mut self, half_width_m: f64) {
        for (keypoint, expected) in self.expected.iter().enumerate() {
            let peaks = &mut self.peaks[keypoint];
            if let Some(expected) = expected
                && !peaks.are_found()
            {
                let half_width_cells = half_width_m / expected.cell_m;
                let map = self.maps.map(keypoint);
                peaks.find(&map, expected.cell, half_width_cells);
            }
        }
    }

    /// The undistorted pixel of the highest peak in the whole map of `keypoint`, and its height, 0
    /// to 1. `None` if no peak is high enough, or the camera does not see it.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub(crate) fn highest_peak(&self, keypoint: usize) -> Option<(Pixel<Undistorted>, f64)> {
        let peak = self.map(keypoint).highest_peak()?;
        let pixel = || self.grid(keypoint).pixel(peak.cell.x, peak.cell.y);
        let is_seen = self.knows(keypoint, peak.cell);
        is_seen.then(|| (pixel(), peak.height))
    }

    /// The peaks of the map of `keypoint`; none before [`Self::find_peaks`].
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub(crate) fn peaks(&self, keypoint: usize) -> &MapPeaks {
        &self.peaks[keypoint]
    }

    pub(super) fn forget_peaks(&mut self, keypoint: usize) {
        self.peaks[keypoint] = MapPeaks::default();
    }
}
