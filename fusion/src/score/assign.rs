//! The best one-to-one assignment of rows to columns.

/// Assigns each row to at most one column and each column to at most one row, so that
/// `min(n_rows, n_columns)` pairs are made and the sum of their costs is least.
///
/// `cost(row, column)` must be finite. The answer holds a column per row. The Hungarian method with
/// potentials and shortest augmenting paths (Kuhn 1955, Munkres 1957), O(n^3).
pub fn assign(
    n_rows: usize,
    n_columns: usize,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<Option<usize>> {
    if n_rows <= n_columns {
        return assign_wide(n_rows, n_columns, cost);
    }
    let mut of_row = vec![None; n_rows];
    for (column, row) in assign_wide(n_columns, n_rows, |c, r| cost(r, c))
        .into_iter()
        .enumerate()
    {
        if let Some(row) = row {
            of_row[row] = Some(column);
        }
    }
    of_row
}

/// As [`assign`], for no more rows than columns: every row gets a column.
fn assign_wide(
    n_rows: usize,
    n_columns: usize,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<Option<usize>> {
    // Column `n_columns` is a stand-in that holds the row which is looking for its place.
    let mut row_potential = vec![0.0; n_rows];
    let mut column_potential = vec![0.0; n_columns + 1];
    let mut row_of: Vec<Option<usize>> = vec![None; n_columns + 1];
    for new_row in 0..n_rows {
        row_of[n_columns] = Some(new_row);
        let mut slack = vec![f64::INFINITY; n_columns];
        let mut came_from = vec![n_columns; n_columns];
        let mut visited = vec![false; n_columns + 1];
        let mut column = n_columns;
        while let Some(row) = row_of[column] {
            visited[column] = true;
            let (mut nearest, mut step) = (column, f64::INFINITY);
            for next in (0..n_columns).filter(|&next| !visited[next]) {
                let reduced = cost(row, next) - row_potential[row] - column_potential[next];
                if reduced < slack[next] {
                    slack[next] = reduced;
                    came_from[next] = column;
                }
                if slack[next] < step {
                    step = slack[next];
                    nearest = next;
                }
            }
            for c in 0..=n_columns {
                if visited[c] {
                    column_potential[c] -= step;
                    if let Some(r) = row_of[c] {
                        row_potential[r] += step;
                    }
                } else if c < n_columns {
                    slack[c] -= step;
                }
            }
            if nearest == column {
                break; // only a cost that is not finite leads here
            }
            column = nearest;
        }
        while column != n_columns {
            let previous = came_from[column];
            row_of[column] = row_of[previous];
            column = previous;
        }
    }
    let mut of_row = vec![None; n_rows];
    for (column, row) in row_of.into_iter().take(n_columns).enumerate() {
        if let Some(row) = row {
            of_row[row] = Some(column);
        }
    }
    of_row
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
    fn the_greedy_choice_is_not_taken_where_it_costs_more() {
        let costs = [[1.0, 2.0], [1.5, 9.0]];
        assert_eq!(assign(2, 2, |i, j| costs[i][j]), [Some(1), Some(0)]);
    }

    #[test]
    fn nothing_is_assigned_to_nothing() {
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
