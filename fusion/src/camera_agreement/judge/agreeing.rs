//! Groups of cameras that show the same people, which of each are taken for right, and what explains the others.

use std::collections::BTreeMap;

use super::super::pairs::PairAgreement;
use super::super::report::DisagreementCause;
use super::{Findings, Judge};

/// Passes of so little time, seconds, show one moment.
const MOMENT_S: f64 = 0.4;
/// Median distance of lines of sight up to which two cameras agree in any case, metres, and pixels of the camera that shows
/// people smaller.
const AGREES_M: f64 = 0.042;
const AGREES_PX: f64 = 1.5;
/// The same as a factor of the distance of the two cameras that agree best, because networks differ.
const AGREES_FACTOR: f64 = 2.5;
/// Cameras never agree if their lines of sight pass farther from each other than this, metres, unless their pixels are
/// as wide.
const NEVER_AGREES_M: f64 = 0.11;

/// Cameras that show the same people.
pub(in crate::camera_agreement) struct Group {
    pub(super) all: Vec<usize>,
    /// Those that are taken for right; empty if no set of them is clearly the largest.
    pub(in crate::camera_agreement) right: Vec<usize>,
    /// The rest.
    pub(in crate::camera_agreement) outside: Vec<usize>,
}

impl Group {
    /// The cameras that `camera` is compared with.
    pub(in crate::camera_agreement) fn references(&self, camera: usize) -> Vec<usize> {
        if self.right.is_empty() {
            let others = self.all.iter().copied();
            others.filter(|&other| other != camera).collect()
        } else {
            self.right.clone()
        }
    }
}

impl Judge<'_> {
    /// Explains the cameras of each group that are not taken for right.
    pub(super) fn find_outside_groups(&self, findings: &mut Findings) {
        for group in self.groups(findings) {
            self.judge_group(&group, findings);
        }
    }

    /// The cameras that were compared, in groups that have no people in common. Explained cameras are left out.
    pub(super) fn groups(&self, findings: &Findings) -> Vec<Group> {
        let compared = self.pairs.keys().copied();
        let compared =
            compared.filter(|&(a, b)| !findings.is_explained(a) && !findings.is_explained(b));
        let sets = linked(self.cameras.len(), compared);
        let group = |all: Vec<usize>| {
            let right = self.taken_for_right(&all);
            let outside = all.iter().copied();
            let outside = outside.filter(|camera| !right.contains(camera)).collect();
            Group {
                all,
                right,
                outside,
            }
        };
        let several = sets.into_iter().filter(|set| set.len() > 1);
        several.map(group).collect()
    }

    fn judge_group(&self, group: &Group, findings: &mut Findings) {
        // At one moment a person may be hidden from some cameras, which is no disagreement.
        let is_of_a_moment = self.samples.passes_last_s() < MOMENT_S;
        let (mut swapped, mut unexplained) = (Vec::new(), Vec::new());
        for &camera in &group.outside {
            if findings.is_explained(camera) {
                continue;
            }
            match self.explain(camera, group, findings) {
                // If cameras stand opposite each other, two swaps may explain the same.
                Some((cameras, DisagreementCause::Swapped)) if group.right.is_empty() => {
                    findings.leave_out(&cameras);
                    swapped.extend(cameras);
                }
                Some((cameras, DisagreementCause::Swapped)) => {
                    findings.add(self, &cameras, DisagreementCause::Swapped);
                }
                Some((cameras, cause)) => findings.name(self, &cameras, cause),
                None if is_of_a_moment => {}
                None => unexplained.push(camera),
            }
            findings.leave_out(&[camera]);
        }
        if !swapped.is_empty() {
            findings.add(self, &swapped, DisagreementCause::Swapped);
        }
        let n_all = unexplained.len().max(1);
        let size = if group.right.is_empty() { n_all } else { 1 };
        for cameras in unexplained.chunks(size) {
            findings.add(self, cameras, DisagreementCause::Unexplained);
        }
    }

    /// The largest set of cameras of a group that are linked by agreement; empty if no two agree, or if two sets are
    /// equally large.
    pub(super) fn taken_for_right(&self, group: &[usize]) -> Vec<usize> {
        let near = self.agreeing(&self.pairs, |camera| group.contains(&camera));
        let sets = linked(self.cameras.len(), near.into_iter());
        let most = sets.iter().map(Vec::len).max().unwrap_or(0);
        let mut largest = sets.into_iter().filter(|set| set.len() == most);
        match (largest.next(), largest.next()) {
            (Some(set), None) if most >= 2 => set,
            _ => Vec::new(),
        }
    }

    /// The `pairs` of cameras in a group whose lines of sight pass each other about as near as those of the best pair.
    pub(super) fn agreeing(
        &self,
        pairs: &BTreeMap<(usize, usize), PairAgreement>,
        is_in_group: impl Fn(usize) -> bool,
    ) -> Vec<(usize, usize)> {
        let own = |(a, b): &(usize, usize)| is_in_group(*a) && is_in_group(*b);
        let own = pairs.iter().filter(|(pair, _)| own(pair));
        let medians = own.filter_map(|(pair, agreement)| Some((*pair, agreement.median_m()?)));
        let medians: Vec<((usize, usize), f64)> = medians.collect();
        let least_m = medians.iter().map(|(_, m)| *m);
        let least_m = least_m.fold(f64::INFINITY, f64::min);
        let limit_m = (AGREES_FACTOR * least_m).min(NEVER_AGREES_M);
        let is_near = |(a, b): (usize, usize), median_m: f64| {
            let pixel_m = pairs[&(a, b)].pixel_m([a, b].map(|c| self.focal_px(c)));
            median_m <= limit_m.max(AGREES_M + AGREES_PX * pixel_m)
        };
        let near = medians.iter().filter(|(pair, m)| is_near(*pair, *m));
        near.map(|(pair, _)| *pair).collect()
    }
}

/// Sets of `n` cameras that are linked by these pairs.
fn linked(n: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Vec<Vec<usize>> {
    let mut set_of: Vec<usize> = (0..n).collect();
    for (a, b) in pairs {
        let (into, from) = (set_of[a], set_of[b]);
        for set in set_of.iter_mut().filter(|set| **set == from) {
            *set = into;
        }
    }
    let members = |set: usize| (0..n).filter(|&camera| set_of[camera] == set).collect();
    let sets = (0..n).map(members);
    sets.filter(|set: &Vec<usize>| !set.is_empty()).collect()
}
