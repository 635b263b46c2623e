//! Left and right are decided together: the other ankle is inside the lattice, and when a network
//! sees one ankle only, it likes to show it for both.

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::venue::parameters::LatticeParameters;
use nalgebra::Vector3;

use super::{Keypoint, LatticeMode};

/// The joints whose sides are taken for one another.
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
    pub(super) fn of(keypoints: &KeypointSet) -> Vec<Self> {
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

/// Chooses the modes of two sides together when their best ones are the same spot; `None` when they
/// are not, and each side keeps its best. A side that comes out without a mode falls back to its
/// prediction: the sum of both scores decides who keeps a spot, and no mode counts as the least
/// support.
pub(super) fn decide_sides(
    sides: [&Keypoint; 2],
    predicted_m: [Vector3<f64>; 2],
    parameters: &LatticeParameters,
) -> Option<[Option<LatticeMode>; 2]> {
    let cell_m = sides[0].witnesses.cell_m.min(sides[1].witnesses.cell_m);
    let apart_m = (predicted_m[0] - predicted_m[1]).norm();
    let same_spot_m = (SAME_SPOT_CELLS * cell_m).min(SAME_SPOT_OF_PREDICTED * apart_m);
    let same_spot = |left: &LatticeMode, right: &LatticeMode| {
        ((predicted_m[0] + left.offset_m) - (predicted_m[1] + right.offset_m)).norm() < same_spot_m
    };
    let [left, right] = sides.map(|side| side.modes.as_slice());
    if !same_spot(left.first()?, right.first()?) {
        return None;
    }
    let mut best = (f64::NEG_INFINITY, [None, None]);
    for l in left.iter().map(Some).chain([None]) {
        for r in right.iter().map(Some).chain([None]) {
            if l.zip(r).is_some_and(|(l, r)| same_spot(l, r)) {
                continue;
            }
            let score =
                |mode: Option<&LatticeMode>| mode.map_or(parameters.min_support, |m| m.score);
            let sum = score(l) + score(r);
            if sum > best.0 {
                best = (sum, [l.copied(), r.copied()]);
            }
        }
    }
    Some(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coco_has_four_pairs() {
        let pairs = Sides::of(&KeypointSet::coco17());
        assert_eq!(
            pairs.iter().map(|p| p.indices()).collect::<Vec<_>>(),
            [[7, 8], [9, 10], [13, 14], [15, 16]]
        );
    }
}
