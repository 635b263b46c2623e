//! The best one-to-one assignment of rows to columns.

/// Assigns each row to at most one column and each column to at most one row, so that `min(n_rows,
/// n_columns)` pairs are made with the least sum of costs.
///
/// `cost(row, column)` must be finite. The result has a column per row. The Hungarian method with
/// potentials and shortest augmenting paths (Kuhn 1955, Munkres 1957), O(n^3).
pub fn assign(
    n_rows: usize,
    n_columns: usize,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<Option<usize>> {
    let mut assigner = Assigner::default();
    assigner.assign(n_rows, n_columns, cost);
    assigner.of_row
}

/// [`assign`] with reused buffers: allocates only while they grow.
#[derive(Debug, Clone, Default)]
pub struct Assigner {
    row_potential: Vec<f64>,
    column_potential: Vec<f64>,
    row_of: Vec<Option<usize>>,
    slack: Vec<f64>,
    came_from: Vec<usize>,
    visited: Vec<bool>,
    of_row: Vec<Option<usize>>,
}

impl Assigner {
    /// As [`assign`].
    pub fn assign(
        &mut self,
        n_rows: usize,
        n_columns: usize,
        cost: impl Fn(usize, usize) -> f64,
    ) -> &[Option<usize>] {
        self.of_row.clear();
        if n_rows <= n_columns {
            self.assign_wide(n_rows, n_columns, cost);
            self.of_row.resize(n_rows, None);
            for (column, row) in self.row_of.iter().take(n_columns).enumerate() {
                if let Some(row) = *row {
                    self.of_row[row] = Some(column);
                }
            }
        } else {
            self.assign_wide(n_columns, n_rows, |column, row| cost(row, column));
            self.of_row.extend(self.row_of.iter().take(n_rows));
        }
        &self.of_row
    }

    /// For no more rows than columns: every row gets a column, in `row_of`.
    fn assign_wide(&mut self, n_rows: usize, n_columns: usize, cost: impl Fn(usize, usize) -> f64) {
        // Column `n_columns` is a dummy with the row that is being placed.
        refill(&mut self.row_potential, n_rows, 0.0);
        refill(&mut self.column_potential, n_columns + 1, 0.0);
        refill(&mut self.row_of, n_columns + 1, None);
        for new_row in 0..n_rows {
            self.row_of[n_columns] = Some(new_row);
            let mut column = self.shortest_path(n_columns, &cost);
            while column != n_columns {
                let previous = self.came_from[column];
                self.row_of[column] = self.row_of[previous];
                column = previous;
            }
        }
    }

    /// The free column at the end of the shortest augmenting path from the dummy.
    fn shortest_path(&mut self, n_columns: usize, cost: &impl Fn(usize, usize) -> f64) -> usize {
        refill(&mut self.slack, n_columns, f64::INFINITY);
        refill(&mut self.came_from, n_columns, n_columns);
        refill(&mut self.visited, n_columns + 1, false);
        let mut column = n_columns;
        while let Some(row) = self.row_of[column] {
            self.visited[column] = true;
            let (mut nearest, mut step) = (column, f64::INFINITY);
            for next in 0..n_columns {
                if self.visited[next] {
                    continue;
                }
                let reduced =
                    cost(row, next) - self.row_potential[row] - self.column_potential[next];
                if reduced < self.slack[next] {
                    self.slack[next] = reduced;
                    self.came_from[next] = column;
                }
                if self.slack[next] < step {
                    step = self.slack[next];
                    nearest = next;
                }
            }
            for c in 0..=n_columns {
                if self.visited[c] {
                    self.column_potential[c] -= step;
                    if let Some(r) = self.row_of[c] {
                        self.row_potential[r] += step;
                    }
                } else if c < n_columns {
                    self.slack[c] -= step;
                }
            }
            if nearest == column {
                break; // only a cost that is not finite leads here
            }
            column = nearest;
        }
        column
    }
}

fn refill<T: Clone>(buffer: &mut Vec<T>, n: usize, value: T) {
    buffer.clear();
    buffer.resize(n, value);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn least_total(n: usize, m: usize, cost: &dyn Fn(usize, usize) -> f64) -> f64 {
        fn best(
            row: usize,
            n: usize,
            free: &mut Vec<bool>,
            skip: usize,
            cost: &dyn Fn(usize, usize) -> f64,
        ) -> f64 {
            if row == n {
                return 0.0;
            }
            let mut least = f64::INFINITY;
            for column in 0..free.len() {
                if free[column] {
                    free[column] = false;
                    least = least.min(cost(row, column) + best(row + 1, n, free, skip, cost));
                    free[column] = true;
                }
            }
            if skip > 0 {
                least = least.min(best(row + 1, n, free, skip - 1, cost));
            }
            least
        }
        best(0, n, &mut vec![true; m], n.saturating_sub(m), cost)
    }

    #[test]
    fn the_assignment_is_better_than_the_greedy_one() {
        let costs = [[1.0, 2.0], [1.5, 9.0]];
        assert_eq!(assign(2, 2, |i, j| costs[i][j]), [Some(1), Some(0)]);
    }

    #[test]
    fn an_empty_problem_has_an_empty_assignment() {
        assert_eq!(assign(0, 3, |_, _| 1.0), []);
        assert_eq!(assign(2, 0, |_, _| 1.0), [None, None]);
    }

    proptest! {
        #[test]
        fn the_total_is_that_of_an_exhaustive_search(
            n in 1usize..6, m in 1usize..6, costs in prop::collection::vec(-5.0f64..5.0, 36),
        ) {
            let cost = |i: usize, j: usize| costs[i * 6 + j];
            let assigned = assign(n, m, cost);
            let pairs: Vec<_> = assigned.iter().enumerate().filter_map(|(i, j)| j.map(|j| (i, j))).collect();
            prop_assert_eq!(pairs.len(), n.min(m));
            let mut columns: Vec<_> = pairs.iter().map(|p| p.1).collect();
            columns.sort_unstable();
            columns.dedup();
            prop_assert_eq!(columns.len(), n.min(m));
            let total: f64 = pairs.iter().map(|&(i, j)| cost(i, j)).sum();
            prop_assert!((total - least_total(n, m, &cost)).abs() < 1e-9);
        }
    }
}
