//! Whether a camera would agree with another focal length, or turned a little: a similarity between where the others
//! say the keypoints of people are in its picture, and where it shows them.
//!
//! ```text
//!   u = s R(v - c) + c + t
//! ```
//!
//! v is the keypoint as the others triangulate it, seen through the calibration; u the one that is shown; c the principal
//! point. Weighted least squares, weights after Geman and `McClure`, so that single keypoints do not count.

pub(super) mod resection;

use farfield_proto::order_statistics::upper_median;
use nalgebra::{Matrix4, Vector2, Vector3, Vector4};

use super::geometry::{SightLines, nearest_point_m};
use super::samples::{Burst, SeenKeypoint};

/// Of the ticks of a burst every so many are compared.
const EVERY_TICKS: usize = 4;
/// Least keypoints that tell.
const MIN_POINTS: usize = 100;
/// Rounds of weighting.
const ROUNDS: usize = 8;

/// What a camera would have to be to agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Refit {
    /// True focal length as a factor of the calibrated one.
    pub(super) focal_factor: f64,
    /// By how much the camera is turned to a side, radians: the angle between where people are expected and where they are
    /// shown, in the middle of them. Not at the principal point, which may be far from anybody.
    pub(super) aside_rad: f64,
    /// By how much it is turned about where it looks, radians.
    pub(super) rolled_rad: f64,
    /// What is left of the median distance in the picture, as a share of what it is without.
    pub(super) ratio: f64,
    /// s R and t, pixels.
    similarity: Vector4<f64>,
    focal_px: f64,
}

impl Refit {
    /// The larger of both turns, radians.
    pub(super) fn turned_rad(&self) -> f64 {
        self.aside_rad.max(self.rolled_rad)
    }

    /// Where the calibration expects what is shown at this place, both normalised.
    pub(super) fn straightened(&self, shown: Vector2<f64>) -> Vector2<f64> {
        let [a, b, x, y] = self.similarity.into();
        let u = self.focal_px * shown - Vector2::new(x, y);
        let v = Vector2::new(a * u.x + b * u.y, a * u.y - b * u.x);
        v / ((a * a + b * b) * self.focal_px)
    }
}

/// Fits `camera` to what the cameras that are `right` show of the same people; `None` where fewer than two of these do,
/// or too few keypoints are compared.
pub(super) fn refit(
    bursts: &[&Burst],
    lines: &[SightLines],
    (camera, right): (usize, &[usize]),
) -> Option<Refit> {
    let own = &lines[camera];
    let pairs = pairs_px(bursts, lines, (camera, right));
    if pairs.len() < MIN_POINTS {
        return None;
    }
    let apart = |to: &dyn Fn(&Vector2<f64>) -> Vector2<f64>| {
        upper_median(pairs.iter().map(|(v, u)| (to(v) - u).norm()).collect())
    };
    let before_px = apart(&|v| *v)?;
    let mut similarity = Vector4::new(1.0, 0.0, 0.0, 0.0);
    for _ in 0..ROUNDS {
        let scale_px = apart(&|v| applied(&similarity, v))?.max(1.0);
        let (mut matrix, mut vector) = (Matrix4::zeros(), Vector4::zeros());
        for (v, u) in &pairs {
            let off2 = (applied(&similarity, v) - u).norm_squared() / (scale_px * scale_px);
            let weight = 1.0 / ((1.0 + off2) * (1.0 + off2));
            for (row, value) in [
                (Vector4::new(v.x, -v.y, 1.0, 0.0), u.x),
                (Vector4::new(v.y, v.x, 0.0, 1.0), u.y),
            ] {
                matrix += weight * row * row.transpose();
                vector += weight * value * row;
            }
        }
        similarity = matrix.cholesky()?.solve(&vector);
    }
    let after_px = apart(&|v| applied(&similarity, v))?;
    let (a, b) = (similarity.x, similarity.y);
    let middle_of = |axis: usize| upper_median(pairs.iter().map(|(v, _)| v[axis]).collect());
    let middle = Vector2::new(middle_of(0)?, middle_of(1)?);
    let ray = |at: Vector2<f64>| at.push(own.mean_focal_px());
    Some(Refit {
        focal_factor: libm::hypot(a, b),
        aside_rad: ray(applied(&similarity, &middle)).angle(&ray(middle)),
        rolled_rad: libm::atan2(b, a).abs(),
        ratio: after_px / before_px.max(f64::MIN_POSITIVE),
        similarity,
        focal_px: own.mean_focal_px(),
    })
}

fn applied(similarity: &Vector4<f64>, v: &Vector2<f64>) -> Vector2<f64> {
    let [a, b, x, y] = (*similarity).into();
    Vector2::new(a * v.x - b * v.y + x, b * v.x + a * v.y + y)
}

/// Where the others say a keypoint is, and where `camera` shows it, pixels from its principal point.
fn pairs_px(
    bursts: &[&Burst],
    lines: &[SightLines],
    (camera, right): (usize, &[usize]),
) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let own = &lines[camera];
    let mut pairs = Vec::new();
    for_each_body(bursts, lines, (camera, right), |expected_px, shown| {
        let both = expected_px.iter().zip(shown);
        let both = both.filter_map(|(v, u)| Some((v.as_ref()?, u.as_ref()?)));
        pairs.extend(both.map(|(v, u)| (v - own.principal_px(), u - own.principal_px())));
    });
    pairs
}

/// Calls `with` for what `camera` shows of a person at some tick, by keypoint, undistorted pixels: where the others that are
/// `right` say it is, and where it is shown.
pub(super) fn for_each_body(
    bursts: &[&Burst],
    lines: &[SightLines],
    (camera, right): (usize, &[usize]),
    mut with: impl FnMut(&[Option<Vector2<f64>>], &[Option<Vector2<f64>>]),
) {
    let own = &lines[camera];
    let is_seen = |seen: &SeenKeypoint| seen.score > 0.0;
    let pixel = |seen: &SeenKeypoint| Vector2::from(seen.pixel.map(f64::from));
    for burst in bursts {
        for trail in burst.trails.iter().filter(|trail| trail.camera == camera) {
            let others = burst.trails.iter().filter(|other| {
                other.person == trail.person
                    && other.camera != camera
                    && right.contains(&other.camera)
            });
            let others: Vec<_> = others.collect();
            for tick in (0..trail.len()).step_by(EVERY_TICKS) {
                let Some((_, seen)) = trail.at(tick) else {
                    continue;
                };
                let expected_px = |k: usize| {
                    let directions = others.iter().filter_map(|other| {
                        let theirs = other.at(tick)?.1.get(k).filter(|seen| is_seen(seen))?;
                        let lines = &lines[other.camera];
                        Some((&lines.center_m, lines.direction(theirs.pixel)))
                    });
                    let directions: Vec<(&Vector3<f64>, Vector3<f64>)> = directions.collect();
                    let enough = directions.len() >= 2;
                    let point_m = enough.then(|| nearest_point_m(directions.into_iter()));
                    Some(own.project(&point_m.flatten()?)?.0)
                };
                let expected_px: Vec<_> = (0..seen.len()).map(expected_px).collect();
                let shown: Vec<_> = seen.iter().map(|s| is_seen(s).then(|| pixel(s))).collect();
                with(&expected_px, &shown);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_a_similarity_shows_is_straightened_back(
            scale in 0.5..2.0_f64,
            turn_rad in -1.0..1.0_f64,
            shift_px in prop::array::uniform2(-300.0..300.0_f64),
            place in prop::array::uniform2(-0.8..0.8_f64),
        ) {
            let focal_px = 900.0;
            let (a, b) = (scale * turn_rad.cos(), scale * turn_rad.sin());
            let similarity = Vector4::new(a, b, shift_px[0], shift_px[1]);
            let refit = Refit {
                focal_factor: scale,
                aside_rad: 0.0,
                rolled_rad: turn_rad.abs(),
                ratio: 0.0,
                similarity,
                focal_px,
            };
            let place = Vector2::from(place);
            let shown = applied(&similarity, &(focal_px * place)) / focal_px;
            prop_assert!((refit.straightened(shown) - place).norm() < 1e-9);
        }
    }
}
