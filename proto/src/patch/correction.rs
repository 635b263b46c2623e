//! What the modes of a map leave, on a grid of its own: whole numbers about zero, interpolated between.

use std::ops::Range;

use super::contexts::{Contexts, Corrections, SIZE_CLASSES, SIZE_NODES, ZERO_CLASSES};
use super::mode::Scale;
use super::range_coder::{BitCoder, Probability};
use super::recipe::Correction;
use super::symbol::number;

/// The corrections of one map.
#[derive(Debug, Clone, Default)]
pub(super) struct Grid {
    /// Cells from one to the next, at least 1.
    pitch: f32,
    columns: usize,
    rows: usize,
    /// Row by row.
    values: Vec<i16>,
    /// Where values are not zero.
    window: [Range<usize>; 2],
    /// Per column of the map within the window: the value to its left, and how far it is from there.
    left: Vec<(usize, f32)>,
}

impl Grid {
    /// Makes room for a map of `scale`; nothing is corrected.
    pub(super) fn reset(&mut self, scale: &Scale, correction: &Correction) {
        self.pitch = (scale.cells * f32::from(correction.pitch)).max(1.0);
        let along = |size: usize| ((size - 1) as f32 / self.pitch).ceil() as usize + 1;
        (self.columns, self.rows) = (along(scale.width), along(scale.height));
        self.values.clear();
        self.values.resize(self.columns * self.rows, 0);
        self.window = [0..0, 0..0];
    }

    /// Takes what is between `cells` and what the modes `show`, in steps; whether any is left.
    pub(super) fn measure(
        &mut self,
        cells: &[u8],
        show: &[u8],
        floor: u8,
        step: u8,
        scale: &Scale,
    ) -> bool {
        let step = i32::from(step);
        let mut window: Option<[Range<usize>; 2]> = None;
        for j in 0..self.rows {
            let y = self.cell(j, scale.height) * scale.width;
            for i in 0..self.columns {
                let at = y + self.cell(i, scale.width);
                let (cell, show) = (cells[at], show[at]);
                if cell.max(show) < floor {
                    continue;
                }
                let cell = if cell < floor { 0 } else { cell };
                let off = i32::from(cell) - i32::from(show);
                // A little less than half a step is not worth its bits.
                let steps = off.signum() * ((off.abs() + step * 2 / 5) / step);
                if steps != 0 {
                    self.values[j * self.columns + i] = steps as i16;
                    window = Some(window.map_or([i..i + 1, j..j + 1], |[columns, rows]| {
                        [
                            columns.start.min(i)..columns.end.max(i + 1),
                            rows.start..j + 1,
                        ]
                    }));
                }
            }
        }
        self.window = window.clone().unwrap_or([0..0, 0..0]);
        window.is_some()
    }

    /// The cell next to a place of the grid.
    fn cell(&self, place: usize, size: usize) -> usize {
        ((place as f32 * self.pitch + 0.5) as usize).min(size - 1)
    }

    /// Codes the corrections; `show` is what the modes show.
    pub(super) fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        contexts: &mut Contexts,
        show: &[u8],
        scale: &Scale,
    ) {
        for axis in 0..2 {
            let size = [self.columns, self.rows][axis];
            let Range { start, end } = self.window[axis].clone();
            let middle = (size / 2) as i32;
            let start = number(coder, contexts.window(2 * axis), start as i32 - middle) + middle;
            let start = start.clamp(0, size as i32 - 1) as usize;
            let length = end.saturating_sub(start) as i32;
            let length = number(coder, contexts.window(2 * axis + 1), length - 8) + 8;
            self.window[axis] = start..(start + length.max(1) as usize).min(size);
        }
        let [columns, rows] = self.window.clone();
        let mut contexts = contexts.corrections();
        for j in rows {
            let y = self.cell(j, scale.height) * scale.width;
            for i in columns.clone() {
                let at = j * self.columns + i;
                let around = self.around(i, j);
                let shown = show[y + self.cell(i, scale.width)];
                self.values[at] = value(coder, &mut contexts, self.values[at], around, shown);
            }
        }
    }

    /// The values to the left, above, above left and above right.
    fn around(&self, i: usize, j: usize) -> [i16; 4] {
        let at = |i: usize, j: usize| self.values[j * self.columns + i];
        let left = if i > 0 { at(i - 1, j) } else { 0 };
        let Some(up) = j.checked_sub(1) else {
            return [left, 0, 0, 0];
        };
        let above_left = if i > 0 { at(i - 1, up) } else { 0 };
        let above_right = if i + 1 < self.columns {
            at(i + 1, up)
        } else {
            0
        };
        [left, at(i, up), above_left, above_right]
    }

    /// Adds the corrections to the map.
    pub(super) fn apply(&mut self, cells: &mut [u8], step: u8, scale: &Scale) {
        let [columns, rows] = self.window.clone();
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let reach = |places: &Range<usize>, size: usize| {
            let first = (places.start as f32 - 1.0) * self.pitch;
            let end = places.end as f32 * self.pitch;
            // Plain casts take what is negative for 0.
            (first.floor() as usize + usize::from(first >= 0.0)).min(size)
                ..(end.ceil() as usize).min(size)
        };
        let (across, down) = (reach(&columns, scale.width), reach(&rows, scale.height));
        let (pitch, last) = (self.pitch, self.columns - 1);
        self.left.clear();
        self.left
            .extend(across.clone().map(|x| split(x, pitch, last)));
        let step = f32::from(step);
        for y in down {
            let (j, fy) = split(y, pitch, self.rows - 1);
            let upper = &self.values[j * self.columns..][..self.columns];
            let lower = &self.values[(j + 1).min(self.rows - 1) * self.columns..][..self.columns];
            let row = &mut cells[y * scale.width..][across.clone()];
            for (cell, &(i, fx)) in row.iter_mut().zip(&self.left) {
                let next = (i + 1).min(last);
                let between = |values: &[i16]| {
                    f32::from(values[i]) + fx * f32::from(values[next] - values[i])
                };
                let (a, b) = (between(upper), between(lower));
                // Casts saturate: what is below zero is zero.
                *cell = (f32::from(*cell) + step * (a + fy * (b - a)) + 0.5) as u8;
            }
        }
    }
}

/// The place of the grid at or before a cell, and how far the cell is from there to the next, 0 to 1.
fn split(cell: usize, pitch: f32, last: usize) -> (usize, f32) {
    let place = cell as f32 / pitch;
    let before = (place as usize).min(last);
    (before, place - before as f32)
}

/// Codes one value, next to those `around` it and on what is `shown` there.
fn value<C: BitCoder>(
    coder: &mut C,
    contexts: &mut Corrections<'_>,
    value: i16,
    around: [i16; 4],
    shown: u8,
) -> i16 {
    let [left, up, above_left, above_right] = around.map(|v| u32::from(v.unsigned_abs().min(64)));
    let near = 2 * (left + up) + above_left + above_right;
    let busy = match near {
        0 => 0,
        1 => 1,
        2..=3 => 2,
        4..=6 => 3,
        _ => 4,
    };
    let height = match shown {
        0 => 0,
        1..=39 => 1,
        40..=119 => 2,
        _ => 3,
    };
    const _: () = assert!(ZERO_CLASSES == 20);
    if !coder.code(value != 0, &mut contexts.zero[busy * 4 + height]) {
        return 0;
    }
    let signs = around[0].signum() + around[1].signum();
    let negative = coder.code(value < 0, &mut contexts.sign[(signs + 2) as usize]);
    let class = (near as usize / 4).min(SIZE_CLASSES - 1);
    let sizes = &mut contexts.size[class * SIZE_NODES..][..SIZE_NODES];
    let size = i32::from(value.unsigned_abs());
    let mut coded = 1;
    while coded <= SIZE_NODES as i32 && coder.code(coded < size, &mut sizes[coded as usize - 1]) {
        coded += 1;
    }
    if coded > SIZE_NODES as i32 {
        // No context is worth its place for what hardly ever happens.
        let mut even = [Probability::even(); super::symbol::NUMBER];
        coded += number(coder, &mut even, size - coded).abs();
    }
    (if negative { -coded } else { coded }) as i16
}
