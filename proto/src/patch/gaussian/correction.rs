//! Corrections: the difference between a map and its modes, on a coarser grid, as integers near
//! zero with bilinear interpolation.

use std::ops::Range;

use super::contexts::{Contexts, Corrections, SIZE_CLASSES, SIZE_NODES, ZERO_CLASSES};
use super::mode::MapScale;
use crate::patch::entropy::range_coder::{BitCoder, Probability};
use crate::patch::entropy::symbol::number;

/// Typical size of a side of the window.
const USUAL: i32 = 8;
/// The largest size with contexts.
const MOST_SIZE: i32 = 12;
const _: () = assert!(ZERO_CLASSES == 20 && SIZE_NODES == MOST_SIZE as usize);

/// The corrections of one map.
#[derive(Debug, Clone, Default)]
pub(in crate::patch) struct CorrectionGrid {
    /// The sides of the maps for which `places` was computed.
    sides: [usize; 2],
    /// Cells between grid places, at least 1.
    pitch: f32,
    /// The cells nearest to the grid places, along columns and rows.
    places: [Vec<u16>; 2],
    /// Columns and rows with corrections.
    window: [Range<usize>; 2],
    /// The corrections of the window, row by row.
    values: Vec<i16>,
    /// Per column of the map within the window: the grid place to its left, and the distance from
    /// it.
    left: Vec<(usize, f32)>,
}

impl CorrectionGrid {
    /// Prepares for maps of `scale`.
    pub(in crate::patch) fn reset(&mut self, scale: &MapScale) {
        self.window = [0..0, 0..0];
        let sides = [scale.width, scale.height];
        if self.sides == sides {
            return;
        }
        self.sides = sides;
        self.pitch = scale.cells.max(1.0);
        for (places, size) in self.places.iter_mut().zip(sides) {
            let n = ((size - 1) as f32 / self.pitch).ceil() as usize + 1;
            let cell = |place: usize| ((place as f32 * self.pitch + 0.5) as usize).min(size - 1);
            places.clear();
            places.extend((0..n).map(|place| cell(place) as u16));
        }
    }

    /// Measures the difference between a map and its modes, in steps; returns whether any remains.
    pub(in crate::patch) fn measure(
        &mut self,
        seen: &MapResidual<'_>,
        step: u8,
        scale: &MapScale,
    ) -> bool {
        let step = i16::from(step);
        // A little less than half a step is not worth its bits.
        let given = step * 2 / 5;
        let least = (step - given) as u8;
        let mut window: Option<[Range<usize>; 2]> = None;
        for (j, &y) in self.places[1].iter().enumerate() {
            let y = usize::from(y);
            if seen.off[y] < least {
                continue;
            }
            let is_off = |&x: &u16| {
                seen.off(y * scale.width + usize::from(x)).unsigned_abs() >= least.into()
            };
            let places = &self.places[0];
            let (Some(first), Some(last)) = (
                places.iter().position(is_off),
                places.iter().rposition(is_off),
            ) else {
                continue;
            };
            window = Some(
                window.map_or([first..last + 1, j..j + 1], |[columns, rows]| {
                    [
                        columns.start.min(first)..columns.end.max(last + 1),
                        rows.start..j + 1,
                    ]
                }),
            );
        }
        let Some(window) = window else {
            return false;
        };
        self.values.clear();
        for &y in &self.places[1][window[1].clone()] {
            let row = usize::from(y) * scale.width;
            self.values
                .extend(self.places[0][window[0].clone()].iter().map(|&x| {
                    let off = seen.off(row + usize::from(x));
                    off.signum() * ((off.abs() + given) / step)
                }));
        }
        self.window = window;
        true
    }

    /// Codes the corrections; `show` is the drawing of the modes.
    pub(in crate::patch) fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        contexts: &mut Contexts,
        show: &[u8],
        scale: &MapScale,
    ) {
        for axis in 0..2 {
            let size = whole(self.places[axis].len());
            let Range { start, end } = self.window[axis].clone();
            let middle = size / 2;
            let first = number(coder, contexts.window(2 * axis), whole(start) - middle) + middle;
            let first = first.clamp(0, size - 1);
            let length = whole(end) - whole(start);
            let length = number(coder, contexts.window(2 * axis + 1), length - USUAL) + USUAL;
            let end = (first + length.max(1)).min(size);
            self.window[axis] = first as usize..end as usize;
        }
        let [columns, rows] = self.window.clone();
        let n = columns.len();
        self.values.resize(n * rows.len(), 0);
        let mut contexts = contexts.corrections();
        let columns = &self.places[0][columns];
        let (mut above, mut rest) = (&mut [][..], &mut self.values[..]);
        for &y in &self.places[1][rows] {
            let (row, below) = rest.split_at_mut(n);
            let show = &show[usize::from(y) * scale.width..];
            let (mut left, mut above_left) = (0, 0);
            for (i, (value, &x)) in row.iter_mut().zip(columns).enumerate() {
                let up = above.get(i).copied().unwrap_or(0);
                let above_right = above.get(i + 1).copied().unwrap_or(0);
                let around = [left, up, above_left, above_right];
                left = self::value(coder, &mut contexts, *value, around, show[usize::from(x)]);
                *value = left;
                above_left = up;
            }
            (above, rest) = (row, below);
        }
    }

    /// Adds the corrections to the map; returns the columns and rows outside which no cell has
    /// changed.
    pub(in crate::patch) fn apply(
        &mut self,
        cells: &mut [u8],
        step: u8,
        scale: &MapScale,
    ) -> [Range<usize>; 2] {
        let [columns, rows] = self.window.clone();
        let step = i16::from(step);
        if self.pitch > 1.0 {
            return self.interpolate(cells, step.into(), scale);
        }
        for (values, y) in self.values.chunks_exact(columns.len()).zip(rows.clone()) {
            let row = &mut cells[y * scale.width..][columns.clone()];
            for (cell, &value) in row.iter_mut().zip(values) {
                *cell = (i16::from(*cell) + step * value).clamp(0, 255) as u8;
            }
        }
        [columns, rows]
    }

    fn interpolate(&mut self, cells: &mut [u8], step: f32, scale: &MapScale) -> [Range<usize>; 2] {
        let [columns, rows] = self.window.clone();
        let pitch = self.pitch;
        let reach = |places: &Range<usize>, size: usize| {
            let first = (places.start as f32 - 1.0) * pitch;
            let end = places.end as f32 * pitch;
            // Casts saturate negative values to 0.
            (first as usize).min(size)..(end as usize + 1).min(size)
        };
        let (across, down) = (reach(&columns, scale.width), reach(&rows, scale.height));
        let split = |cell: usize| {
            let place = cell as f32 / pitch;
            (place as usize, place - (place as usize) as f32)
        };
        self.left.clear();
        self.left.extend(across.clone().map(split));
        let n = columns.len();
        let at = |i: usize, j: usize| {
            let inside = columns.contains(&i) && rows.contains(&j);
            let value = || self.values[(j - rows.start) * n + i - columns.start];
            if inside { f32::from(value()) } else { 0.0 }
        };
        for y in down.clone() {
            let (j, fy) = split(y);
            let row = &mut cells[y * scale.width..][across.clone()];
            for (cell, &(i, fx)) in row.iter_mut().zip(&self.left) {
                let upper = at(i, j) + fx * (at(i + 1, j) - at(i, j));
                let lower = at(i, j + 1) + fx * (at(i + 1, j + 1) - at(i, j + 1));
                // Casts saturate: values below zero become zero.
                *cell = (f32::from(*cell) + step * (upper + fy * (lower - upper)) + 0.5) as u8;
            }
        }
        [across, down]
    }
}

/// A map and the drawing of its modes, for comparison.
pub(in crate::patch) struct MapResidual<'a> {
    pub(in crate::patch) cells: &'a [u8],
    pub(in crate::patch) shown: &'a [u8],
    /// Per row of the map, the largest error of a cell.
    pub(in crate::patch) off: &'a [u8],
    /// Cells below count as zero where the drawing is also zero.
    pub(in crate::patch) floor: u8,
}

impl MapResidual<'_> {
    /// By how much the map exceeds the drawing.
    fn off(&self, at: usize) -> i16 {
        let (cell, shown) = (self.cells[at], self.shown[at]);
        if cell.max(shown) < self.floor {
            return 0;
        }
        i16::from(cell) - i16::from(shown)
    }
}

/// Converts a small number of places.
fn whole(places: usize) -> i32 {
    i32::try_from(places).unwrap_or(i32::MAX)
}

/// Codes one value, given its neighbours `around` and the drawn value `shown`.
fn value<C: BitCoder>(
    coder: &mut C,
    contexts: &mut Corrections<'_>,
    value: i16,
    around: [i16; 4],
    shown: u8,
) -> i16 {
    let [left, up, above_left, above_right] = around.map(|v| u32::from(v.unsigned_abs().min(64)));
    let near = 2 * (left + up) + above_left + above_right;
    // Counted without branches, because the neighbours are unpredictable.
    let busy = [0, 1, 3, 6].map(|most| usize::from(near > most));
    let height = [0, 39, 119].map(|most| usize::from(shown > most));
    let class = busy.iter().sum::<usize>() * 4 + height.iter().sum::<usize>();
    if !coder.code(value != 0, &mut contexts.zero[class]) {
        return 0;
    }
    let signs = around[0].signum() + around[1].signum();
    let negative = coder.code(value < 0, &mut contexts.sign[(signs + 2) as usize]);
    let class = (near as usize / 4).min(SIZE_CLASSES - 1);
    let sizes = &mut contexts.size[class * SIZE_NODES..][..SIZE_NODES];
    let size = i32::from(value.unsigned_abs());
    let mut coded = 1;
    for context in sizes {
        if !coder.code(coded < size, context) {
            break;
        }
        coded += 1;
    }
    if coded > MOST_SIZE {
        // Too rare for contexts of its own.
        let mut even = [Probability::even(); crate::patch::entropy::symbol::NUMBER];
        coded += number(coder, &mut even, size - coded).abs();
    }
    // No cell has a larger error; larger values, from invalid bytes, would overflow in the
    // multiplication.
    let coded = coded.min(255) as i16;
    if negative { -coded } else { coded }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patch::entropy::range_coder::{BitReader, BitWriter};

    #[test]
    fn invalid_bytes_correct_a_cell_by_at_most_255() {
        let mut contexts = Contexts::new();
        contexts.reset();
        let mut writer = BitWriter::new(Vec::new());
        value(&mut writer, &mut contexts.corrections(), 1036, [0; 4], 0);
        let bytes = writer.finish();
        contexts.reset();
        let mut reader = BitReader::new(&bytes);
        let read = value(&mut reader, &mut contexts.corrections(), 0, [0; 4], 0);
        let mut grid = CorrectionGrid {
            pitch: 1.0,
            window: [0..1, 0..1],
            values: vec![read],
            ..CorrectionGrid::default()
        };
        let (mut cells, scale) = (
            [9],
            MapScale {
                width: 1,
                height: 1,
                cells: 1.0,
            },
        );
        grid.apply(&mut cells, 40, &scale);
        assert_eq!(cells, [255]);
    }
}
