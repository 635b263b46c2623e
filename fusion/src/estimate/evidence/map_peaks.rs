//! The peaks of one map around where its keypoint is expected.

use std::ops::Range;

use farfield_proto::patch::Written;
use nalgebra::Vector2;

use super::edit::{common, span};
use super::packed_maps::{BLOCK, Block, PackedMap};

/// Lowest height of a peak, as a cell value: 0.1.
const LEAST_PEAK: u8 = 25;
/// Most peaks of a map, the highest ones.
const MAX_PEAKS: usize = 6;
/// A local maximum of a map.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct MapPeak {
    /// Its top, cells: of a parabola through the highest cell and its neighbours, per axis.
    pub(crate) cell: Vector2<f64>,
    /// 0 to 1.
    pub(crate) height: f64,
}

/// The highest peaks of one map within the circumscribed square of the lattice's face, by height.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct MapPeaks {
    all: [MapPeak; MAX_PEAKS],
    n: u8,
    are_found: bool,
    highest: u8,
}

impl MapPeaks {
    /// Whether the search has run.
    pub(super) fn are_found(&self) -> bool {
        self.are_found
    }

    /// Highest first.
    pub(crate) fn as_slice(&self) -> &[MapPeak] {
        &self.all[..usize::from(self.n)]
    }

    /// The highest value of the map, 0 to 1, within the half width of the lattice along both axes.
    pub(crate) fn highest(&self) -> f64 {
        f64::from(self.highest) / 255.0
    }

    /// Finds the peaks of a map within `half_width_cells` times the square root of two of `center`
    /// along both axes.
    pub(super) fn find(
        &mut self,
        map: &PackedMap<'_>,
        center: Vector2<f64>,
        half_width_cells: f64,
    ) {
        *self = Self {
            are_found: true,
            ..Self::default()
        };
        let (size, written) = (map.size(), map.written());
        let reach = half_width_cells * 2.0f64.sqrt();
        let columns = common(span(center.x, reach, size.0), &written.columns);
        let rows = common(span(center.y, reach, size.1), &written.rows);
        let near_columns = common(span(center.x, half_width_cells, size.0), &columns);
        let near_rows = common(span(center.y, half_width_cells, size.1), &rows);
        let first = written.columns.start;
        for x in blocks(&columns, first) {
            let near = near_columns.start.max(x)..near_columns.end.clamp(x, x + BLOCK);
            let highest = highest_of(map, x - first, near_rows.clone());
            let near = highest
                .get(near.start - x..near.end - x)
                .unwrap_or_default();
            self.highest = near.iter().fold(self.highest, |most, &cell| most.max(cell));
        }
        for y in rows {
            for x in blocks(&columns, first) {
                let mut tops = tops(map, x - first, y);
                while tops != 0 {
                    let at = x + tops.trailing_zeros() as usize / 8;
                    tops &= tops - 1;
                    if columns.contains(&at) {
                        self.take(map, at, y);
                    }
                }
            }
        }
    }

    /// Adds a peak if this is its highest cell.
    #[inline(never)]
    fn take(&mut self, map: &PackedMap<'_>, x: usize, y: usize) {
        if map.is_highest(x, y) {
            self.insert(MapPeak {
                cell: map.top_of(x, y),
                height: f64::from(map.value(x, y)) / 255.0,
            });
        }
    }

    fn insert(&mut self, peak: MapPeak) {
        let own = self.as_slice();
        let at = own.iter().take_while(|p| p.height >= peak.height).count();
        if at < MAX_PEAKS {
            let n = (own.len() + 1).min(MAX_PEAKS);
            self.all[at..n].rotate_right(1);
            self.all[at] = peak;
            self.n = n as u8;
        }
    }
}

// Separate functions, so that the code around them does not prevent vector instructions.

/// Whether no cell of a block reaches a peak's least height; false is not certain.
#[inline]
fn is_low(block: &Block) -> bool {
    /// The high bits: a cell of the least peak has at least one.
    const HIGH: u128 = 0xf0f0_f0f0_f0f0_f0f0_f0f0_f0f0_f0f0_f0f0;
    const _: () = assert!(LEAST_PEAK >= 16);
    u128::from_le_bytes(*block) & HIGH == 0
}

/// Whether any of a block's cells is above `most`.
#[inline(never)]
fn is_any_above(own: &Block, most: u8) -> bool {
    let above = own.map(|cell| cell.saturating_sub(most));
    u128::from_le_bytes(above) != 0
}

/// [`is_top`] of each cell of a block.
#[inline(never)]
fn are_tops(own: &Block, [left, right]: [&Block; 2], [above, below]: [&Block; 2]) -> Block {
    std::array::from_fn(|i| is_top(own[i], left[i].max(above[i]), right[i].max(below[i])))
}

/// Whether a cell is high enough, higher than those `before` it and not lower than those `after`
/// it: 1, or 0. Saturating sums, which processors compute for many cells at once.
fn is_top(own: u8, before: u8, after: u8) -> u8 {
    let is_high = own.saturating_sub(LEAST_PEAK - 1).min(1);
    let is_higher = own.saturating_sub(before).min(1);
    let is_lower = after.saturating_sub(own).min(1);
    is_high & is_higher & (1 - is_lower)
}

/// Where the blocks of a row begin that contain any of `columns`; the first block of all is at
/// `first`.
fn blocks(columns: &Range<usize>, first: usize) -> impl Iterator<Item = usize> + use<> {
    let start = columns.start - (columns.start.max(first) - first) % BLOCK;
    (start..columns.end).step_by(BLOCK)
}

/// The highest cell of each column of the block that begins at a column of the written part, among
/// `rows`.
#[inline(never)]
fn highest_of(map: &PackedMap<'_>, column: usize, rows: Range<usize>) -> Block {
    let mut highest = [0; BLOCK];
    for y in rows {
        if let Some(block) = map.row(y)[column..].first_chunk::<BLOCK>() {
            highest = std::array::from_fn(|i| highest[i].max(block[i]));
        }
    }
    highest
}

/// One byte per cell of the block that begins at a column of the written part, the first in the
/// lowest byte. 1 if the cell is high enough and higher than its neighbours in the row and the
/// column; of a plateau, for its first cell.
#[inline]
fn tops(map: &PackedMap<'_>, column: usize, y: usize) -> u128 {
    match map.neighbourhood(column, y) {
        Some([own, left, right, above, below]) if !is_low(own) => {
            u128::from_le_bytes(are_tops(own, [left, right], [above, below]))
        }
        _ => 0,
    }
}

impl PackedMap<'_> {
    /// Whether no neighbour in the rows above and below is higher; of a plateau, its first cell
    /// counts.
    fn is_highest(&self, x: usize, y: usize) -> bool {
        let own = self.value(x, y);
        // Outside the map all values are zero.
        let around = |y: usize| [x.wrapping_sub(1), x, x + 1].map(|x| self.value(x, y));
        around(y.wrapping_sub(1)).iter().all(|&other| other < own)
            && around(y + 1).iter().all(|&other| other <= own)
    }

    /// The peak of the highest cell of the map; `None` if it is too low.
    pub(crate) fn highest_peak(&self) -> Option<MapPeak> {
        let Written { rows, columns } = self.written();
        let (mut most, mut highest_row) = (LEAST_PEAK - 1, None);
        for y in rows.clone() {
            for block in self.row(y).as_chunks::<BLOCK>().0 {
                if is_any_above(block, most) {
                    let highest = block.iter().fold(0, |highest, &cell| cell.max(highest));
                    (most, highest_row) = (highest, Some(y));
                }
            }
        }
        let y = highest_row?;
        let x = columns.start + self.row(y).iter().position(|&cell| cell == most)?;
        Some(MapPeak {
            cell: self.top_of(x, y),
            height: f64::from(most) / 255.0,
        })
    }

    /// The top of the peak with this highest cell.
    fn top_of(&self, x: usize, y: usize) -> Vector2<f64> {
        let (width, height) = self.size();
        let value = |x: usize, y: usize| f64::from(self.value(x, y));
        let shift = |before: f64, after: f64| {
            let bend = 2.0 * value(x, y) - before - after;
            if bend > 0.0 {
                (0.5 * (after - before) / bend).clamp(-0.5, 0.5)
            } else {
                0.0
            }
        };
        let (left, right) = (
            value(x.saturating_sub(1), y),
            value((x + 1).min(width - 1), y),
        );
        let (above, below) = (
            value(x, y.saturating_sub(1)),
            value(x, (y + 1).min(height - 1)),
        );
        Vector2::new(
            x as f64 + shift(left, right),
            y as f64 + shift(above, below),
        )
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::patch::Maps;
    use proptest::prelude::*;

    use super::super::packed_maps::{PackedMaps, packed};
    use super::*;

    const SIZE: (usize, usize) = (12, 16);

    fn found_peaks(cells: &[u8], center: [f64; 2], half_width_cells: f64) -> MapPeaks {
        let mut peaks = MapPeaks::default();
        peaks.find(&packed(cells, SIZE).map(0), center.into(), half_width_cells);
        peaks
    }

    #[test]
    fn the_highest_peak_is_found_anywhere_in_the_map() {
        for at in [[3.0, 3.0], [8.0, 12.0], [9.0, 4.0]] {
            let peak = packed(&gaussian(at, 0.8), SIZE)
                .map(0)
                .highest_peak()
                .unwrap();
            let off = (peak.cell - Vector2::from(at)).norm();
            assert!(off < 0.1, "{at:?}: {:?}", peak.cell);
            assert!((peak.height - 0.8).abs() < 0.05);
        }
        let low = vec![20; SIZE.0 * SIZE.1];
        assert_eq!(packed(&low, SIZE).map(0).highest_peak(), None);
        let mut nothing = PackedMaps::default();
        nothing.pack(&Maps::new(SIZE.0, SIZE.1, 1));
        assert_eq!(nothing.map(0).highest_peak(), None);
    }

    fn gaussian(at: [f64; 2], height: f64) -> Vec<u8> {
        let value = |i: usize| {
            let (x, y) = ((i % SIZE.0) as f64 - at[0], (i / SIZE.0) as f64 - at[1]);
            height * libm::exp(-(x * x + y * y) / 8.0)
        };
        (0..SIZE.0 * SIZE.1)
            .map(|i| (255.0 * value(i)).round() as u8)
            .collect()
    }

    #[test]
    fn the_first_cell_of_a_plateau_is_the_peak() {
        let mut cells = vec![0; SIZE.0 * SIZE.1];
        for y in 4..7 {
            cells[y * SIZE.0 + 3..][..3].fill(200);
        }
        let peaks = found_peaks(&cells, [5.0, 5.0], 4.0);
        assert_eq!(peaks.as_slice().len(), 1);
        assert!((peaks.as_slice()[0].cell - Vector2::new(3.5, 4.5)).norm() < 1e-9);
    }

    #[test]
    fn the_highest_peaks_are_kept_highest_first() {
        let mut cells = vec![0; SIZE.0 * SIZE.1];
        let tops: Vec<u8> = (0..9).map(|i| 40 + 20 * ((i * 5) % 9)).collect();
        for (i, &top) in tops.iter().enumerate() {
            cells[(1 + 2 * (i / 3)) * SIZE.0 + 1 + 2 * (i % 3)] = top;
        }
        let peaks = found_peaks(&cells, [4.0, 4.0], 6.0);
        let heights: Vec<f64> = peaks.as_slice().iter().map(|p| p.height * 255.0).collect();
        assert_eq!(heights.len(), MAX_PEAKS);
        for (height, expected) in heights
            .iter()
            .zip([200.0, 180.0, 160.0, 140.0, 120.0, 100.0])
        {
            assert!((height - expected).abs() < 1e-9, "{heights:?}");
        }
    }

    proptest! {
        #[test]
        fn the_top_of_a_gaussian_is_exact_to_a_tenth_cell(
            x in 3.0f64..8.0, y in 3.0f64..12.0, height in 0.5f64..1.0,
        ) {
            let peaks = found_peaks(&gaussian([x, y], height), [6.0, 8.0], 6.0);
            prop_assert_eq!(peaks.as_slice().len(), 1);
            prop_assert!((peaks.as_slice()[0].cell - Vector2::new(x, y)).norm() < 0.1);
        }

        #[test]
        fn peaks_are_the_local_maxima(
            cells in prop::collection::vec(0u8..60, SIZE.0 * SIZE.1),
        ) {
            let (width, height) = SIZE;
            let is_peak = |&i: &usize| {
                let (x, y) = (i % width, i / width);
                let rows = y.saturating_sub(1)..(y + 2).min(height);
                let mut around = rows.flat_map(|y| {
                    (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x)
                });
                // A neighbour that comes first in the map must be lower.
                cells[i] >= LEAST_PEAK
                    && around.all(|other| cells[other] < cells[i] || (cells[other] == cells[i] && other >= i))
            };
            let expected = (0..cells.len()).filter(is_peak).count();
            let peaks = found_peaks(&cells, [6.0, 8.0], 30.0);
            prop_assert_eq!(peaks.as_slice().len(), expected.min(MAX_PEAKS));
        }

        #[test]
        fn any_map_and_place_is_accepted(
            cells in prop::collection::vec(any::<u8>(), SIZE.0 * SIZE.1),
            center in prop::array::uniform2(-40.0f64..40.0), half_width in 0.0f64..100.0,
        ) {
            let peaks = found_peaks(&cells, center, half_width);
            prop_assert!(peaks.as_slice().windows(2).all(|p| p[0].height >= p[1].height));
        }
    }
}
