//! Predicts a keypoint's peak from the peaks of earlier keypoints, which both sides know.
//!
//! Each of COCO's 17 keypoints is predicted from one or two others and a typical offset. Keypoints
//! of other networks are predicted at the last peak.

/// Classes of predictions: the 17 keypoints, a keypoint of another network, a further peak.
pub(super) const CLASSES: usize = 19;
/// The class of a keypoint of another network.
const OTHER: usize = 17;
/// The class of a map's further peaks.
pub(super) const FURTHER: usize = 18;

/// For each of COCO's keypoints: the keypoints that predict its column and its row, and its typical
/// offsets from them, sixteenths of a unit. Measured on the maps of TinyPose, of rendered and of
/// simulated people together.
const NEAR: [([usize; 2], [i32; 2]); 17] = [
    ([0, 0], [0, 0]),
    ([0, 0], [4, -14]),
    ([1, 1], [-14, -1]),
    ([1, 1], [10, 7]),
    ([2, 2], [-12, 7]),
    ([3, 3], [16, 78]),
    ([4, 5], [-16, 0]),
    ([5, 5], [8, 100]),
    ([6, 6], [-8, 96]),
    ([7, 7], [0, 60]),
    ([8, 8], [8, 40]),
    ([5, 5], [0, 215]),
    ([11, 11], [-32, -2]),
    ([11, 11], [0, 155]),
    ([12, 13], [0, 0]),
    ([13, 13], [0, 150]),
    ([14, 15], [0, 0]),
];

/// The first peaks of the maps so far, as both sides know them.
#[derive(Debug, Clone)]
pub(super) struct PeakPredictor {
    peaks: Vec<Option<[i32; 2]>>,
    middle: [i32; 2],
    is_coco: bool,
}

impl PeakPredictor {
    pub(super) fn new() -> Self {
        Self {
            peaks: Vec::new(),
            middle: [0; 2],
            is_coco: true,
        }
    }

    /// Resets all peaks, before maps of that many keypoints whose last position is `last`.
    pub(super) fn reset(&mut self, keypoints: usize, last: [i32; 2]) {
        self.peaks.clear();
        self.is_coco = keypoints == NEAR.len();
        self.middle = last.map(|last| last / 2);
        if self.is_coco {
            // The head is in the upper part of an upright person's crop.
            self.middle[1] = last[1] / 5;
        }
    }

    /// The predicted position of the next map's first peak, and the class of the prediction.
    pub(super) fn expected(&self) -> ([i32; 2], usize) {
        let k = self.peaks.len();
        let nearest = self.peaks.iter().rev().flatten().next();
        let nearest = *nearest.unwrap_or(&self.middle);
        if !self.is_coco {
            return (nearest, OTHER);
        }
        let (of, offset) = NEAR[k % NEAR.len()];
        let at = [0, 1].map(|axis| {
            let near = self.peaks.get(of[axis]).copied().flatten();
            near.map_or(nearest[axis], |near| near[axis] + offset[axis])
        });
        (at, k % NEAR.len())
    }

    /// Adds the first peak of the next map, if any.
    pub(super) fn push(&mut self, peak: Option<[i32; 2]>) {
        self.peaks.push(peak);
    }
}
