//! Whether three cameras or more have each other's sources, in a cycle: each fits the calibration of the next.
//!
//! If none of them has its own calibration, there is no valid camera to compare the others with. So all orders of their
//! calibrations are tried, and the one with which lines of sight meet best is taken, if it is clearly the best. Cameras
//! that stand symmetrically and are exchanged along the symmetry cannot be detected: the world is only turned.

use std::collections::BTreeMap;

use super::super::pairs::{CameraRays, PairAgreement, PictureChange};
use super::super::report::DisagreementCause;
use super::{Findings, Judge, MIN_KEYPOINTS};

/// Most and fewest cameras in the search: five cameras have 120 orders.
const MAX_CAMERAS: usize = 5;
const MIN_CAMERAS: usize = 3;
/// So many cameras may agree by chance.
const MAX_BY_CHANCE: usize = 2;
/// Largest share that the best order may leave of the cost, and of the cost of the next best order.
const MAX_COST_RATIO: f64 = 0.5;
const MAX_COST_RATIO_TO_NEXT: f64 = 0.8;

/// A camera, and the camera whose calibration it is given.
type Given = (usize, usize);

impl Judge<'_> {
    /// Cameras that have each other's sources.
    pub(super) fn find_permuted(&self, findings: &mut Findings) {
        for mut group in self.groups(findings) {
            if group.outside.len() < MIN_CAMERAS {
                continue;
            }
            if group.right.len() <= MAX_BY_CHANCE && group.all.len() <= MAX_CAMERAS {
                group.right.clear();
                group.outside.clone_from(&group.all);
            }
            if group.outside.len() > MAX_CAMERAS {
                continue;
            }
            for cycle in self.cycles(&group.outside, &group.right) {
                let cause = if cycle.len() == 2 {
                    DisagreementCause::Swapped
                } else {
                    DisagreementCause::Permuted
                };
                findings.add(self, &cycle, cause);
            }
        }
    }

    /// Cycles of cameras whose pictures fit the calibration of the next; none if no order is clearly the best.
    fn cycles(&self, outside: &[usize], right: &[usize]) -> Vec<Vec<usize>> {
        let table = CostTable::new(self, outside, right);
        let own = table.cost(outside);
        let mut costs: Vec<(f64, Vec<usize>)> = Vec::new();
        permute(&mut outside.to_vec(), 0, &mut |order: &[usize]| {
            if order != outside
                && let Some(cost) = table.cost(order)
            {
                costs.push((cost, order.to_vec()));
            }
        });
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (Some(own), [(best, order), (next, _), ..]) = (own, &costs[..]) else {
            return Vec::new();
        };
        let moved = outside.iter().zip(order).filter(|(a, b)| a != b).count();
        if moved < MIN_CAMERAS
            || *best >= MAX_COST_RATIO * own
            || *best >= MAX_COST_RATIO_TO_NEXT * next
        {
            return Vec::new();
        }
        let fits: BTreeMap<usize, usize> =
            outside.iter().copied().zip(order.iter().copied()).collect();
        cycles_of(&fits)
    }
}

/// Costs of pairs of cameras with each other's calibrations.
struct CostTable {
    outside: Vec<usize>,
    right: Vec<usize>,
    pairs: BTreeMap<(Given, Given), Option<f64>>,
}

impl CostTable {
    fn new(judge: &Judge<'_>, outside: &[usize], right: &[usize]) -> Self {
        let rays =
            |(camera, calibrated): Given| judge.rays(camera, calibrated, PictureChange::AsItIs);
        let both = outside
            .iter()
            .flat_map(|&a| outside.iter().map(move |&b| (a, b)));
        let moved: Vec<(Given, CameraRays)> = both.map(|given| (given, rays(given))).collect();
        let mut pairs = BTreeMap::new();
        let cost = |one: &(Given, CameraRays), other: (Given, &CameraRays)| {
            let is_apart = judge.are_apart(one.0.1, other.0.1) && one.0.0 != other.0.0;
            let pair = is_apart.then(|| PairAgreement::of_all(&one.1, other.1));
            pair.filter(|pair| pair.len() >= MIN_KEYPOINTS)
                .map(|pair| pair.mean_cost())
        };
        for (index, one) in moved.iter().enumerate() {
            for other in &moved[index + 1..] {
                pairs.insert((one.0, other.0), cost(one, (other.0, &other.1)));
            }
            for &fixed in right {
                let given = (fixed, fixed);
                pairs.insert((one.0, given), cost(one, (given, &judge.as_it_is[fixed])));
            }
        }
        Self {
            outside: outside.to_vec(),
            right: right.to_vec(),
            pairs,
        }
    }

    /// Mean cost of all pairs with the calibrations of `order`; `None` if none can be compared.
    fn cost(&self, order: &[usize]) -> Option<f64> {
        let given: Vec<Given> = self
            .outside
            .iter()
            .copied()
            .zip(order.iter().copied())
            .collect();
        let among = given.iter().enumerate().flat_map(|(index, one)| {
            let later = given[index + 1..].iter();
            later.map(move |other| (*one, *other))
        });
        let fixed = given
            .iter()
            .flat_map(|one| self.right.iter().map(move |&right| (*one, (right, right))));
        let costs = among.chain(fixed);
        let costs = costs.filter_map(|pair| self.pairs.get(&pair).copied().flatten());
        let costs: Vec<f64> = costs.collect();
        (!costs.is_empty()).then(|| costs.iter().sum::<f64>() / costs.len() as f64)
    }
}

/// Visits every order of `all` from index `from` on.
fn permute(all: &mut Vec<usize>, from: usize, visit: &mut impl FnMut(&[usize])) {
    if from == all.len() {
        visit(&all[..]);
        return;
    }
    for next in from..all.len() {
        all.swap(from, next);
        permute(all, from + 1, visit);
        all.swap(from, next);
    }
}

/// Cycles in which each camera fits the next, and the last fits the first. A camera that fits itself is in none.
fn cycles_of(fits: &BTreeMap<usize, usize>) -> Vec<Vec<usize>> {
    let mut left = fits.clone();
    let mut cycles = Vec::new();
    while let Some((first, mut next)) = left.pop_first() {
        let mut cycle = vec![first];
        while let Some(after) = left.remove(&next) {
            cycle.push(next);
            next = after;
        }
        if cycle.len() > 1 {
            cycles.push(cycle);
        }
    }
    cycles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cycles_start_at_their_first_camera() {
        let fits = [(0, 2), (1, 1), (2, 4), (3, 5), (4, 0), (5, 3)].into();
        assert_eq!(cycles_of(&fits), [vec![0, 2, 4], vec![3, 5]]);
    }
}
