//! The field, divided into cells; each detection pass covers one cell.

use farfield_proto::venue::Field;

/// A part of the field's floor, world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    pub(super) min_m: [f64; 2],
    pub(super) max_m: [f64; 2],
}

impl Cell {
    /// The point at `share` (0 to 1) of both sides.
    pub(super) fn at(&self, share: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| self.min_m[i] + share[i] * (self.max_m[i] - self.min_m[i]))
    }

    pub(super) fn holds(&self, at_m: [f64; 2]) -> bool {
        (0..2).all(|i| at_m[i] >= self.min_m[i] && at_m[i] <= self.max_m[i])
    }
}

/// The field in `count` cells, a power of two: halved repeatedly along the longer side.
pub(super) fn cells(field: &Field, count: usize) -> Vec<Cell> {
    let whole = Cell {
        min_m: [field.min_m[0], field.min_m[1]],
        max_m: [field.max_m[0], field.max_m[1]],
    };
    let mut cells = vec![whole];
    while cells.len() < count {
        cells = cells.into_iter().flat_map(halves).collect();
    }
    cells
}

fn halves(cell: Cell) -> [Cell; 2] {
    let side = |i: usize| cell.max_m[i] - cell.min_m[i];
    let along = usize::from(side(1) > side(0));
    let middle = cell.min_m[along] + side(along) / 2.0;
    let (mut first, mut second) = (cell, cell);
    first.max_m[along] = middle;
    second.min_m[along] = middle;
    [first, second]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_divide_the_field_along_its_longer_side() {
        let field = Field {
            min_m: [-10.0, -4.0, 0.0],
            max_m: [10.0, 4.0, 2.5],
            floor_m: 0.0,
        };
        assert_eq!(cells(&field, 1).len(), 1);
        let four = cells(&field, 4);
        assert_eq!(four.len(), 4);
        assert_eq!((four[0].min_m, four[0].max_m), ([-10.0, -4.0], [-5.0, 4.0]));
        assert_eq!((four[3].min_m, four[3].max_m), ([5.0, -4.0], [10.0, 4.0]));
        let area = |c: &Cell| (c.max_m[0] - c.min_m[0]) * (c.max_m[1] - c.min_m[1]);
        let sum: f64 = cells(&field, 16).iter().map(area).sum();
        assert!((sum - 160.0).abs() < 1e-9);
    }
}
