//! Whose pose is whose, tick after tick: pairs within the gate, and the outliers beyond it.
//!
//! A pose that leaves its person by more than the gate would, as a gap and a false pose, take its error out of every
//! mean. So a truth that has no pose within the gate is held against the id that was its last, when that is still
//! there and nobody else's at this tick.

use std::collections::BTreeMap;

use farfield_fusion::assign::assign;

use super::lines::TruthExtent;
use super::points::ScoredBody;

/// Farthest mean distance at which a pose can be a truth's, metres.
pub const GATE_M: f64 = 0.5;

/// Cost of a pair beyond the gate: far above any sum of distances within it, so that the matching
/// first has as many pairs as can be, then the least distance.
const BEYOND_GATE: f64 = 1e6;

/// Mean point distances between the truths and the poses of one tick, metres.
#[derive(Debug, Clone)]
pub(crate) struct Distances {
    pub(crate) true_ids: Vec<u32>,
    pub(crate) pose_ids: Vec<u32>,
    /// Row-major, one row per truth; infinite where the two share no point.
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
        let d = self.of_m(truth_idx, pose_idx);
        (d <= GATE_M).then_some(d)
    }

    /// The least distance of any pair; infinite without one.
    pub(crate) fn nearest_m(&self) -> f64 {
        self.values_m.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The distance of a pair.
    pub(crate) fn of_m(&self, truth_idx: usize, pose_idx: usize) -> f64 {
        self.values_m[truth_idx * self.pose_ids.len() + pose_idx]
    }

    /// Per truth the index of its pose: most pairs within the gate, then least distance.
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

/// The pairs of a tick, and whose each pose was before.
#[derive(Debug, Clone)]
pub(crate) struct Pairing {
    with_outliers: bool,
    /// Per actor, the id of its last pose within the gate that is nobody else's since.
    last_ids: BTreeMap<u32, u32>,
    matched: Vec<Option<usize>>,
    outliers: Vec<Option<usize>>,
}

impl Pairing {
    /// Nobody was there yet. A truth that was annotated in part has no outliers: a pose that has left its person may be
    /// of somebody whom it leaves out.
    pub(crate) fn new(truth: TruthExtent) -> Self {
        Self {
            with_outliers: truth == TruthExtent::Whole,
            last_ids: BTreeMap::new(),
            matched: Vec::new(),
            outliers: Vec::new(),
        }
    }

    /// Pairs the truths and the poses of the next tick.
    pub(crate) fn pair(&mut self, distances: &Distances) {
        self.matched = distances.matches();
        for (&actor, j) in distances.true_ids.iter().zip(&self.matched) {
            if let Some(id) = j.map(|j| distances.pose_ids[j]) {
                // An id that is another's now is nobody else's last.
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
                distances.of_m(i, at).is_finite().then_some(at)
            });
            self.outliers.push(outlier);
        }
    }

    /// Per truth, the index of its pose within the gate.
    pub(crate) fn matched(&self) -> &[Option<usize>] {
        &self.matched
    }

    /// Per truth without such a pose, the index of the one that was its last.
    pub(crate) fn outliers(&self) -> &[Option<usize>] {
        &self.outliers
    }

    /// Actor and id of all pairs, outliers too.
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
