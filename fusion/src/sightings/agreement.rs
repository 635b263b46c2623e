//! Agreement of two witnesses: whether their rays meet in the field, keypoint by keypoint.
//!
//! The number of pairs grows with the square of the witnesses. Most are of people outside the
//! field, and few agree. So rays that miss the field are removed before pairs are made, and a pair
//! is given up as soon as it can no longer agree. Comparability is computed only for the pairs that
//! a group needs.

use farfield_proto::id::ViewpointIndex;
use nalgebra::Vector3;

use super::rays::{SightedBody, SightedRay};

/// How far outside the field two rays may meet, metres: their meeting point is less certain than a
/// body's.
const FIELD_SLACK_M: f64 = 0.5;

/// Sine of the angle between two rays (4 degrees) below which they are not comparable: they meet
/// anywhere.
const PARALLEL_SINE: f64 = 0.07;

/// Far above the rounding error of a meeting point, metres.
const ROUNDING_M: f64 = 1e-6;

/// Far above the rounding error of a squared distance, as a factor.
const ROUNDING: f64 = 1.0 + 1e-9;

/// The agreements among the free witnesses of a pass. Witnesses with at least one agreement have
/// places from 0, in order.
pub(super) struct Agreements<'a> {
    witnesses: &'a [SightedBody],
    gates: &'a Gates,
    /// Per place, the index of its witness.
    witness_at: Vec<usize>,
    /// Per place, the places that agree with it in order, with the median distance of the rays in
    /// metres.
    agreeing: Vec<Vec<(usize, f64)>>,
    /// Per requested place, whether each place can be compared with it.
    comparable: Vec<Vec<bool>>,
}

impl<'a> Agreements<'a> {
    /// Among `free` (indices into `witnesses`, ascending).
    pub(super) fn among(witnesses: &'a [SightedBody], free: &[usize], gates: &'a Gates) -> Self {
        let in_field = in_field(witnesses, free, gates);
        let mut pairs = Vec::new();
        for (at, (a, first)) in in_field.iter().enumerate() {
            for (b, second) in &in_field[at + 1..] {
                if first.viewpoint == second.viewpoint {
                    continue;
                }
                if may_agree(first, second, gates) {
                    let distance_m = agreement_m(&witnesses[*a], &witnesses[*b], gates);
                    pairs.extend(distance_m.map(|distance_m| (*a, *b, distance_m)));
                }
            }
        }
        let mut witness_at: Vec<usize> = pairs.iter().flat_map(|&(a, b, _)| [a, b]).collect();
        witness_at.sort_unstable();
        witness_at.dedup();
        let mut place_of = vec![usize::MAX; witnesses.len()];
        for (place, &witness) in witness_at.iter().enumerate() {
            place_of[witness] = place;
        }
        // The pairs are in order, so those below each place come before those above it.
        let mut agreeing = vec![Vec::new(); witness_at.len()];
        for (a, b, distance_m) in pairs {
            let (a, b) = (place_of[a], place_of[b]);
            agreeing[a].push((b, distance_m));
            agreeing[b].push((a, distance_m));
        }
        Self {
            witnesses,
            gates,
            comparable: vec![Vec::new(); witness_at.len()],
            witness_at,
            agreeing,
        }
    }

    /// How many places there are: witnesses with an agreement.
    pub(super) fn len(&self) -> usize {
        self.witness_at.len()
    }

    /// Index of the witness at `place`.
    pub(super) fn witness(&self, place: usize) -> usize {
        self.witness_at[place]
    }

    /// The viewpoint of the witness at `place`.
    pub(super) fn viewpoint(&self, place: usize) -> ViewpointIndex {
        self.witnesses[self.witness_at[place]].viewpoint
    }

    /// The pairs of places that agree, the lower first, in order.
    pub(super) fn pairs(&self) -> Vec<(usize, usize)> {
        let of = |(a, others): (usize, &Vec<(usize, f64)>)| {
            let above = others.iter().filter(move |&&(b, _)| b > a);
            above.map(|&(b, _)| (a, b)).collect::<Vec<_>>()
        };
        self.agreeing.iter().enumerate().flat_map(of).collect()
    }

    /// The places that agree with `place`, in order, with the median distance of the rays in
    /// metres.
    pub(super) fn with(&self, place: usize) -> &[(usize, f64)] {
        &self.agreeing[place]
    }

    /// Per place, whether it shares enough with `place` for disagreement to count.
    pub(super) fn comparable(&mut self, place: usize) -> &[bool] {
        if self.comparable[place].is_empty() {
            let own = &self.witnesses[self.witness_at[place]];
            let others = self.witness_at.iter().map(|&other| &self.witnesses[other]);
            self.comparable[place] = others
                .map(|other| are_comparable(own, other, self.gates))
                .collect();
        }
        &self.comparable[place]
    }
}

/// The `free` witnesses that may agree with any, without rays that cannot meet another in the
/// field.
fn in_field(witnesses: &[SightedBody], free: &[usize], gates: &Gates) -> Vec<(usize, SightedBody)> {
    let bodies = free
        .iter()
        .map(|&w| (w, within_field(&witnesses[w], gates)));
    let enough = |body: &SightedBody| body.rays.iter().flatten().count() >= gates.min_keypoints;
    bodies.filter(|(_, body)| enough(body)).collect()
}

/// `body` without the rays that cannot meet another in the field.
fn within_field(body: &SightedBody, gates: &Gates) -> SightedBody {
    // Two rays that agree pass the point between them at half of their distance.
    let slack_m = FIELD_SLACK_M + gates.point_distance_m() + ROUNDING_M;
    let mut body = body.clone();
    for ray in &mut body.rays {
        *ray = ray.filter(|ray| gates.are_crossed_by(ray, slack_m));
    }
    body
}

/// Whether two witnesses agree.
pub(super) fn agree(a: &SightedBody, b: &SightedBody, gates: &Gates) -> bool {
    a.viewpoint != b.viewpoint && may_agree(a, b, gates) && agreement_m(a, b, gates).is_some()
}

/// A necessary condition of agreement, by rays through the field; false is certain.
fn may_agree(a: &SightedBody, b: &SightedBody, gates: &Gates) -> bool {
    let mut left = a.in_common(b).count();
    let mut agreeing = 0;
    for (p, q) in a.in_common(b) {
        if agreeing + left < gates.min_keypoints {
            return false;
        }
        left -= 1;
        let agree = || meeting(p, q, gates).is_some_and(|d| d <= gates.ray_distance_m);
        agreeing += usize::from(!are_far(p, q, gates) && agree());
    }
    agreeing >= gates.min_keypoints
}

/// Whether two rays certainly pass each other too far away; false is not certain.
fn are_far(p: &SightedRay, q: &SightedRay, gates: &Gates) -> bool {
    let normal = p.direction.cross(&q.direction);
    let across = (q.origin_m - p.origin_m).dot(&normal);
    across * across > gates.ray_distance_m.powi(2) * normal.norm_squared() * ROUNDING
}

/// The median distance of the rays of two witnesses, metres, if they agree.
fn agreement_m(a: &SightedBody, b: &SightedBody, gates: &Gates) -> Option<f64> {
    let mut distances: Vec<f64> = a
        .in_common(b)
        .filter_map(|(p, q)| meeting(p, q, gates))
        .collect();
    let agreeing = distances
        .iter()
        .filter(|&&d| d <= gates.ray_distance_m)
        .count();
    if agreeing < gates.min_keypoints {
        return None;
    }
    distances.sort_by(f64::total_cmp);
    let median_m = *distances.get(distances.len() / 2)?;
    (median_m <= gates.ray_distance_m).then_some(median_m)
}

/// Whether two witnesses share enough rays that are not parallel to be compared.
fn are_comparable(a: &SightedBody, b: &SightedBody, gates: &Gates) -> bool {
    let is_clear = |(p, q): &(&SightedRay, &SightedRay)| {
        p.direction.cross(&q.direction).norm() >= PARALLEL_SINE
    };
    let least = gates.min_keypoints.max(1);
    a.viewpoint != b.viewpoint && a.in_common(b).filter(is_clear).take(least).count() == least
}

/// The distance at which two rays pass each other; infinite if they do so behind a camera or
/// outside the field, `None` if they are too parallel.
fn meeting(p: &SightedRay, q: &SightedRay, gates: &Gates) -> Option<f64> {
    let normal = p.direction.cross(&q.direction);
    let sine = normal.norm();
    if sine < PARALLEL_SINE {
        return None;
    }
    let between = q.origin_m - p.origin_m;
    let along_p = between.cross(&q.direction).dot(&normal) / (sine * sine);
    let along_q = between.cross(&p.direction).dot(&normal) / (sine * sine);
    let middle: Vector3<f64> =
        0.5 * (p.origin_m + p.direction * along_p + q.origin_m + q.direction * along_q);
    let possible = along_p > 0.0 && along_q > 0.0 && gates.inside(&middle, FIELD_SLACK_M);
    Some(if possible {
        between.dot(&normal).abs() / sine
    } else {
        f64::INFINITY
    })
}

/// Limits for witnesses of one body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gates {
    /// Largest distance between two rays of one keypoint, metres.
    pub(crate) ray_distance_m: f64,
    /// Least keypoints that two witnesses must agree on.
    pub(crate) min_keypoints: usize,
    /// Lower corner of the field, world metres.
    pub(crate) field_min_m: Vector3<f64>,
    /// Upper corner of the field, world metres.
    pub(crate) field_max_m: Vector3<f64>,
}

impl Gates {
    /// The same without a field.
    pub(crate) fn anywhere(&self) -> Self {
        Self {
            field_min_m: Vector3::repeat(f64::NEG_INFINITY),
            field_max_m: Vector3::repeat(f64::INFINITY),
            ..*self
        }
    }

    /// Whether `point_m` is in the field grown by `slack_m`.
    pub(crate) fn inside(&self, point_m: &Vector3<f64>, slack_m: f64) -> bool {
        (0..3).all(|i| {
            point_m[i] >= self.field_min_m[i] - slack_m
                && point_m[i] <= self.field_max_m[i] + slack_m
        })
    }

    /// Whether `ray` passes through the field grown by `slack_m`.
    pub(crate) fn are_crossed_by(&self, ray: &SightedRay, slack_m: f64) -> bool {
        let (mut from, mut to) = (0.0_f64, f64::INFINITY);
        for i in 0..3 {
            let low = self.field_min_m[i] - slack_m - ray.origin_m[i];
            let high = self.field_max_m[i] + slack_m - ray.origin_m[i];
            let along = ray.direction[i];
            if along.abs() < f64::MIN_POSITIVE {
                // The ray is between these two planes everywhere or nowhere.
                if low > 0.0 || high < 0.0 {
                    return false;
                }
                continue;
            }
            let (first, second) = (low / along, high / along);
            from = from.max(first.min(second));
            to = to.min(first.max(second));
        }
        from <= to
    }

    /// Largest distance of a ray from its point: half of that between two rays.
    pub(crate) fn point_distance_m(&self) -> f64 {
        0.5 * self.ray_distance_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::sightings::fixture::{TestHall, gates, hall, hall_of_sixteen};
    use crate::sightings::rays::witnesses;

    /// What the cameras of `hall` sight of people at these places (x, y, height of the ground,
    /// metres).
    fn sighted(hall: &TestHall, places_m: &[[f64; 3]], noise: &mut Noise) -> Vec<SightedBody> {
        let bodies: Vec<Vec<Vector3<f64>>> = places_m
            .iter()
            .map(|&[x, y, ground_m]| {
                let body = standing(x, y, 1.7, noise);
                let raise = |p: Vector3<f64>| p + Vector3::z() * ground_m;
                body.into_iter().map(raise).collect()
            })
            .collect();
        let sightings = hall.sightings(&bodies, 2.0, noise);
        witnesses(&sightings, &hall.cameras, 17, hall.parameters.min_score)
    }

    /// `people` in the field, and `spectators` on stands around it.
    fn places_m(people: usize, spectators: usize, noise: &mut Noise) -> Vec<[f64; 3]> {
        let mut within = |from: f64, to: f64| from + (to - from) * noise.uniform();
        let mut all: Vec<[f64; 3]> = (0..people)
            .map(|_| [within(-3.5, 3.5), within(-2.5, 2.5), 0.0])
            .collect();
        all.extend((0..spectators).map(|i| {
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let row = within(0.0, 8.0);
            [within(-10.0, 10.0), side * (7.0 + row), 1.5 + row]
        }));
        all
    }

    /// The plain computation: the median distance of two witnesses' rays, metres, if they agree,
    /// and whether they are comparable.
    fn plain(a: &SightedBody, b: &SightedBody, gates: &Gates) -> (Option<f64>, bool) {
        let pairs = a.in_common(b);
        let mut distances: Vec<f64> = pairs.filter_map(|(p, q)| meeting(p, q, gates)).collect();
        if a.viewpoint == b.viewpoint || distances.len() < gates.min_keypoints {
            return (None, false);
        }
        distances.sort_by(f64::total_cmp);
        let median_m = distances[distances.len() / 2];
        let enough = distances[gates.min_keypoints - 1] <= gates.ray_distance_m;
        let agree = enough && median_m <= gates.ray_distance_m;
        (agree.then_some(median_m), true)
    }

    #[test]
    fn agreements_equal_those_of_all_pairs() {
        let (hall, mut noise) = (hall(), Noise(7));
        let gates = gates(&hall);
        let places_m = places_m(6, 12, &mut noise);
        let all = sighted(&hall, &places_m, &mut noise);
        let free: Vec<usize> = (0..all.len()).collect();
        let mut agreements = Agreements::among(&all, &free, &gates);
        let agreement = |a: usize, b: usize| plain(&all[a], &all[b], &gates);
        let expected = (0..all.len()).flat_map(|a| (a + 1..all.len()).map(move |b| (a, b)));
        let expected = expected.filter(|&(a, b)| agreement(a, b).0.is_some());
        let expected: Vec<_> = expected.collect();
        let witnesses = |(a, b)| (agreements.witness(a), agreements.witness(b));
        let pairs: Vec<_> = agreements.pairs().into_iter().map(witnesses).collect();
        assert_eq!(pairs, expected);
        assert!(pairs.len() > 6, "{}", pairs.len());
        for a in 0..agreements.len() {
            for &(b, distance_m) in agreements.with(a) {
                let plain = agreement(agreements.witness(a), agreements.witness(b)).0;
                assert_eq!(plain.map(f64::to_bits), Some(distance_m.to_bits()));
            }
            for (b, is_comparable) in agreements.comparable(a).to_vec().into_iter().enumerate() {
                let plain = agreement(agreements.witness(a), agreements.witness(b)).1;
                assert_eq!(is_comparable, plain, "{a} {b}");
            }
        }
    }

    #[test]
    fn spectators_outside_the_field_make_few_pairs() {
        let (hall, mut noise) = (hall_of_sixteen(), Noise(11));
        let gates = gates(&hall);
        let places_m = places_m(4, 56, &mut noise);
        let all = sighted(&hall, &places_m, &mut noise);
        let free: Vec<usize> = (0..all.len()).collect();
        let in_field = in_field(&all, &free, &gates);
        let (n, compared) = (all.len(), in_field.len() * in_field.len() / 2);
        assert!(n > 900, "{n} sightings");
        assert!(compared < n * n / 30, "{compared} pairs of {n} sightings");
    }
}
