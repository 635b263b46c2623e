//! Compares poses with a truth at selected ticks, with the truth unchanged or reinterpreted.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use farfield_fusion::assign::assign;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::similarity::Similarity;
use crate::lines::PoseLines;
use crate::pairing::{Distances, GATE_M};
use crate::points::{LIMB_POINTS, N_POINTS, ScoredBody};

/// Limits on the ticks compared: an error that one number corrects shows at few ticks.
const MIN_TICKS: usize = 5;
const MAX_TICKS: usize = 200;
/// A half of the recording needs more ticks: a shift of one or two ticks fits any few ticks.
const MIN_HALF_TICKS: usize = 20;
/// Most pairs of a true body and a pose over all ticks. It bounds the time for a crowd.
const MAX_PAIRS: usize = 4000;
/// Most pairs of a true person and a posed person that are compared as tracks.
const MAX_TRACKS: usize = 16;

/// Maps a tick of the truth to the tick of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TickMap {
    /// The poses are this many ticks later.
    After(i64),
    /// The truth counts two ticks where the poses count one, starting at the first tick of the truth and of the poses.
    TwoToOne([Tick; 2]),
    /// The truth counts one tick where the poses count two, starting at the same two ticks.
    OneToTwo([Tick; 2]),
}

impl TickMap {
    fn pose_tick(self, tick: Tick) -> Tick {
        match self {
            Self::After(ticks) => tick + ticks,
            Self::TwoToOne([truth, poses]) => poses + (tick - truth).div_euclid(2),
            Self::OneToTwo([truth, poses]) => poses + (tick - truth).saturating_mul(2),
        }
    }
}

/// The body parts of [`LIMB_POINTS`], in their order; each has a left and a right point.
pub(super) const PARTS: [&str; LIMB_POINTS.len() / 2] =
    ["shoulders", "elbows", "wrists", "hips", "knees", "ankles"];

/// Maps the names of points in the poses to those in the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NameMap {
    Unchanged,
    SidesExchanged,
    /// Two [`PARTS`] are exchanged, on both sides.
    PartsExchanged([usize; 2]),
}

impl NameMap {
    /// The slot of the truth that corresponds to `slot` of the poses.
    fn truth_slot(self, slot: usize) -> usize {
        // The limb points come in pairs, left and right; a head has no side.
        let is_paired = slot < LIMB_POINTS.len();
        let (part, side) = (slot / 2, slot % 2);
        match self {
            Self::SidesExchanged if is_paired => slot ^ 1,
            Self::PartsExchanged([one, other]) if part == one => 2 * other + side,
            Self::PartsExchanged([one, other]) if part == other => 2 * one + side,
            _ => slot,
        }
    }
}

/// An interpretation of the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    pub(super) ticks: TickMap,
    pub(super) names: NameMap,
    pub(super) place: Similarity,
}

impl Reading {
    pub(super) fn unchanged() -> Self {
        Self {
            ticks: TickMap::After(0),
            names: NameMap::Unchanged,
            place: Similarity::identity(),
        }
    }

    fn apply(&self, truth: &ScoredBody) -> ScoredBody {
        let point = |slot: usize| truth.points_m[self.names.truth_slot(slot)];
        ScoredBody {
            points_m: std::array::from_fn(|slot| point(slot).map(|at_m| self.place.apply(at_m))),
            ..ScoredBody::default()
        }
    }
}

/// An unchanged body of the truth and the pose that it is compared with.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyPair<'a> {
    truth: &'a ScoredBody,
    pose: &'a ScoredBody,
    /// Mean distance of their points under a reading, metres; [`GATE_M`] if larger or unknown.
    distance_m: f64,
}

/// The points that both bodies of a pair have: `[truth, pose]`.
pub(super) fn shared_points(pairs: &[BodyPair<'_>], names: NameMap) -> Vec<[Vector3<f64>; 2]> {
    let of_pair = |pair: &BodyPair<'_>| {
        let (truth, pose) = (pair.truth.points_m, pair.pose.points_m);
        let known = pose.into_iter().enumerate();
        let known = known.filter_map(|(slot, p)| Some([truth[names.truth_slot(slot)]?, p?]));
        known.collect::<Vec<_>>()
    };
    pairs.iter().flat_map(of_pair).collect()
}

/// The number of joints or keypoints that both bodies of some pair have. Many ticks of a single joint constrain a similarity
/// little more than one tick does.
pub(super) fn n_shared_kinds(pairs: &[BodyPair<'_>], names: NameMap) -> usize {
    let is_known = |slot: &usize| {
        let mut pairs = pairs.iter();
        pairs.any(|pair| {
            let true_point = pair.truth.points_m[names.truth_slot(*slot)];
            true_point.is_some() && pair.pose.points_m[*slot].is_some()
        })
    };
    (0..N_POINTS).filter(is_known).count()
}

/// The pairs at most twice as far apart as the median pair. The others belong to another person or to a false pose.
pub(super) fn nearest(mut pairs: Vec<BodyPair<'_>>) -> Vec<BodyPair<'_>> {
    pairs.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    if let Some(median) = pairs.get(pairs.len() / 2).copied() {
        pairs.retain(|pair| pair.distance_m <= 2.0 * median.distance_m);
    }
    pairs
}

/// Distances of the pairs under one reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairDistances {
    /// Mean over the nearest three quarters, metres. People without a pose and false poses do not depend on how the truth is
    /// read.
    pub(super) most_m: f64,
    /// Mean over the pairs within the gate, metres.
    pub(super) near_m: Option<f64>,
    /// Number of pairs.
    pub(super) n: usize,
}

impl PairDistances {
    /// `None` without pairs.
    pub(super) fn from_pairs(pairs: &[BodyPair<'_>]) -> Option<Self> {
        let mut distances_m: Vec<f64> = pairs.iter().map(|pair| pair.distance_m).collect();
        distances_m.sort_by(f64::total_cmp);
        let n = distances_m.len();
        let n_near = distances_m.partition_point(|&distance_m| distance_m < GATE_M);
        Some(Self {
            most_m: mean(&distances_m[..(3 * n).div_ceil(4)])?,
            near_m: mean(&distances_m[..n_near]),
            n,
        })
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The ticks at which poses and truth are compared.
#[derive(Debug, Clone)]
pub(super) struct Comparison<'a> {
    poses: &'a PoseLines,
    truth: &'a PoseLines,
    /// Ticks of the truth at which both contain people, ascending.
    ticks: Vec<Tick>,
}

impl<'a> Comparison<'a> {
    /// `None` if the two share fewer than [`MIN_TICKS`] ticks.
    pub(super) fn new(poses: &'a PoseLines, truth: &'a PoseLines) -> Option<Self> {
        let n_pairs = |tick| Some(truth.people_at(tick)?.len() * poses.people_at(tick)?.len());
        let shared: Vec<(Tick, usize)> = truth
            .ticks()
            .filter_map(|tick| Some((tick, n_pairs(tick)?)))
            .collect();
        let n = shared.len();
        if n < MIN_TICKS {
            return None;
        }
        let all: usize = shared.iter().map(|(_, n_pairs)| n_pairs).sum();
        let most = (MAX_PAIRS * n / all.max(1)).clamp(MIN_TICKS, MAX_TICKS);
        let most = most.min(n);
        Some(Self {
            poses,
            truth,
            ticks: (0..most).map(|i| shared[i * n / most].0).collect(),
        })
    }

    /// The first half and the second half of the ticks; `None` if they are too short.
    pub(super) fn halves(&self) -> Option<[Self; 2]> {
        let (first, second) = self.ticks.split_at(self.ticks.len() / 2);
        (first.len() >= MIN_HALF_TICKS).then(|| {
            [first, second].map(|ticks| Self {
                ticks: ticks.to_vec(),
                ..self.clone()
            })
        })
    }

    /// The first and the last compared tick.
    pub(super) fn ends(&self) -> Option<[i64; 2]> {
        Some([self.ticks.first()?.0, self.ticks.last()?.0])
    }

    /// The first tick of the truth, and that of the poses.
    pub(super) fn first_ticks(&self) -> Option<[Tick; 2]> {
        Some([self.truth.ticks().next()?, self.poses.ticks().next()?])
    }

    /// Assigns poses to true bodies at each tick: as many pairs as possible, with the least distances under the reading.
    pub(super) fn pairs(&self, reading: &Reading) -> Vec<BodyPair<'a>> {
        let mut pairs = Vec::new();
        for &tick in &self.ticks {
            let truths = self.truth.people_at(tick);
            let Some((truths, poses)) =
                truths.zip(self.poses.people_at(reading.ticks.pose_tick(tick)))
            else {
                continue;
            };
            let read: BTreeMap<u32, ScoredBody> = truths
                .iter()
                .map(|(&person, body)| (person, reading.apply(body)))
                .collect();
            let distances = Distances::new(&read, poses);
            let distance_m = |i: usize, j: usize| distances.pair_m(i, j).min(GATE_M);
            let assigned = assign(truths.len(), poses.len(), distance_m);
            for (i, (truth, j)) in truths.values().zip(assigned).enumerate() {
                pairs.extend(j.map(|j| BodyPair {
                    truth,
                    pose: &poses[&distances.pose_ids[j]],
                    distance_m: distance_m(i, j),
                }));
            }
        }
        pairs
    }

    /// The pairs of the unchanged truth at the ticks that `ticks` compares: once at those of the truth, once at those of the
    /// poses.
    pub(super) fn unchanged_pairs_at(&self, ticks: TickMap) -> [Vec<BodyPair<'a>>; 2] {
        let has_poses = |tick: &Tick| self.poses.people_at(ticks.pose_tick(*tick)).is_some();
        let of_truth: Vec<Tick> = self.ticks.iter().copied().filter(has_poses).collect();
        let of_poses = of_truth.iter().map(|&tick| ticks.pose_tick(tick)).collect();
        [of_truth, of_poses].map(|ticks| {
            let selected = Self {
                ticks,
                ..self.clone()
            };
            selected.pairs(&Reading::unchanged())
        })
    }

    /// Each person of the truth paired with each of the poses; the pairs with most common ticks come first.
    pub(super) fn tracks(&self) -> Vec<Vec<BodyPair<'a>>> {
        let mut tracks: BTreeMap<[u32; 2], Vec<BodyPair<'a>>> = BTreeMap::new();
        for &tick in &self.ticks {
            let truths = self.truth.people_at(tick).into_iter().flatten();
            for (&actor, truth) in truths {
                for (&id, pose) in self.poses.people_at(tick).into_iter().flatten() {
                    tracks.entry([actor, id]).or_default().push(BodyPair {
                        truth,
                        pose,
                        distance_m: GATE_M,
                    });
                }
            }
        }
        let mut tracks: Vec<_> = tracks.into_values().collect();
        tracks.sort_by_key(|pairs| Reverse(pairs.len()));
        tracks.truncate(MAX_TRACKS);
        tracks
    }
}
