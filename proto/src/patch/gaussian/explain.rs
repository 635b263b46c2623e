//! Greedy decomposition of a map into modes: the highest peak, then the highest of the residual,
//! and so on.

use super::correction::MapResidual;
use super::fit::Fitter;
use super::mode::{MapScale, Mode};
use super::recipe::{MAX_MODES, Recipe};

/// Decomposes maps into modes.
#[derive(Debug, Clone)]
pub(in crate::patch) struct Explainer {
    fitter: Fitter,
}

/// The decomposition of one map; reused from map to map.
#[derive(Debug, Clone, Default)]
pub(in crate::patch) struct Explained {
    /// The modes, in the order of detection.
    pub(in crate::patch) modes: Vec<Mode>,
    /// Their drawing, as in the decoder.
    shown: Vec<u8>,
    /// Per row: the largest error of a cell.
    off: Vec<u8>,
}

impl Explainer {
    pub(in crate::patch) fn new() -> Self {
        Self {
            fitter: Fitter::new(),
        }
    }

    /// Decomposes a map of `scale` with the precision of `recipe`; modes after the first are at
    /// least `further` high.
    pub(in crate::patch) fn explain(
        &self,
        cells: &[u8],
        recipe: &Recipe,
        further: u8,
        scale: &MapScale,
        into: &mut Explained,
    ) {
        let map = Map {
            fitter: &self.fitter,
            cells,
            recipe,
            further,
            scale,
        };
        map.explain(into);
        into.measure(cells, recipe.floor, scale);
    }
}

/// A map under decomposition.
struct Map<'a> {
    fitter: &'a Fitter,
    cells: &'a [u8],
    recipe: &'a Recipe,
    further: u8,
    scale: &'a MapScale,
}

impl Map<'_> {
    /// Adds modes until no cell exceeds the drawing by the minimum height of a mode, or the limit
    /// is reached.
    fn explain(&self, into: &mut Explained) {
        let Self {
            cells,
            recipe,
            scale,
            ..
        } = *self;
        into.modes.clear();
        into.off.clear();
        let highest = |row: &[u8]| row.iter().fold(0, |most: u8, &cell| most.max(cell));
        into.off
            .extend(cells.chunks_exact(scale.width).map(highest));
        into.shown.clear();
        into.shown.resize(cells.len(), 0);
        while into.modes.len() < recipe.modes {
            let rows = into.off.iter().enumerate();
            let Some((row, &most)) = rows.max_by_key(|(_, above)| **above) else {
                return;
            };
            let least = if into.modes.is_empty() {
                recipe.floor
            } else {
                self.further
            };
            if most < least {
                break;
            }
            let start = row * scale.width;
            let rest = cells[start..start + scale.width]
                .iter()
                .zip(&into.shown[start..]);
            let mut rest = rest.map(|(cell, shown)| cell.saturating_sub(*shown));
            let column = rest.position(|above| above == most).unwrap_or(0);
            let mode = self.fitted(&into.shown, [column, row]);
            into.modes.push(mode);
            self.show(&mode, into);
        }
        if into.modes.len() > 1 {
            self.refine(into);
        }
    }

    fn fitted(&self, shown: &[u8], at: [usize; 2]) -> Mode {
        let peak = self.fitter.peak(self.cells, shown, at, self.scale);
        self.recipe.snapped(&Mode::from_peak(&peak, self.scale))
    }

    /// Draws one more mode.
    fn show(&self, mode: &Mode, into: &mut Explained) {
        mode.draw(self.scale, &mut into.shown);
        let width = self.scale.width;
        for row in mode.rows(self.scale) {
            let start = row * width;
            let pairs = self.cells[start..start + width]
                .iter()
                .zip(&into.shown[start..]);
            into.off[row] = pairs.fold(0, |most, (cell, shown)| {
                most.max(cell.saturating_sub(*shown))
            });
        }
    }

    /// Refits every mode without the cells of the other modes, if that improves the result.
    fn refine(&self, into: &mut Explained) {
        let scale = self.scale;
        let before = square_error(self.cells, &into.shown);
        let mut old = [Mode::default(); MAX_MODES];
        let old = &mut old[..into.modes.len()];
        old.copy_from_slice(&into.modes);
        for i in 0..into.modes.len() {
            into.draw_all(Some(i), scale);
            let at = into.modes[i]
                .center(scale)
                .map(|at| (at + 0.5).max(0.0) as usize);
            let at = [at[0].min(scale.width - 1), at[1].min(scale.height - 1)];
            into.modes[i] = self.fitted(&into.shown, at);
        }
        into.draw_all(None, scale);
        if square_error(self.cells, &into.shown) >= before {
            into.modes.copy_from_slice(old);
            into.draw_all(None, scale);
        }
    }
}

impl Explained {
    /// Redraws all modes but one.
    fn draw_all(&mut self, but: Option<usize>, scale: &MapScale) {
        self.shown.fill(0);
        for (i, mode) in self.modes.iter().enumerate() {
            if Some(i) != but {
                mode.draw(scale, &mut self.shown);
            }
        }
    }

    fn measure(&mut self, cells: &[u8], floor: u8, scale: &MapScale) {
        let rows = cells
            .chunks_exact(scale.width)
            .zip(self.shown.chunks_exact(scale.width));
        self.off.clear();
        self.off
            .extend(rows.map(|(cells, shown)| most_off(cells, shown, floor)));
    }

    /// The map relative to the drawing of its modes.
    pub(in crate::patch) fn residual<'a>(&'a self, cells: &'a [u8], floor: u8) -> MapResidual<'a> {
        MapResidual {
            cells,
            shown: &self.shown,
            off: &self.off,
            floor,
        }
    }
}

/// The largest error of `cells` relative to the drawing, where either is above the floor.
fn most_off(cells: &[u8], shown: &[u8], floor: u8) -> u8 {
    let mut most = 0;
    // Simple, so that sixteen cells are processed at a time.
    for (&cell, &shown) in cells.iter().zip(shown) {
        let (high, low) = (cell.max(shown), cell.min(shown));
        let off = if high >= floor { high - low } else { 0 };
        most = most.max(off);
    }
    most
}

/// The sum of squared errors.
fn square_error(cells: &[u8], shown: &[u8]) -> u32 {
    // At most 65,536 cells of 65,025.
    let square = |(&cell, &shown): (&u8, &u8)| u32::from(cell.abs_diff(shown)).pow(2);
    cells.iter().zip(shown).map(square).sum()
}
