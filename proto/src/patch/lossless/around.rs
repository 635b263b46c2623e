//! The causal neighbourhood of a cell, which both directions know before it, and the prediction from it.
//!
//! What the rows above say is summed for a whole row before its first cell, many columns at a time; along the row goes
//! what the cells to the left say.

use crate::patch::maps::MAX_SIDE;

/// How far expectations look: rows above and cells to the left.
const REACH: usize = 3;
/// Columns that are summed at once.
const LANES: usize = 16;
/// Zeros before and after a row, so that none of its cells is at an end.
const MARGIN: usize = LANES;
/// Where a row's cells end.
const END: usize = MARGIN + MAX_SIDE;

/// Sums of cells that an expectation is scaled by, up to a power of two, so that no index needs a check.
const SUMS: usize = 1024;
const _: () = assert!(SUMS > REACH * 255);
/// Fraction bits of [`RECIPROCALS`]: with these, products with what is scaled are the quotients, exactly.
const RECIPROCAL_BITS: u32 = 28;
/// 1/n, rounded up; that of 0 is 0.
const RECIPROCALS: [u32; SUMS] = {
    let mut table = [0; SUMS];
    let mut n = 1;
    while n < table.len() {
        table[n] = (1u32 << RECIPROCAL_BITS).div_ceil(n as u32);
        n += 1;
    }
    table
};

/// A row of a map between its margins.
type Row = [u8; END + MARGIN];

/// The row that is coded, those above it, and what these say of each of its columns.
#[derive(Debug, Clone)]
pub(super) struct Around {
    /// The rows that are coded: row y is the one of y modulo how many there are.
    rows: [Row; REACH],
    /// The row that is coded.
    own: Row,
    /// Per column, the cell above.
    up: Columns<u8>,
    /// Per column, of the rows above in which neither its cell nor the one before is zero.
    sums: Columns<Sums>,
    /// Per column: 2 where the cell above is zero, and 4 where the one to its right is.
    zeros: Columns<u8>,
}

/// One for each column of a row.
type Columns<T> = [T; MAX_SIDE + LANES];

/// Sums of cells, and of the cells beside these.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    of: u16,
    beside: u16,
}

/// What the rows above say of a column.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    up: u8,
    from_left: Sums,
    zeros: u8,
}

impl Around {
    /// No row is known.
    pub(super) const fn new() -> Self {
        let nothing = Sums { of: 0, beside: 0 };
        Self {
            rows: [[0; END + MARGIN]; REACH],
            own: [0; END + MARGIN],
            up: [0; MAX_SIDE + LANES],
            sums: [nothing; MAX_SIDE + LANES],
            zeros: [0; MAX_SIDE + LANES],
        }
    }

    /// Forgets all rows.
    pub(super) fn begin(&mut self) {
        self.rows = [[0; END + MARGIN]; REACH];
    }

    /// Row `y` has no cell but zeros.
    pub(super) fn skip(&mut self, y: usize) {
        self.rows[y % REACH] = [0; END + MARGIN];
    }

    /// Begins row `y`, whose cells are zero but from `start` to `end`.
    pub(super) fn begin_row(&mut self, y: usize, start: usize, end: usize) {
        self.own = [0; END + MARGIN];
        self.look_up(y, start, end);
    }

    /// Column `x` of the row.
    #[inline]
    pub(super) fn column(&self, x: usize) -> Column {
        let x = x % MAX_SIDE;
        Column {
            up: self.up[x],
            from_left: self.sums[x],
            zeros: self.zeros[x],
        }
    }

    /// Says what the cell of the row in column `x` is.
    #[inline]
    pub(super) fn set(&mut self, x: usize, cell: u8) {
        self.own[MARGIN + x % MAX_SIDE] = cell;
    }

    /// Ends row `y`; returns its cells from `start` to `end`.
    pub(super) fn end_row(&mut self, y: usize, start: usize, end: usize) -> &[u8] {
        let row = &mut self.rows[y % REACH];
        *row = self.own;
        &row[MARGIN + start..=MARGIN + end]
    }

    /// Sums what the rows above row `y` say of the columns from `start` to `end`.
    fn look_up(&mut self, y: usize, start: usize, end: usize) {
        let above = [1, 2, 3].map(|up| &self.rows[(y + REACH - up) % REACH]);
        for x in (start..=end).step_by(LANES) {
            let sums = self.sums[x..]
                .first_chunk_mut()
                .zip(self.zeros[x..].first_chunk_mut());
            if let Some((sums, zeros)) = sums {
                *sums = [Sums::default(); LANES];
                for row in above {
                    add_pairs(sums, lanes(row, x + MARGIN), lanes(row, x + MARGIN - 1));
                }
                let [up, right] = [0, 1].map(|right| lanes(above[0], x + MARGIN + right));
                find_zeros(zeros, up, right);
                self.up[x..x + LANES].copy_from_slice(up);
            }
        }
    }
}

// These in their own functions, so that nothing around them keeps their numbers from being vectors.

/// Adds cells and those beside them, where neither is zero.
#[inline(never)]
fn add_pairs(sums: &mut [Sums; LANES], own: &[u8; LANES], beside: &[u8; LANES]) {
    for (sums, (&own, &beside)) in sums.iter_mut().zip(own.iter().zip(beside)) {
        let known = if own.min(beside) > 0 { u8::MAX } else { 0 };
        sums.of += u16::from(own & known);
        sums.beside += u16::from(beside & known);
    }
}

/// Which cells above are zero, and which right of these.
#[inline(never)]
fn find_zeros(zeros: &mut [u8; LANES], up: &[u8; LANES], right: &[u8; LANES]) {
    for (zeros, (&up, &right)) in zeros.iter_mut().zip(up.iter().zip(right)) {
        *zeros = u8::from(up == 0) << 1 | u8::from(right == 0) << 2;
    }
}

/// Those of a row from `at` on.
fn lanes(row: &Row, at: usize) -> &[u8; LANES] {
    row[at..].first_chunk().unwrap_or(&[0; LANES])
}

/// What lies left of a cell in its row.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Left {
    cell: u32,
    second: u32,
    /// The last columns in which neither the cell nor the one above is zero: these, the latter above 16 bits.
    pairs: [u32; REACH],
}

impl Left {
    /// Moves on over a column whose cell is `cell`.
    #[inline]
    pub(super) fn pass(&mut self, column: Column, cell: u8) {
        let (cell, up) = (u32::from(cell), u32::from(column.up));
        let known = cell > 0 && up > 0;
        let [last, second, _] = self.pairs;
        self.pairs = [if known { cell | up << 16 } else { 0 }, last, second];
        (self.cell, self.second) = (cell, self.cell);
    }
}

impl Column {
    /// Context of whether the cell is zero, below 8: which of left, above and above right are.
    #[inline]
    pub(super) fn zero_context(self, left: &Left) -> usize {
        usize::from(self.zeros | u8::from(left.cell == 0)) % 8
    }

    /// The value that the neighbours suggest, `floor`..=255, and the kind of suggestion (below 5).
    #[inline]
    pub(super) fn expect(
        self,
        left: &Left,
        floor: u8,
        around: &Around,
        at: [usize; 2],
    ) -> (u8, usize) {
        let up = u32::from(self.up);
        let Sums { of, beside } = self.from_left;
        let (of, beside) = (u32::from(of), u32::from(beside));
        let pairs = left.pairs.iter().sum::<u32>();
        let (of_left, of_up) = (pairs & 0xffff, pairs >> 16);
        // What is not known suggests 0.
        let from_left = quotient(left.cell * of + beside / 2, beside);
        let from_up = quotient(up * of_left + of_up / 2, of_up);
        let known = u32::from(left.cell > 0 && beside > 0) + u32::from(up > 0 && of_up > 0);
        let (value, kind) = match known {
            0 => self.expect_from_one(left, floor, around, at),
            1 => (from_left + from_up, 1),
            _ => ((from_left + from_up).div_ceil(2), 0),
        };
        (value.clamp(floor.into(), 255) as u8, kind)
    }

    /// As [`Self::expect`] where nothing is known beside left and above.
    #[inline(never)]
    fn expect_from_one(
        self,
        left: &Left,
        floor: u8,
        around: &Around,
        [x, y]: [usize; 2],
    ) -> (u32, usize) {
        let scaled = |value: u32, before: u32| {
            if before > 0 {
                quotient(value * value + before / 2, before)
            } else {
                value
            }
        };
        if left.cell > 0 {
            (scaled(left.cell, left.second), 2)
        } else if self.up > 0 {
            let second = around.rows[(y + REACH - 2) % REACH][MARGIN + x];
            (scaled(self.up.into(), second.into()), 3)
        } else {
            (floor.into(), 4)
        }
    }
}

/// `dividend / divisor` for sums of cells, without the division: there are two for every cell.
fn quotient(dividend: u32, divisor: u32) -> u32 {
    let reciprocal = RECIPROCALS[divisor as usize % SUMS];
    ((u64::from(dividend) * u64::from(reciprocal)) >> RECIPROCAL_BITS) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reciprocals_give_the_quotients() {
        let most = 255 * REACH as u32;
        for divisor in 1..=most {
            // The quotient changes at the multiples of the divisor: there and just before them.
            let largest = 255 * most + divisor / 2;
            for multiple in (divisor..=largest).step_by(divisor as usize) {
                for dividend in [multiple - 1, multiple] {
                    assert_eq!(quotient(dividend, divisor), dividend / divisor);
                }
            }
        }
    }
}
