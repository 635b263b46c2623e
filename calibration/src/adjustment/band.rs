//! Cholesky factorisation of a symmetric banded matrix, and forward and back substitution.

/// The lower half of a symmetric matrix with zeros more than `below` places under the diagonal.
#[derive(Debug, Clone)]
pub(super) struct Band {
    size: usize,
    below: usize,
    /// By rows of `below + 1` entries each; the last is the diagonal.
    entries: Vec<f64>,
}

impl Band {
    pub(super) fn zeros(size: usize, below: usize) -> Self {
        Self {
            size,
            below,
            entries: vec![0.0; size * (below + 1)],
        }
    }

    /// Adds to the entry (`row`, `column`); `column` is at most `row`.
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        let place = self.place(row, column);
        if let Some(entry) = self.entries.get_mut(place) {
            *entry += value;
        }
    }

    pub(super) fn diagonal(&self, row: usize) -> f64 {
        self.entry(row, row)
    }

    fn place(&self, row: usize, column: usize) -> usize {
        debug_assert!(column <= row && row - column <= self.below);
        row * (self.below + 1) + self.below + column - row
    }

    fn entry(&self, row: usize, column: usize) -> f64 {
        self.entries[self.place(row, column)]
    }

    fn row(&self, row: usize) -> &[f64] {
        let width = self.below + 1;
        &self.entries[row * width..(row + 1) * width]
    }

    /// Replaces the matrix by its factor L with L L' = A; false if it is not positive definite.
    pub(super) fn factorise(&mut self) -> bool {
        let width = self.below + 1;
        for row in 0..self.size {
            let start = row.saturating_sub(self.below);
            for column in start..=row {
                let from = start.max(column.saturating_sub(self.below));
                let a = &self.row(row)[self.below + from - row..self.below + column - row];
                let b = &self.row(column)[self.below + from - column..self.below];
                let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                let rest = self.entry(row, column) - dot;
                let value = if column < row {
                    rest / self.entry(column, column)
                } else if rest > 0.0 {
                    rest.sqrt()
                } else {
                    return false;
                };
                self.entries[row * width + self.below + column - row] = value;
            }
        }
        true
    }

    /// Replaces `right`, rows of `columns` numbers, by L^-1 `right`.
    pub(super) fn forward(&self, right: &mut [f64], columns: usize) {
        if columns == 0 {
            return;
        }
        for row in 0..self.size {
            let start = row.saturating_sub(self.below);
            let (done, rest) = right.split_at_mut(row * columns);
            let current = &mut rest[..columns];
            for earlier in start..row {
                let factor = self.entry(row, earlier);
                if factor != 0.0 {
                    let source = &done[earlier * columns..(earlier + 1) * columns];
                    for (value, by) in current.iter_mut().zip(source) {
                        *value -= factor * by;
                    }
                }
            }
            let diagonal = self.entry(row, row);
            for value in current {
                *value /= diagonal;
            }
        }
    }

    /// Replaces `right` by L'^-1 `right`.
    pub(super) fn backward(&self, right: &mut [f64]) {
        for row in (0..self.size).rev() {
            let value = right[row] / self.entry(row, row);
            right[row] = value;
            let start = row.saturating_sub(self.below);
            let factors = &self.row(row)[self.below + start - row..self.below];
            for (earlier, factor) in right[start..row].iter_mut().zip(factors) {
                *earlier -= factor * value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_banded_system_is_solved() {
        // Tridiagonal, with the solution 1, 2, 3, 4.
        let mut band = Band::zeros(4, 1);
        for i in 0..4 {
            band.add(i, i, 4.0);
            if i > 0 {
                band.add(i, i - 1, -1.0);
            }
        }
        let mut right = vec![2.0, 4.0, 6.0, 13.0];
        assert!(band.factorise());
        band.forward(&mut right, 1);
        band.backward(&mut right);
        for (found, expected) in right.iter().zip([1.0, 2.0, 3.0, 4.0]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn an_indefinite_matrix_is_refused() {
        let mut band = Band::zeros(2, 1);
        band.add(0, 0, 1.0);
        band.add(1, 1, 1.0);
        band.add(1, 0, 2.0);
        assert!(!band.factorise());
    }
}
