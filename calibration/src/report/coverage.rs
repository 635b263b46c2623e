//! The parts of a camera's picture with sights: elsewhere its lens and its pose are not checked.

/// Columns of the grid over a picture.
const COLUMNS: usize = 6;
/// Rows of the grid over a picture.
const ROWS: usize = 4;

/// An edge of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureEdge {
    /// The edge at x = 0.
    Left,
    /// The edge at the largest x.
    Right,
    /// The edge at y = 0.
    Upper,
    /// The edge at the largest y.
    Lower,
}

impl PictureEdge {
    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Upper => "upper",
            Self::Lower => "lower",
        }
    }
}

/// The number of fitting sights in each part of a picture.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PictureCoverage {
    /// Sights per cell, by rows from the top, each from the left.
    pub cells: [[usize; COLUMNS]; ROWS],
}

impl PictureCoverage {
    /// The coverage of a picture of `size_px`; pixels outside of it are ignored.
    pub fn new(size_px: [u32; 2], pixels: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let mut cells = [[0; COLUMNS]; ROWS];
        for px in pixels {
            let part = |axis: usize, parts: usize| {
                (px[axis] + 0.5) / f64::from(size_px[axis]) * parts as f64
            };
            let (column, row) = (part(0, COLUMNS).floor(), part(1, ROWS).floor());
            if column >= 0.0
                && row >= 0.0
                && let Some(cell) = cells
                    .get_mut(row as usize)
                    .and_then(|row: &mut [usize; COLUMNS]| row.get_mut(column as usize))
            {
                *cell += 1;
            }
        }
        Self { cells }
    }

    /// Share of the cells without a sight, 0 to 1.
    pub fn empty_share(&self) -> f64 {
        let empty = self.cells.iter().flatten().filter(|count| **count == 0);
        empty.count() as f64 / (COLUMNS * ROWS) as f64
    }

    /// Edges whose cells have no sight.
    pub fn empty_edges(&self) -> Vec<PictureEdge> {
        let row_is_empty = |row: usize| self.cells[row].iter().all(|count| *count == 0);
        let column_is_empty = |column: usize| self.cells.iter().all(|row| row[column] == 0);
        let edges = [
            (PictureEdge::Left, column_is_empty(0)),
            (PictureEdge::Right, column_is_empty(COLUMNS - 1)),
            (PictureEdge::Upper, row_is_empty(0)),
            (PictureEdge::Lower, row_is_empty(ROWS - 1)),
        ];
        let empty = edges.into_iter().filter(|(_, is_empty)| *is_empty);
        empty.map(|(edge, _)| edge).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_without_sights_are_listed() {
        let size_px = [600, 400];
        // The right half except for the lowest quarter.
        let pixels = (0..300).flat_map(|x| {
            let column = f64::from(300 + x);
            (0..6).map(move |y| [column, 50.0 * f64::from(y)])
        });
        let found = PictureCoverage::new(size_px, pixels);
        assert_eq!(found.empty_edges(), [PictureEdge::Left, PictureEdge::Lower]);
        assert!((found.empty_share() - 15.0 / 24.0).abs() < 1e-12);
    }

    #[test]
    fn pixels_outside_of_the_picture_are_ignored() {
        let outside = [
            [-0.6, 5.0],
            [599.6, 5.0],
            [5.0, 400.0],
            [f64::NAN, 1.0],
            [1e300, 1.0],
        ];
        let found = PictureCoverage::new([600, 400], outside);
        assert!((found.empty_share() - 1.0).abs() < 1e-12);
        let corners = [[-0.5, -0.5], [599.4, 399.4]];
        let found = PictureCoverage::new([600, 400], corners);
        assert_eq!((found.cells[0][0], found.cells[3][5]), (1, 1));
    }
}
