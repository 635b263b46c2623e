//! Matches poses to true people over time: pairs within the gate, and outliers beyond it.
//!
//! If a pose that drifts beyond the gate counted as a gap and a false pose, its error would be missing from every mean. So a
//! true person without a pose within the gate is compared with its last id, if that is still present and matched to no
//! other person at this tick.

use std::collections::BTreeMap;

use farfield_fusion::assign::assign;

use super::lines::TruthExtent;
use super::points::ScoredBody;

/// Largest mean distance of a pose that matches a true person, metres.
pub const GATE_M: f64 = 0.5;

/// Cost of a pair beyond the gate: far above any sum of distances within it, so that the matching maximises the number of
/// pairs first, then minimises the distance.
const BEYOND_GATE: f64 = 1e6;

/// Mean point distances between the true people and the poses of one tick, metres.
#[derive(Debug, Clone)]
pub(crate) struct Distances {
    pub(crate) true_ids: Vec<u32>,
    pub(crate) pose_ids: Vec<u32>,
    /// Row-major, one row per true person; infinite if the two share no point.
    values_m: Vec<f64>,
}

impl Distances {
    pub(crate) fn new(
        truths: &BTreeMap<u32, ScoredBody>,
        poses: &BTreeMap<u32, ScoredBody>,
    ) -> Self {
        let values_m = truths
            .values()
            .flat_map(|t| {
                poses
                    .values()
                    .map(|p| t.mean_distance_m(p).unwrap_or(f64::INFINITY))
            })
            .collect();
        let true_ids = truths.keys().copied().collect();
        Self {
            true_ids,
            pose_ids: poses.keys().copied().collect(),
            values_m,
        }
    }

    /// The distance of a pair, `None` beyond the gate.
    pub(crate) fn within_gate(&self, truth_idx: usize, pose_idx: usize) -> Option<f64> {
        let d = self.pair_m(truth_idx, pose_idx);
        (d <= GATE_M).then_some(d)
    }

    /// The least distance of any pair; infinite without one.
    pub(crate) fn nearest_m(&self) -> f64 {
        self.values_m.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The distance of a pair.
    pub(crate) fn pair_m(&self, truth_idx: usize, pose_idx: usize) -> f64 {
        self.values_m[truth_idx * self.pose_ids.len() + pose_idx]
    }

    /// Per true person the index of its pose: most pairs within the gate, then least distance.
    pub(crate) fn matches(&self) -> Vec<Option<usize>> {
        let mut assigned = assign(self.true_ids.len(), self.pose_ids.len(), |i, j| {
            self.within_gate(i, j).unwrap_or(BEYOND_GATE)
        });
        for (i, pose_idx) in assigned.iter_mut().enumerate() {
            *pose_idx = pose_idx.filter(|&j| self.within_gate(i, j).is_some());
        }
        assigned
    }
}

/// The pairs of a tick, and the last pose of each actor.
#[derive(Debug, Clone)]
pub(crate) struct Pairing {
    with_outliers: bool,
    /// Per actor, the id of its last pose within the gate that has matched no other actor since.
    last_ids: BTreeMap<u32, u32>,
    matched: Vec<Option<usize>>,
    outliers: Vec<Option<usize>>,
}

impl Pairing {
    /// No earlier ticks. A partial truth has no outliers: a pose that leaves its person may be of a person that the truth
    /// leaves out.
    pub(crate) fn new(truth: TruthExtent) -> Self {
        Self {
            with_outliers: truth == TruthExtent::Whole,
            last_ids: BTreeMap::new(),
            matched: Vec::new(),
            outliers: Vec::new(),
        }
    }

    /// Pairs the true people and the poses of the next tick.
    pub(crate) fn pair(&mut self, distances: &Distances) {
        self.matched = distances.matches();
        for (&actor, j) in distances.true_ids.iter().zip(&self.matched) {
            if let Some(id) = j.map(|j| distances.pose_ids[j]) {
                // An id that matches a person now is no longer the last of another.
                self.last_ids.retain(|_, last| *last != id);
                self.last_ids.insert(actor, id);
            }
        }
        self.outliers.clear();
        for (i, actor) in distances.true_ids.iter().enumerate() {
            let last = self.last_ids.get(actor);
            let last = last.filter(|_| self.matched[i].is_none() && self.with_outliers);
            let outlier = last.and_then(|id| {
                let at = distances.pose_ids.iter().position(|pose| pose == id)?;
                distances.pair_m(i, at).is_finite().then_some(at)
            });
            self.outliers.push(outlier);
        }
    }

    /// Per true person, the index of its pose within the gate.
    pub(crate) fn matched(&self) -> &[Option<usize>] {
        &self.matched
    }

    /// Per true person without such a pose, the index of its last pose.
    pub(crate) fn outliers(&self) -> &[Option<usize>] {
        &self.outliers
    }

    /// Actor and id of all pairs, including outliers.
    pub(crate) fn pairs<'a>(
        &'a self,
        distances: &'a Distances,
    ) -> impl Iterator<Item = (u32, u32)> + 'a {
        let pairs = self.matched.iter().zip(&self.outliers);
        let pairs = distances.true_ids.iter().zip(pairs);
        pairs.filter_map(|(&actor, (matched, outlier))| {
            Some((actor, distances.pose_ids[matched.or(*outlier)?]))
        })
    }
}
