//! Which part of a picture had corners.

use std::collections::BTreeSet;

use nalgebra::Vector2;

/// Cells along each side of the picture.
const CELLS: u32 = 8;

/// How much of the picture the corners of all boards cover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Share of the cells of an 8 x 8 grid with a corner in it, 0 to 1.
    pub cells: f64,
    /// Distance of the farthest corner from the picture's middle, as a share of that of its corner: beyond it the lens is
    /// guessed.
    pub radius: f64,
}

impl Coverage {
    pub(super) fn of<'a>(
        size_px: [u32; 2],
        pixels: impl Iterator<Item = &'a Vector2<f64>>,
    ) -> Self {
        let size = Vector2::from(size_px.map(f64::from));
        let middle = (size - Vector2::repeat(1.0)) / 2.0;
        let mut seen = BTreeSet::new();
        let mut farthest = 0.0_f64;
        for pixel in pixels {
            let cell = ((pixel + Vector2::repeat(0.5)).component_div(&size) * f64::from(CELLS))
                .map(f64::floor);
            let inside = cell.iter().all(|c| (0.0..f64::from(CELLS)).contains(c));
            if inside {
                seen.insert([cell.x as u32, cell.y as u32]);
            }
            farthest = farthest.max((pixel - middle).norm());
        }
        Self {
            cells: seen.len() as f64 / f64::from(CELLS * CELLS),
            radius: farthest / middle.norm().max(0.5),
        }
    }
}
