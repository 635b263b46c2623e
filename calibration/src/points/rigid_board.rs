//! A board whose corners keep their places to each other.

use nalgebra::Vector3;

/// A board whose inner corners are numbered row by row, as `OpenCV` numbers those of a `ChArUco` board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBoard {
    /// Squares along a row and along a column.
    pub squares: [u32; 2],
    /// Side of a square, metres.
    pub square_m: f64,
}

impl RigidBoard {
    /// Its inner corners about their middle, metres.
    pub(super) fn shape(&self) -> Vec<Vector3<f64>> {
        let [columns, rows] = self.squares.map(|n| n.saturating_sub(1));
        let place = |i: u32, of: u32| self.square_m * (f64::from(i) - 0.5 * (f64::from(of) - 1.0));
        let corners = (0..rows).flat_map(|v| (0..columns).map(move |u| (u, v)));
        corners
            .map(|(u, v)| Vector3::new(place(u, columns), place(v, rows), 0.0))
            .collect()
    }

    /// How many inner corners it has.
    pub(super) fn corner_count(&self) -> usize {
        let [columns, rows] = self.squares.map(|n| n.saturating_sub(1) as usize);
        columns.saturating_mul(rows)
    }
}
