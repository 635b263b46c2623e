//! The accuracy of a triangulated point in each cell of the field, and the number of cameras that see it.

use nalgebra::{Matrix2, Matrix3, Vector3};

use crate::adjustment::CameraState;

/// Most cells of a map.
const MOST_CELLS: usize = 250_000;
/// Least ratio of the smallest to the largest eigenvalue of the information for a determined point.
const LEAST_EIGENVALUE: f64 = 1e-9;

/// A camera with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldCamera {
    /// Lens and pose in the venue.
    pub state: CameraState,
    /// Width and height of its pictures, pixels.
    pub size_px: [u32; 2],
    /// Standard deviation of its position along each axis, metres: `CameraReport::position_sigma_m` over the root of three.
    pub position_sigma_m: f64,
    /// Standard deviation of its rotation about each axis, radians.
    pub rotation_sigma_rad: f64,
}

/// The extent of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldGrid {
    /// Smallest x and y, venue, metres.
    pub from_m: [f64; 2],
    /// Largest x and y.
    pub to_m: [f64; 2],
    /// Side of a cell.
    pub step_m: f64,
    /// Height above the floor.
    pub height_m: f64,
}

/// One cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldCell {
    /// Its middle, venue, metres.
    pub position_m: [f64; 3],
    /// The number of cameras that see it.
    pub cameras: usize,
    /// Standard deviation of a point that all of them see: root of the summed variances of the three axes, metres; `None` if
    /// fewer than two see it, or all from one direction.
    pub sigma_m: Option<f64>,
}

/// The cells of `grid` by rows of increasing y. A sight has a standard deviation of `sight_sigma_px` along each axis.
///
/// The information of a cell is the sum over the cameras that see it of J' C^-1 J. J is the derivative of the pixel by the point,
/// and C the variance of the sight plus that from the camera's position and rotation. Cameras are treated as independent:
/// errors that move all cameras alike (the alignment) are not included ([`crate::alignment::MarkFit::sigma_m`] is that).
///
/// # Errors
/// A message: a grid without cells, or with more than 250,000.
pub fn field_map(
    cameras: &[FieldCamera],
    grid: &FieldGrid,
    sight_sigma_px: f64,
) -> Result<Vec<FieldCell>, String> {
    let count = |axis: usize| ((grid.to_m[axis] - grid.from_m[axis]) / grid.step_m).round();
    let (columns, rows) = (count(0), count(1));
    let is_grid = columns >= 1.0 && rows >= 1.0 && columns * rows <= MOST_CELLS as f64;
    if !is_grid || !grid.height_m.is_finite() || !(grid.from_m[0] + grid.from_m[1]).is_finite() {
        return Err(format!(
            "found a map from {:?} to {:?} m in steps of {} m, expected 1 to {MOST_CELLS} cells",
            grid.from_m, grid.to_m, grid.step_m
        ));
    }
    let folds: Vec<f64> = cameras
        .iter()
        .map(|camera| camera.state.fold_radius())
        .collect();
    let mut cells = Vec::new();
    for row in 0..rows as usize {
        for column in 0..columns as usize {
            let at =
                |axis: usize, index: usize| grid.from_m[axis] + (index as f64 + 0.5) * grid.step_m;
            let position = Vector3::new(at(0, column), at(1, row), grid.height_m);
            cells.push(cell(cameras, &folds, &position, sight_sigma_px));
        }
    }
    Ok(cells)
}

fn cell(
    cameras: &[FieldCamera],
    folds: &[f64],
    position: &Vector3<f64>,
    sight_sigma_px: f64,
) -> FieldCell {
    let mut information = Matrix3::zeros();
    let mut seen_by = 0;
    for (camera, fold) in cameras.iter().zip(folds) {
        let Some(drawn) = camera.state.project_with_derivatives(position, *fold) else {
            continue;
        };
        let is_inside = (0..2)
            .all(|axis| (-0.5..f64::from(camera.size_px[axis]) - 0.5).contains(&drawn.px[axis]));
        if !is_inside {
            continue;
        }
        seen_by += 1;
        let by_pose = drawn.by_camera.fixed_view::<2, 6>(0, 0);
        let (by_turn, by_place) = (by_pose.fixed_columns::<3>(0), by_pose.fixed_columns::<3>(3));
        let (turn, place) = (camera.rotation_sigma_rad, camera.position_sigma_m);
        let variance = Matrix2::identity() * (sight_sigma_px * sight_sigma_px)
            + by_turn * by_turn.transpose() * (turn * turn)
            + by_place * by_place.transpose() * (place * place);
        if let Some(inverse) = variance.try_inverse() {
            information += drawn.by_point.transpose() * inverse * drawn.by_point;
        }
    }
    let eigen = information.symmetric_eigenvalues();
    let is_fixed = seen_by >= 2 && eigen.min() > LEAST_EIGENVALUE * eigen.max();
    let inverse = information
        .cholesky()
        .filter(|_| is_fixed)
        .map(|it| it.inverse());
    FieldCell {
        position_m: (*position).into(),
        cameras: seen_by,
        sigma_m: inverse.map(|covariance| covariance.trace().sqrt()),
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Distortion, Intrinsics};
    use nalgebra::{Rotation3, UnitQuaternion};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::triangulate;

    /// Four cameras that look at the middle from 10 m.
    fn cameras() -> Vec<FieldCamera> {
        let intrinsics = Intrinsics {
            fx_px: 1000.0,
            fy_px: 1000.0,
            cx_px: 960.0,
            cy_px: 600.0,
        };
        let around = (0..4).map(|i| {
            let turn = 0.4 + 1.5 * f64::from(i);
            let center = Vector3::new(10.0 * libm::cos(turn), 10.0 * libm::sin(turn), 3.0);
            let forward = -center.normalize();
            let right = forward.cross(&Vector3::z()).normalize();
            let rows = [
                right.transpose(),
                forward.cross(&right).transpose(),
                forward.transpose(),
            ];
            let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows));
            FieldCamera {
                state: CameraState {
                    center_w: center,
                    camera_from_world: UnitQuaternion::from_rotation_matrix(&rotation),
                    ..CameraState::at_origin(intrinsics, Distortion::default())
                },
                size_px: [1920, 1200],
                position_sigma_m: 0.0,
                rotation_sigma_rad: 0.0,
            }
        });
        around.collect()
    }

    const GRID: FieldGrid = FieldGrid {
        from_m: [-12.0, -12.0],
        to_m: [12.0, 12.0],
        step_m: 2.0,
        height_m: 1.5,
    };

    #[test]
    fn the_sigma_of_a_cell_matches_the_errors_of_points() {
        let cameras = cameras();
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let map = field_map(&cameras, &GRID, 2.0).unwrap();
        // Only near the middle, where all cameras have similar distances: elsewhere the nearest point to all rays is not optimal.
        let is_inner =
            |cell: &&FieldCell| libm::hypot(cell.position_m[0], cell.position_m[1]) < 3.5;
        for cell in map.iter().filter(is_inner) {
            assert_eq!(cell.cameras, 4);
            let at = Vector3::from(cell.position_m);
            let mut squares = 0.0;
            for _ in 0..200 {
                // Uniform with standard deviation 2.
                let mut noise = || rng.random_range(-1.0..1.0) * 2.0 * 3f64.sqrt();
                let sights: Vec<_> = cameras
                    .iter()
                    .map(|camera| {
                        let state = &camera.state;
                        let px = state.project(&at, state.fold_radius()).unwrap();
                        let bearing = state
                            .bearing([px.x + noise(), px.y + noise()], state.fold_radius())
                            .unwrap();
                        (state.center_w, state.camera_from_world.inverse() * bearing)
                    })
                    .collect();
                let (found, _) = triangulate(&sights, 0.1).unwrap();
                squares += (found - at).norm_squared();
            }
            let ratio = (squares / 200.0).sqrt() / cell.sigma_m.unwrap();
            assert!((0.8..1.4).contains(&ratio), "{cell:?}: {ratio}");
        }
        assert!(map.iter().any(|cell| is_inner(&cell)));
    }

    #[test]
    fn cells_that_one_camera_sees_have_no_sigma() {
        let map = field_map(&cameras(), &GRID, 1.0).unwrap();
        assert_eq!(map.len(), 144);
        assert!(
            map.iter()
                .filter(|cell| cell.cameras < 2)
                .all(|cell| cell.sigma_m.is_none())
        );
        assert!(
            map.iter().any(|cell| cell.cameras < 2)
                && map.iter().any(|cell| cell.sigma_m.is_some())
        );
    }

    #[test]
    fn uncertain_cameras_give_uncertain_points() {
        let sharp = field_map(&cameras(), &GRID, 1.0).unwrap();
        let mut loose = cameras();
        for camera in &mut loose {
            camera.rotation_sigma_rad = 0.002;
            camera.position_sigma_m = 0.01;
        }
        let blurred = field_map(&loose, &GRID, 1.0).unwrap();
        for (a, b) in sharp.iter().zip(&blurred) {
            if let (Some(a), Some(b)) = (a.sigma_m, b.sigma_m) {
                assert!(b > 1.5 * a);
            }
        }
    }

    #[test]
    fn an_impossible_grid_is_refused() {
        for (step_m, to_m) in [
            (0.0, 12.0),
            (-1.0, 12.0),
            (f64::NAN, 12.0),
            (0.001, 12.0),
            (1.0, -20.0),
            (1.0, f64::INFINITY),
        ] {
            let grid = FieldGrid {
                step_m,
                to_m: [to_m; 2],
                ..GRID
            };
            assert!(field_map(&cameras(), &grid, 1.0).is_err());
        }
    }
}
