//! Codes the modes of the maps of a patch, and predicts each keypoint's peak from the peaks of
//! earlier keypoints. Encoder and decoder run the same code.
//!
//! Each of COCO's 17 keypoints is predicted from one or two others and a typical offset. Keypoints
//! of other networks are predicted at the last peak.

use super::contexts::Contexts;
use super::mode::{MOST_TILTED, MapScale, Mode, OUTSIDE, STEPS, WIDEST};
use super::recipe::{MAX_MODES, Recipe};
use crate::patch::entropy::range_coder::BitCoder;
use crate::patch::entropy::symbol::{count, number, plain, tree};

/// Positions are coded in quarters of a unit with contexts; finer bits are practically random.
const QUARTER_BITS: u32 = (STEPS / 4).ilog2();

/// The state of the coder within a patch.
#[derive(Debug, Clone)]
pub(in crate::patch) struct ModeCoder {
    pub(in crate::patch) contexts: Contexts,
    body: PeakPredictor,
    last: [i32; 2],
    last_count: usize,
    /// Height and widths of the last mode.
    last_height: Option<u8>,
    last_widths: [i32; 3],
}

impl ModeCoder {
    pub(in crate::patch) fn new() -> Self {
        Self {
            contexts: Contexts::new(),
            body: PeakPredictor::new(),
            last: [0; 2],
            last_count: 1,
            last_height: None,
            last_widths: [0; 3],
        }
    }

    /// Resets the state of earlier maps, but not the contexts, before `keypoints` maps of `scale`.
    pub(in crate::patch) fn begin(&mut self, keypoints: usize, scale: &MapScale) {
        self.last = scale.last();
        self.body.reset(keypoints, self.last);
        self.last_count = 1;
        self.last_height = None;
        self.last_widths = [0; 3];
    }

    /// Codes the modes of the next map: writes `modes`, or fills it.
    pub(in crate::patch) fn modes<C: BitCoder>(
        &mut self,
        coder: &mut C,
        recipe: &Recipe,
        modes: &mut Vec<Mode>,
    ) {
        let n = count(coder, self.contexts.count(self.last_count), modes.len());
        self.last_count = n;
        modes.resize(n.min(MAX_MODES), Mode::default());
        let (mut expected, mut class) = self.body.expected();
        for mode in modes.iter_mut() {
            self.mode(coder, recipe, (expected, class), mode);
            (expected, class) = (mode.at, FURTHER);
        }
        self.body.push(modes.first().map(|mode| mode.at));
    }

    fn mode<C: BitCoder>(
        &mut self,
        coder: &mut C,
        recipe: &Recipe,
        (expected, class): ([i32; 2], usize),
        mode: &mut Mode,
    ) {
        for axis in 0..2 {
            let expected = expected[axis] >> QUARTER_BITS;
            let contexts = self.contexts.position(class, axis);
            let off = number(coder, contexts, (mode.at[axis] >> QUARTER_BITS) - expected);
            let bits = QUARTER_BITS - recipe.position_bits;
            let fine = (mode.at[axis] >> recipe.position_bits) as u32 & ((1 << bits) - 1);
            let fine = plain(coder, bits, fine) << recipe.position_bits;
            let at = (expected + off) << QUARTER_BITS | fine.cast_signed();
            mode.at[axis] = at.clamp(-OUTSIDE * STEPS, self.last[axis] + OUTSIDE * STEPS);
        }
        let of_height = match self.last_height {
            _ if class == FURTHER => 4,
            None => 0,
            Some(height) => 1 + usize::from(height > 127) + usize::from(height > 207),
        };
        let upper = tree(
            coder,
            self.contexts.height(of_height),
            usize::from(mode.height >> 4),
        );
        let bits = 4 - recipe.height_bits;
        let fine = u32::from(mode.height) >> recipe.height_bits & ((1 << bits) - 1);
        let fine = plain(coder, bits, fine);
        mode.height = recipe.height((upper as u32) << bits | fine);
        if class != FURTHER {
            self.last_height = Some(mode.height);
        }
        self.shape(coder, recipe, mode);
    }

    fn shape<C: BitCoder>(&mut self, coder: &mut C, recipe: &Recipe, mode: &mut Mode) {
        let written = [mode.width[0], mode.width[1], mode.tilt];
        let steps = [recipe.width_step, recipe.width_step, recipe.tilt_step];
        let most = [WIDEST, WIDEST, MOST_TILTED];
        let mut coded = [0; 3];
        for i in 0..3 {
            if i == 2 && !recipe.has_tilt() {
                continue;
            }
            let expected = if i == 1 {
                coded[0]
            } else {
                self.last_widths[i]
            };
            let contexts = self.contexts.width(steps[i], i, expected);
            coded[i] = number(coder, contexts, written[i] / steps[i]);
        }
        self.last_widths = coded;
        let [across, down, tilt] =
            [0, 1, 2].map(|i| (coded[i] * steps[i]).clamp(-most[i], most[i]));
        (mode.width, mode.tilt) = ([across, down], tilt);
    }
}

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
struct PeakPredictor {
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
