//! Poster rejection: pictures of people are flat, and never move.
//!
//! A poster passes every test of a single tick: it has human proportions, and all cameras agree on
//! its place. But its keypoints lie in one plane and never move. A body with both properties is not
//! published until it moves or proves solid. If that takes too long, it is dropped and remembered,
//! so that it causes no more requests. A person who stands still is solid: a nose is 0.1 m in front
//! of the ears, and arms do not hang in the plane of the shoulders.

use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;
use farfield_proto::venue::parameters::BirthParameters;
use nalgebra::{Matrix3, Vector3};

use crate::identity::track::TentativeTick;
use crate::sightings::explanation::KnownBody;

/// Least keypoints, all seen over the whole time, for a test of flatness.
const MIN_KEYPOINTS: usize = 6;
/// Most ticks that give a place.
const MAX_SAMPLES: usize = 64;
/// How long a poster is remembered, seconds; then it is tested anew.
const REMEMBERED_S: f64 = 60.0;
/// Most posters that are remembered; the oldest are forgotten first.
const MAX_POSTERS: usize = 64;

/// Flatness and motion of a tentative body over its ticks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stillness {
    /// Distance of its keypoints from their plane, root mean square, metres of the average
    /// keypoint. A face is located several times as exactly as hips, and its depth distinguishes a
    /// head from a printed one.
    pub(crate) flat_m: f64,
    /// Median distance of its keypoints from their first places, metres.
    pub(crate) moved_m: f64,
}

impl Stillness {
    /// From `ticks`; `None` if they show too little. `relative_sigmas` are the expected errors of
    /// the keypoints over that of the average keypoint.
    pub(crate) fn from_ticks(ticks: &[TentativeTick], relative_sigmas: &[f64]) -> Option<Self> {
        let quarter = (ticks.len() / 4).max(1);
        let n = ticks.first()?.estimates.len();
        let (first, last) = (ticks.get(..quarter)?, ticks.get(ticks.len() - quarter..)?);
        let (mut places_m, mut moved_m) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for k in 0..n {
            let sigma = relative_sigmas.get(k).copied().unwrap_or(1.0);
            places_m.extend(place_m(ticks, k).map(|place_m| (place_m, sigma)));
            let ends = place_m(first, k).zip(place_m(last, k));
            moved_m.extend(ends.map(|(first, last)| (last - first).norm()));
        }
        if places_m.len() < MIN_KEYPOINTS {
            return None;
        }
        Some(Self {
            flat_m: off_plane_m(&places_m),
            moved_m: upper_median(moved_m)?,
        })
    }

    /// Whether it may be a poster.
    pub(crate) fn is_poster(&self, births: &BirthParameters) -> bool {
        self.flat_m < births.flat_m && self.moved_m < births.moved_m
    }
}

/// Where keypoint `k` was over `ticks`, where two viewpoints agreed on it, world metres. The median
/// of each coordinate, because passers-by displace keypoints for a while.
fn place_m(ticks: &[TentativeTick], k: usize) -> Option<Vector3<f64>> {
    let stride = ticks.len().div_ceil(MAX_SAMPLES).max(1);
    let seen = ticks.iter().step_by(stride);
    let seen = seen.filter_map(|tick| tick.estimates.get(k));
    let seen: Vec<Vector3<f64>> = seen
        .filter(|e| e.views >= 2 && e.weight > 0.0)
        .map(|e| e.position_m)
        .collect();
    let along = |axis: usize| upper_median(seen.iter().map(|p| p[axis]).collect());
    Some(Vector3::new(along(0)?, along(1)?, along(2)?))
}

/// Root mean square distance of `points` (place, relative sigma) from their best plane, metres,
/// each divided by its sigma.
///
/// ```text
///   min over n, c of  sum_k (n . (p_k - c) / s_k)^2 / K  =  least eigenvalue of the weighted scatter / K
/// ```
fn off_plane_m(points: &[(Vector3<f64>, f64)]) -> f64 {
    let weight = |sigma: f64| 1.0 / (sigma * sigma).max(1e-6);
    let total: f64 = points.iter().map(|(_, sigma)| weight(*sigma)).sum();
    let sum: Vector3<f64> = points.iter().map(|(p, sigma)| p * weight(*sigma)).sum();
    let middle = sum / total;
    let scatter: Matrix3<f64> = points
        .iter()
        .map(|(p, sigma)| (p - middle) * (p - middle).transpose() * weight(*sigma))
        .sum();
    (scatter.symmetric_eigenvalues().min().max(0.0) / points.len() as f64).sqrt()
}

/// A poster where it hangs.
#[derive(Debug, Clone)]
struct KnownPoster {
    body: KnownBody,
    found: Tick,
}

/// The posters found so far.
#[derive(Debug, Clone, Default)]
pub(crate) struct Posters {
    all: Vec<KnownPoster>,
}

impl Posters {
    /// Adds a poster with its keypoints (world metres, in the network's order).
    pub(crate) fn add(&mut self, keypoints_m: Vec<Vector3<f64>>, found: Tick) {
        if self.all.len() == MAX_POSTERS {
            self.all.remove(0);
        }
        let body = KnownBody { keypoints_m };
        self.all.push(KnownPoster { body, found });
    }

    /// Forgets old posters.
    pub(crate) fn forget(&mut self, now: Tick, rate_hz: f64) {
        self.all
            .retain(|poster| (now - poster.found) as f64 <= REMEMBERED_S * rate_hz);
    }

    /// The posters as bodies: they explain sightings as people do.
    pub(crate) fn bodies(&self) -> impl Iterator<Item = KnownBody> + '_ {
        self.all.iter().map(|poster| poster.body.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    use crate::body::fixture::{Noise, coco, joints, standing};
    use crate::body::ik::relative_sigmas;
    use crate::body::observed::KeypointEstimate;
    use crate::body::skeleton::{Pose, Proportions, Skeleton};
    use farfield_proto::keypoints::KeypointSet;
    use nalgebra::UnitQuaternion;

    const WINDOW: u32 = 12;
    /// Error per axis of the average keypoint that lasts for seconds, and that of single ticks,
    /// metres: what two views of a network leave (COCO's spreads, bias 0.4 and jitter 0.1 of them).
    const LASTING_M: f64 = 0.015;
    const PASSING_M: f64 = 0.004;

    /// `body` as seen in a fifth of a second.
    fn seen(body: &[Vector3<f64>], noise: &mut Noise, moving_m: f64) -> Vec<TentativeTick> {
        let sigmas = sigmas();
        let off = |(p, sigma): (&Vector3<f64>, &f64)| p + noise.vector(LASTING_M * sigma);
        let lasting: Vec<_> = body.iter().zip(&sigmas).map(off).collect();
        let tick = |i: u32| TentativeTick {
            tick: Tick(i64::from(i)),
            estimates: lasting
                .iter()
                .map(|p| KeypointEstimate {
                    position_m: p
                        + noise.vector(PASSING_M)
                        + Vector3::x() * (moving_m * f64::from(i) / f64::from(WINDOW)),
                    weight: 1.0,
                    views: 4,
                    ..KeypointEstimate::unsupported(Vector3::zeros(), 1.0)
                })
                .collect(),
        };
        (0..WINDOW).map(tick).collect()
    }

    /// A photograph of the body on a wall: flattened along x.
    fn printed(body: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        body.iter().map(|p| Vector3::new(2.0, p.y, p.z)).collect()
    }

    fn sigmas() -> Vec<f64> {
        relative_sigmas(&KeypointSet::coco17(), &BTreeMap::new())
    }

    fn is_poster(ticks: &[TentativeTick]) -> bool {
        let stillness = Stillness::from_ticks(ticks, &sigmas()).unwrap();
        stillness.is_poster(&BirthParameters::default())
    }

    #[test]
    fn a_picture_is_a_poster_and_a_person_is_not() {
        let mut noise = Noise(1);
        for _ in 0..200 {
            let body = standing(0.0, 0.0, 1.75, &mut noise);
            assert!(is_poster(&seen(&printed(&body), &mut noise, 0.0)));
            assert!(!is_poster(&seen(&body, &mut noise, 0.0)));
        }
    }

    #[test]
    fn a_person_standing_at_attention_is_solid() {
        let mut noise = Noise(2);
        let skeleton = Skeleton::new(&Proportions::from_stature(1.6));
        let pose = Pose::neutral(Vector3::new(0.0, 0.0, 0.9), UnitQuaternion::identity());
        let body = coco(&joints(&skeleton, &pose));
        for _ in 0..200 {
            assert!(!is_poster(&seen(&body, &mut noise, 0.0)));
        }
    }

    #[test]
    fn a_banner_that_is_carried_is_no_poster() {
        let mut noise = Noise(3);
        let body = standing(0.0, 0.0, 1.75, &mut noise);
        assert!(!is_poster(&seen(&printed(&body), &mut noise, 0.2)));
    }

    #[test]
    fn too_few_keypoints_give_no_stillness() {
        let mut noise = Noise(4);
        let body = standing(0.0, 0.0, 1.75, &mut noise);
        let ticks = seen(&body[..5], &mut noise, 0.0);
        assert_eq!(Stillness::from_ticks(&ticks, &sigmas()), None);
        assert_eq!(Stillness::from_ticks(&[], &sigmas()), None);
    }

    #[test]
    fn a_poster_is_forgotten_after_a_minute() {
        let mut posters = Posters::default();
        posters.add(vec![Vector3::zeros()], Tick(0));
        posters.forget(Tick(600), 10.0);
        assert_eq!(posters.bodies().count(), 1);
        posters.forget(Tick(601), 10.0);
        assert_eq!(posters.bodies().count(), 0);
    }
}
