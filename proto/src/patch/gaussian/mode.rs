//! A mode: one peak of a map as a Gaussian, in a few integers.
//!
//! Lengths have units that do not depend on the map's resolution: 64 are its height, or 48 its
//! width, whichever makes them longer. Both sides compute every cell only with additions, products
//! and roots of single precision, so all machines draw the same maps.

use super::rounding::{at_most, ceil, exp2, floor, not_below_zero, whole};
use crate::patch::maps::Maps;

/// Position steps per unit.
pub(in crate::patch) const STEPS: i32 = 16;
/// Sigma of a network's typical peak, units: most networks are trained with 2, and their peaks are
/// a little wider.
const SIGMA: f32 = 2.05;
/// Width steps per doubling.
const PER_OCTAVE: f32 = 12.0;
/// Largest number of width steps from the typical one: a quarter to four times.
pub(in crate::patch) const WIDEST: i32 = 24;
/// Step of a correlation: an eighth.
pub(super) const CORRELATION: f32 = 1.0 / 8.0;
/// Largest number of correlation steps.
pub(in crate::patch) const MOST_TILTED: i32 = 6;
/// Where a mode ends, squared and in sigmas: at 1/55 of its height.
pub(super) const REACH2: f32 = 8.0;
/// How far positions may be outside the map, units.
pub(in crate::patch) const OUTSIDE: i32 = 4;

/// The resolution of maps, in their units.
#[derive(Debug, Clone, Copy)]
pub(in crate::patch) struct MapScale {
    pub(in crate::patch) width: usize,
    pub(in crate::patch) height: usize,
    /// Cells per unit.
    pub(in crate::patch) cells: f32,
}

impl MapScale {
    pub(in crate::patch) fn from_maps(maps: &Maps) -> Self {
        let (width, height) = (maps.width(), maps.height());
        Self {
            width,
            height,
            cells: (width as f32 / 48.0).max(height as f32 / 64.0),
        }
    }

    /// The largest position, [`STEPS`] per unit, of the last column and row.
    pub(in crate::patch) fn last(&self) -> [i32; 2] {
        [self.width, self.height].map(|n| (n as f32 / self.cells) as i32 * STEPS)
    }
}

/// One peak.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::patch) struct Mode {
    /// Column and row of its centre, [`STEPS`] per unit.
    pub(in crate::patch) at: [i32; 2],
    /// Highest value, of 255.
    pub(in crate::patch) height: u8,
    /// Sigma along columns and rows, steps from the typical one.
    pub(in crate::patch) width: [i32; 2],
    /// Correlation of the two, steps.
    pub(in crate::patch) tilt: i32,
}

/// A measured peak, in cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::patch) struct FittedPeak {
    pub(in crate::patch) at: [f32; 2],
    pub(in crate::patch) height: f32,
    pub(in crate::patch) sigma: [f32; 2],
    pub(in crate::patch) correlation: f32,
}

impl Mode {
    /// The mode closest to a measured peak.
    pub(in crate::patch) fn from_peak(peak: &FittedPeak, scale: &MapScale) -> Self {
        let last = scale.last();
        let at = [0, 1].map(|i| {
            let at = (peak.at[i] / scale.cells * STEPS as f32).round() as i32;
            at.clamp(-OUTSIDE * STEPS, last[i] + OUTSIDE * STEPS)
        });
        let steps = |sigma: f32| {
            let steps = (libm::log2f(sigma / (SIGMA * scale.cells)) * PER_OCTAVE).round() as i32;
            steps.clamp(-WIDEST, WIDEST)
        };
        let tilt = (peak.correlation / CORRELATION).round() as i32;
        Self {
            at,
            height: peak.height.round() as u8,
            width: peak.sigma.map(steps),
            tilt: tilt.clamp(-MOST_TILTED, MOST_TILTED),
        }
    }

    /// Column and row of the centre, cells.
    pub(in crate::patch) fn center(&self, scale: &MapScale) -> [f32; 2] {
        self.at.map(|at| at as f32 / STEPS as f32 * scale.cells)
    }

    /// The rows that it covers.
    pub(in crate::patch) fn rows(&self, scale: &MapScale) -> std::ops::Range<usize> {
        let [_, y] = self.center(scale);
        // Along one axis an ellipse extends as its sigma, whatever its rotation.
        let reach = sigma(self.width[1], scale) * REACH2.sqrt();
        let height = scale.height as f32;
        let [first, end] = [span_start(y, reach, height), span_end(y, reach, height)].map(whole);
        first.min(end) as usize..end as usize
    }

    /// Columns that contain it. One more at either end than in [`Self::rows`], because the ends of
    /// rows are rounded in another way.
    pub(in crate::patch) fn columns(&self, scale: &MapScale) -> std::ops::Range<usize> {
        let [x, _] = self.center(scale);
        let reach = sigma(self.width[0], scale) * REACH2.sqrt() + 1.0;
        let width = scale.width as f32;
        let [first, end] = [span_start(x, reach, width), span_end(x, reach, width)].map(whole);
        first.min(end) as usize..end as usize
    }
}

/// Sigma of a width, cells.
pub(super) fn sigma(width: i32, scale: &MapScale) -> f32 {
    SIGMA * scale.cells * WIDTHS[(width + WIDEST).clamp(0, 2 * WIDEST) as usize]
}

/// Widths relative to the typical one.
static WIDTHS: [f32; 2 * WIDEST as usize + 1] = {
    let mut widths = [0.0; 2 * WIDEST as usize + 1];
    let mut i = 0;
    while i < widths.len() {
        widths[i] = exp2((i as f32 - WIDEST as f32) / PER_OCTAVE);
        i += 1;
    }
    widths
};

/// The first of the `size` cells of a row or column within `reach` of `center`.
#[inline]
pub(super) fn span_start(center: f32, reach: f32, size: f32) -> f32 {
    ceil(at_most(size, not_below_zero(center - reach)))
}

/// The cell after the last one; the span is empty if this is not after the first.
#[inline]
pub(super) fn span_end(center: f32, reach: f32, size: f32) -> f32 {
    let last = center + reach;
    let after = if last < 0.0 { 0.0 } else { 1.0 };
    at_most(size, floor(at_most(size, not_below_zero(last))) + after)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SCALE: MapScale = MapScale {
        width: 48,
        height: 64,
        cells: 1.0,
    };

    fn any_mode() -> impl Strategy<Value = Mode> {
        let at = (-64i32..48 * 16 + 64, -64i32..64 * 16 + 64);
        let width = (-WIDEST..=WIDEST, -WIDEST..=WIDEST);
        (at, 1u8..=255, width, -MOST_TILTED..=MOST_TILTED).prop_map(|(at, height, width, tilt)| {
            Mode {
                at: [at.0, at.1],
                height,
                width: [width.0, width.1],
                tilt,
            }
        })
    }

    proptest! {
        #[test]
        fn a_mode_is_drawn_as_a_gaussian_that_ends(mode in any_mode()) {
            let mut cells = vec![0; 48 * 64];
            mode.draw(&SCALE, &mut cells);
            let [x, y] = mode.center(&SCALE).map(f64::from);
            let [sx, sy] = mode.width.map(|w| 2.05 * libm::exp2(f64::from(w) / 12.0));
            let rho = f64::from(mode.tilt) / 8.0;
            for (i, &cell) in cells.iter().enumerate() {
                let (dx, dy) = (((i % 48) as f64 - x) / sx, ((i / 48) as f64 - y) / sy);
                let square = (dx * dx - 2.0 * rho * dx * dy + dy * dy) / (1.0 - rho * rho);
                let expected = f64::from(mode.height) * libm::exp(-0.5 * square);
                if square < 7.99 {
                    prop_assert!((f64::from(cell) - expected).abs() < 0.6, "{cell} {expected}");
                } else if square > 8.01 {
                    prop_assert_eq!(cell, 0);
                }
            }
        }

        #[test]
        fn measuring_a_mode_gives_the_same_mode(mode in any_mode()) {
            let peak = FittedPeak {
                at: mode.center(&SCALE),
                height: mode.height.into(),
                sigma: mode.width.map(|width| sigma(width, &SCALE)),
                correlation: mode.tilt as f32 * CORRELATION,
            };
            prop_assert_eq!(Mode::from_peak(&peak, &SCALE), mode);
        }
    }
}
