//! The relative pose of two cameras, from their sights at the same moments.

use farfield_proto::order_statistics::upper_median;
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;

use super::essential::five_point;
use super::resection::{sample, samples_needed};

/// A pair of sights, first and second camera.
pub type TwoViews = (Vector3<f64>, Vector3<f64>);

/// The pose of the second camera relative to the first: `x_b = R x_a + t`, with |t| = 1.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativePose {
    /// R.
    pub rotation: UnitQuaternion<f64>,
    /// t.
    pub translation: Vector3<f64>,
    /// Indices of the pairs that agree and lie in front of both cameras.
    pub inliers: Vec<usize>,
    /// Mean loss, 0 (all fit exactly) to 1 (none fits).
    pub loss: f64,
    /// Median angle between the two sights of an agreeing pair, radians: small angles hardly determine depth.
    pub parallax_rad: f64,
}

impl RelativePose {
    /// t x R.
    pub fn essential(&self) -> Matrix3<f64> {
        self.translation.cross_matrix() * self.rotation.to_rotation_matrix().matrix()
    }
}

/// Sampson's distance of a pair to the essential matrix on the sphere: b'Ea / sqrt(|Ea|^2 + |E'b|^2), radians.
pub fn sampson_rad(e: &Matrix3<f64>, (a, b): &TwoViews) -> f64 {
    let (line_b, line_a) = (e * a, e.transpose() * b);
    let norm = (line_b.norm_squared() + line_a.norm_squared()).sqrt();
    b.dot(&line_b) / norm.max(1e-15)
}

/// The relative pose with which most pairs agree within `threshold_rad`, from at most `most` random samples.
///
/// `None` for fewer than 8 pairs, or if no sample gave a pose with points in front of both cameras.
pub fn relative_pose(
    pairs: &[TwoViews],
    threshold_rad: f64,
    most: usize,
    rng: &mut ChaCha8Rng,
) -> Option<RelativePose> {
    if pairs.len() < 8 {
        return None;
    }
    let mut best: Option<(f64, Matrix3<f64>)> = None;
    let mut needed = most;
    let mut tried = 0;
    while tried < needed {
        tried += 1;
        let chosen = sample::<5>(rng, pairs.len())?;
        let a = chosen.map(|i| pairs[i].0);
        let b = chosen.map(|i| pairs[i].1);
        for e in five_point(&a, &b) {
            let limit = best.as_ref().map_or(f64::INFINITY, |(loss, _)| *loss);
            let Some(loss) = summed_loss(&e, pairs, threshold_rad, limit) else {
                continue;
            };
            best = Some((loss, e));
            let share = 1.0 - loss / pairs.len() as f64;
            needed = needed.min(samples_needed(share, 5, most).max(10));
        }
    }
    let (_, e) = best?;
    let first = oriented(&e, pairs, threshold_rad)?;
    let refined = refined(&first, pairs, threshold_rad);
    let better = finished(refined, pairs, threshold_rad);
    better.filter(|pose| pose.inliers.len() >= 8)
}

/// The relative pose nearest to `start` (R, t) with which the pairs agree within about `threshold_rad`; `None` if fewer than 8
/// agree.
pub fn refined_pose(
    start: &(UnitQuaternion<f64>, Vector3<f64>),
    pairs: &[TwoViews],
    threshold_rad: f64,
) -> Option<RelativePose> {
    let pose = refined(start, pairs, threshold_rad);
    finished(pose, pairs, threshold_rad).filter(|pose| pose.inliers.len() >= 8)
}

/// Mean loss (0: all fit, 1: none) of the best of `samples` random essential matrices; faster than a pose. It stops after a
/// third of the samples if the loss is still above `hopeless`.
pub fn least_loss(
    pairs: &[TwoViews],
    threshold_rad: f64,
    samples: usize,
    hopeless: f64,
    rng: &mut ChaCha8Rng,
) -> f64 {
    let count = pairs.len() as f64;
    let mut best = count;
    for tried in 0..samples {
        if 3 * tried > samples && best > hopeless * count {
            break;
        }
        let Some(chosen) = sample::<5>(rng, pairs.len()) else {
            return 1.0;
        };
        let a = chosen.map(|i| pairs[i].0);
        let b = chosen.map(|i| pairs[i].1);
        for e in five_point(&a, &b) {
            if let Some(loss) = summed_loss(&e, pairs, threshold_rad, best) {
                best = loss;
            }
        }
    }
    best / count
}

/// Summed squared distance relative to the threshold, at most 1 each; `None` as soon as it exceeds `limit`.
fn summed_loss(
    e: &Matrix3<f64>,
    pairs: &[TwoViews],
    threshold_rad: f64,
    limit: f64,
) -> Option<f64> {
    let mut total = 0.0;
    for pair in pairs {
        let d = sampson_rad(e, pair) / threshold_rad;
        total += (d * d).min(1.0);
        if total >= limit {
            return None;
        }
    }
    Some(total)
}

type Pose = (UnitQuaternion<f64>, Vector3<f64>);

/// The one of the four poses of an essential matrix with most pairs in front of both cameras.
fn oriented(e: &Matrix3<f64>, pairs: &[TwoViews], threshold_rad: f64) -> Option<Pose> {
    let svd = e.svd(true, true);
    let (mut u, mut v_t) = (svd.u?, svd.v_t?);
    // nalgebra sorts the singular values, so the last one is zero; the signs make both matrices rotations.
    if u.determinant() < 0.0 {
        u = -u;
    }
    if v_t.determinant() < 0.0 {
        v_t = -v_t;
    }
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let t = u.column(2).into_owned();
    let mut best: Option<(usize, Pose)> = None;
    for r in [u * w * v_t, u * w.transpose() * v_t] {
        let r = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
        for t in [t, -t] {
            let count = agreeing(&(r, t), pairs, threshold_rad).count();
            if best.as_ref().is_none_or(|(most, _)| count > *most) {
                best = Some((count, (r, t)));
            }
        }
    }
    best.map(|(_, pose)| pose)
}

/// Pairs within the threshold and in front of both cameras, with the cosine of their parallax.
fn agreeing<'a>(
    (r, t): &Pose,
    pairs: &'a [TwoViews],
    threshold_rad: f64,
) -> impl Iterator<Item = (usize, f64)> + use<'a> {
    let e = t.cross_matrix() * r.to_rotation_matrix().matrix();
    let (r, t) = (*r, *t);
    pairs.iter().enumerate().filter_map(move |(i, pair)| {
        if sampson_rad(&e, pair).abs() > threshold_rad {
            return None;
        }
        // Depths along both sights: d_b b = d_a R a + t.
        let (ra, b) = (r * pair.0, pair.1);
        let cosine = ra.dot(&b);
        let sine2 = 1.0 - cosine * cosine;
        let depth_a = cosine * b.dot(&t) - ra.dot(&t);
        let depth_b = b.dot(&t) - cosine * ra.dot(&t);
        (depth_a > 0.0 && depth_b > 0.0 && sine2 > 0.0).then_some((i, cosine))
    })
}

fn finished(pose: Pose, pairs: &[TwoViews], threshold_rad: f64) -> Option<RelativePose> {
    let e = pose.1.cross_matrix() * pose.0.to_rotation_matrix().matrix();
    let loss = summed_loss(&e, pairs, threshold_rad, f64::INFINITY)? / pairs.len() as f64;
    let (inliers, cosines): (Vec<usize>, Vec<f64>) = agreeing(&pose, pairs, threshold_rad).unzip();
    let median = upper_median(cosines)?;
    Some(RelativePose {
        rotation: pose.0,
        translation: pose.1,
        inliers,
        loss,
        parallax_rad: libm::acos(median.clamp(-1.0, 1.0)),
    })
}

/// Damped Gauss-Newton steps on Sampson's distances, with Cauchy's weights.
fn refined(start: &Pose, pairs: &[TwoViews], threshold_rad: f64) -> Pose {
    const STEP: f64 = 1e-6;
    let scale = 0.5 * threshold_rad;
    let essential = |pose: &Pose| pose.1.cross_matrix() * pose.0.to_rotation_matrix().matrix();
    let cost = |pose: &Pose| {
        let e = essential(pose);
        let each = pairs.iter().map(|pair| {
            let d = sampson_rad(&e, pair) / scale;
            libm::log1p(d * d)
        });
        each.sum::<f64>()
    };
    let mut pose = *start;
    let mut current = cost(&pose);
    let mut damping = 1e-6;
    for _ in 0..15 {
        let steps: [Matrix3<f64>; 5] = std::array::from_fn(|k| {
            let mut by = SVector::<f64, 5>::zeros();
            by[k] = STEP;
            essential(&moved(&pose, &by))
        });
        let e = essential(&pose);
        let mut hessian = SMatrix::<f64, 5, 5>::zeros();
        let mut gradient = SVector::<f64, 5>::zeros();
        for pair in pairs {
            let d = sampson_rad(&e, pair) / scale;
            let weight = 1.0 / (1.0 + d * d);
            let by = SVector::<f64, 5>::from_fn(|k, _| {
                (sampson_rad(&steps[k], pair) / scale - d) / STEP
            });
            hessian += by * by.transpose() * weight;
            gradient += by * (d * weight);
        }
        for k in 0..5 {
            hessian[(k, k)] *= 1.0 + damping;
        }
        let Some(cholesky) = hessian.cholesky() else {
            break;
        };
        let next = moved(&pose, &-cholesky.solve(&gradient));
        let found = cost(&next);
        if found < current {
            let enough = current - found < 1e-9 * current;
            (pose, current) = (next, found);
            damping *= 0.1;
            if enough {
                break;
            }
        } else {
            damping = damping * 10.0 + 1e-6;
        }
    }
    pose
}

/// `pose` rotated by the first three numbers, with its translation moved on the sphere by the last two.
fn moved((r, t): &Pose, by: &SVector<f64, 5>) -> Pose {
    let aside = if t.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let first = t.cross(&aside).normalize();
    let second = t.cross(&first);
    (
        UnitQuaternion::from_scaled_axis(Vector3::new(by[0], by[1], by[2])) * r,
        (t + first * by[3] + second * by[4]).normalize(),
    )
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn a_third_of_wrong_pairs_does_not_change_the_pose() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.9, -0.2));
        let translation = Vector3::new(-0.8, 0.1, 0.5).normalize();
        let mut any = |size: f64| {
            Vector3::new(
                rng.random_range(-size..size),
                rng.random_range(-size..size),
                rng.random_range(-size..size),
            )
        };
        let pairs: Vec<TwoViews> = (0..200)
            .map(|i| {
                let a = any(1.0) + Vector3::new(0.0, 0.0, 3.0);
                let b = if i % 10 < 3 {
                    any(1.0) + Vector3::new(0.0, 0.0, 2.0)
                } else {
                    rotation * a + translation
                };
                ((a.normalize() + any(2e-4)).normalize(), b.normalize())
            })
            .collect();
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let found = relative_pose(&pairs, 1e-3, 500, &mut rng).unwrap();
        assert!(found.rotation.angle_to(&rotation) < 1e-3);
        assert!((found.translation - translation).norm() < 2e-3);
        assert!(
            (135..150).contains(&found.inliers.len()),
            "{}",
            found.inliers.len()
        );
    }
}
