//! The homography of a plane, and the pose it means.

use nalgebra::{
    DMatrix, Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// The 3 x 3 matrix that takes points of a plane to image points, by normalised direct linear transformation (Hartley and
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

/// Moves points to a mean of zero and a mean distance of the square root of two.
fn normalising(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean: Vector2<f64> = points.iter().sum::<Vector2<f64>>() / n;
    let distance = points.iter().map(|p| (p - mean).norm()).sum::<f64>() / n;
    let s = std::f64::consts::SQRT_2 / distance;
    s.is_finite()
        .then(|| Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0))
}

/// The pose of a plane (z = 0) whose homography into normalised image coordinates is `h`: camera from plane, with the plane's
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
