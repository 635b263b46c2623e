//! The packed maps of a view: of each map only the rows and columns that may be nonzero, one map
//! after the other.
//!
//! Unpacked, the maps of a crowd exceed a processor's caches and its table of pages, and nearly all
//! of it is zero. Packed, a map is usually one block wide.
//!
//! A row of zeros precedes the first row of a map and follows its last, and each row ends with at
//! least one zero. So comparing a cell with its neighbours needs no check of the border.

use farfield_proto::patch::{Maps, Written};
use nalgebra::Vector2;

/// Cells of a row that are processed at once.
pub(super) const BLOCK: usize = 16;
/// Cells of a row, side by side.
pub(super) type Block = [u8; BLOCK];
/// Cells along one side of a [`PackedMap::square`].
const SIDE: usize = 5;

/// The maps of one view. Reused from tick to tick: allocates only if the written part grows.
#[derive(Debug, Clone, Default)]
pub(crate) struct PackedMaps {
    /// Of each unpacked map, cells.
    size: (usize, usize),
    cells: Vec<u8>,
    windows: Vec<MapWindow>,
}

/// The written part of one map, and where it is stored.
#[derive(Debug, Clone, Default)]
struct MapWindow {
    /// Where its cells begin, with the row of zeros before the first.
    begin: usize,
    /// Cells from one row to the next: whole blocks.
    stride: usize,
    written: Written,
}

impl MapWindow {
    /// Range of its cells, with both rows of zeros.
    fn place(&self) -> std::ops::Range<usize> {
        self.begin..self.begin + (self.written.rows.len() + 2) * self.stride
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct PackedMap<'a> {
    /// With both rows of zeros.
    cells: &'a [u8],
    stride: usize,
    written: &'a Written,
    size: (usize, usize),
}

impl PackedMaps {
    /// Stores the written parts of `maps`.
    pub(super) fn pack(&mut self, maps: &Maps) {
        self.size = (maps.width(), maps.height());
        self.cells.clear();
        self.windows.clear();
        for keypoint in 0..maps.keypoints() {
            self.push(maps.cells(keypoint), maps.written(keypoint));
        }
    }

    fn push(&mut self, map: &[u8], written: &Written) {
        let (width, n) = (self.size.0, written.columns.len());
        let window = MapWindow {
            begin: self.cells.len(),
            stride: (n + 1).next_multiple_of(BLOCK),
            written: written.clone(),
        };
        self.cells.resize(window.place().end, 0);
        let first = written.columns.start;
        let rows = map.chunks_exact(width.max(1)).skip(written.rows.start);
        let own = self.cells[window.place()].chunks_exact_mut(window.stride);
        for (own, row) in own.skip(1).zip(rows.take(written.rows.len())) {
            match (own.first_chunk_mut(), row[first..].first_chunk::<BLOCK>()) {
                // Cells beyond the written columns are also zero.
                (Some(own), Some(block)) if n < BLOCK => *own = *block,
                _ => own[..n].copy_from_slice(&row[first..first + n]),
            }
        }
        self.windows.push(window);
    }

    /// Columns and rows of each map.
    pub(super) fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The map of `keypoint`.
    ///
    /// # Panics
    /// If there is no such map.
    pub(crate) fn map(&self, keypoint: usize) -> PackedMap<'_> {
        let window = &self.windows[keypoint];
        PackedMap {
            cells: &self.cells[window.place()],
            stride: window.stride,
            written: &window.written,
            size: self.size,
        }
    }

    /// The written part of the map of `keypoint`, with its mutable cells from the first column on,
    /// and the cells from row to row.
    ///
    /// # Panics
    /// If there is no such map.
    pub(super) fn written_mut(&mut self, keypoint: usize) -> (&Written, &mut [u8], usize) {
        let window = &self.windows[keypoint];
        let cells = &mut self.cells[window.place()][window.stride..];
        (&window.written, cells, window.stride)
    }

    /// Swaps the maps of two keypoints.
    ///
    /// # Panics
    /// If there is no such map.
    pub(super) fn swap(&mut self, a: usize, b: usize) {
        self.windows.swap(a, b);
    }

    /// Replaces the map of `keypoint` by another, row by row.
    #[cfg(test)]
    pub(super) fn replace_for_test(&mut self, keypoint: usize, map: &[u8]) {
        let whole = Written {
            rows: 0..self.size.1,
            columns: 0..self.size.0,
        };
        self.push(map, &whole);
        self.windows.swap_remove(keypoint);
    }
}

impl<'a> PackedMap<'a> {
    /// Columns and rows of the map.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The rows and columns outside which all cells are zero.
    pub(super) fn written(&self) -> &'a Written {
        self.written
    }

    /// The cell in a column and row; 0 outside the map.
    #[inline]
    pub(super) fn value(&self, x: usize, y: usize) -> u8 {
        let Written { rows, columns } = self.written;
        let (column, row) = (x.wrapping_sub(columns.start), y.wrapping_sub(rows.start));
        if column < columns.len() && row < rows.len() {
            self.cells[(row + 1) * self.stride + column]
        } else {
            0
        }
    }

    /// The cells of the written row `y`, and at least one zero.
    pub(super) fn row(&self, y: usize) -> &'a [u8] {
        let row = y - self.written.rows.start + 1;
        &self.cells[row * self.stride..][..self.stride]
    }

    /// The block that begins at a column of the written part, a multiple of [`BLOCK`], in row `y`,
    /// and its neighbours: to the left and right, above and below.
    #[inline]
    pub(super) fn neighbourhood(&self, column: usize, y: usize) -> Option<[&'a Block; 5]> {
        let at = (y - self.written.rows.start) * self.stride + column;
        let block = |at: usize| self.cells.get(at..)?.first_chunk::<BLOCK>();
        let own = at + self.stride;
        Some([
            block(own)?,
            block(own - 1)?,
            block(own + 1)?,
            block(at)?,
            block(own + self.stride)?,
        ])
    }

    /// The map at a fractional cell, clamped to its border, 0 to 1.
    pub(crate) fn bilinear(&self, cell: Vector2<f64>) -> f64 {
        let (width, height) = self.size;
        let x = cell.x.max(0.0).min((width - 1) as f64);
        let y = cell.y.max(0.0).min((height - 1) as f64);
        // Casts round towards zero, and x and y are not negative.
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = (x - x0 as f64, y - y0 as f64);
        let [[a, b], [c, d]] = self.four(x0, y0).map(|row| row.map(f64::from));
        let upper = a + fx * (b - a);
        let lower = c + fx * (d - c);
        (upper + fy * (lower - upper)) * (1.0 / 255.0)
    }

    /// The cell in a column and row and those to its right and below, row by row; outside the map
    /// its border.
    #[inline]
    fn four(&self, x0: usize, y0: usize) -> [[u8; 2]; 2] {
        let (width, height) = self.size;
        let (right, down) = (usize::from(x0 + 1 < width), usize::from(y0 + 1 < height));
        let Written { rows, columns } = self.written;
        let (column, row) = (x0.wrapping_sub(columns.start), y0.wrapping_sub(rows.start));
        if column < columns.len() && row < rows.len() {
            // A zero ends the row, and a row of zeros the map.
            let upper = &self.cells[(row + 1) * self.stride + column..];
            let lower = down * self.stride;
            [
                [upper[0], upper[right]],
                [upper[lower], upper[lower + right]],
            ]
        } else {
            [y0, y0 + down].map(|y| [self.value(x0, y), self.value(x0 + right, y)])
        }
    }

    /// The square of cells around one, row by row; outside the map its border.
    #[inline]
    pub(crate) fn square(&self, (x, y): (usize, usize)) -> [[u8; SIDE]; SIDE] {
        const HALF: usize = SIDE / 2;
        let (width, height) = self.size;
        let Written { rows, columns } = self.written;
        // One more row and column of zeros are stored on each side.
        let is_within = x >= columns.start + HALF
            && x + HALF <= columns.end
            && x + HALF < width
            && y + 1 >= rows.start + HALF
            && y >= HALF
            && y + HALF <= rows.end
            && y + HALF < height;
        if is_within {
            let first = (y + 1 - HALF - rows.start) * self.stride + x - HALF - columns.start;
            let from = &self.cells[first..];
            std::array::from_fn(|i| {
                let row = from.get(i * self.stride..).and_then(<[u8]>::first_chunk);
                row.copied().unwrap_or_default()
            })
        } else {
            let near = |v: usize, i: usize, size: usize| (v + i).saturating_sub(HALF).min(size - 1);
            std::array::from_fn(|j| {
                let y = near(y, j, height);
                std::array::from_fn(|i| self.value(near(x, i, width), y))
            })
        }
    }

    /// Writes the whole map, row by row.
    pub(crate) fn write_unpacked(&self, into: &mut Vec<u8>) {
        let (width, height) = self.size;
        into.clear();
        into.resize(width * height, 0);
        let Written { rows, columns } = self.written;
        for y in rows.clone() {
            let own = &self.row(y)[..columns.len()];
            into[y * width..][columns.clone()].copy_from_slice(own);
        }
    }
}

/// A single map of this size.
#[cfg(test)]
pub(crate) fn packed(cells: &[u8], (width, height): (usize, usize)) -> PackedMaps {
    let mut maps = Maps::new(width, height, 1);
    maps.cells_mut(0).copy_from_slice(cells);
    let mut packed = PackedMaps::default();
    packed.pack(&maps);
    packed
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use proptest::prelude::*;

    use super::*;

    /// Maps of 20 x 12 cells of which the last is written in these columns and rows, and the same
    /// as a dense one.
    fn partly(columns: Range<usize>, rows: Range<usize>, seed: u64) -> (PackedMaps, Vec<u8>) {
        let (width, height) = (20, 12);
        let mut dense = vec![0; width * height];
        for y in rows.clone() {
            for x in columns.clone() {
                let mixed = (seed + (y * width + x) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                dense[y * width + x] = (mixed >> 56) as u8;
            }
        }
        let mut maps = PackedMaps {
            size: (width, height),
            ..PackedMaps::default()
        };
        maps.push(&dense, &Written::default());
        maps.push(&dense, &Written { rows, columns });
        (maps, dense)
    }

    fn part(most: usize) -> impl Strategy<Value = Range<usize>> {
        (0..most, 1..=most).prop_map(move |(first, n)| first..(first + n).min(most))
    }

    proptest! {
        #[test]
        fn packing_does_not_change_a_map(
            columns in part(20), rows in part(12), seed in any::<u64>(), x in 0usize..20, y in 0usize..12,
        ) {
            let (maps, dense) = partly(columns, rows, seed);
            let map = maps.map(1);
            let at = |x: usize, y: usize| dense[y.min(11) * 20 + x.min(19)];
            prop_assert_eq!(map.value(x, y), at(x, y));
            prop_assert_eq!(map.value(x + 20, y), 0);
            let four = [[at(x, y), at(x + 1, y)], [at(x, y + 1), at(x + 1, y + 1)]];
            prop_assert_eq!(map.four(x, y), four);
            let near = |v: usize, i: usize| (v + i).saturating_sub(2);
            let square = [0, 1, 2, 3, 4].map(|j| [0, 1, 2, 3, 4].map(|i| at(near(x, i), near(y, j))));
            prop_assert_eq!(map.square((x, y)), square);
            let mut unpacked = Vec::new();
            map.write_unpacked(&mut unpacked);
            prop_assert_eq!(&unpacked, &dense);
            maps.map(0).write_unpacked(&mut unpacked);
            prop_assert!(unpacked.iter().all(|&cell| cell == 0));
        }

        #[test]
        fn neighbours_outside_the_map_are_zero(
            columns in part(20), rows in part(12), seed in any::<u64>(),
        ) {
            let (maps, _) = partly(columns.clone(), rows.clone(), seed);
            let map = maps.map(1);
            for (first, y) in rows.flat_map(|y| (0..columns.len()).step_by(BLOCK).map(move |x| (x, y))) {
                let around = map.neighbourhood(first, y).unwrap();
                for (i, x) in (columns.start + first..columns.end).take(BLOCK).enumerate() {
                    let expected = [
                        map.value(x, y),
                        map.value(x.wrapping_sub(1), y),
                        map.value(x + 1, y),
                        map.value(x, y.wrapping_sub(1)),
                        map.value(x, y + 1),
                    ];
                    prop_assert_eq!(around.map(|block| block[i]), expected);
                }
            }
        }
    }
}
