//! The causal neighbourhood of a cell, which both directions know before it, and the prediction from it.

/// How far expectations look: rows above and cells to the left.
const REACH: usize = 3;

/// Largest sum of the cells that an expectation is scaled by.
const MAX_SUM: usize = REACH * 255;
/// Fraction bits of [`RECIPROCALS`]: with these, products with what is scaled are the quotients, exactly.
const RECIPROCAL_BITS: u32 = 28;
/// 1/n, rounded up; that of 0 is 0.
const RECIPROCALS: [u32; MAX_SUM + 1] = {
    let mut table = [0; MAX_SUM + 1];
    let mut n = 1;
    while n < table.len() {
        table[n] = (1u32 << RECIPROCAL_BITS).div_ceil(n as u32);
        n += 1;
    }
    table
};

/// The cells around one cell that are known before it; 0 where there is none. It moves along a row,
/// so that every cell is loaded once for each row below it.
pub(super) struct Around<'a> {
    above: [&'a [u8]; REACH],
    /// By rows up; the lowest byte is the cell's own column, the next one back, and so on.
    rows: [u32; REACH + 1],
    above_right: u32,
}

impl<'a> Around<'a> {
    /// Before cell `x` of the row under `above`, which is all rows so far.
    pub(super) fn before(above: &'a [u8], width: usize, x: usize) -> Self {
        let mut rows = above.rchunks_exact(width);
        let above = [(); REACH].map(|()| rows.next().unwrap_or(&[]));
        let mut around = Self {
            above,
            rows: [0; REACH + 1],
            above_right: 0,
        };
        for x in x.saturating_sub(REACH)..x {
            around.move_to(x);
        }
        around
    }

    /// Moves on to cell `x`, which nothing is known of yet.
    pub(super) fn move_to(&mut self, x: usize) {
        let loaded = |row: &[u8], x: usize| row.get(x).copied().map_or(0, u32::from);
        self.rows[0] <<= 8;
        for (row, above) in self.rows[1..].iter_mut().zip(self.above) {
            *row = *row << 8 | loaded(above, x);
        }
        self.above_right = loaded(self.above[0], x + 1);
    }

    /// Says what the cell itself is.
    pub(super) fn set(&mut self, cell: u8) {
        self.rows[0] |= u32::from(cell);
    }

    /// The cell so many rows up and columns back.
    fn cell(&self, up: usize, back: usize) -> u32 {
        self.rows[up] >> (8 * back) & 0xff
    }

    /// Context of whether the cell is zero: which of left, above and above right are.
    pub(super) fn zero_context(&self) -> usize {
        usize::from(self.cell(0, 1) == 0)
            | usize::from(self.cell(1, 0) == 0) << 1
            | usize::from(self.above_right == 0) << 2
    }

    /// The value that the neighbours suggest, `floor`..=255, and the kind of suggestion (below 5).
    pub(super) fn expect(&self, floor: u8) -> (u8, usize) {
        let (left, up) = (self.cell(0, 1), self.cell(1, 0));
        let from_left = scaled(left, [1, 2, 3].map(|k| (self.cell(k, 0), self.cell(k, 1))));
        let from_up = scaled(up, [1, 2, 3].map(|k| (self.cell(0, k), self.cell(1, k))));
        let (value, kind) = match (from_left, from_up) {
            (Some(a), Some(b)) => ((a + b).div_ceil(2), 0),
            (Some(one), None) | (None, Some(one)) => (one, 1),
            (None, None) if left > 0 => {
                (scaled(left, [(left, self.cell(0, 2))]).unwrap_or(left), 2)
            }
            (None, None) if up > 0 => (scaled(up, [(up, self.cell(2, 0))]).unwrap_or(up), 3),
            (None, None) => (u32::from(floor), 4),
        };
        (value.clamp(floor.into(), 255) as u8, kind)
    }
}

/// `value` times the ratio of the summed pairs, of which both must be above zero.
fn scaled<const N: usize>(value: u32, pairs: [(u32, u32); N]) -> Option<u32> {
    // Without branches: which neighbours are zero cannot be foreseen.
    let (a, b) = pairs.into_iter().fold((0, 0), |(a, b), (next_a, next_b)| {
        let known = u32::from(next_a > 0 && next_b > 0);
        (a + known * next_a, b + known * next_b)
    });
    (value > 0 && b > 0).then(|| quotient(value * a + b / 2, b))
}

/// `dividend / divisor` for sums of cells, without the division: there are two for every cell.
fn quotient(dividend: u32, divisor: u32) -> u32 {
    let reciprocal = RECIPROCALS[divisor as usize];
    ((u64::from(dividend) * u64::from(reciprocal)) >> RECIPROCAL_BITS) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reciprocals_give_the_quotients() {
        for divisor in 1..=MAX_SUM as u32 {
            // The quotient changes at the multiples of the divisor: there and just before them.
            let largest = 255 * MAX_SUM as u32 + divisor / 2;
            for multiple in (divisor..=largest).step_by(divisor as usize) {
                for dividend in [multiple - 1, multiple] {
                    assert_eq!(quotient(dividend, divisor), dividend / divisor);
                }
            }
        }
    }
}
