//! The pose of a camera from known points.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::polynomial::quartic_roots;

/// A camera's pose from known points.
#[derive(Debug, Clone, PartialEq)]
pub struct Resection {
    /// World axes to camera axes.
    pub camera_from_world: UnitQuaternion<f64>,
    /// The pinhole, world.
    pub center_w: Vector3<f64>,
    /// Indices of the inliers.
    pub inliers: Vec<usize>,
}

/// The pose with which most of `pairs` (sight, point of the world) agree within `threshold_rad`, from at most `most` random
/// samples; `None` for fewer than 6 pairs or without a result.
///
/// It is only as accurate as its best sample of three and needs refinement by an adjustment.
pub fn resect(
    pairs: &[(Vector3<f64>, Vector3<f64>)],
    threshold_rad: f64,
    most: usize,
    rng: &mut ChaCha8Rng,
) -> Option<Resection> {
    if pairs.len() < 6 {
        return None;
    }
    let mut best: Option<(f64, Pose)> = None;
    let mut needed = most;
    let mut tried = 0;
    while tried < needed {
        tried += 1;
        let chosen = sample::<3>(rng, pairs.len())?;
        let poses = three_point(&chosen.map(|i| pairs[i].0), &chosen.map(|i| pairs[i].1));
        for pose in poses {
            let each = pairs.iter().map(|pair| {
                let d = angle_rad(&pose, pair) / threshold_rad;
                (d * d).min(1.0)
            });
            let loss: f64 = each.sum();
            if best.as_ref().is_none_or(|(least, _)| loss < *least) {
                best = Some((loss, pose));
                let share = 1.0 - loss / pairs.len() as f64;
                needed = needed.min(samples_needed(share, 3, most).max(30));
            }
        }
    }
    let (_, pose) = best?;
    let each = pairs.iter().enumerate();
    let inliers: Vec<usize> = each
        .filter(|(_, pair)| angle_rad(&pose, pair) < threshold_rad)
        .map(|(i, _)| i)
        .collect();
    (inliers.len() >= 6).then_some(Resection {
        camera_from_world: pose.0,
        center_w: pose.1,
        inliers,
    })
}

pub(crate) type Pose = (UnitQuaternion<f64>, Vector3<f64>);

fn angle_rad((rotation, center): &Pose, (sight, point): &(Vector3<f64>, Vector3<f64>)) -> f64 {
    let seen = (rotation * (point - center)).normalize();
    let (sine, cosine) = (seen.cross(sight).norm(), seen.dot(sight));
    libm::atan2(sine, cosine)
}

/// The poses at which three points are on three rays (Grunert 1841, as in Haralick et al. 1994).
pub(crate) fn three_point(sights: &[Vector3<f64>; 3], points: &[Vector3<f64>; 3]) -> Vec<Pose> {
    let square = |i: usize, j: usize| (points[i] - points[j]).norm_squared();
    let (a2, b2, c2) = (square(1, 2), square(0, 2), square(0, 1));
    let alpha = sights[1].dot(&sights[2]);
    let beta = sights[0].dot(&sights[2]);
    let gamma = sights[0].dot(&sights[1]);
    if b2 <= 0.0 {
        return Vec::new();
    }
    let difference = (a2 - c2) / b2;
    let sum = (a2 + c2) / b2;
    let (a, c) = (a2 / b2, c2 / b2);
    let quartic = [
        (1.0 + difference) * (1.0 + difference) - 4.0 * a * gamma * gamma,
        4.0 * (-difference * (1.0 + difference) * beta + 2.0 * a * gamma * gamma * beta
            - (1.0 - sum) * alpha * gamma),
        2.0 * (difference * difference - 1.0
            + 2.0 * difference * difference * beta * beta
            + 2.0 * (1.0 - c) * alpha * alpha
            - 4.0 * sum * alpha * beta * gamma
            + 2.0 * (1.0 - a) * gamma * gamma),
        4.0 * (difference * (1.0 - difference) * beta - (1.0 - sum) * alpha * gamma
            + 2.0 * c * alpha * alpha * beta),
        (difference - 1.0) * (difference - 1.0) - 4.0 * c * alpha * alpha,
    ];
    let mut poses = Vec::new();
    for v in quartic_roots(&quartic) {
        let below = 2.0 * (gamma - v * alpha);
        let u =
            ((difference - 1.0) * v * v - 2.0 * difference * beta * v + 1.0 + difference) / below;
        let first2 = b2 / (1.0 + v * v - 2.0 * v * beta);
        let is_before = u > 0.0 && v > 0.0 && first2 > 0.0 && u.is_finite();
        if !is_before {
            continue;
        }
        let first = first2.sqrt();
        let seen = [
            sights[0] * first,
            sights[1] * (first * u),
            sights[2] * (first * v),
        ];
        poses.extend(rigid(points, &seen));
    }
    poses
}

/// The pose that maps three points to three positions in front of the camera.
fn rigid(points: &[Vector3<f64>; 3], seen: &[Vector3<f64>; 3]) -> Option<Pose> {
    let axes = |p: &[Vector3<f64>; 3]| {
        let first = (p[1] - p[0]).try_normalize(1e-12)?;
        let third = first.cross(&(p[2] - p[0])).try_normalize(1e-12)?;
        Some(Matrix3::from_columns(&[first, third.cross(&first), third]))
    };
    let matrix = axes(seen)? * axes(points)?.transpose();
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    Some((rotation, points[0] - rotation.inverse() * seen[0]))
}

/// Probability that at least one sample has no outliers.
const CONFIDENCE: f64 = 0.999;

/// `N` different indices below `count`; `None` if there are fewer.
pub(super) fn sample<const N: usize>(rng: &mut ChaCha8Rng, count: usize) -> Option<[usize; N]> {
    if count < N {
        return None;
    }
    let mut chosen = [usize::MAX; N];
    let mut filled = 0;
    while filled < N {
        let index = rng.random_range(0..count);
        if !chosen.contains(&index) {
            chosen[filled] = index;
            filled += 1;
        }
    }
    Some(chosen)
}

/// The number of samples of `size` that is needed if `share` of the data are inliers, at most `most`.
pub(super) fn samples_needed(share: f64, size: i32, most: usize) -> usize {
    let clean = (0..size).fold(1.0, |product, _| product * share);
    if clean <= 0.0 {
        return most;
    }
    let needed = libm::log(1.0 - CONFIDENCE) / libm::log1p(-clean.min(1.0 - 1e-12));
    (needed.ceil() as usize).clamp(1, most)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn three_rays_give_the_true_pose_among_others(
            turn in prop::array::uniform3(-1.0f64..1.0),
            points in prop::array::uniform3(prop::array::uniform3(-1.0f64..1.0)),
        ) {
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            let center = rotation.inverse() * Vector3::new(0.3, -0.2, -4.0);
            let points = points.map(Vector3::from);
            let area = (points[1] - points[0]).cross(&(points[2] - points[0])).norm();
            prop_assume!(area > 0.3);
            let sights = points.map(|p| (rotation * (p - center)).normalize());
            let found = three_point(&sights, &points);
            let nearest = found.iter().map(|(_, c)| (c - center).norm()).fold(f64::INFINITY, f64::min);
            prop_assert!(nearest < 1e-2, "{nearest} of {}", found.len());
        }
    }
}
