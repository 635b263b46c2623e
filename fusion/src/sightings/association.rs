//! Which witnesses of different viewpoints see the same person.
//!
//! Two viewpoints alone cannot distinguish people from false bodies: with n people there are up to
//! n^2 crossings of rays. So groups grow from every pair that agrees, each group is triangulated,
//! and the groups compete for their witnesses. The group with the most agreeing rays takes its
//! witnesses out of all others. A false body owns rays of people with more rays, and loses them.
//!
//! Most groups are false, and there are many more of them than people. So a group is triangulated
//! only when it could be the next to win, by the number of its rays. Until then only the witnesses
//! are recorded that winners took from it. Nearly all groups lose without triangulation, and the
//! winners are the same.

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};

use super::agreement::Gates;
use super::growth::grown_groups;
use crate::sightings::rays::SightedBody;
use crate::sightings::reconstruction::{Reconstruction, reconstruct};

/// Groups `free` witnesses (indices into `witnesses`) by person. Each group has two or more members
/// of different viewpoints, is accepted by `plausible`, and shares no member with another. Best
/// supported first.
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
    let mut accepted = Accepted {
        groups: Vec::new(),
        taken_by: vec![usize::MAX; witnesses.len()],
    };
    let n_rays: Vec<usize> = witnesses
        .iter()
        .map(|witness| witness.rays.iter().flatten().count())
        .collect();
    let grown = grown_groups(witnesses, free, gates).into_iter();
    let mut hypotheses: BinaryHeap<Hypothesis> = grown
        .map(|members| Hypothesis::noted(members, &n_rays))
        .collect();
    let mut triangulated: BTreeSet<Vec<usize>> = BTreeSet::new();
    while let Some(hypothesis) = hypotheses.pop() {
        let Hypothesis {
            most_support,
            group,
            members,
        } = hypothesis;
        if let Some(group) = group {
            accepted.take(group);
            // A rival without a bad sighting may have more support than with it.
            let left = hypotheses.into_iter();
            let left = left.map(|hypothesis| hypothesis.after(&accepted, &n_rays));
            hypotheses = left.collect();
            continue;
        }
        let left = accepted.free_of(&members);
        if left.len() < 2 {
            // In any case fewer than two of its members are free.
            continue;
        }
        let noted = Hypothesis::noted(left, &n_rays);
        if noted.most_support < most_support {
            hypotheses.push(Hypothesis { members, ..noted });
        } else if triangulated.insert(members.clone())
            && let Some(group) = build(&members)
        {
            hypotheses.push(Hypothesis::triangulated(group).after(&accepted, &n_rays));
        }
    }
    accepted.groups
}

/// The groups that have won.
struct Accepted {
    groups: Vec<Reconstruction>,
    /// Per witness, the group that took it; `usize::MAX`: none.
    taken_by: Vec<usize>,
}

impl Accepted {
    fn take(&mut self, group: Reconstruction) {
        for &member in &group.members {
            self.taken_by[member] = self.groups.len();
        }
        self.groups.push(group);
    }

    /// The first group that has taken any of `members`.
    fn first_rival(&self, members: &[usize]) -> Option<usize> {
        let rivals = members.iter().map(|&m| self.taken_by[m]);
        rivals.min().filter(|&rival| rival != usize::MAX)
    }

    /// The `members` that `rival` has not taken.
    fn without(&self, members: &[usize], rival: usize) -> Vec<usize> {
        let members = members.iter().copied();
        members.filter(|&m| self.taken_by[m] != rival).collect()
    }

    /// The `members` that no group has taken.
    fn free_of(&self, members: &[usize]) -> Vec<usize> {
        let members = members.iter().copied();
        let free = members.filter(|&m| self.taken_by[m] == usize::MAX);
        free.collect()
    }
}

/// Witnesses that may be of one person.
struct Hypothesis {
    /// The support of the group, or its upper bound.
    most_support: f64,
    /// `None` until it is triangulated.
    group: Option<Reconstruction>,
    /// The witnesses to triangulate, ascending.
    members: Vec<usize>,
}

impl Hypothesis {
    /// `members` that are not triangulated yet; `n_rays` has the number of rays of every witness.
    fn noted(members: Vec<usize>, n_rays: &[usize]) -> Self {
        // A ray counts at most 1.
        let most: usize = members.iter().map(|&m| n_rays[m]).sum();
        Self {
            most_support: most as f64,
            group: None,
            members,
        }
    }

    fn triangulated(group: Reconstruction) -> Self {
        Self {
            most_support: group.support,
            members: group.members.clone(),
            group: Some(group),
        }
    }

    /// Updates after `accepted` have won: a group that shares members with one of them is
    /// triangulated again, without those of the first.
    fn after(self, accepted: &Accepted, n_rays: &[usize]) -> Self {
        let group = self.group.as_ref();
        match group.and_then(|group| accepted.first_rival(&group.members)) {
            Some(rival) => Self::noted(accepted.without(&self.members, rival), n_rays),
            None => self,
        }
    }
}

impl Ord for Hypothesis {
    /// By support, and not triangulated ones first, because they may have as much. Equal ones by
    /// their first members.
    fn cmp(&self, other: &Self) -> Ordering {
        let by_support = self.most_support.total_cmp(&other.most_support);
        by_support
            .then_with(|| self.group.is_none().cmp(&other.group.is_none()))
            .then_with(|| other.members.cmp(&self.members))
    }
}

impl PartialOrd for Hypothesis {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Hypothesis {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Hypothesis {}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::sightings::fixture::{gates, hall_of_sixteen};
    use crate::sightings::rays::witnesses;

    /// The groups that win if every group is triangulated first.
    fn all_triangulated_at_once(witnesses: &[SightedBody], gates: &Gates) -> Vec<Vec<usize>> {
        let free: Vec<usize> = (0..witnesses.len()).collect();
        let gate_m = gates.point_distance_m();
        let build = |of: &Vec<usize>| reconstruct(witnesses, of, gate_m, gates.min_keypoints);
        let grown = grown_groups(witnesses, &free, gates);
        let mut groups: Vec<Reconstruction> = grown.iter().filter_map(build).collect();
        let mut accepted = Vec::new();
        while let Some(best) = groups.iter().cloned().max_by(|a, b| {
            let by_support = a.support.total_cmp(&b.support);
            by_support.then_with(|| b.members.cmp(&a.members))
        }) {
            let is_free = |m: &&usize| !best.members.contains(m);
            groups = groups
                .iter()
                .filter_map(|other| {
                    let rest: Vec<usize> = other.members.iter().filter(is_free).copied().collect();
                    if rest.len() == other.members.len() {
                        Some(other.clone())
                    } else {
                        build(&rest)
                    }
                })
                .collect();
            accepted.push(best.members);
        }
        accepted
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        #[test]
        fn winners_equal_those_of_triangulating_all_groups(seed in any::<u64>()) {
            let (hall, mut noise) = (hall_of_sixteen(), Noise(seed));
            let gates = gates(&hall);
            let bodies: Vec<_> = (0..7)
                .map(|_| {
                    let [x, y] = [noise.uniform(), noise.uniform()];
                    standing(6.0 * x - 3.0, 4.0 * y - 2.0, 1.7, &mut noise)
                })
                .collect();
            let mut sightings = hall.sightings(&bodies, 4.0, &mut noise);
            // Most are hidden from some viewpoints.
            sightings.retain(|_| noise.uniform() < 0.5);
            let all = witnesses(&sightings, &hall.cameras, 17, hall.parameters.min_score);
            let free: Vec<usize> = (0..all.len()).collect();
            let found = associate(&all, &free, &gates, |_| true);
            let found: Vec<Vec<usize>> = found.into_iter().map(|group| group.members).collect();
            prop_assert!(found.len() >= 5);
            prop_assert_eq!(found, all_triangulated_at_once(&all, &gates));
        }
    }
}
