//! Which witnesses of different viewpoints see the same person.
//!
//! Two viewpoints alone cannot tell people from false bodies: with n people there are up to n^2 crossings
//! of rays. So groups are grown from every pair that agrees, each group is triangulated, and the
//! groups compete for their witnesses: the one with the most agreeing rays takes its witnesses out
//! of all others. A false body owns rays that belong to people with more of them, and starves.

use std::collections::{BTreeMap, BTreeSet};

use super::agreement::{Agreements, RayAgreement};
use super::gates::Gates;
use crate::sightings::rays::SightedBody;
use crate::sightings::reconstruction::{Reconstruction, reconstruct};

/// Share of the members that may disagree with a new one: one bad sighting in a group must not keep
/// the good ones out.
const MAX_DISAGREEING: f64 = 0.34;

/// Members from which a group is not grown again from other pairs of its own: nearly all of them lead to it, and they
/// are as many as its viewpoints squared.
const LARGE: usize = 6;

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
    let mut agreements = Agreements::among(witnesses, free, gates);
    let mut groups: BTreeSet<Vec<usize>> = BTreeSet::new();
    // Per witness, the large groups that hold it, by their number.
    let mut large_of: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    let mut n_large = 0;
    for (a, b) in agreements.pairs() {
        let is_inside = (large_of.get(&a).zip(large_of.get(&b)))
            .is_some_and(|(of_a, of_b)| !of_a.is_disjoint(of_b));
        if is_inside {
            continue;
        }
        let group = grow(a, b, &mut agreements, gates);
        if group.len() >= LARGE && !groups.contains(&group) {
            for &member in &group {
                large_of.entry(member).or_default().insert(n_large);
            }
            n_large += 1;
        }
        groups.insert(group);
    }
    groups
}

/// Grows the pair (`a`, `b`) by the witness of another viewpoint that its members agree with best,
/// until there is none.
fn grow(a: usize, b: usize, agreements: &mut Agreements<'_>, gates: &Gates) -> Vec<usize> {
    let mut members = vec![a, b];
    // Who agrees with none of the members gets no vote.
    let mut candidates: BTreeSet<usize> = agreements.with(a).chain(agreements.with(b)).collect();
    loop {
        candidates.retain(|&c| {
            let mut others = members.iter();
            !others.any(|&m| agreements.are_of_one_viewpoint(m, c))
        });
        let votes = candidates
            .iter()
            .filter_map(|&c| Some((c, votes(c, &members, agreements, gates)?)));
        let Some((best, _)) = votes.max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0))) else {
            members.sort_unstable();
            return members;
        };
        members.push(best);
        candidates.extend(agreements.with(best));
    }
}

/// How well `candidate` fits the members: each agreement counts up to 1, by its distance. `None`
/// when nobody agrees or too many disagree.
fn votes(
    candidate: usize,
    members: &[usize],
    agreements: &mut Agreements<'_>,
    gates: &Gates,
) -> Option<f64> {
    let (mut agreeing, mut disagreeing, mut sum) = (0_u32, 0_u32, 0.0);
    for &m in members {
        match agreements.between(candidate, m) {
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
