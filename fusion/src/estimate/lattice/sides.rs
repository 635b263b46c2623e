//! Left and right are decided together: the other ankle is inside the lattice, and a network that
//! sees only one ankle often shows it for both.

use farfield_proto::keypoints::KeypointSet;
use nalgebra::Vector3;

use super::{Keypoint, LatticeMode};

/// The joints whose sides are often swapped.
const PAIRED: [&str; 4] = ["elbow", "wrist", "knee", "ankle"];
/// Distance below which two sides are on the same spot, cells: about a third of the width of a peak
/// (full width at half height of sigma 2 cells: 4.7).
const SAME_SPOT_CELLS: f64 = 1.5;
/// Two sides that are predicted close together may meet (folded hands): the same spot is at most
/// this share of their predicted distance.
const SAME_SPOT_OF_PREDICTED: f64 = 0.5;

/// Two keypoints of the network that are one joint's left and right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sides {
    left: usize,
    right: usize,
}

impl Sides {
    /// The pairs among a network's keypoints.
    pub(super) fn of_network(keypoints: &KeypointSet) -> Vec<Self> {
        let index = |side: &str, joint: &str| keypoints.index_of(&format!("{side}_{joint}"));
        let pair = |joint: &&str| {
            Some(Self {
                left: index("left", joint)?,
                right: index("right", joint)?,
            })
        };
        PAIRED.iter().filter_map(pair).collect()
    }

    /// Left and right.
    pub(super) fn indices(self) -> [usize; 2] {
        [self.left, self.right]
    }
}

/// How near two places must be to be one spot for both sides.
struct SameSpot {
    predicted_m: [Vector3<f64>; 2],
    within_m: f64,
}

impl SameSpot {
    fn new(sides: [&Keypoint; 2], predicted_m: [Vector3<f64>; 2]) -> Self {
        let cell_m = sides[0].witnesses.cell_m.min(sides[1].witnesses.cell_m);
        let apart_m = (predicted_m[0] - predicted_m[1]).norm();
        Self {
            predicted_m,
            within_m: (SAME_SPOT_CELLS * cell_m).min(SAME_SPOT_OF_PREDICTED * apart_m),
        }
    }

    fn contains(&self, left: &LatticeMode, right: &LatticeMode) -> bool {
        let [of_left, of_right] = self.predicted_m;
        ((of_left + left.offset_m) - (of_right + right.offset_m)).norm() < self.within_m
    }
}

/// Whether the best modes of two sides are the same spot; if not, each side keeps its best.
pub(super) fn are_one_spot(sides: [&Keypoint; 2], predicted_m: [Vector3<f64>; 2]) -> bool {
    let [left, right] = sides.map(|side| side.modes.as_slice().first());
    let same_spot = SameSpot::new(sides, predicted_m);
    left.zip(right)
        .is_some_and(|(left, right)| same_spot.contains(left, right))
}

/// Chooses the modes of two sides together, not both at one spot. A side without a mode falls back
/// to its prediction. The sum of both scores decides which side gets a spot, and no mode counts as
/// the least support.
pub(super) fn decide_sides(
    sides: [&Keypoint; 2],
    predicted_m: [Vector3<f64>; 2],
    min_support: f64,
) -> [Option<LatticeMode>; 2] {
    let same_spot = SameSpot::new(sides, predicted_m);
    let [left, right] = sides.map(|side| side.modes.as_slice());
    let mut best = (f64::NEG_INFINITY, [None, None]);
    for l in left.iter().map(Some).chain([None]) {
        for r in right.iter().map(Some).chain([None]) {
            if l.zip(r).is_some_and(|(l, r)| same_spot.contains(l, r)) {
                continue;
            }
            let score = |mode: Option<&LatticeMode>| mode.map_or(min_support, |m| m.score);
            let sum = score(l) + score(r);
            if sum > best.0 {
                best = (sum, [l.copied(), r.copied()]);
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coco_has_four_pairs() {
        let pairs = Sides::of_network(&KeypointSet::coco17());
        assert_eq!(
            pairs.iter().map(|p| p.indices()).collect::<Vec<_>>(),
            [[7, 8], [9, 10], [13, 14], [15, 16]]
        );
    }
}
