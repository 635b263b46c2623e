//! The causal neighbourhood of a cell, which both directions know before the cell, and the
//! prediction from it.
//!
//! The contribution of the rows above is summed for a whole row before its first cell, many columns
//! at a time. The cells to the left are added along the row.

use crate::patch::maps::MAX_SIDE;

/// Extent of the neighbourhood: rows above and cells to the left.
const REACH: usize = 3;
/// Columns that are summed at once.
const LANES: usize = 16;
/// Zeros before and after a row, so that no cell is at an end.
const MARGIN: usize = LANES;
/// End of a row's cells.
const END: usize = MARGIN + MAX_SIDE;

/// Limit of the sums that scale a prediction, rounded up to a power of two, so that no index needs
/// a check.
const SUMS: usize = 1024;
const _: () = assert!(SUMS > REACH * 255);
/// Fraction bits of [`RECIPROCALS`]: with these, products equal the exact quotients.
const RECIPROCAL_BITS: u32 = 28;
/// 1/n, rounded up; 0 for n = 0.
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

/// The coded row, the rows above, and their contribution to each of its columns.
#[derive(Debug, Clone)]
pub(super) struct Around {
    /// The earlier rows: row y is at index y modulo their number.
    rows: [Row; REACH],
    /// The coded row.
    own: Row,
    /// Per column, the cell above.
    up: Columns<u8>,
    /// Per column, sums over the rows above in which neither the cell nor the one before is zero.
    sums: Columns<Sums>,
    /// Per column: 2 if the cell above is zero, plus 4 if the one to its right is.
    zeros: Columns<u8>,
}

/// One for each column of a row.
type Columns<T> = [T; MAX_SIDE + LANES];

/// Sums of cells, and of their neighbours.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    of: u16,
    neighbour: u16,
}

/// The contribution of the rows above to a column.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    up: u8,
    from_left: Sums,
    zeros: u8,
}

impl Around {
    /// Without rows.
    pub(super) const fn new() -> Self {
        let nothing = Sums {
            of: 0,
            neighbour: 0,
        };
        Self {
            rows: [[0; END + MARGIN]; REACH],
            own: [0; END + MARGIN],
            up: [0; MAX_SIDE + LANES],
            sums: [nothing; MAX_SIDE + LANES],
            zeros: [0; MAX_SIDE + LANES],
        }
    }

    /// Removes all rows.
    pub(super) fn begin(&mut self) {
        self.rows = [[0; END + MARGIN]; REACH];
    }

    /// Adds row `y` with only zeros.
    pub(super) fn skip(&mut self, y: usize) {
        self.rows[y % REACH] = [0; END + MARGIN];
    }

    /// Starts row `y`, whose cells are zero except from `start` to `end`.
    pub(super) fn begin_row(&mut self, y: usize, start: usize, end: usize) {
        self.own = [0; END + MARGIN];
        self.sum_rows_above(y, start, end);
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

    /// Sets the cell of the row in column `x`.
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

    /// Sums the rows above row `y` for the columns from `start` to `end`.
    fn sum_rows_above(&mut self, y: usize, start: usize, end: usize) {
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

// In functions of their own, so that the code around them does not prevent vectorisation.

/// Adds cells and their neighbours if neither is zero.
#[inline(never)]
fn add_pairs(sums: &mut [Sums; LANES], own: &[u8; LANES], neighbour: &[u8; LANES]) {
    for (sums, (&own, &neighbour)) in sums.iter_mut().zip(own.iter().zip(neighbour)) {
        let known = if own.min(neighbour) > 0 { u8::MAX } else { 0 };
        sums.of += u16::from(own & known);
        sums.neighbour += u16::from(neighbour & known);
    }
}

/// Marks the cells above, and to the right of these, that are zero.
#[inline(never)]
fn find_zeros(zeros: &mut [u8; LANES], up: &[u8; LANES], right: &[u8; LANES]) {
    for (zeros, (&up, &right)) in zeros.iter_mut().zip(up.iter().zip(right)) {
        *zeros = u8::from(up == 0) << 1 | u8::from(right == 0) << 2;
    }
}

/// The cells of a row from `at` on.
fn lanes(row: &Row, at: usize) -> &[u8; LANES] {
    row[at..].first_chunk().unwrap_or(&[0; LANES])
}

/// The cells to the left in the row.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Left {
    cell: u32,
    second: u32,
    /// The last columns in which neither the cell nor the one above is zero: sums, the latter above
    /// 16 bits.
    pairs: [u32; REACH],
}

impl Left {
    /// Moves over a column whose cell is `cell`.
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
    /// Context of whether the cell is zero, below 8: which of left, above and above right are zero.
    #[inline]
    pub(super) fn zero_context(self, left: &Left) -> usize {
        usize::from(self.zeros | u8::from(left.cell == 0)) % 8
    }

    /// The value predicted from the neighbours, `floor`..=255, and the kind of prediction (below
    /// 5).
    #[inline]
    pub(super) fn expect(
        self,
        left: &Left,
        floor: u8,
        around: &Around,
        at: [usize; 2],
    ) -> (u8, usize) {
        let up = u32::from(self.up);
        let Sums { of, neighbour } = self.from_left;
        let (of, neighbour) = (u32::from(of), u32::from(neighbour));
        let pairs = left.pairs.iter().sum::<u32>();
        let (of_left, of_up) = (pairs & 0xffff, pairs >> 16);
        // Unknown neighbours predict 0.
        let from_left = quotient(left.cell * of + neighbour / 2, neighbour);
        let from_up = quotient(up * of_left + of_up / 2, of_up);
        let known = u32::from(left.cell > 0 && neighbour > 0) + u32::from(up > 0 && of_up > 0);
        let (value, kind) = match known {
            0 => self.expect_from_one(left, floor, around, at),
            1 => (from_left + from_up, 1),
            _ => ((from_left + from_up).div_ceil(2), 0),
        };
        (value.clamp(floor.into(), 255) as u8, kind)
    }

    /// As [`Self::expect`] if only one of left and above is known.
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
            // The quotient changes at the multiples of the divisor: tests them and the values just
            // before.
            let largest = 255 * most + divisor / 2;
            for multiple in (divisor..=largest).step_by(divisor as usize) {
                for dividend in [multiple - 1, multiple] {
                    assert_eq!(quotient(dividend, divisor), dividend / divisor);
                }
            }
        }
    }
}
