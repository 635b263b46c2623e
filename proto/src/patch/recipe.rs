//! What a quality means: how finely modes are written, and what is corrected after them.

use super::mode::{MOST_TILTED, Mode};
use super::quality::{FLOOR, Quality};

/// How maps become bytes at one quality. The decoder needs the steps, all else is the encoder's own.
#[derive(Debug, Clone, Copy)]
pub(super) struct Recipe {
    /// Least height of a mode.
    pub(super) floor: u8,
    /// Most modes of a map.
    pub(super) modes: usize,
    /// Bits of a position, of [`super::mode::STEPS`], that are left out.
    pub(super) position_bits: u32,
    /// Bits of a height that are left out, at most 4.
    pub(super) height_bits: u32,
    /// Widths are multiples of so many steps.
    pub(super) width_step: i32,
    /// Correlations are multiples of so many steps.
    pub(super) tilt_step: i32,
    /// What the modes leave is corrected.
    pub(super) correction: Correction,
}

/// How what the modes of a map leave is corrected.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    /// Where no cell is off by more, nothing is.
    pub(super) tolerance: u8,
    /// Corrections are multiples of this.
    pub(super) step: u8,
    /// Units from one correction to the next; between them it is interpolated.
    pub(super) pitch: u8,
}

/// Most modes of a map at any quality.
pub(super) const MAX_MODES: usize = 4;

impl Recipe {
    /// That of `quality`; there is none for what is kept without loss.
    pub(super) const fn of(quality: Quality) -> Option<Self> {
        let (floor, modes, [position_bits, height_bits], [width_step, tilt_step], correction) =
            match quality.level() {
                0 => return None,
                1 => (FLOOR, 4, [0, 0], [1, 1], [6, 4, 1]),
                2 => (18, 4, [0, 1], [1, 1], [12, 8, 1]),
                3 => (20, 4, [1, 2], [1, 1], [20, 12, 1]),
                4 => (25, 4, [1, 3], [2, 2], [36, 24, 2]),
                5 => (30, 3, [2, 4], [3, 2], [64, 40, 2]),
                _ => (38, 2, [2, 4], [4, 8], [255, 64, 2]),
            };
        let [tolerance, step, pitch] = correction;
        Some(Self {
            floor,
            modes,
            position_bits,
            height_bits,
            width_step,
            tilt_step,
            correction: Correction {
                tolerance,
                step,
                pitch,
            },
        })
    }

    /// The mode as it can be written.
    pub(super) fn snapped(&self, mode: &Mode) -> Mode {
        let near = |value: i32, step: i32| (value + step.div_euclid(2)).div_euclid(step) * step;
        let height = u32::from(mode.height);
        Mode {
            at: mode.at.map(|at| near(at, 1 << self.position_bits)),
            height: self.height(height >> self.height_bits),
            width: mode.width.map(|width| near(width, self.width_step)),
            tilt: if self.has_tilt() {
                near(mode.tilt, self.tilt_step)
            } else {
                0
            },
        }
    }

    /// Whether correlations are written: with coarser steps than these there are none.
    pub(super) fn has_tilt(&self) -> bool {
        self.tilt_step <= MOST_TILTED
    }

    /// The height of a step of heights.
    pub(super) fn height(&self, step: u32) -> u8 {
        (step << self.height_bits | (1 << self.height_bits) / 2) as u8
    }
}
