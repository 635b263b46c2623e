//! Identity over time: switches, fragmentations, MOTA and IDF1 as `TrackEval` counts them.
//!
//! The similarity of a pair is 1 - d, with d the mean point distance in metres, so the threshold 0.5 of `TrackEval` is the
//! 0.5 m gate. CLEAR (MOTA, switches, fragmentations) makes its own matching per tick, which first continues the pairs of
//! the previous tick. The accuracy figures use another matching.

use std::collections::BTreeMap;

use serde::Serialize;

use super::accuracy::percent;
use super::lines::TruthExtent;
use super::pairing::Distances;
use farfield_fusion::assign::assign;

/// Value of continuing a pair of the previous tick in CLEAR's matching; a similarity is at most 1.
const CONTINUATION: f64 = 1000.0;

/// Figures of identity, over all actors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IdentityScore {
    /// Times that an actor's pose had another id than its previous pose (IDSW).
    pub switches: u64,
    /// Times that an actor was found again after it was lost (Frag). As in `TrackEval`, an actor that the truth itself
    /// leaves out for a while also counts.
    pub fragmentations: u64,
    /// Ids matched in fewer than half of their ticks; 0 for a partial truth.
    pub false_births: u64,
    /// Identity F1, percent. With a partial truth, unmatched poses do not count.
    pub idf1: f64,
    /// Multiple object tracking accuracy, percent; negative if the errors outnumber the true poses. With a partial truth,
    /// unmatched poses do not count.
    pub mota: f64,
}

/// Counts over the ticks.
#[derive(Debug, Clone, Default)]
pub(super) struct IdentityTally {
    /// With a partial truth, poses beyond the gate of every actor are ignored: they may be of people that it leaves out
    /// (`TrackEval` removes such regions beforehand).
    truth: TruthExtent,
    clear: Clear,
    /// Ticks per actor and per id.
    true_ticks: BTreeMap<u32, u64>,
    pose_ticks: BTreeMap<u32, u64>,
    /// Ticks at which an id was matched to an actor in the accuracy matching.
    matched_ticks: BTreeMap<u32, u64>,
    /// Ticks at which an actor and an id were within the gate.
    close_ticks: BTreeMap<(u32, u32), u64>,
}

impl IdentityTally {
    /// An empty tally.
    pub(super) fn new(truth: TruthExtent) -> Self {
        Self {
            truth,
            ..Self::default()
        }
    }

    /// Adds one tick; `matched` is the accuracy matching, one entry per true person.
    pub(super) fn add(&mut self, distances: &Distances, matched: &[Option<usize>]) {
        for &id in &distances.true_ids {
            *self.true_ticks.entry(id).or_default() += 1;
        }
        for (j, &id) in distances.pose_ids.iter().enumerate() {
            let mut actors = 0..distances.true_ids.len();
            if self.truth == TruthExtent::Whole
                || actors.any(|i| distances.within_gate(i, j).is_some())
            {
                *self.pose_ticks.entry(id).or_default() += 1;
            }
        }
        for &j in matched.iter().flatten() {
            *self.matched_ticks.entry(distances.pose_ids[j]).or_default() += 1;
        }
        for (i, &actor) in distances.true_ids.iter().enumerate() {
            for (j, &id) in distances.pose_ids.iter().enumerate() {
                if distances.within_gate(i, j).is_some() {
                    *self.close_ticks.entry((actor, id)).or_default() += 1;
                }
            }
        }
        self.clear.add(distances);
    }

    /// The number of id changes of `actor`.
    pub(super) fn switches_of(&self, actor: u32) -> u64 {
        self.clear.switches.get(&actor).copied().unwrap_or(0)
    }

    pub(super) fn finish(&self) -> IdentityScore {
        let is_false = |(id, &ticks): (&u32, &u64)| {
            2 * self.matched_ticks.get(id).copied().unwrap_or(0) < ticks
        };
        let false_births = self
            .pose_ticks
            .iter()
            .filter(|&entry| is_false(entry))
            .count() as u64;
        let n_truths: u64 = self.true_ticks.values().sum();
        let n_poses: u64 = self.pose_ticks.values().sum();
        IdentityScore {
            switches: self.clear.switches.values().sum(),
            fragmentations: self
                .clear
                .found_again
                .values()
                .map(|n| n.saturating_sub(1))
                .sum(),
            false_births: match self.truth {
                TruthExtent::Whole => false_births,
                TruthExtent::Partial => 0,
            },
            idf1: percent(2 * self.identity_true_positives(), n_truths + n_poses),
            mota: self.clear.mota(n_truths, n_poses),
        }
    }

    /// Ticks explained by the best one-to-one assignment of actors to ids.
    ///
    /// `TrackEval` minimises misses and false positives over a square matrix with a stand-in per actor and id. Each
    /// explained tick lowers both by one, so maximising explained ticks is equivalent.
    fn identity_true_positives(&self) -> u64 {
        let actors: Vec<u32> = self.true_ticks.keys().copied().collect();
        let ids: Vec<u32> = self.pose_ticks.keys().copied().collect();
        let shared = |i: usize, j: usize| {
            self.close_ticks
                .get(&(actors[i], ids[j]))
                .copied()
                .unwrap_or(0)
        };
        let pairs = assign(actors.len(), ids.len(), |i, j| -(shared(i, j) as f64));
        pairs
            .iter()
            .enumerate()
            .filter_map(|(i, j)| j.map(|j| shared(i, j)))
            .sum()
    }
}

/// The CLEAR metrics of `TrackEval`.
#[derive(Debug, Clone, Default)]
struct Clear {
    true_positives: u64,
    /// Per actor, the number of id changes.
    switches: BTreeMap<u32, u64>,
    /// Per actor, its last id at any earlier tick.
    last_id: BTreeMap<u32, u32>,
    /// Per actor, its id at the previous tick.
    previous: BTreeMap<u32, u32>,
    /// Per actor, the number of times that it was found after a tick without a pose.
    found_again: BTreeMap<u32, u64>,
}

impl Clear {
    fn add(&mut self, distances: &Distances) {
        if distances.true_ids.is_empty() || distances.pose_ids.is_empty() {
            return; // as in `TrackEval`: such a tick does not end a continuation
        }
        let value = |i: usize, j: usize| {
            let distance_m = distances.within_gate(i, j)?;
            let goes_on = self.previous.get(&distances.true_ids[i]) == Some(&distances.pose_ids[j]);
            Some(1.0 - distance_m + if goes_on { CONTINUATION } else { 0.0 })
        };
        let assigned = assign(
            distances.true_ids.len(),
            distances.pose_ids.len(),
            |i, j| -value(i, j).unwrap_or(0.0),
        );
        let mut current = BTreeMap::new();
        for (i, j) in assigned.into_iter().enumerate() {
            if let Some(j) = j.filter(|&j| value(i, j).is_some()) {
                current.insert(distances.true_ids[i], distances.pose_ids[j]);
            }
        }
        for (&actor, &id) in &current {
            let before = self.last_id.insert(actor, id);
            if before.is_some_and(|before| before != id) {
                *self.switches.entry(actor).or_default() += 1;
            }
            if !self.previous.contains_key(&actor) {
                *self.found_again.entry(actor).or_default() += 1;
            }
        }
        self.true_positives += current.len() as u64;
        self.previous = current;
    }

    fn mota(&self, n_truths: u64, n_poses: u64) -> f64 {
        let wrong = (n_poses - self.true_positives) + self.switches.values().sum::<u64>();
        percent(self.true_positives, n_truths) - percent(wrong, n_truths)
    }
}
