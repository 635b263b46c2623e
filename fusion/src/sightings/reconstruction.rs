//! Reconstruction of the body that a group of witnesses sees, if there is one.

use nalgebra::{Matrix3, Vector3};

use crate::sightings::rays::{SightedBody, SightedRay};

/// Least angle between two rays of a keypoint, radians (8 degrees): below it, a pixel of noise
/// moves the point along the rays by more than a limb.
const MIN_ANGLE_RAD: f64 = 0.14;

/// Distance below which a camera gets no more weight for being near, metres.
const NEAREST_M: f64 = 0.1;

/// Sine of an angle between two rays below which their distance is inaccurate.
const MIN_GAP_SINE: f64 = 1e-3;

/// More than rounding takes from a distance, as a factor.
const ROUNDING: f64 = 1.0 - 1e-9;

/// Share of the best support that rays meeting at another place may have: with more, neither place
/// is used.
const MAX_RIVAL: f64 = 0.8;

/// Distance up to which two meetings are one place, in gates: rays of one keypoint do not all meet
/// at one point.
const SAME_PLACE_GATES: f64 = 2.0;

/// A keypoint in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SightedKeypoint {
    /// World metres.
    pub position_m: Vector3<f64>,
    /// Mean score of its peaks, 0 to 1.
    pub score: f64,
    /// How many viewpoints agree on it.
    pub views: u16,
}

/// The keypoints that a group of witnesses agrees on.
#[derive(Debug, Clone)]
pub(crate) struct Reconstruction {
    /// Indices of the witnesses that agree, ascending.
    pub(crate) members: Vec<usize>,
    /// Per keypoint of the network.
    pub(crate) keypoints_m: Vec<Option<SightedKeypoint>>,
    /// Agreeing rays, weighted by their distance from their point.
    pub(crate) support: f64,
}

/// Triangulates the common keypoints of `members`. Drops rays that pass farther than `gate_m` from
/// the point, and then members with fewer than `min_keypoints` rays.
///
/// `None` if fewer than two members, or fewer than `min_keypoints` points, remain.
pub(crate) fn reconstruct(
    witnesses: &[SightedBody],
    members: &[usize],
    gate_m: f64,
    min_keypoints: usize,
) -> Option<Reconstruction> {
    let mut members = members.to_vec();
    let n_keypoints = witnesses.get(*members.first()?)?.rays.len();
    let bundles: Vec<RayBundle<'_>> = (0..n_keypoints)
        .map(|k| RayBundle::new(witnesses, &members, k))
        .collect();
    loop {
        if members.len() < 2 {
            return None;
        }
        let points = bundles.iter();
        let points = points.map(|bundle| bundle.agreed_point(&members, gate_m));
        let points: Vec<Option<SightedKeypoint>> = points.collect();
        let worst = members
            .iter()
            .enumerate()
            .map(|(at, &m)| (at, member_rays(&witnesses[m], &points, gate_m)))
            .min_by_key(|&(_, agreeing)| agreeing)?;
        if worst.1 < min_keypoints {
            members.remove(worst.0);
            continue;
        }
        return Some(summary(witnesses, members, points, gate_m));
    }
}

/// How many rays of `witness` pass within `gate_m` of their points.
fn member_rays(witness: &SightedBody, points: &[Option<SightedKeypoint>], gate_m: f64) -> usize {
    distances(witness, points).filter(|&d| d <= gate_m).count()
}

/// Distances of the rays of `witness` from the points that exist.
pub(crate) fn distances<'a>(
    witness: &'a SightedBody,
    points: &'a [Option<SightedKeypoint>],
) -> impl Iterator<Item = f64> + 'a {
    witness
        .rays
        .iter()
        .zip(points)
        .filter_map(|(ray, point)| Some(ray.as_ref()?.distance_m(&point.as_ref()?.position_m)))
}

fn summary(
    witnesses: &[SightedBody],
    members: Vec<usize>,
    keypoints_m: Vec<Option<SightedKeypoint>>,
    gate_m: f64,
) -> Reconstruction {
    let support = members
        .iter()
        .flat_map(|&m| distances(&witnesses[m], &keypoints_m))
        .map(|d| (1.0 - (d / gate_m).powi(2)).max(0.0))
        .sum();
    Reconstruction {
        members,
        keypoints_m,
        support,
    }
}

/// The point where rays approximately meet.
struct RayMeeting {
    point_m: Vector3<f64>,
    /// Largest distance of a ray from the point, metres.
    worst_m: f64,
    /// Sine of the widest angle between two of the rays.
    sine: f64,
}

impl RayMeeting {
    /// Flat angles make rays pass near each other in any case, so they count less.
    fn error_ratio(&self) -> f64 {
        self.worst_m / self.sine
    }
}

/// Geometry of two rays.
#[derive(Clone, Copy)]
struct RayPair {
    /// Sine of their angle.
    sine: f64,
    /// Least distance between their lines, metres; 0 if nearly parallel.
    gap_m: f64,
}

impl RayPair {
    fn new(p: &SightedRay, q: &SightedRay) -> Self {
        let normal = p.direction.cross(&q.direction);
        let sine = normal.norm();
        let across = (q.origin_m - p.origin_m).dot(&normal).abs();
        Self {
            sine,
            gap_m: if sine < MIN_GAP_SINE {
                0.0
            } else {
                across / sine
            },
        }
    }
}

/// The rays of one keypoint, with the terms that their subsets share.
struct RayBundle<'a> {
    rays: Vec<&'a SightedRay>,
    /// Per ray its member, ascending.
    of: Vec<usize>,
    /// P = I - d d' of each ray.
    across: Vec<Matrix3<f64>>,
    /// Score times P of each ray, and that times its origin.
    weighted: Vec<(Matrix3<f64>, Vector3<f64>)>,
    /// Per ray, its pairs with the earlier ones.
    pairs: Vec<Vec<RayPair>>,
}

impl<'a> RayBundle<'a> {
    /// The rays of keypoint `k` of `members` (ascending).
    fn new(witnesses: &'a [SightedBody], members: &[usize], k: usize) -> Self {
        let seen = members
            .iter()
            .filter_map(|&m| Some((m, witnesses[m].rays[k].as_ref()?)));
        let (of, rays): (Vec<usize>, Vec<&SightedRay>) = seen.unzip();
        let across =
            |ray: &&SightedRay| Matrix3::identity() - ray.direction * ray.direction.transpose();
        let across: Vec<Matrix3<f64>> = rays.iter().map(across).collect();
        let weighted = rays.iter().zip(&across).map(|(ray, across)| {
            let p = across * ray.score;
            (p, p * ray.origin_m)
        });
        let pairs = |(n, ray): (usize, &&SightedRay)| {
            let before = rays[..n].iter();
            before.map(|other| RayPair::new(other, ray)).collect()
        };
        Self {
            weighted: weighted.collect(),
            pairs: rays.iter().enumerate().map(pairs).collect(),
            across,
            of,
            rays,
        }
    }

    /// The point that at least two rays of `members` agree on. Of more than two, the ray whose
    /// removal gives the best agreement is dropped, until all pass within `gate_m`. If no more
    /// remain than were dropped, the rays may also meet at another place: see
    /// [`Self::best_supported`].
    fn agreed_point(&self, members: &[usize], gate_m: f64) -> Option<SightedKeypoint> {
        let all: Vec<usize> = (0..self.rays.len())
            .filter(|&r| members.contains(&self.of[r]))
            .collect();
        let mut kept = all.clone();
        let mut best = self.meeting(&kept, self.most(&kept, |pair| pair.sine))?;
        while best.worst_m > gate_m {
            if kept.len() == 2 {
                break;
            }
            let (meeting, dropped) = self.best_without_one(&kept)?;
            best = meeting;
            kept.remove(dropped);
        }
        if 2 * kept.len() <= all.len() {
            return self.best_supported(&all, gate_m);
        }
        (best.worst_m <= gate_m).then(|| self.keypoint(&kept, &best))
    }

    fn keypoint(&self, kept: &[usize], meeting: &RayMeeting) -> SightedKeypoint {
        let score = kept.iter().map(|&r| self.rays[r].score).sum::<f64>() / kept.len() as f64;
        SightedKeypoint {
            position_m: meeting.point_m,
            score,
            views: kept.len() as u16,
        }
    }

    /// The best supported of all places where two rays of `all` meet, by rays within `gate_m`;
    /// `None` if a distant place has nearly as much support. Support is a sum of squared scores,
    /// because an unsure network is wrong more often.
    fn best_supported(&self, all: &[usize], gate_m: f64) -> Option<SightedKeypoint> {
        let (mut best, mut second): (Option<(f64, SightedKeypoint)>, f64) = (None, 0.0);
        let mut kept = Vec::with_capacity(all.len());
        for (n, &r) in all.iter().enumerate() {
            for &other in &all[..n] {
                let pair = self.pairs[r][other];
                let Some(pair_m) = self.meeting(&[other, r], pair.sine) else {
                    continue;
                };
                if pair_m.worst_m > gate_m {
                    continue;
                }
                let passes = |&r: &usize| self.rays[r].distance_m(&pair_m.point_m) <= gate_m;
                kept.clear();
                kept.extend(all.iter().copied().filter(passes));
                let Some(meeting) = self.meeting(&kept, self.most(&kept, |pair| pair.sine)) else {
                    continue;
                };
                let support: f64 = kept.iter().map(|&r| self.rays[r].score.powi(2)).sum();
                let place_m = meeting.point_m;
                let is_same = |(_, known): &(f64, SightedKeypoint)| {
                    (known.position_m - place_m).norm() <= SAME_PLACE_GATES * gate_m
                };
                let is_better = best.as_ref().is_none_or(|(most, _)| support > *most);
                if best.as_ref().is_some_and(is_same) && !is_better {
                    continue;
                }
                if is_better {
                    let known = best.replace((support, self.keypoint(&kept, &meeting)));
                    second = known
                        .filter(|known| !is_same(known))
                        .map_or(second, |known| known.0);
                } else {
                    second = second.max(support);
                }
            }
        }
        best.filter(|(most, _)| second <= MAX_RIVAL * most)
            .map(|(_, keypoint)| keypoint)
    }

    /// The meeting of the rays `kept` with the least error ratio when one is left out, and the
    /// place of that one; of equal ones the first.
    ///
    /// One of two rays passes any point at half their distance or more. So if two rays are far
    /// apart, most of the others need not be tried: removing them would keep those two.
    fn best_without_one(&self, kept: &[usize]) -> Option<(RayMeeting, usize)> {
        let sines = self.most_without_each(kept, |pair| pair.sine);
        let gaps_m = self.most_without_each(kept, |pair| pair.gap_m);
        let least_error_ratio = |place: usize| ROUNDING * 0.5 * gaps_m[place] / sines[place];
        let mut order: Vec<usize> = (0..kept.len()).collect();
        order.sort_by(|&x, &y| {
            least_error_ratio(x)
                .total_cmp(&least_error_ratio(y))
                .then(x.cmp(&y))
        });
        let mut others = Vec::with_capacity(kept.len());
        let mut best: Option<(RayMeeting, usize)> = None;
        for dropped in order {
            let bound = best.as_ref().map(|(meeting, _)| meeting.error_ratio());
            if bound.is_some_and(|error_ratio| least_error_ratio(dropped) > error_ratio) {
                break;
            }
            others.clear();
            others.extend_from_slice(&kept[..dropped]);
            others.extend_from_slice(&kept[dropped + 1..]);
            let Some(meeting) = self.meeting(&others, sines[dropped]) else {
                continue;
            };
            let is_better = best.as_ref().is_none_or(|(best, place)| {
                let by_error_ratio = meeting.error_ratio().total_cmp(&best.error_ratio());
                by_error_ratio.then(dropped.cmp(place)).is_lt()
            });
            if is_better {
                best = Some((meeting, dropped));
            }
        }
        best
    }

    /// The maximum of a nonnegative quantity over pairs of the rays `of` these indices, ascending.
    fn most(&self, of: &[usize], what: impl Fn(&RayPair) -> f64) -> f64 {
        let before = |(n, &r): (usize, &usize)| {
            let others = of[..n].iter();
            others.fold(0.0_f64, |most, &other| {
                most.max(what(&self.pairs[r][other]))
            })
        };
        of.iter().enumerate().map(before).fold(0.0, f64::max)
    }

    /// [`Self::most`] without each of the rays.
    fn most_without_each(&self, of: &[usize], what: impl Fn(&RayPair) -> f64) -> Vec<f64> {
        let (mut most, mut ends) = (0.0, [0, 0]);
        for (n, &r) in of.iter().enumerate() {
            for (before, &other) in of[..n].iter().enumerate() {
                let own = what(&self.pairs[r][other]);
                if own > most {
                    (most, ends) = (own, [before, n]);
                }
            }
        }
        let mut all = vec![most; of.len()];
        // Only without one of that pair another pair has the maximum.
        for end in ends {
            let mut others = of.to_vec();
            others.remove(end);
            all[end] = self.most(&others, &what);
        }
        all
    }

    /// The nearest point to the rays `of` these indices, ascending; `sine` is that of their widest
    /// angle. `None` if they are too few or nearly parallel, or meet behind a camera.
    fn meeting(&self, of: &[usize], sine: f64) -> Option<RayMeeting> {
        if sine < libm::sin(MIN_ANGLE_RAD) {
            return None;
        }
        let weighted = of.iter().map(|&r| self.weighted[r]);
        let even = nearest_point(weighted)?;
        // An error of a pixel is an error in metres that grows with the distance, so near cameras
        // decide. One repetition gives the distances accurately enough.
        let weighted = of.iter().map(|&r| {
            let ray = self.rays[r];
            let trust = ray.depth_m(&even).max(NEAREST_M).powi(-2);
            let p = self.across[r] * (ray.score * trust);
            (p, p * ray.origin_m)
        });
        let point_m = nearest_point(weighted)?;
        let rays = of.iter().map(|&r| self.rays[r]);
        let in_front = rays.clone().all(|ray| ray.depth_m(&point_m) > 0.0);
        let worst_m = rays.map(|ray| ray.distance_m(&point_m)).fold(0.0, f64::max);
        in_front.then_some(RayMeeting {
            point_m,
            worst_m,
            sine,
        })
    }
}

/// The point with the least weighted sum of squared distances from rays, from w P and w P o.
///
/// ```text
///   (sum w P) x = sum w P o,   P = I - d d'      w = score times trust
/// ```
fn nearest_point(
    weighted: impl Iterator<Item = (Matrix3<f64>, Vector3<f64>)>,
) -> Option<Vector3<f64>> {
    let mut a = Matrix3::zeros();
    let mut b = Vector3::zeros();
    for (p, p_origin) in weighted {
        a += p;
        b += p_origin;
    }
    let x = a.cholesky()?.solve(&b);
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::sightings::fixture::{hall, hall_of_sixteen};
    use crate::sightings::rays::witnesses;

    proptest! {
        #[test]
        fn the_dropped_ray_equals_that_of_trying_all(
            seed in any::<u64>(), n in 3usize..16, wild in 0usize..4,
        ) {
            let (hall, mut noise) = (hall_of_sixteen(), Noise(seed));
            let bodies = [standing(0.5, -0.5, 1.7, &mut noise), standing(1.5, 1.0, 1.8, &mut noise)];
            // The first `wild` viewpoints see another body.
            let sighting = |camera: usize, noise: &mut Noise| {
                hall.sighting(camera, &bodies[usize::from(camera < wild)], 5.0, noise)
            };
            let sightings: Vec<_> = (0..n).map(|camera| sighting(camera, &mut noise)).collect();
            let all = witnesses(&sightings, &hall.cameras, 17, 0.1);
            let members: Vec<usize> = (0..all.len()).collect();
            let bundle = RayBundle::new(&all, &members, 5);
            let kept: Vec<usize> = (0..bundle.rays.len()).collect();
            prop_assume!(kept.len() > 2);
            let without = (0..kept.len()).filter_map(|dropped| {
                let mut others = kept.clone();
                others.remove(dropped);
                let meeting = bundle.meeting(&others, bundle.most(&others, |pair| pair.sine))?;
                Some((meeting, dropped))
            });
            let expected = without.min_by(|a, b| a.0.error_ratio().total_cmp(&b.0.error_ratio()));
            let bits = |(meeting, dropped): (RayMeeting, usize)| {
                (meeting.point_m.map(f64::to_bits), meeting.worst_m.to_bits(), dropped)
            };
            prop_assert_eq!(bundle.best_without_one(&kept).map(bits), expected.map(bits));
        }
    }

    #[test]
    fn of_two_contradicting_pairs_the_surer_wins_and_equal_ones_lose() {
        const KNEE: usize = 13;
        let (hall, mut noise) = (hall(), Noise(3));
        let standing = standing(0.5, -0.3, 1.7, &mut noise);
        let mut sitting = standing.clone();
        sitting[KNEE] += Vector3::new(0.4, 0.1, 0.35);
        let mut knee_m = |scores: [f32; 2]| {
            let sighting = |camera: usize| {
                let body = [&sitting, &standing][camera % 2];
                let mut sighting = hall.sighting(camera, body, 1.0, &mut noise);
                if let Some(peak) = &mut sighting.keypoints[KNEE] {
                    peak.score = scores[camera % 2];
                }
                sighting
            };
            let sightings: Vec<_> = (0..4).map(sighting).collect();
            let all = witnesses(&sightings, &hall.cameras, 17, 0.1);
            let members: Vec<usize> = (0..all.len()).collect();
            let found = reconstruct(&all, &members, 0.06, 4).unwrap();
            found.keypoints_m[KNEE].map(|found| found.position_m)
        };
        for (scores, knee) in [([0.9, 0.6], sitting[KNEE]), ([0.6, 0.9], standing[KNEE])] {
            let found_m = knee_m(scores).unwrap();
            assert!((found_m - knee).norm() < 0.05, "{scores:?}: {found_m}");
        }
        assert_eq!(knee_m([0.8, 0.8]), None);
    }
}
