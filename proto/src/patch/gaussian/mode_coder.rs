//! Codes the modes of the maps of a patch; encoder and decoder run the same code.

use super::contexts::Contexts;
use super::mode::{MOST_TILTED, MapScale, Mode, OUTSIDE, STEPS, WIDEST};
use super::peak_predictor::{FURTHER, PeakPredictor};
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
