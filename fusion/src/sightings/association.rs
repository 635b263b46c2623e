//! Which witnesses of different viewpoints see the same person.
//!
//! Two viewpoints alone cannot tell people from false bodies: with n people there are up to n^2 crossings
//! of rays. So groups are grown from every pair that agrees, each group is triangulated, and the
//! groups compete for their witnesses: the one with the most agreeing rays takes its witnesses out
//! of all others. A false body owns rays that belong to people with more of them, and starves.

use std::collections::BTreeSet;

use farfield_proto::order_statistics::upper_median;
use nalgebra::Vector3;

use crate::sightings::rays::{SightedBody, SightedRay};
use crate::sightings::reconstruction::{Reconstruction, reconstruct};

/// How far outside the field two rays may meet, metres: their meeting point is less certain than
/// a body's.
const FIELD_SLACK_M: f64 = 0.5;

/// Sine of the angle between two rays, below which (4 degrees) they say nothing about each other:
/// they meet anywhere.
const PARALLEL_SINE: f64 = 0.07;

/// Share of the members that may disagree with a new one: one bad sighting in a group must not keep
/// the good ones out.
const MAX_DISAGREEING: f64 = 0.34;

/// What association needs to know.
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
    /// Whether `point_m` is in the field grown by `slack_m`.
    pub(crate) fn inside(&self, point_m: &Vector3<f64>, slack_m: f64) -> bool {
        (0..3).all(|i| {
            point_m[i] >= self.field_min_m[i] - slack_m
                && point_m[i] <= self.field_max_m[i] + slack_m
        })
    }

    /// Largest distance of a ray from its point: half of that between two rays.
    pub(crate) fn point_distance_m(&self) -> f64 {
        0.5 * self.ray_distance_m
    }
}

/// What two witnesses say about each other.
#[derive(Debug, Clone, Copy, PartialEq)]
enum RayAgreement {
    /// Too little in common to tell.
    Unknown,
    /// The rays pass each other.
    Disagree,
    /// Median distance of the rays, metres.
    Agree(f64),
}

/// Groups `free` witnesses (indices into `witnesses`) by person. Each group has two or more members
/// of different viewpoints, is accepted by `plausible`, and shares no member with another.
/// Best supported first.
pub(crate) fn associate(
    witnesses: &[SightedBody],
    free: &[usize],
    gates: &Gates,
    mut plausible: impl FnMut(&mut Reconstruction) -> bool,
) -> Vec<Reconstruction> {
    let mut build = |members: &[usize]| {
        let mut group = reconstruct(
            witnesses,
            members,
            gates.point_distance_m(),
            gates.min_keypoints,
        )?;
        plausible(&mut group).then_some(group)
    };
    let mut hypotheses: Vec<Reconstruction> = grown_groups(witnesses, free, gates)
        .iter()
        .filter_map(|members| build(members))
        .collect();
    let mut accepted: Vec<Reconstruction> = Vec::new();
    while let Some(best) = take_best(&mut hypotheses) {
        // What the winner took is gone for the others; what they are left with may still be a person.
        let mut rest: BTreeSet<Vec<usize>> = BTreeSet::new();
        hypotheses.retain(|other| {
            let remaining: Vec<usize> = other
                .members
                .iter()
                .copied()
                .filter(|m| !best.members.contains(m))
                .collect();
            let untouched = remaining.len() == other.members.len();
            if !untouched && remaining.len() >= 2 {
                rest.insert(remaining);
            }
            untouched
        });
        hypotheses.extend(rest.iter().filter_map(|members| build(members)));
        accepted.push(best);
    }
    accepted
}

fn take_best(hypotheses: &mut Vec<Reconstruction>) -> Option<Reconstruction> {
    let by_support = |a: &Reconstruction, b: &Reconstruction| {
        a.support
            .total_cmp(&b.support)
            .then_with(|| b.members.cmp(&a.members))
    };
    let best = (0..hypotheses.len()).max_by(|&a, &b| by_support(&hypotheses[a], &hypotheses[b]))?;
    Some(hypotheses.swap_remove(best))
}

/// The different groups that grow from the pairs that agree, members ascending.
fn grown_groups(witnesses: &[SightedBody], free: &[usize], gates: &Gates) -> BTreeSet<Vec<usize>> {
    let mut verdicts = vec![vec![RayAgreement::Unknown; free.len()]; free.len()];
    for a in 0..free.len() {
        for b in a + 1..free.len() {
            verdicts[a][b] = verdict(&witnesses[free[a]], &witnesses[free[b]], gates);
            verdicts[b][a] = verdicts[a][b];
        }
    }
    let mut groups = BTreeSet::new();
    for a in 0..free.len() {
        for b in a + 1..free.len() {
            if let RayAgreement::Agree(_) = verdicts[a][b] {
                let grown = grow(a, b, &verdicts, |m| witnesses[free[m]].viewpoint, gates);
                groups.insert(grown.into_iter().map(|m| free[m]).collect());
            }
        }
    }
    groups
}

/// Grows the pair (`a`, `b`) by the witness of another viewpoint that its members agree with best,
/// until there is none.
fn grow<V: PartialEq>(
    a: usize,
    b: usize,
    verdicts: &[Vec<RayAgreement>],
    viewpoint: impl Fn(usize) -> V,
    gates: &Gates,
) -> Vec<usize> {
    let mut members = vec![a, b];
    loop {
        let candidates = (0..verdicts.len())
            .filter(|&c| members.iter().all(|&m| viewpoint(m) != viewpoint(c)))
            .filter_map(|c| Some((c, votes(c, &members, verdicts, gates)?)));
        let Some((best, _)) = candidates.max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)))
        else {
            members.sort_unstable();
            return members;
        };
        members.push(best);
    }
}

/// How well `candidate` fits the members: each agreement counts up to 1, by its distance. `None`
/// when nobody agrees or too many disagree.
fn votes(
    candidate: usize,
    members: &[usize],
    verdicts: &[Vec<RayAgreement>],
    gates: &Gates,
) -> Option<f64> {
    let (mut agreeing, mut disagreeing, mut sum) = (0_u32, 0_u32, 0.0);
    for &m in members {
        match verdicts[candidate][m] {
            RayAgreement::Unknown => {}
            RayAgreement::Disagree => disagreeing += 1,
            RayAgreement::Agree(distance) => {
                agreeing += 1;
                sum += 1.0 - 0.5 * distance / gates.ray_distance_m;
            }
        }
    }
    let compared = f64::from(agreeing + disagreeing);
    (agreeing > 0 && f64::from(disagreeing) <= MAX_DISAGREEING * compared).then_some(sum)
}

/// Compares two witnesses by the distances of their rays, keypoint by keypoint.
fn verdict(a: &SightedBody, b: &SightedBody, gates: &Gates) -> RayAgreement {
    if a.viewpoint == b.viewpoint {
        return RayAgreement::Unknown;
    }
    let distances: Vec<f64> = a
        .in_common(b)
        .filter_map(|(p, q)| meeting(p, q, gates))
        .collect();
    if distances.len() < gates.min_keypoints {
        return RayAgreement::Unknown;
    }
    let agreeing = distances
        .iter()
        .filter(|&&d| d <= gates.ray_distance_m)
        .count();
    match upper_median(distances) {
        Some(d) if d <= gates.ray_distance_m && agreeing >= gates.min_keypoints => {
            RayAgreement::Agree(d)
        }
        _ => RayAgreement::Disagree,
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
    let middle = 0.5 * (p.origin_m + p.direction * along_p + q.origin_m + q.direction * along_q);
    let possible = along_p > 0.0 && along_q > 0.0 && gates.inside(&middle, FIELD_SLACK_M);
    Some(if possible {
        between.dot(&normal).abs() / sine
    } else {
        f64::INFINITY
    })
}
