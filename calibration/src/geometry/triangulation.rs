//! Triangulation of a point that several cameras see.

use nalgebra::{Matrix3, Vector3};

/// A ray: its origin and its direction, a unit vector.
pub type Sight = (Vector3<f64>, Vector3<f64>);

/// Least sine of the angle between two rays that determine a point.
const LEAST_SINE: f64 = 0.01;

/// The point with which most sights agree within `threshold_rad`, with their indices; `None` if no two agree at a sufficient
/// angle.
///
/// Every pair of sights proposes its nearest point; the winner is the least-squares point of all that agree.
pub fn triangulate(sights: &[Sight], threshold_rad: f64) -> Option<(Vector3<f64>, Vec<usize>)> {
    let mut best: Option<(f64, Vec<usize>)> = None;
    for (i, a) in sights.iter().enumerate() {
        for b in &sights[i + 1..] {
            if a.1.cross(&b.1).norm() < LEAST_SINE {
                continue;
            }
            let Some(point) = nearest([a, b].into_iter()) else {
                continue;
            };
            if angle_rad(a, &point) > threshold_rad || angle_rad(b, &point) > threshold_rad {
                continue;
            }
            let (loss, inliers) = agreeing(sights, &point, threshold_rad);
            if best.as_ref().is_none_or(|(least, _)| loss < *least) {
                best = Some((loss, inliers));
            }
        }
    }
    let (_, chosen) = best?;
    let point = nearest(chosen.iter().filter_map(|i| sights.get(*i)))?;
    let (_, inliers) = agreeing(sights, &point, threshold_rad);
    (inliers.len() >= 2).then_some((point, inliers))
}

fn agreeing(sights: &[Sight], point: &Vector3<f64>, threshold_rad: f64) -> (f64, Vec<usize>) {
    let mut loss = 0.0;
    let mut inliers = Vec::new();
    for (i, sight) in sights.iter().enumerate() {
        let d = angle_rad(sight, point) / threshold_rad;
        loss += (d * d).min(1.0);
        if d < 1.0 {
            inliers.push(i);
        }
    }
    (loss, inliers)
}

/// Angle between a sight and the direction to `point`, radians.
fn angle_rad((origin, direction): &Sight, point: &Vector3<f64>) -> f64 {
    let to = point - origin;
    libm::atan2(to.cross(direction).norm(), to.dot(direction))
}

/// The point with the least summed squared distance to the lines: sum (I - d d') x = sum (I - d d') o.
fn nearest<'a>(sights: impl Iterator<Item = &'a Sight>) -> Option<Vector3<f64>> {
    let mut matrix = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (origin, direction) in sights {
        let across = Matrix3::identity() - direction * direction.transpose();
        matrix += across;
        right += across * origin;
    }
    let point = matrix.cholesky()?.solve(&right);
    point.iter().all(|v| v.is_finite()).then_some(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_sight_of_four_is_left_out() {
        let point = Vector3::new(0.3, -0.1, 1.0);
        let mut sights: Vec<Sight> = (0..4)
            .map(|i| {
                let angle = 1.1 * f64::from(i);
                let origin = Vector3::new(5.0 * libm::cos(angle), 5.0 * libm::sin(angle), 2.0);
                (origin, (point - origin).normalize())
            })
            .collect();
        sights[2].1 = Vector3::new(-0.3, 0.4, -0.1).normalize();
        let (found, inliers) = triangulate(&sights, 1e-3).unwrap();
        assert!((found - point).norm() < 1e-9);
        assert_eq!(inliers, [0, 1, 3]);
    }

    #[test]
    fn parallel_sights_determine_no_point() {
        let sights = [
            (Vector3::zeros(), Vector3::x()),
            (Vector3::y() * 0.001, Vector3::x()),
        ];
        assert_eq!(triangulate(&sights, 1e-2), None);
    }
}
