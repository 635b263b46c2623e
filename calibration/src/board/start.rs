//! Starts of a fit of intrinsics: homographies and their poses, Zhang's closed form, and several focal lengths for a fisheye.

use farfield_proto::camera::Intrinsics;
use nalgebra::{
    DMatrix, Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};

use super::adjust::{Sighting, State, adjust, residuals};
use super::projection::{Coefficients, MOST, Optics};

/// Focal lengths from which a fit of a fisheye starts, relative to the picture's longer side.
const FISHEYE_STARTS: [f64; 7] = [0.2, 0.26, 0.33, 0.42, 0.55, 0.75, 1.1];

/// Zhang 2000, section 3.1, with the principal point in the picture's middle: two columns of a homography satisfy
/// h1' w h2 = 0 and h1' w h1 = h2' w h2, which is linear in 1/fx^2 and 1/fy^2.
pub(super) fn start_pinhole(
    size_px: [u32; 2],
    sightings: &[Sighting],
    coefficients: Coefficients,
) -> Option<State> {
    let center = size_px.map(|s| 0.5 * (f64::from(s) - 1.0));
    let shift = Matrix3::new(1.0, 0.0, -center[0], 0.0, 1.0, -center[1], 0.0, 0.0, 1.0);
    let homographies = sightings.iter().map(|s| {
        let plane: Vec<Vector2<f64>> = s.board.iter().map(nalgebra::Matrix::xy).collect();
        homography(&plane, &s.pixels).map(|h| shift * h)
    });
    let homographies = homographies.collect::<Option<Vec<_>>>()?;
    let mut rows = Vec::new();
    let mut right = Vec::new();
    for h in &homographies {
        let (a, b) = (h.column(0), h.column(1));
        // Pictures have equal weight, whatever the size of the board.
        let scale = 1.0 / (a.norm() * b.norm()).max(1e-300);
        rows.push([a.x * b.x * scale, a.y * b.y * scale]);
        right.push(-a.z * b.z * scale);
        rows.push([
            (a.x * a.x - b.x * b.x) * scale,
            (a.y * a.y - b.y * b.y) * scale,
        ]);
        right.push((b.z * b.z - a.z * a.z) * scale);
    }
    let matrix = DMatrix::from_fn(rows.len(), 2, |i, j| rows.get(i).map_or(0.0, |row| row[j]));
    let svd = matrix.svd(true, true);
    let solved = svd.solve(&nalgebra::DVector::from_vec(right), 1e-12).ok()?;
    let side = f64::from(size_px[0].max(size_px[1]));
    // If noise makes a square negative, use an ordinary lens.
    let focal = |squared: f64| {
        let f = 1.0 / squared.max(0.0).sqrt();
        if (0.1 * side..30.0 * side).contains(&f) {
            f
        } else {
            side
        }
    };
    let mut values = [0.0; MOST];
    let given = [focal(solved[0]), focal(solved[1]), center[0], center[1]];
    for (value, given) in values.iter_mut().zip(given) {
        *value = given;
    }
    let optics = Optics {
        coefficients,
        values,
    };
    let normal =
        Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0 / given[0], 1.0 / given[1], 1.0));
    let poses = homographies
        .iter()
        .map(|h| pose(&(normal * h)))
        .collect::<Option<Vec<_>>>()?;
    Some(State { optics, poses })
}

/// The best fit from several focal lengths of an equidistant lens.
pub(super) fn start_fisheye(size_px: [u32; 2], sightings: &[Sighting]) -> Option<State> {
    let center = size_px.map(|s| 0.5 * (f64::from(s) - 1.0));
    let side = f64::from(size_px[0].max(size_px[1]));
    let mut best: Option<(f64, State)> = None;
    for share in FISHEYE_STARTS {
        let focal = share * side;
        let mut values = [0.0; MOST];
        for (value, given) in values.iter_mut().zip([focal, focal, center[0], center[1]]) {
            *value = given;
        }
        let optics = Optics {
            coefficients: Coefficients::Fisheye,
            values,
        };
        let poses = sightings
            .iter()
            .map(|s| fisheye_pose(&optics, s))
            .collect::<Option<Vec<_>>>();
        let Some(state) = poses.map(|poses| State { optics, poses }) else {
            continue;
        };
        let Some(fitted) = adjust(state, sightings) else {
            continue;
        };
        let all = fitted
            .poses
            .iter()
            .zip(sightings)
            .map(|(pose, s)| residuals(&fitted.optics, pose, s));
        let Some(all) = all.collect::<Option<Vec<_>>>() else {
            continue;
        };
        let cost: f64 = all.iter().flatten().map(Vector2::norm_squared).sum();
        if best.as_ref().is_none_or(|(lowest, _)| cost < *lowest) {
            best = Some((cost, fitted));
        }
    }
    best.map(|(_, state)| state)
}

/// The pose of a board from its corners within 75 degrees of the axis of an equidistant lens.
fn fisheye_pose(optics: &Optics, sighting: &Sighting) -> Option<Isometry3<f64>> {
    let Intrinsics {
        fx_px,
        fy_px,
        cx_px,
        cy_px,
    } = optics.intrinsics();
    let mut plane = Vec::new();
    let mut image = Vec::new();
    for (board, pixel) in sighting.board.iter().zip(&sighting.pixels) {
        let at = Vector2::new((pixel.x - cx_px) / fx_px, (pixel.y - cy_px) / fy_px);
        let theta = at.norm();
        if theta < 1.3 {
            let stretch = if theta > 1e-9 {
                libm::tan(theta) / theta
            } else {
                1.0
            };
            plane.push(board.xy());
            image.push(at * stretch);
        }
    }
    pose(&homography(&plane, &image)?)
}

/// The 3 x 3 matrix that maps points of a plane to image points, by normalised direct linear transformation (Hartley and
/// Zisserman 2004, algorithm 4.2); `None` for fewer than four points or points on a line.
pub(super) fn homography(plane: &[Vector2<f64>], image: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    if plane.len() < 4 || plane.len() != image.len() {
        return None;
    }
    let (from, to) = (normalising(plane)?, normalising(image)?);
    let mut a = DMatrix::<f64>::zeros(2 * plane.len().max(5), 9);
    for (i, (p, q)) in plane.iter().zip(image).enumerate() {
        let p = from * p.push(1.0);
        let q = to * q.push(1.0);
        let rows = [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
        ];
        for (offset, row) in rows.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                a[(2 * i + offset, j)] = *value;
            }
        }
    }
    let svd = a.svd(false, true);
    let values = &svd.singular_values;
    // Points on a line leave a second direction free.
    if values[7] < 1e-9 * values[0] {
        return None;
    }
    let last = svd.v_t?.row(8).transpose();
    let h = Matrix3::from_row_slice(last.as_slice());
    let h = to.try_inverse()? * h * from;
    let norm = h.norm();
    (norm.is_finite() && norm > 0.0).then(|| h / norm)
}

/// The transform to a mean of zero and a mean distance of the square root of two.
fn normalising(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean: Vector2<f64> = points.iter().sum::<Vector2<f64>>() / n;
    let distance = points.iter().map(|p| (p - mean).norm()).sum::<f64>() / n;
    let s = std::f64::consts::SQRT_2 / distance;
    s.is_finite()
        .then(|| Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0))
}

/// The pose of a plane (z = 0) with the homography `h` into normalised image coordinates: camera from plane, with the plane's
/// origin in front.
pub(super) fn pose(h: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let scale = (h.column(0).norm() * h.column(1).norm()).sqrt();
    let scale = if h[(2, 2)] < 0.0 { -scale } else { scale };
    let m = h / scale;
    let (r1, r2) = (m.column(0).into_owned(), m.column(1).into_owned());
    let svd = Matrix3::from_columns(&[r1, r2, r1.cross(&r2)]).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    if !rotation.iter().all(|v| v.is_finite()) || rotation.determinant() < 0.0 {
        return None;
    }
    let translation: Vector3<f64> = m.column(2).into_owned();
    Some(Isometry3::from_parts(
        Translation3::from(translation),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_corners_of_a_square_give_its_pose() {
        let truth = Isometry3::new(Vector3::new(0.2, -0.1, 3.0), Vector3::new(0.3, -0.4, 0.2));
        let plane =
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vector2::new(x, y));
        let image = plane.map(|p| {
            let c = truth * nalgebra::Point3::new(p.x, p.y, 0.0);
            Vector2::new(c.x / c.z, c.y / c.z)
        });
        let found = pose(&homography(&plane, &image).expect("four corners")).expect("a pose");
        assert!(
            (found.to_homogeneous() - truth.to_homogeneous())
                .abs()
                .max()
                < 1e-9
        );
    }

    #[test]
    fn points_on_a_line_give_no_homography() {
        let line: Vec<_> = (0..6)
            .map(|i| Vector2::new(f64::from(i), 2.0 * f64::from(i)))
            .collect();
        assert_eq!(homography(&line, &line), None);
    }
}
