//! Poses and a truth held against each other at some ticks, with the truth as it stands or read in another way.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use farfield_fusion::assign::assign;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::similarity::Similarity;
use crate::lines::PoseLines;
use crate::pairing::{Distances, GATE_M};
use crate::points::{LIMB_POINTS, N_POINTS, ScoredBody};

/// Ticks that are looked at: what one number would mend shows at few.
const LEAST_TICKS: usize = 5;
const MOST_TICKS: usize = 200;
/// Of half of the time there must be more: a shift of a tick or two explains something of any few.
const LEAST_HALF_TICKS: usize = 20;
/// Most pairs of a truth and a pose over all ticks, so that a crowd takes no longer.
const MOST_PAIRS: usize = 4000;
/// Most pairs of a person of the truth and one of the poses that are told apart.
const MOST_TRACKS: usize = 16;

/// At which tick the poses have what the truth has at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TickMap {
    /// So many ticks later.
    After(i64),
    /// The truth counts two ticks where the poses count one; both from these ticks, the truth's and the poses'.
    TwoToOne([Tick; 2]),
    /// The truth counts one tick where the poses count two.
    OneToTwo([Tick; 2]),
}

impl TickMap {
    fn of(self, tick: Tick) -> Tick {
        match self {
            Self::After(ticks) => tick + ticks,
            Self::TwoToOne([truth, poses]) => poses + (tick - truth).div_euclid(2),
            Self::OneToTwo([truth, poses]) => poses + (tick - truth).saturating_mul(2),
        }
    }
}

/// The parts of [`LIMB_POINTS`], left and right of each, in their order.
pub(super) const PARTS: [&str; LIMB_POINTS.len() / 2] =
    ["shoulders", "elbows", "wrists", "hips", "knees", "ankles"];

/// What a name stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Names {
    AsTheyAre,
    SidesExchanged,
    /// Two of [`PARTS`], on both sides.
    PartsExchanged([usize; 2]),
}

impl Names {
    /// The slot at which the truth has the point of `slot`.
    fn of(self, slot: usize) -> usize {
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

/// How the truth is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    pub(super) ticks: TickMap,
    pub(super) names: Names,
    pub(super) place: Similarity,
}

impl Reading {
    /// As it stands.
    pub(super) fn as_it_is() -> Self {
        Self {
            ticks: TickMap::After(0),
            names: Names::AsTheyAre,
            place: Similarity::identity(),
        }
    }

    fn of(&self, truth: &ScoredBody) -> ScoredBody {
        let point = |slot: usize| truth.points_m[self.names.of(slot)];
        ScoredBody {
            points_m: std::array::from_fn(|slot| point(slot).map(|at_m| self.place.of(at_m))),
            ..ScoredBody::default()
        }
    }
}

/// A body of the truth, as it stands, and the one of the poses that it is held against.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyPair<'a> {
    truth: &'a ScoredBody,
    pose: &'a ScoredBody,
    /// Mean distance of their points under a reading, metres; [`GATE_M`] where it is more, or not known.
    distance_m: f64,
}

/// The points that both bodies of the pairs know, of the truth and of the poses.
pub(super) fn points_of(pairs: &[BodyPair<'_>], names: Names) -> Vec<[Vector3<f64>; 2]> {
    let of_pair = |pair: &BodyPair<'_>| {
        let (truth, pose) = (pair.truth.points_m, pair.pose.points_m);
        let known = pose.into_iter().enumerate();
        let known = known.filter_map(|(slot, p)| Some([truth[names.of(slot)]?, p?]));
        known.collect::<Vec<_>>()
    };
    pairs.iter().flat_map(of_pair).collect()
}

/// How many joints or keypoints both bodies of the pairs know: of one the points of all ticks tell hardly more than one does.
pub(super) fn kinds(pairs: &[BodyPair<'_>], names: Names) -> usize {
    let is_known = |slot: &usize| {
        let mut pairs = pairs.iter();
        pairs.any(|pair| {
            pair.truth.points_m[names.of(*slot)].is_some() && pair.pose.points_m[*slot].is_some()
        })
    };
    (0..N_POINTS).filter(is_known).count()
}

/// Those of the pairs that are at most twice as far apart as half of them are: what is left out is another's, or no body at all.
pub(super) fn nearest(mut pairs: Vec<BodyPair<'_>>) -> Vec<BodyPair<'_>> {
    pairs.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    if let Some(median) = pairs.get(pairs.len() / 2).copied() {
        pairs.retain(|pair| pair.distance_m <= 2.0 * median.distance_m);
    }
    pairs
}

/// How far pairs are apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Apart {
    /// Mean over the nearest three quarters, metres: people without a pose, and poses of nobody, are no matter of how a truth is
    /// read.
    pub(super) most_m: f64,
    /// Mean over those within the gate, metres.
    pub(super) near_m: Option<f64>,
    /// How many pairs.
    pub(super) n: usize,
}

impl Apart {
    /// `None` of no pair.
    pub(super) fn of(pairs: &[BodyPair<'_>]) -> Option<Self> {
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

/// The ticks at which poses and truth are held against each other.
#[derive(Debug, Clone)]
pub(super) struct Comparison<'a> {
    poses: &'a PoseLines,
    truth: &'a PoseLines,
    /// Ticks of the truth at which both hold people, rising.
    ticks: Vec<Tick>,
}

impl<'a> Comparison<'a> {
    /// `None` where the two share hardly any tick.
    pub(super) fn of(poses: &'a PoseLines, truth: &'a PoseLines) -> Option<Self> {
        let n_pairs = |tick| Some(truth.people_at(tick)?.len() * poses.people_at(tick)?.len());
        let shared: Vec<(Tick, usize)> = truth
            .ticks()
            .filter_map(|tick| Some((tick, n_pairs(tick)?)))
            .collect();
        let n = shared.len();
        if n < LEAST_TICKS {
            return None;
        }
        let all: usize = shared.iter().map(|(_, n_pairs)| n_pairs).sum();
        let most = (MOST_PAIRS * n / all.max(1)).clamp(LEAST_TICKS, MOST_TICKS);
        let most = most.min(n);
        Some(Self {
            poses,
            truth,
            ticks: (0..most).map(|i| shared[i * n / most].0).collect(),
        })
    }

    /// The same of the first half of the ticks and of the second; `None` where these are too few.
    pub(super) fn halves(&self) -> Option<[Self; 2]> {
        let (first, second) = self.ticks.split_at(self.ticks.len() / 2);
        (first.len() >= LEAST_HALF_TICKS).then(|| {
            [first, second].map(|ticks| Self {
                ticks: ticks.to_vec(),
                ..self.clone()
            })
        })
    }

    /// The first and the last tick that are compared.
    pub(super) fn ends(&self) -> Option<[i64; 2]> {
        Some([self.ticks.first()?.0, self.ticks.last()?.0])
    }

    /// The first tick of the truth, and that of the poses.
    pub(super) fn first_ticks(&self) -> Option<[Tick; 2]> {
        Some([self.truth.ticks().next()?, self.poses.ticks().next()?])
    }

    /// As many pairs a tick as there can be, with the least distances that the reading leaves.
    pub(super) fn pairs(&self, reading: &Reading) -> Vec<BodyPair<'a>> {
        let mut pairs = Vec::new();
        for &tick in &self.ticks {
            let truths = self.truth.people_at(tick);
            let Some((truths, poses)) = truths.zip(self.poses.people_at(reading.ticks.of(tick)))
            else {
                continue;
            };
            let read: BTreeMap<u32, ScoredBody> = truths
                .iter()
                .map(|(&person, body)| (person, reading.of(body)))
                .collect();
            let distances = Distances::new(&read, poses);
            let distance_m = |i: usize, j: usize| distances.of_m(i, j).min(GATE_M);
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

    /// The pairs of the truth as it stands at the ticks that a reading at other ticks compares: at those of the truth, and at those
    /// of the poses.
    pub(super) fn as_it_is_where(&self, ticks: TickMap) -> [Vec<BodyPair<'a>>; 2] {
        let read = |tick: &Tick| self.poses.people_at(ticks.of(*tick)).is_some();
        let of_truth: Vec<Tick> = self.ticks.iter().copied().filter(read).collect();
        let of_poses = of_truth.iter().map(|&tick| ticks.of(tick)).collect();
        [of_truth, of_poses].map(|ticks| {
            let there = Self {
                ticks,
                ..self.clone()
            };
            there.pairs(&Reading::as_it_is())
        })
    }

    /// Each person of the truth with each of the poses, those first who are there together for longest.
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
        tracks.truncate(MOST_TRACKS);
        tracks
    }
}
