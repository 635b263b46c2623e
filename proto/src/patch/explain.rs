//! Which modes explain a map: the highest peak, then the highest of what is left, and so on.

use super::fit::Fitter;
use super::mode::{Mode, Scale};
use super::recipe::{MAX_MODES, Recipe};

/// Finds the modes of maps; keeps its memory from map to map.
#[derive(Debug, Clone)]
pub(super) struct Explainer {
    fitter: Fitter,
    modes: Vec<Mode>,
    /// What the modes show, as the decoder draws them.
    shown: Vec<u8>,
    /// Per row, by how much the cells are above what is shown.
    above: Vec<u8>,
}

impl Explainer {
    pub(super) fn new() -> Self {
        Self {
            fitter: Fitter::new(),
            modes: Vec::with_capacity(MAX_MODES),
            shown: Vec::new(),
            above: Vec::new(),
        }
    }

    /// The modes of the map that was explained last.
    pub(super) fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// What they show.
    pub(super) fn shown(&self) -> &[u8] {
        &self.shown
    }

    /// Finds modes until no cell is above what they show by the recipe's floor, or there are enough
    /// of them.
    pub(super) fn explain(&mut self, cells: &[u8], recipe: &Recipe, scale: &Scale) {
        self.modes.clear();
        self.above.clear();
        let highest = |row: &[u8]| row.iter().fold(0, |most: u8, &cell| most.max(cell));
        self.above
            .extend(cells.chunks_exact(scale.width).map(highest));
        self.shown.clear();
        self.shown.resize(cells.len(), 0);
        while self.modes.len() < recipe.modes {
            let (row, &most) = match self
                .above
                .iter()
                .enumerate()
                .max_by_key(|(_, above)| **above)
            {
                Some(found) => found,
                None => return,
            };
            if most < recipe.floor {
                break;
            }
            let start = row * scale.width;
            let rest = cells[start..start + scale.width]
                .iter()
                .zip(&self.shown[start..]);
            let mut rest = rest.map(|(cell, shown)| cell.saturating_sub(*shown));
            let column = rest.position(|above| above == most).unwrap_or(0);
            let peak = self.fitter.peak(cells, &self.shown, [column, row], scale);
            let mode = recipe.snapped(&Mode::of(&peak, scale));
            self.modes.push(mode);
            self.show(&mode, cells, scale);
        }
        if self.modes.len() > 1 {
            self.refine(cells, recipe, scale);
        }
    }

    /// Draws one more mode.
    fn show(&mut self, mode: &Mode, cells: &[u8], scale: &Scale) {
        mode.draw(scale, &mut self.shown);
        for row in mode.rows(scale) {
            let start = row * scale.width;
            let pairs = cells[start..start + scale.width]
                .iter()
                .zip(&self.shown[start..]);
            self.above[row] = pairs.fold(0, |most, (cell, shown)| {
                most.max(cell.saturating_sub(*shown))
            });
        }
    }

    /// Fits every mode again, without the cells that are the others'.
    fn refine(&mut self, cells: &[u8], recipe: &Recipe, scale: &Scale) {
        for i in 0..self.modes.len() {
            self.draw_all(Some(i), scale);
            let old = self.modes[i];
            let at = old.center(scale).map(|at| at.round().max(0.0) as usize);
            let at = [at[0].min(scale.width - 1), at[1].min(scale.height - 1)];
            let peak = self.fitter.peak(cells, &self.shown, at, scale);
            self.modes[i] = recipe.snapped(&Mode::of(&peak, scale));
        }
        self.draw_all(None, scale);
    }

    /// Draws all modes but one anew.
    fn draw_all(&mut self, but: Option<usize>, scale: &Scale) {
        self.shown.fill(0);
        for (i, mode) in self.modes.iter().enumerate() {
            if Some(i) != but {
                mode.draw(scale, &mut self.shown);
            }
        }
    }

    /// By how much any cell, above `floor` on either side, is off what the modes show.
    pub(super) fn off(&self, cells: &[u8], floor: u8) -> u8 {
        let off = |(cell, shown): (&u8, &u8)| {
            let counts = *cell >= floor || *shown >= floor;
            if counts { cell.abs_diff(*shown) } else { 0 }
        };
        let pairs = cells.iter().zip(&self.shown);
        pairs.map(off).fold(0, |most, off| most.max(off))
    }
}
