//! What two witnesses say about each other: do their rays meet, keypoint by keypoint, in the field?
//!
//! There are as many pairs as witnesses squared, most of them of people outside the field, and few agree. So rays that
//! miss the field are left out before any pair is made, a pair is given up as soon as it cannot agree any more, and
//! whether two disagree or cannot be compared is found out only of those that a group asks about.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::gates::Gates;
use super::rays::{SightedBody, SightedRay};

/// How far outside the field two rays may meet, metres: their meeting point is less certain than
/// a body's.
const FIELD_SLACK_M: f64 = 0.5;

/// Sine of the angle between two rays, below which (4 degrees) they say nothing about each other:
/// they meet anywhere.
const PARALLEL_SINE: f64 = 0.07;

/// Far more than what rounding moves a meeting point by, metres.
const ROUNDING_M: f64 = 1e-6;

/// What two witnesses say about each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum RayAgreement {
    /// Too little in common to tell.
    Unknown,
    /// The rays pass each other.
    Disagree,
    /// Median distance of the rays, metres.
    Agree(f64),
}

/// The agreements among the free witnesses of a pass.
pub(super) struct Agreements<'a> {
    witnesses: &'a [SightedBody],
    gates: &'a Gates,
    /// Per witness, who agrees with it and by which median distance, metres.
    agreeing: BTreeMap<usize, BTreeMap<usize, f64>>,
    /// Of pairs that do not agree, the lower first: whether they were comparable.
    comparable: BTreeMap<(usize, usize), bool>,
    /// How many pairs were looked at.
    pub(super) compared: usize,
}

impl<'a> Agreements<'a> {
    /// Among `free` (indices into `witnesses`, ascending).
    pub(super) fn among(witnesses: &'a [SightedBody], free: &[usize], gates: &'a Gates) -> Self {
        let mut all = Self {
            witnesses,
            gates,
            agreeing: BTreeMap::new(),
            comparable: BTreeMap::new(),
            compared: 0,
        };
        let in_field: Vec<(usize, SightedBody)> = free
            .iter()
            .map(|&w| (w, within_field(&witnesses[w], gates)))
            .filter(|(_, body)| body.rays.iter().flatten().count() >= gates.min_keypoints)
            .collect();
        for (at, (a, first)) in in_field.iter().enumerate() {
            for (b, second) in &in_field[at + 1..] {
                if first.viewpoint == second.viewpoint {
                    continue;
                }
                all.compared += 1;
                if !may_agree(first, second, gates) {
                    continue;
                }
                let verdict = verdict(&witnesses[*a], &witnesses[*b], gates);
                if let RayAgreement::Agree(distance_m) = verdict {
                    all.agreeing.entry(*a).or_default().insert(*b, distance_m);
                    all.agreeing.entry(*b).or_default().insert(*a, distance_m);
                }
            }
        }
        all
    }

    /// The pairs that agree, the lower first, in order.
    pub(super) fn pairs(&self) -> Vec<(usize, usize)> {
        let of = |(&a, others): (&usize, &BTreeMap<usize, f64>)| {
            let above = others.range(a + 1..);
            above.map(|(&b, _)| (a, b)).collect::<Vec<_>>()
        };
        self.agreeing.iter().flat_map(of).collect()
    }

    /// Who agrees with `witness`, in order.
    pub(super) fn with(&self, witness: usize) -> impl Iterator<Item = usize> {
        self.agreeing
            .get(&witness)
            .into_iter()
            .flat_map(|others| others.keys().copied())
    }

    /// What `a` and `b` say about each other.
    pub(super) fn between(&mut self, a: usize, b: usize) -> RayAgreement {
        let agreed = self.agreeing.get(&a).and_then(|others| others.get(&b));
        if let Some(&distance_m) = agreed {
            return RayAgreement::Agree(distance_m);
        }
        let (witnesses, gates) = (self.witnesses, self.gates);
        let (low, high) = (a.min(b), a.max(b));
        let compare = || verdict(&witnesses[low], &witnesses[high], gates) != RayAgreement::Unknown;
        let is_comparable = *self.comparable.entry((low, high)).or_insert_with(compare);
        if is_comparable {
            RayAgreement::Disagree
        } else {
            RayAgreement::Unknown
        }
    }

    /// Whether `a` and `b` are of one viewpoint.
    pub(super) fn are_of_one_viewpoint(&self, a: usize, b: usize) -> bool {
        self.witnesses[a].viewpoint == self.witnesses[b].viewpoint
    }
}

/// `body` without the rays that can meet no other where it counts.
fn within_field(body: &SightedBody, gates: &Gates) -> SightedBody {
    // Two rays that agree pass the point between them at half of their distance.
    let slack_m = FIELD_SLACK_M + gates.point_distance_m() + ROUNDING_M;
    let mut body = body.clone();
    for ray in &mut body.rays {
        *ray = ray.filter(|ray| gates.are_crossed_by(ray, slack_m));
    }
    body
}

/// Whether two witnesses may agree, by their rays through the field. (What is left out here does not agree.)
fn may_agree(a: &SightedBody, b: &SightedBody, gates: &Gates) -> bool {
    let mut left = a.in_common(b).count();
    let mut agreeing = 0;
    for (p, q) in a.in_common(b) {
        if agreeing + left < gates.min_keypoints {
            return false;
        }
        left -= 1;
        let distance_m = meeting(p, q, gates);
        agreeing += usize::from(distance_m.is_some_and(|d| d <= gates.ray_distance_m));
    }
    agreeing >= gates.min_keypoints
}

/// Compares two witnesses by the distances of their rays, keypoint by keypoint.
fn verdict(a: &SightedBody, b: &SightedBody, gates: &Gates) -> RayAgreement {
    if a.viewpoint == b.viewpoint {
        return RayAgreement::Unknown;
    }
    let mut distances: Vec<f64> = a
        .in_common(b)
        .filter_map(|(p, q)| meeting(p, q, gates))
        .collect();
    if distances.is_empty() || distances.len() < gates.min_keypoints {
        return RayAgreement::Unknown;
    }
    let agreeing = distances
        .iter()
        .filter(|&&d| d <= gates.ray_distance_m)
        .count();
    distances.sort_by(f64::total_cmp);
    let median_m = distances[distances.len() / 2];
    if median_m <= gates.ray_distance_m && agreeing >= gates.min_keypoints {
        RayAgreement::Agree(median_m)
    } else {
        RayAgreement::Disagree
    }
}

/// The distance at which two rays pass each other; infinite when they do so behind a camera or
/// outside the field, `None` when they are too parallel to tell.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::sightings::fixture::{TestHall, hall, hall_of_sixteen};
    use crate::sightings::rays::witnesses;

    fn gates(hall: &TestHall) -> Gates {
        Gates {
            ray_distance_m: hall.parameters.ray_distance_m,
            min_keypoints: hall.parameters.min_keypoints as usize,
            field_min_m: Vector3::new(-4.0, -3.0, -0.3),
            field_max_m: Vector3::new(4.0, 3.0, 2.6),
        }
    }

    /// What the cameras of `hall` sight of people at these places (x, y, height of the ground, metres).
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

    #[test]
    fn who_agrees_is_who_agrees_when_every_pair_is_compared() {
        let (hall, mut noise) = (hall(), Noise(7));
        let gates = gates(&hall);
        let places_m = places_m(6, 12, &mut noise);
        let all = sighted(&hall, &places_m, &mut noise);
        let free: Vec<usize> = (0..all.len()).collect();
        let mut agreements = Agreements::among(&all, &free, &gates);
        let mut agreeing = 0;
        for a in 0..all.len() {
            for b in a + 1..all.len() {
                let plain = verdict(&all[a], &all[b], &gates);
                assert_eq!(agreements.between(a, b), plain, "{a} {b}");
                assert_eq!(agreements.between(b, a), plain, "{b} {a}");
                agreeing += usize::from(matches!(plain, RayAgreement::Agree(_)));
            }
        }
        assert_eq!(agreements.pairs().len(), agreeing);
        assert!(agreeing > 6, "{agreeing}");
    }

    #[test]
    fn spectators_on_the_stands_make_few_pairs() {
        let (hall, mut noise) = (hall_of_sixteen(), Noise(11));
        let gates = gates(&hall);
        let places_m = places_m(4, 56, &mut noise);
        let all = sighted(&hall, &places_m, &mut noise);
        let free: Vec<usize> = (0..all.len()).collect();
        let (n, compared) = (all.len(), Agreements::among(&all, &free, &gates).compared);
        assert!(n > 900, "{n} sightings");
        assert!(compared < n * n / 30, "{compared} pairs of {n} sightings");
    }
}
