//! A point from its images in several cameras: weighted direct linear transform (DLT).
//!
//! The plain method for comparison with the lattice; the pipeline does not use it. (Initiations
//! have rays with outliers, see `sightings/reconstruction.rs`.)

use farfield_proto::frames::{Pixel, Point, Undistorted, World};
use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, Vector3, Vector4};

/// Least ratio of eigenvalues at which directions determine a point: rays within about 0.03 degrees
/// of each other do not.
const LEAST_SPREAD: f64 = 1e-7;

/// Why there is no point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum TriangulateError {
    /// One view (or none) leaves a whole ray.
    #[error("{got} views do not determine a point, 2 are needed")]
    TooFewViews {
        /// How many views there were (with a weight above zero).
        got: usize,
    },
    /// The rays do not determine a point.
    #[error("the rays are parallel")]
    ParallelRays,
}

/// Where one camera saw the point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// World metres to homogeneous undistorted pixels, eq. (A.1).
    pub pixel_from_world: Matrix3x4<f64>,
    /// Where it was seen.
    pub pixel: Pixel<Undistorted>,
    /// How much it counts; not negative.
    pub weight: f64,
}

/// Finds the point whose algebraic error over `observations` is least: weighted DLT.
///
/// ```text
///   min |A X|, |X| = 1,   rows of A:  w_i (u_i p3 - p1)/|p1|,   w_i (v_i p3 - p2)/|p2|
/// ```
///
/// with p1, p2, p3 the rows of the projection matrix. The norms (of the rows' first three numbers)
/// make rows of wide and tele lenses comparable. The origin is moved into the middle of the
/// cameras, because distant world origins cost digits. Source: Hartley and Zisserman 2004, section
/// 12.2. Cost: one symmetric 4 x 4 eigenproblem.
///
/// # Errors
/// [`TriangulateError::TooFewViews`] with fewer than two observations of positive weight,
/// [`TriangulateError::ParallelRays`] if they do not determine a point.
pub fn weighted_dlt(observations: &[Observation]) -> Result<Point<World>, TriangulateError> {
    let counting = || observations.iter().filter(|o| o.weight > 0.0);
    let got = counting().count();
    if got < 2 {
        return Err(TriangulateError::TooFewViews { got });
    }
    let origin = counting()
        .map(|o| center(&o.pixel_from_world))
        .sum::<Vector3<f64>>()
        / got as f64;
    let mut normal = Matrix4::zeros();
    for o in counting() {
        let p = &o.pixel_from_world;
        let shifted_column = p * origin.push(1.0);
        let row = |i: usize| Vector4::new(p[(i, 0)], p[(i, 1)], p[(i, 2)], shifted_column[i]);
        for (i, coordinate) in [o.pixel.x(), o.pixel.y()].into_iter().enumerate() {
            let a = (row(2) * coordinate - row(i)) * (o.weight / row(i).xyz().norm());
            normal += a * a.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let order = ascending(eigen.eigenvalues.as_slice());
    let x: Vector4<f64> = eigen.eigenvectors.column(order[0]).into_owned();
    // Two small eigenvalues: a whole line of solutions.
    let [second, largest] = [eigen.eigenvalues[order[1]], eigen.eigenvalues[order[3]]];
    let point = x.xyz() / x.w + origin;
    let fixed = second > largest * LEAST_SPREAD * LEAST_SPREAD && x.w.abs() > 1e-9;
    if fixed && point.iter().all(|v| v.is_finite()) {
        Ok(Point::new(Point3::from(point)))
    } else {
        Err(TriangulateError::ParallelRays)
    }
}

/// The camera centre of a projection matrix [M | t], -M^-1 t; the origin if M is singular, which no
/// camera model has.
fn center(pixel_from_world: &Matrix3x4<f64>) -> Vector3<f64> {
    let m: Matrix3<f64> = pixel_from_world.fixed_columns::<3>(0).into_owned();
    m.lu()
        .solve(&-pixel_from_world.column(3))
        .unwrap_or_default()
}

/// The order of four eigenvalues, smallest first.
fn ascending(values: &[f64]) -> [usize; 4] {
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    order
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
    use farfield_proto::frames::Transform;
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    use super::*;

    /// World origins are up to 200 m away, pixels a thousand: the accuracy of f64.
    const TOLERANCE_M: f64 = 1e-6;

    fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(range).prop_map(Vector3::from)
    }

    /// A camera at `eye_m` that looks at `target_m`.
    fn camera(eye_m: Vector3<f64>, target_m: Vector3<f64>, focal_px: f64) -> CameraModel {
        let intrinsics = Intrinsics {
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: 959.5,
            cy_px: 599.5,
        };
        let camera_from_world =
            Isometry3::look_at_lh(&eye_m.into(), &target_m.into(), &-Vector3::z());
        CameraModel::new(
            "test",
            [1920, 1200],
            intrinsics,
            Distortion::default(),
            Transform::new(camera_from_world),
        )
        .unwrap()
    }

    /// Cameras around `middle_m` and their observations of `point_m`.
    fn seen(middle_m: Vector3<f64>, point_m: Vector3<f64>, n: usize) -> Vec<Observation> {
        let views = (0..n).map(|i| {
            let (sine, cosine) = (0.3 + 1.1 * i as f64).sin_cos();
            let eye_m = middle_m + Vector3::new(9.0 * cosine, 9.0 * sine, 2.0);
            // A mix of wide and tele lenses.
            let model = camera(eye_m, middle_m, 600.0 + 900.0 * i as f64);
            let pixel = model.project(Point::new(Point3::from(point_m))).unwrap();
            Observation {
                pixel_from_world: model.projection_matrix(),
                pixel,
                weight: 1.0,
            }
        });
        views.collect()
    }

    proptest! {
        #[test]
        fn exact_observations_give_the_point(
            middle in vector(-200.0..200.0), off in vector(-1.5..1.5), n in 2usize..8, weight in 0.1f64..10.0,
        ) {
            let mut observations = seen(middle, middle + off, n);
            observations[0].weight = weight;
            let dlt = weighted_dlt(&observations).unwrap();
            prop_assert!((dlt.coordinates_m().coords - middle - off).norm() < TOLERANCE_M);
        }
    }

    #[test]
    fn a_view_without_weight_is_ignored() {
        let point = Vector3::new(0.3, 0.1, 1.2);
        let mut observations = seen(Vector3::zeros(), point, 3);
        observations[2].pixel = Pixel::new(0.0, 0.0);
        observations[2].weight = 0.0;
        let found = weighted_dlt(&observations).unwrap();
        assert!((found.coordinates_m().coords - point).norm() < TOLERANCE_M);
    }

    #[test]
    fn one_view_is_refused() {
        let observations = seen(Vector3::zeros(), Vector3::new(0.0, 0.0, 1.0), 1);
        assert_eq!(
            weighted_dlt(&observations),
            Err(TriangulateError::TooFewViews { got: 1 })
        );
    }

    #[test]
    fn parallel_rays_are_refused() {
        let observations = seen(Vector3::zeros(), Vector3::new(0.0, 0.0, 1.0), 1);
        assert_eq!(
            weighted_dlt(&[observations[0], observations[0]]),
            Err(TriangulateError::ParallelRays)
        );
    }
}
