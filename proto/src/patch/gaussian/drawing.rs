//! Draws modes cell by cell, the same in encoder and decoder.
//!
//! Along a row each cell is computed from the previous one, so a single row is limited by the
//! latency of its products. Therefore four rows are drawn in step; arrays of their numbers become
//! vectors on every machine. Each cell results from the same operations in the same order as if its
//! row were drawn alone.

use super::mode::{CORRELATION, MapScale, Mode, REACH2, sigma, span_end, span_start};
use super::rounding::{at_most, exp, floor, not_below_zero, whole, whole_below};

/// Rows drawn in step.
const ROWS: usize = 4;
/// Groups of rows that are started before any is drawn, so that none waits for another.
const GROUPS: usize = 4;
/// Cells of each row that are merged into the map at once.
const CELLS: usize = 8;
/// Masks that keep the first n of that many cells, for every n; the first cell is the lowest byte.
static KEEP: [u64; CELLS + 1] = {
    let mut keep = [u64::MAX; CELLS + 1];
    let mut n = 0;
    while n < CELLS {
        keep[n] = (1 << (8 * n)) - 1;
        n += 1;
    }
    keep
};

/// One value per row.
type Rows<T> = [T; ROWS];

#[inline]
fn each<T>(of_row: impl FnMut(usize) -> T) -> Rows<T> {
    std::array::from_fn(of_row)
}

impl Mode {
    /// Draws the mode into one map; each cell keeps its maximum.
    pub(in crate::patch) fn draw(&self, scale: &MapScale, cells: &mut [u8]) {
        let outline = Outline::new(self, scale);
        let rows = self.rows(scale);
        for first in rows.clone().step_by(GROUPS * ROWS) {
            let mut groups = [RowsInStep::default(); GROUPS];
            let needed = (rows.end - first).div_ceil(ROWS).min(GROUPS);
            let groups = &mut groups[..needed];
            for (i, group) in groups.iter_mut().enumerate() {
                outline.place(first + i * ROWS, rows.end, group);
            }
            for group in &mut *groups {
                outline.begin(group);
            }
            for (i, group) in groups.iter_mut().enumerate() {
                outline.draw(first + i * ROWS, group, cells);
            }
        }
    }
}

/// A mode in the form for drawing rows: its exponent is -(a dx^2 + 2 b dx dy + c dy^2) / 2.
struct Outline {
    center: [f32; 2],
    height: f32,
    a: f32,
    b_of_a: f32,
    /// Sigma along rows, squared.
    sy2: f32,
    /// Sigma within one row.
    across: f32,
    /// Factor from each ratio of neighbouring cells to the next ratio.
    fall: f32,
    /// Columns of the map.
    width: usize,
    /// No row has more cells than this.
    longest: u32,
}

impl Outline {
    fn new(mode: &Mode, scale: &MapScale) -> Self {
        let [sx, sy] = mode.width.map(|width| sigma(width, scale));
        let correlation = mode.tilt as f32 * CORRELATION;
        let rest = 1.0 - correlation * correlation;
        let a = 1.0 / (sx * sx * rest);
        let b = -correlation / (sx * sy * rest);
        let (across, width) = (sx * rest.sqrt(), scale.width);
        // Slightly more, because the ends of rows are rounded.
        let longest = floor(2.0 * across * REACH2.sqrt() + 0.01) + 1.0;
        Self {
            center: mode.center(scale),
            height: mode.height.into(),
            a,
            b_of_a: b / a,
            sy2: sy * sy,
            across,
            fall: exp(-a),
            width,
            longest: whole(at_most(width as f32, longest)),
        }
    }

    /// The positions of the rows from `first` on; rows from `end` on are empty.
    // In a function of its own, so that uses row by row do not prevent vectorisation.
    #[inline(never)]
    fn place(&self, first: usize, end: usize, rows: &mut RowsInStep) {
        let [x, y] = self.center;
        let (width, after) = (self.width as f32, end as f32);
        let row = each(|i| first as f32 + i as f32);
        let dy = row.map(|row| row - y);
        // Along a row the mode is a Gaussian around `middle`, lower by the factor between the two.
        let middle = dy.map(|dy| x - self.b_of_a * dy);
        let down = dy.map(|dy| dy * dy / self.sy2);
        let reach = down.map(|down| self.across * not_below_zero(REACH2 - down).sqrt());
        let start = each(|i| span_start(middle[i], reach[i], width));
        let end = each(|i| span_end(middle[i], reach[i], width));
        let end = each(|i| if row[i] < after { end[i] } else { 0.0 });
        rows.start = start.map(whole);
        rows.length = each(|i| whole(not_below_zero(end[i] - start[i])));
        rows.dx = each(|i| start[i] - middle[i]);
        rows.down = down;
    }

    /// The first values and ratios of placed rows.
    #[inline(never)]
    fn begin(&self, rows: &mut RowsInStep) {
        let RowsInStep { dx, down, .. } = *rows;
        rows.value = each(|i| self.height * exp(-0.5 * (self.a * dx[i] * dx[i] + down[i])));
        rows.ratio = dx.map(|dx| exp(-self.a * (dx + 0.5)));
    }

    /// Draws the rows from `first` on, which have been started.
    #[inline]
    fn draw(&self, first: usize, rows: &mut RowsInStep, cells: &mut [u8]) {
        for drawn in (0..self.longest).step_by(CELLS) {
            let low = rows.four_cells(self.fall);
            let high = if drawn + 4 < self.longest {
                rows.four_cells(self.fall)
            } else {
                [0; ROWS]
            };
            for i in 0..ROWS {
                let start = (first + i) * self.width + (rows.start[i] + drawn) as usize;
                let left = rows.length[i].saturating_sub(drawn) as usize;
                let eight = u64::from(low[i]) | u64::from(high[i]) << 32;
                merge_cells(cells, start, eight & KEEP[CELLS.min(left)]);
            }
        }
    }
}

/// Consecutive rows of a mode while they are drawn.
#[derive(Debug, Clone, Copy, Default)]
struct RowsInStep {
    /// The first column of each.
    start: Rows<u32>,
    /// Their numbers of cells.
    length: Rows<u32>,
    /// Distance from the middle of each to its first column.
    dx: Rows<f32>,
    /// Reduction of the exponent in the middle, doubled.
    down: Rows<f32>,
    /// The next value: the last one times a ratio.
    value: Rows<f32>,
    /// The next ratio: the last one times a constant.
    ratio: Rows<f32>,
}

impl RowsInStep {
    /// The next four cells of each row, the first in the lowest byte.
    #[inline(never)]
    fn four_cells(&mut self, fall: f32) -> Rows<u32> {
        let (mut value, mut ratio) = (self.value, self.ratio);
        let mut cells = [0; ROWS];
        for place in 0..4 {
            cells = each(|i| cells[i] | cell(value[i]) << (8 * place));
            value = each(|i| value[i] * ratio[i]);
            ratio = ratio.map(|ratio| ratio * fall);
        }
        (self.value, self.ratio) = (value, ratio);
        cells
    }
}

/// The cell of a value that is not negative.
#[inline]
fn cell(value: f32) -> u32 {
    // Up to 255, except for rounding; beyond the end of a row the values are arbitrary.
    whole_below(at_most(255.0, value + 0.5))
}

/// Merges [`CELLS`] cells into those from `start` on, the first in the lowest byte.
// In a function of its own, so that the cells stay one number until they become a vector.
#[inline(never)]
fn merge_cells(cells: &mut [u8], start: usize, drawn: u64) {
    // Always all cells: the end of a row is unpredictable, and zeros leave later cells unchanged.
    let cells = cells.get_mut(start..).unwrap_or_default();
    match cells.first_chunk_mut::<CELLS>() {
        Some(cells) => merge_all(cells, drawn),
        None => merge_last(cells, drawn),
    }
}

#[inline]
fn merge_all(cells: &mut [u8], drawn: u64) {
    for (cell, drawn) in cells.iter_mut().zip(drawn.to_le_bytes()) {
        *cell = drawn.max(*cell);
    }
}

/// As [`merge_all`], if the map ends before.
#[cold]
fn merge_last(cells: &mut [u8], drawn: u64) {
    merge_all(cells, drawn);
}
