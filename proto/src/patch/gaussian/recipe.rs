//! The parameters of each compression level: precision of modes, and corrections.

use super::mode::{MOST_TILTED, Mode};
use crate::patch::compression_level::{CompressionLevel, FLOOR};

/// The parameters of one compression level. The decoder needs the steps; the rest is used by the
/// encoder only.
#[derive(Debug, Clone, Copy)]
pub(in crate::patch) struct Recipe {
    /// Minimum height of a mode.
    pub(in crate::patch) floor: u8,
    /// Most modes of a map.
    pub(in crate::patch) modes: usize,
    /// Omitted bits of a position, of [`super::mode::STEPS`].
    pub(in crate::patch) position_bits: u32,
    /// Omitted bits of a height, at most 4.
    pub(in crate::patch) height_bits: u32,
    /// Widths are multiples of this number of steps.
    pub(in crate::patch) width_step: i32,
    /// Correlations are multiples of this number of steps.
    pub(in crate::patch) tilt_step: i32,
    /// The first of [`STEPS_DOWN`] to try.
    pub(in crate::patch) first: usize,
    /// A patch of more bytes is encoded again, one step further down.
    pub(in crate::patch) most_bytes: usize,
}

/// What is sent in addition to the highest peak of each map.
#[derive(Debug, Clone, Copy)]
pub(in crate::patch) struct Rest {
    /// No correction if no cell's error is larger.
    pub(in crate::patch) tolerance: u8,
    /// Corrections are multiples of this; 0: none.
    pub(in crate::patch) step: u8,
    /// Minimum height of a map's further modes.
    pub(in crate::patch) further: u8,
}

/// From finest to coarsest; a patch contains its index.
pub(in crate::patch) const STEPS_DOWN: [Rest; 11] = [
    rest(6, 4, 0),
    rest(12, 8, 0),
    rest(20, 12, 0),
    rest(28, 20, 32),
    rest(40, 24, 40),
    rest(48, 32, 48),
    rest(64, 40, 64),
    rest(u8::MAX, 0, 32),
    rest(u8::MAX, 0, 64),
    rest(u8::MAX, 0, 96),
    rest(u8::MAX, 0, 128),
];

/// The first step without corrections.
pub(in crate::patch) const NO_CORRECTION: usize = 7;

const fn rest(tolerance: u8, step: u8, further: u8) -> Rest {
    Rest {
        tolerance,
        step,
        further,
    }
}

/// Most modes of a map at any compression level.
pub(in crate::patch) const MAX_MODES: usize = 4;

impl Recipe {
    /// The recipe of `level`; `None` for lossless.
    pub(in crate::patch) const fn for_level(level: CompressionLevel) -> Option<Self> {
        let (
            floor,
            modes,
            [position_bits, height_bits],
            [width_step, tilt_step],
            [first, most_bytes],
        ) = match level.number() {
            0 => return None,
            1 => (FLOOR, 4, [0, 0], [1, 1], [0, usize::MAX]),
            2 => (18, 4, [0, 1], [1, 1], [1, 290]),
            3 => (20, 4, [1, 2], [1, 1], [2, 190]),
            4 => (25, 4, [1, 3], [2, 2], [4, 115]),
            5 => (25, 3, [1, 3], [2, 2], [7, 105]),
            _ => (38, 2, [2, 4], [4, 8], [7, 95]),
        };
        Some(Self {
            floor,
            modes,
            position_bits,
            height_bits,
            width_step,
            tilt_step,
            first,
            most_bytes,
        })
    }

    /// The mode rounded to what can be written.
    pub(in crate::patch) fn snapped(&self, mode: &Mode) -> Mode {
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

    /// Whether correlations are written: coarser steps have none.
    pub(in crate::patch) fn has_tilt(&self) -> bool {
        self.tilt_step <= MOST_TILTED
    }

    /// The height of a step of heights.
    pub(in crate::patch) fn height(&self, step: u32) -> u8 {
        ((step << self.height_bits) | ((1 << self.height_bits) / 2)) as u8
    }
}
