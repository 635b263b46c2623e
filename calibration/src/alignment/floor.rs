//! The floor from points on it: clicked points, or the path of a rolling ball.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::similarity::Similarity;

/// A floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// Rotates up to z, and moves the floor to z = 0 with the middle of its points at the origin. It keeps lengths.
    pub level: Similarity,
    /// Root of the mean squared distance of the inliers to the floor, in the units of the points.
    pub rms: f64,
    /// Indices of points that are not on it.
    pub outliers: Vec<usize>,
}

/// Largest distance of an inlier, relative to the extent of all points: bumps, and a ball that hops.
const NEAR_SHARE: f64 = 0.01;
/// Most triples of points that propose a floor.
const MOST_TRIPLES: usize = 2000;
/// Least share of inliers.
const LEAST_SHARE: f64 = 0.5;
/// Least extent of the points across their best line, relative to the extent along it (squares).
const LEAST_SPREAD: f64 = 1e-6;

/// The plane of most `points`, with the pinholes `centers` above it.
///
/// If all points fit, it is their plane of least squares. Points that are off the floor, such as hops of a ball, are left out.
///
/// # Errors
/// A message: fewer than three points, points on one line, no plane with half of the points, cameras on both sides.
pub fn floor(points: &[Vector3<f64>], centers: &[Vector3<f64>]) -> Result<Floor, String> {
    if points.len() < 3 {
        return Err(format!(
            "found {} floor points, expected three or more",
            points.len()
        ));
    }
    let (middle, up, _) = plane(points)?;
    let extent = points
        .iter()
        .map(|p| (p - middle).norm())
        .fold(0.0, f64::max);
    let near = NEAR_SHARE * extent;
    let off = |p: &Vector3<f64>, (middle, up): &(Vector3<f64>, Vector3<f64>)| {
        (p - middle).dot(up).abs() / near
    };
    let cost = |it: &(Vector3<f64>, Vector3<f64>)| {
        points
            .iter()
            .map(|p| {
                let d = off(p, it);
                (d * d).min(1.0)
            })
            .sum::<f64>()
    };
    let mut best = (cost(&(middle, up)), (middle, up));
    if points.iter().any(|p| off(p, &best.1) > 1.0) {
        for it in proposed(points) {
            let cost = cost(&it);
            if cost < best.0 {
                best = (cost, it);
            }
        }
    }
    let kept: Vec<Vector3<f64>> = points
        .iter()
        .filter(|p| off(p, &best.1) <= 1.0)
        .copied()
        .collect();
    if (kept.len() as f64) < LEAST_SHARE * points.len() as f64 || kept.len() < 3 {
        return Err(format!(
            "{} of {} floor points lie on one plane, expected half or more: some are not on the floor",
            kept.len(),
            points.len()
        ));
    }
    let (middle, mut up, rms) = plane(&kept)?;
    let above = centers
        .iter()
        .filter(|c| (*c - middle).dot(&up) > 0.0)
        .count();
    if above != 0 && above != centers.len() {
        return Err(format!(
            "{above} of {} cameras are on one side of the floor, expected all: floor points may be clicked wrongly",
            centers.len()
        ));
    }
    if above == 0 {
        up = -up;
    }
    let rotation = UnitQuaternion::rotation_between(&up, &Vector3::z()).unwrap_or_else(|| {
        let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        UnitQuaternion::from_rotation_matrix(&turned)
    });
    let is_off = |p: &Vector3<f64>| (p - middle).dot(&up).abs() > near;
    Ok(Floor {
        level: Similarity {
            scale: 1.0,
            rotation,
            shift: -(rotation * middle),
        },
        rms,
        outliers: (0..points.len()).filter(|i| is_off(&points[*i])).collect(),
    })
}

/// Middle, normal and RMS distance of the plane of least squares.
fn plane(points: &[Vector3<f64>]) -> Result<(Vector3<f64>, Vector3<f64>, f64), String> {
    let count = points.len() as f64;
    let middle = points.iter().fold(Vector3::zeros(), |s, p| s + p) / count;
    let spread = points.iter().fold(Matrix3::zeros(), |s, p| {
        s + (p - middle) * (p - middle).transpose()
    });
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    if eigen.eigenvalues[order[1]] <= LEAST_SPREAD * eigen.eigenvalues[order[2]] {
        return Err("the floor points lie on one line, expected three that do not".to_owned());
    }
    let up = eigen.eigenvectors.column(order[0]).into_owned();
    let rms = (eigen.eigenvalues[order[0]].max(0.0) / count).sqrt();
    Ok((middle, up, rms))
}

/// Planes through triples of the points, evenly distributed over all triples.
fn proposed(points: &[Vector3<f64>]) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + '_ {
    let n = points.len();
    (0..MOST_TRIPLES).filter_map(move |index| {
        // Steps that share no factor with most counts combine different points in each round.
        let at =
            |step: usize, from: usize| points.get((index * step + from + index / n.max(1)) % n);
        let (a, b, c) = (at(1, 0)?, at(3, n / 3)?, at(7, 2 * n / 3)?);
        let up = (b - a).cross(&(c - a)).try_normalize(1e-12)?;
        Some((*a, up))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted() -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -1.2, 0.3))
    }

    /// The path of a rolling ball with `hops`, in a rotated world.
    fn path(hops: usize) -> Vec<Vector3<f64>> {
        let points = (0..60).map(|i| {
            let t = 0.1 * i as f64;
            let hop = if i % 60 < hops {
                0.4 + 0.1 * t
            } else {
                0.003 * libm::sin(9.0 * t)
            };
            tilted() * Vector3::new(4.0 * libm::sin(t), 3.0 * libm::cos(0.7 * t), hop)
        });
        points.collect()
    }

    #[test]
    fn a_path_on_the_ground_determines_up_without_its_hops() {
        let centers =
            [Vector3::new(5.0, 0.0, 2.5), Vector3::new(-5.0, 3.0, 3.0)].map(|c| tilted() * c);
        let found = floor(&path(18), &centers).unwrap();
        let up = found.level.rotation * tilted() * Vector3::z();
        assert!(
            up.angle(&Vector3::z()) < 0.005,
            "{up:?} {:?}",
            found.outliers
        );
        assert_eq!(found.outliers, (0..18).collect::<Vec<_>>());
        assert!((found.level.apply(&centers[0]).z - 2.5).abs() < 0.02);
        assert!(found.rms < 0.004);
    }

    #[test]
    fn points_without_a_floor_are_refused() {
        let centers = [Vector3::new(0.0, 0.0, 2.0), Vector3::new(1.0, 0.0, -2.0)];
        let line: Vec<_> = (0..5)
            .map(|i| Vector3::new(f64::from(i), 0.0, 0.0))
            .collect();
        assert!(floor(&line, &centers).unwrap_err().contains("on one line"));
        assert!(
            floor(&line[..2], &centers)
                .unwrap_err()
                .contains("three or more")
        );
        let square =
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
        assert!(
            floor(&square, &centers)
                .unwrap_err()
                .contains("on one side of the floor")
        );
        let cloud: Vec<_> = (0..30)
            .map(|i| {
                Vector3::new(
                    libm::sin(f64::from(i)),
                    libm::sin(2.3 * f64::from(i)),
                    libm::sin(5.1 * f64::from(i)),
                )
            })
            .collect();
        assert!(
            floor(&cloud, &centers[..1])
                .unwrap_err()
                .contains("lie on one plane")
        );
    }
}
