//! Maps drawn from 2D candidates, for the fusion of recordings that exist only as keypoints.
//!
//! Every candidate of a keypoint, of any person, becomes a Gaussian with the source's sigma and the
//! candidate's score as its height. Where Gaussians overlap, the higher value counts. No picture
//! and no network are involved.

use farfield_proto::camera::CameraModel;
use farfield_proto::grid::CellGrid;
use farfield_proto::patch::{Maps, quantize};

use crate::source::KeypointCandidate;

/// Radius of a Gaussian in sigmas; beyond it the value is below 1/255 of the largest score.
const REACH_SIGMAS: f64 = 3.34;

/// Draws one map per keypoint of `peaks` over `grid` (a crop in undistorted pixels of `camera`).
///
/// `into` is cleared and gets the grid's size. Positions are undistorted first; candidates beyond
/// the lens model are left out. Cost: (6.7 sigma)^2 cells per candidate that overlaps the grid.
pub fn draw_maps(
    peaks: &[Vec<KeypointCandidate>],
    camera: &CameraModel,
    grid: &CellGrid,
    sigma_cells: f64,
    into: &mut Maps,
) {
    into.resize(grid.width.into(), grid.height.into(), peaks.len());
    for (keypoint, candidates) in peaks.iter().enumerate() {
        let cells = into.cells_mut(keypoint);
        cells.fill(0);
        for candidate in candidates {
            let Some(pixel) = camera.undistort(candidate.position) else {
                continue;
            };
            let center = grid.cell(pixel);
            draw_peak(
                cells,
                usize::from(grid.width),
                [center.x, center.y],
                candidate.score,
                sigma_cells,
            );
        }
    }
}

/// Draws one Gaussian into a map of rows of `width` cells, keeping higher values.
pub fn draw_peak(cells: &mut [u8], width: usize, center: [f64; 2], score: f32, sigma: f64) {
    let reach = REACH_SIGMAS * sigma;
    let span = |c: f64, size: usize| {
        let first = (c - reach).ceil().clamp(0.0, size as f64) as usize;
        let end = ((c + reach).floor() + 1.0).clamp(0.0, size as f64) as usize;
        first..end
    };
    let height = cells.len() / width;
    let fall = -0.5 / (sigma * sigma);
    for y in span(center[1], height) {
        for x in span(center[0], width) {
            let square = (x as f64 - center[0]).powi(2) + (y as f64 - center[1]).powi(2);
            let cell = &mut cells[y * width + x];
            *cell = (*cell).max(quantize(score * (fall * square).exp() as f32));
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::BoundingBox;
    use farfield_proto::frames::Pixel;

    use super::*;
    use crate::crop::{CropGeometry, CropShape};
    use crate::fixtures::{bent, pinhole};
    use crate::peaks::find_peaks;

    fn grid() -> CellGrid {
        let b = BoundingBox {
            center_px: [300.0, 240.0],
            size_px: [96.0, 128.0],
            rotation_rad: 0.2,
        };
        CropGeometry::new(&b, CropShape::of_grid([48, 64]))
            .unwrap()
            .grid()
    }

    fn drawn(camera: &CameraModel, peaks: &[Vec<KeypointCandidate>]) -> Maps {
        let mut maps = Maps::new(1, 1, 1);
        draw_maps(peaks, camera, &grid(), 2.0, &mut maps);
        maps
    }

    fn values(maps: &Maps, keypoint: usize) -> Vec<f32> {
        maps.cells(keypoint)
            .iter()
            .map(|&c| f32::from(c) / 255.0)
            .collect()
    }

    #[test]
    fn a_candidate_is_found_where_it_was_drawn() {
        let camera = bent("a", [640, 480]);
        let position = Pixel::new(310.3, 255.8);
        let maps = drawn(
            &camera,
            &[
                vec![],
                vec![KeypointCandidate {
                    position,
                    score: 0.8,
                }],
            ],
        );
        assert!(maps.cells(0).iter().all(|&c| c == 0));
        let peak = find_peaks(&values(&maps, 1), 48, 0.1)[0];
        let expected = camera.undistort(position).unwrap();
        let found = grid().pixel(peak.cell[0], peak.cell[1]);
        assert!(
            (found.vector_px() - expected.vector_px()).norm() < 0.1,
            "cells are 2 px"
        );
        assert!((peak.value - 0.8).abs() < 0.03);
    }

    #[test]
    fn two_candidates_of_a_keypoint_are_two_peaks() {
        let camera = pinhole("a", [640, 480]);
        let at = |x, score| KeypointCandidate {
            position: Pixel::new(x, 240.0),
            score,
        };
        let maps = drawn(&camera, &[vec![at(280.0, 0.5), at(320.0, 0.9)]]);
        let peaks = find_peaks(&values(&maps, 0), 48, 0.1);
        assert_eq!(peaks.len(), 2);
        assert!((peaks[0].value - 0.9).abs() < 0.04 && (peaks[1].value - 0.5).abs() < 0.04);
    }

    #[test]
    fn only_candidates_near_the_grid_reach_into_it() {
        let camera = pinhole("a", [640, 480]);
        let left_of_grid = grid().pixel(-2.0, 30.0);
        let near = KeypointCandidate {
            position: Pixel::new(left_of_grid.x(), left_of_grid.y()),
            score: 1.0,
        };
        let maps = drawn(&camera, &[vec![near]]);
        assert!(maps.cells(0)[30 * 48] > 100);
        let far = KeypointCandidate {
            position: Pixel::new(-5000.0, f64::MAX),
            score: 1.0,
        };
        assert!(
            drawn(&camera, &[vec![far]])
                .cells(0)
                .iter()
                .all(|&c| c == 0)
        );
    }
}
