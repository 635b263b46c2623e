//! Draws modes: what both sides show of one, cell by cell.
//!
//! Along a row each cell is made from the one before, so a row alone takes as long as its products one after the other.
//! Several rows are therefore drawn in step: what is written as arrays of their numbers is vectors on every machine. Each
//! cell is made by the same operations in the same order as if its row were drawn alone.

use super::mode::{CORRELATION, MapScale, Mode, REACH2, sigma, span_end, span_start};
use super::rounding::{at_most, exp, floor, not_below_zero, whole, whole_below};

/// Rows that are drawn in step.
const ROWS: usize = 8;
/// Cells of each row that are laid into the map at once, four to a word.
const WORDS: usize = 4;
const CELLS: usize = 4 * WORDS;
/// From the n-th last of the first half on: bytes that keep the first n cells.
static KEEP: [u8; 2 * CELLS] = {
    let mut keep = [0; 2 * CELLS];
    let mut i = 0;
    while i < CELLS {
        keep[i] = u8::MAX;
        i += 1;
    }
    keep
};

/// Something of each of the rows.
type Rows<T> = [T; ROWS];

#[inline]
fn each<T>(of_row: impl FnMut(usize) -> T) -> Rows<T> {
    std::array::from_fn(of_row)
}

impl Mode {
    /// Draws the mode into one map wherever it is higher than what is there.
    pub(in crate::patch) fn draw(&self, scale: &MapScale, cells: &mut [u8]) {
        let outline = Outline::of(self, scale);
        let rows = self.rows(scale);
        let longest = outline.longest_row();
        for first in rows.clone().step_by(ROWS) {
            let mut drawing = outline.rows(first, rows.end);
            for drawn in (0..longest).step_by(CELLS) {
                let mut words = [[0; ROWS]; WORDS];
                let needed = (longest - drawn).div_ceil(4) as usize;
                for four in words.iter_mut().take(needed) {
                    *four = drawing.four_cells(outline.fall);
                }
                for i in 0..ROWS {
                    let start = (first + i) * scale.width + (drawing.start[i] + drawn) as usize;
                    let left = drawing.length[i].saturating_sub(drawn);
                    lay(cells, start, words.map(|four| four[i]), left as usize);
                }
            }
        }
    }
}

/// A mode as its rows are made from it: its exponent is -(a dx^2 + 2 b dx dy + c dy^2) / 2.
struct Outline {
    center: [f32; 2],
    height: f32,
    a: f32,
    b_of_a: f32,
    /// Sigma along rows, squared.
    sy2: f32,
    /// Sigma within one row.
    across: f32,
    /// What each ratio of a cell to the one before is multiplied with for the next.
    fall: f32,
    /// Columns of the map.
    width: f32,
}

impl Outline {
    fn of(mode: &Mode, scale: &MapScale) -> Self {
        let [sx, sy] = mode.width.map(|width| sigma(width, scale));
        let correlation = mode.tilt as f32 * CORRELATION;
        let rest = 1.0 - correlation * correlation;
        let a = 1.0 / (sx * sx * rest);
        let b = -correlation / (sx * sy * rest);
        Self {
            center: mode.center(scale),
            height: mode.height.into(),
            a,
            b_of_a: b / a,
            sy2: sy * sy,
            across: sx * rest.sqrt(),
            fall: exp(-a),
            width: scale.width as f32,
        }
    }

    /// No row has more cells than this.
    fn longest_row(&self) -> u32 {
        let reach = self.across * REACH2.sqrt();
        // A little more, for what is rounded where the ends of rows are computed.
        whole(at_most(self.width, floor(2.0 * reach + 0.01) + 1.0))
    }

    /// The rows from `first` on as they begin; those from `end` on are empty.
    // Apart from what uses them row by row, so that they stay vectors.
    #[inline(never)]
    fn rows(&self, first: usize, end: usize) -> RowsInStep {
        let [x, y] = self.center;
        let rows = first as f32;
        let dy = each(|i| rows + i as f32 - y);
        // Along a row the Gaussian is one about `middle`, and lower by what is between the two.
        let middle = dy.map(|dy| x - self.b_of_a * dy);
        let down = dy.map(|dy| dy * dy / self.sy2);
        let reach = down.map(|down| self.across * not_below_zero(REACH2 - down).sqrt());
        let start = each(|i| span_start(middle[i], reach[i], self.width));
        let ends = each(|i| span_end(middle[i], reach[i], self.width));
        let dx = each(|i| start[i] - middle[i]);
        let length = each(|i| whole(not_below_zero(ends[i] - start[i])));
        let end = end as f32;
        RowsInStep {
            start: start.map(whole),
            length: each(|i| {
                if rows + (i as f32) < end {
                    length[i]
                } else {
                    0
                }
            }),
            value: each(|i| self.height * exp(-0.5 * (self.a * dx[i] * dx[i] + down[i]))),
            ratio: dx.map(|dx| exp(-self.a * (dx + 0.5))),
        }
    }
}

/// Rows of a mode, one below the other, while they are drawn.
struct RowsInStep {
    /// The first column of each.
    start: Rows<u32>,
    /// How many cells they have.
    length: Rows<u32>,
    /// The next value: the last one times a ratio.
    value: Rows<f32>,
    /// The next ratio: the last one times a constant.
    ratio: Rows<f32>,
}

impl RowsInStep {
    /// The next four cells of each row, the first in the lowest byte.
    // Apart for the same reason.
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
    // Up to 255 but for rounding; beyond the end of a row they may be anything.
    whole_below(at_most(255.0, value + 0.5))
}

/// Lays the first `length` cells of `words` over the cells from `start` on.
#[inline]
fn lay(cells: &mut [u8], start: usize, words: [u32; WORDS], length: usize) {
    // Always all of them: where a row ends cannot be foreseen, and zeros leave the cells after it what they are.
    let keep = &KEEP[CELLS - length.min(CELLS)..];
    let drawn: [u8; CELLS] = std::array::from_fn(|i| keep[i] & words[i / 4].to_le_bytes()[i % 4]);
    let cells = cells.get_mut(start..).unwrap_or_default();
    let lay = |(cell, drawn): (&mut u8, u8)| *cell = drawn.max(*cell);
    match cells.first_chunk_mut::<CELLS>() {
        Some(cells) => cells.iter_mut().zip(drawn).for_each(lay),
        None => cells.iter_mut().zip(drawn).for_each(lay),
    }
}
