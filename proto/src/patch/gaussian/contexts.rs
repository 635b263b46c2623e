//! The contexts of the range coder: probabilities that adapt within a patch and start with the
//! priors.

use super::mode_coder::CLASSES;
use super::priors::PRIORS;
use crate::patch::entropy::range_coder::Probability;
use crate::patch::entropy::symbol::NUMBER;

/// Number of contexts of each kind, in storage order.
const POSITIONS: usize = 2 * CLASSES * NUMBER;
const HEIGHTS: usize = HEIGHT_CLASSES * HEIGHT_NODES;
const WIDTHS: usize = 3 * WIDTH_CLASSES * 3 * NUMBER;
const COUNTS: usize = 3 * COUNT_NODES;
const CORRECTED: usize = 3;
const WINDOWS: usize = 4 * NUMBER;
const ZEROS: usize = ZERO_CLASSES;
const SIGNS: usize = 5;
const SIZES: usize = SIZE_CLASSES * SIZE_NODES;
const TOTAL: usize =
    POSITIONS + HEIGHTS + WIDTHS + COUNTS + CORRECTED + WINDOWS + ZEROS + SIGNS + SIZES;
const _: () = assert!(TOTAL == PRIORS.len(), "one prior for each context");

/// Classes of a height: no previous mode, a low, a middle, a high one, a further peak.
const HEIGHT_CLASSES: usize = 5;
const HEIGHT_NODES: usize = 15;
/// Classes of a width: steps of 1, of 2, and coarser ones.
const WIDTH_CLASSES: usize = 3;
const COUNT_NODES: usize = super::recipe::MAX_MODES;
/// Classes of a correction that may be zero: four of its neighbours, four of the drawn value.
pub(in crate::patch) const ZERO_CLASSES: usize = 20;
/// Classes of a correction's size, by its neighbours.
pub(in crate::patch) const SIZE_CLASSES: usize = 3;
/// Sizes after the first; beyond, the rest is a number without contexts.
pub(in crate::patch) const SIZE_NODES: usize = 12;

/// The contexts of one patch.
#[derive(Debug, Clone)]
pub(in crate::patch) struct Contexts {
    all: [Probability; TOTAL],
}

impl Contexts {
    /// Contexts with equal probabilities.
    pub(in crate::patch) const fn new() -> Self {
        Self {
            all: [Probability::even(); TOTAL],
        }
    }

    /// Resets all contexts to the priors.
    pub(in crate::patch) fn reset(&mut self) {
        self.all = KNOWN.all;
    }

    fn part(&mut self, first: usize, length: usize) -> &mut [Probability] {
        &mut self.all[first..first + length]
    }

    /// Contexts of a position along an axis, in a class of [`super::mode_coder`].
    pub(in crate::patch) fn position(&mut self, class: usize, axis: usize) -> &mut [Probability] {
        self.part((2 * class + axis) * NUMBER, NUMBER)
    }

    /// Contexts of the upper four bits of a height.
    pub(in crate::patch) fn height(&mut self, class: usize) -> &mut [Probability] {
        self.part(POSITIONS + class * HEIGHT_NODES, HEIGHT_NODES)
    }

    /// Contexts of a width along an axis, or (axis 2) of the correlation, by the step and by how
    /// unusual the last one was.
    pub(in crate::patch) fn width(
        &mut self,
        step: i32,
        axis: usize,
        last: i32,
    ) -> &mut [Probability] {
        let class = usize::from(step > 1) + usize::from(step > 2);
        let unusual = last.unsigned_abs().min(2) as usize;
        let index = (class * 3 + axis) * 3 + unusual;
        self.part(POSITIONS + HEIGHTS + index * NUMBER, NUMBER)
    }

    /// Contexts of the number of modes of a map, by that of the last map.
    pub(in crate::patch) fn count(&mut self, last: usize) -> &mut [Probability] {
        let first = POSITIONS + HEIGHTS + WIDTHS;
        self.part(first + last.min(2) * COUNT_NODES, COUNT_NODES)
    }

    /// Context of whether a map is corrected, by its number of modes.
    pub(in crate::patch) fn corrected(&mut self, modes: usize) -> &mut Probability {
        &mut self.all[POSITIONS + HEIGHTS + WIDTHS + COUNTS + modes.min(2)]
    }

    /// Contexts of a side of the window of corrections.
    pub(in crate::patch) fn window(&mut self, side: usize) -> &mut [Probability] {
        let first = POSITIONS + HEIGHTS + WIDTHS + COUNTS + CORRECTED;
        self.part(first + side * NUMBER, NUMBER)
    }

    /// Contexts of one correction.
    pub(in crate::patch) fn corrections(&mut self) -> Corrections<'_> {
        let first = POSITIONS + HEIGHTS + WIDTHS + COUNTS + CORRECTED + WINDOWS;
        let (zero, rest) = self.all[first..].split_at_mut(ZEROS);
        let (sign, size) = rest.split_at_mut(SIGNS);
        Corrections { zero, sign, size }
    }

    /// The learnt probabilities, in the order of [`KNOWN`].
    pub(in crate::patch) fn learnt(&self) -> impl Iterator<Item = u16> {
        self.all.iter().map(|context| context.of_false())
    }
}

/// The contexts of corrections.
pub(in crate::patch) struct Corrections<'a> {
    pub(in crate::patch) zero: &'a mut [Probability],
    pub(in crate::patch) sign: &'a mut [Probability],
    /// [`SIZE_CLASSES`] times [`SIZE_NODES`].
    pub(in crate::patch) size: &'a mut [Probability],
}

/// The contexts before the first bit: the priors.
static KNOWN: Contexts = {
    let mut known = Contexts::new();
    let mut i = 0;
    while i < TOTAL {
        // A context that never occurred in the measured maps has no prior.
        if PRIORS[i] > 0 {
            known.all[i] = Probability::known((PRIORS[i] as u16) << 8);
        }
        i += 1;
    }
    known
};
