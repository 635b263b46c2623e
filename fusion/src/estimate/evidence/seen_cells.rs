//! Which cells of a crop its camera sees, and values for the others.
//!
//! A cell outside the image takes the value of its nearest seen cell, so that the search can clamp
//! its samples without testing each. Without lens distortion an upright crop has straight borders,
//! and clamping columns and rows finds that cell; other outlines are swept. Cells beyond the used
//! part of a fisheye's view are unseen like those outside the image.

use std::ops::Range;

use farfield_proto::camera::CameraModel;
use farfield_proto::grid::CellGrid;
use farfield_proto::patch::Written;

/// Distance of the cells that are tested, cells. The camera's field of view has a smooth edge; a
/// cell counts as known only if all tested cells around it are seen.
const TEST_EVERY_CELLS: usize = 4;

/// The seen cells of one crop. Reused from tick to tick: allocates only when crops grow.
#[derive(Debug, Clone, Default)]
pub(super) struct SeenCells {
    width: usize,
    height: usize,
    /// Per cell, row by row; empty if every cell is seen.
    known: Vec<bool>,
    outline: CropOutline,
    /// Buffer and result of the sweeps: per cell, its nearest seen cell as (column, row).
    nearest: Vec<[u16; 2]>,
}

/// Shape of the seen cells.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
enum CropOutline {
    /// All of them, or none.
    #[default]
    Whole,
    /// These columns and rows.
    Rectangle {
        columns: Range<usize>,
        rows: Range<usize>,
    },
    /// Per cell, in `nearest`.
    Ragged,
}

impl SeenCells {
    /// Tests which cells of `grid` the camera sees.
    pub(super) fn find_seen(&mut self, grid: &CellGrid, model: &CameraModel) {
        self.known.clear();
        self.outline = CropOutline::Whole;
        let (w, h) = (usize::from(grid.width), usize::from(grid.height));
        (self.width, self.height) = (w, h);
        let sees = |x: usize, y: usize| model.sees(grid.pixel(x as f64, y as f64));
        // Images are convex except for the lens: if the rim of a grid is seen, all of it is.
        let rim = [0, w / 2, w - 1]
            .into_iter()
            .flat_map(|x| [0, h / 2, h - 1].map(|y| (x, y)));
        // A fisheye's image has corners far outside concave sides: every part is tested.
        let is_fisheye = model.lens().is_fisheye();
        if !is_fisheye && rim.into_iter().all(|(x, y)| sees(x, y)) {
            return;
        }
        self.known.resize(w * h, true);
        for y in (0..h + TEST_EVERY_CELLS - 1).step_by(TEST_EVERY_CELLS) {
            for x in (0..w + TEST_EVERY_CELLS - 1).step_by(TEST_EVERY_CELLS) {
                if !sees(x.min(w - 1), y.min(h - 1)) {
                    self.forget_around(x, y);
                }
            }
        }
        if is_fisheye && self.known.iter().all(|&known| known) {
            self.known.clear();
            return;
        }
        self.outline = self.find_outline();
        if self.outline == CropOutline::Ragged {
            self.find_nearest();
        }
    }

    /// Whether the cell at this column and row is seen.
    pub(super) fn knows(&self, column: usize, row: usize) -> bool {
        self.known
            .get(row * self.width + column)
            .copied()
            .unwrap_or(true)
    }

    /// Whether every cell of a map keeps its value: all are seen, or the map is zero outside the
    /// `written` part, and that is inside the outermost seen cells.
    pub(super) fn stands_for_itself(&self, written: &Written) -> bool {
        let is_inside = |inner: &Range<usize>, outer: &Range<usize>| {
            inner.start > outer.start && inner.end < outer.end
        };
        match &self.outline {
            CropOutline::Whole => true,
            CropOutline::Rectangle { columns, rows } => {
                written.rows.is_empty()
                    || is_inside(&written.columns, columns) && is_inside(&written.rows, rows)
            }
            CropOutline::Ragged => written.rows.is_empty(),
        }
    }

    /// Sets the unseen cells of one map to the values of their nearest seen cells.
    pub(super) fn extend(&self, cells: &mut [u8]) {
        match &self.outline {
            CropOutline::Whole => {}
            CropOutline::Rectangle { columns, rows } => self.clamp(cells, columns, rows),
            CropOutline::Ragged => {
                for (index, &[x, y]) in self.nearest.iter().enumerate() {
                    if !self.known[index] {
                        cells[index] = cells[usize::from(y) * self.width + usize::from(x)];
                    }
                }
            }
        }
    }

    fn clamp(&self, cells: &mut [u8], columns: &Range<usize>, rows: &Range<usize>) {
        let width = self.width;
        for row in cells
            .chunks_exact_mut(width)
            .take(rows.end)
            .skip(rows.start)
        {
            let (first, last) = (row[columns.start], row[columns.end - 1]);
            row[..columns.start].fill(first);
            row[columns.end..].fill(last);
        }
        let row = |y: usize| y * width..(y + 1) * width;
        for y in 0..rows.start {
            cells.copy_within(row(rows.start), y * width);
        }
        for y in rows.end..self.height {
            cells.copy_within(row(rows.end - 1), y * width);
        }
    }

    /// Marks every cell nearer than one test step to (`x`, `y`) as unknown.
    fn forget_around(&mut self, x: usize, y: usize) {
        let (w, h) = (self.width, self.height);
        let reach = TEST_EVERY_CELLS - 1;
        let columns = x.min(w - 1).saturating_sub(reach)..(x + reach + 1).min(w);
        for row in y.min(h - 1).saturating_sub(reach)..(y + reach + 1).min(h) {
            self.known[row * w..][columns.clone()].fill(false);
        }
    }

    fn find_outline(&self) -> CropOutline {
        let mut found: Option<(Range<usize>, Range<usize>)> = None;
        for (y, row) in self.known.chunks_exact(self.width).enumerate() {
            let Some(first) = row.iter().position(|&k| k) else {
                continue;
            };
            let end = row.iter().rposition(|&k| k).map_or(first, |last| last + 1);
            if row[first..end].contains(&false) {
                return CropOutline::Ragged;
            }
            match &mut found {
                None => found = Some((first..end, y..y + 1)),
                Some((columns, rows)) if *columns == (first..end) && rows.end == y => {
                    rows.end = y + 1;
                }
                Some(_) => return CropOutline::Ragged,
            }
        }
        found.map_or(CropOutline::Whole, |(columns, rows)| {
            CropOutline::Rectangle { columns, rows }
        })
    }

    /// Finds (approximately) the nearest seen cell of every cell, by two sweeps. At least one is
    /// seen.
    fn find_nearest(&mut self) {
        const NONE: [u16; 2] = [u16::MAX; 2];
        let (width, height) = (self.width, self.height);
        self.nearest.clear();
        let known = self.known.iter().enumerate();
        self.nearest.extend(known.map(|(i, &k)| {
            // Sides are at most those of a patch, 256.
            if k {
                [(i % width) as u16, (i / width) as u16]
            } else {
                NONE
            }
        }));
        let (known, nearest) = (&self.known, &mut self.nearest);
        let mut offer = |[x, y]: [usize; 2], from: usize| {
            let cell = y * width + x;
            let (mine, theirs) = (nearest[cell], nearest[from]);
            let distance2 = |[sx, sy]: [u16; 2]| {
                let (dx, dy) = (x.abs_diff(sx.into()), y.abs_diff(sy.into()));
                dx * dx + dy * dy
            };
            if theirs != NONE && (mine == NONE || distance2(theirs) < distance2(mine)) {
                nearest[cell] = theirs;
            }
        };
        // The backward sweep runs twice: only then a seed in the middle reaches the upper right.
        for _ in 0..2 {
            for y in 0..height {
                for x in (0..width).filter(|x| !known[y * width + x]) {
                    let cell = y * width + x;
                    if x > 0 {
                        offer([x, y], cell - 1);
                    }
                    if y > 0 {
                        offer([x, y], cell - width);
                    }
                }
            }
            for y in (0..height).rev() {
                for x in (0..width).rev().filter(|x| !known[y * width + x]) {
                    let cell = y * width + x;
                    if x + 1 < width {
                        offer([x, y], cell + 1);
                    }
                    if y + 1 < height {
                        offer([x, y], cell + width);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WIDTH: usize = 12;
    const HEIGHT: usize = 16;
    /// Error of sweeps along rows and columns relative to the nearest cell: 1.20 over 250 random
    /// edges.
    const FARTHER: f64 = 1.3;

    fn seen(known: Vec<bool>) -> SeenCells {
        let mut seen = SeenCells {
            width: WIDTH,
            height: HEIGHT,
            known,
            ..SeenCells::default()
        };
        seen.outline = seen.find_outline();
        seen.find_nearest();
        seen
    }

    /// A map in which every cell has a different value.
    fn numbered() -> Vec<u8> {
        (0..WIDTH * HEIGHT).map(|i| i as u8).collect()
    }

    #[test]
    fn every_unknown_cell_finds_a_known_one() {
        for seed in 0..WIDTH * HEIGHT {
            let known = (0..WIDTH * HEIGHT).map(|i| i == seed).collect();
            let mut cells = numbered();
            seen(known).extend(&mut cells);
            assert!(cells.iter().all(|&c| usize::from(c) == seed), "{seed}");
        }
    }

    proptest! {
        #[test]
        fn clamping_a_rectangle_equals_sweeping(
            columns in (0..WIDTH, 1..=WIDTH), rows in (0..HEIGHT, 1..=HEIGHT),
        ) {
            let columns = columns.0..(columns.0 + columns.1).min(WIDTH);
            let rows = rows.0..(rows.0 + rows.1).min(HEIGHT);
            let inside = |i: usize| columns.contains(&(i % WIDTH)) && rows.contains(&(i / WIDTH));
            let mut seen = seen((0..WIDTH * HEIGHT).map(inside).collect());
            prop_assert_eq!(&seen.outline, &CropOutline::Rectangle { columns, rows });
            let (mut clamped, mut swept) = (numbered(), numbered());
            seen.extend(&mut clamped);
            seen.outline = CropOutline::Ragged;
            seen.extend(&mut swept);
            prop_assert_eq!(clamped, swept);
        }

        #[test]
        fn a_map_is_kept_only_if_extending_changes_nothing(
            columns in (0..WIDTH, 1..=WIDTH), rows in (0..HEIGHT, 1..=HEIGHT),
            peak_columns in (0..WIDTH, 1..=4usize), peak_rows in (0..HEIGHT, 1..=4usize),
        ) {
            let range = |(first, n): (usize, usize), most: usize| first..(first + n).min(most);
            let (columns, rows) = (range(columns, WIDTH), range(rows, HEIGHT));
            let written = Written { columns: range(peak_columns, WIDTH), rows: range(peak_rows, HEIGHT) };
            let within = |i: usize, columns: &Range<usize>, rows: &Range<usize>| {
                columns.contains(&(i % WIDTH)) && rows.contains(&(i / WIDTH))
            };
            let seen = seen((0..WIDTH * HEIGHT).map(|i| within(i, &columns, &rows)).collect());
            let map: Vec<u8> = (0..WIDTH * HEIGHT)
                .map(|i| if within(i, &written.columns, &written.rows) { 9 } else { 0 })
                .collect();
            let mut extended = map.clone();
            seen.extend(&mut extended);
            prop_assert!(!seen.stands_for_itself(&written) || extended == map);
        }

        #[test]
        fn at_a_straight_edge_the_found_cell_is_near_the_nearest(
            angle in -3.0f64..3.0, offset in -4.0f64..4.0,
        ) {
            let at = |i: usize| [(i % WIDTH) as f64, (i / WIDTH) as f64];
            let inside = |i: usize| {
                let [x, y] = at(i);
                (x - 6.0) * angle.cos() + (y - 8.0) * angle.sin() < offset
            };
            let mut cells = numbered();
            let seen = seen((0..WIDTH * HEIGHT).map(inside).collect());
            seen.extend(&mut cells);
            for (i, &from) in cells.iter().enumerate() {
                let distance = |j: usize| (at(i)[0] - at(j)[0]).hypot(at(i)[1] - at(j)[1]);
                let least = (0..cells.len()).filter(|&j| inside(j)).map(distance).fold(f64::INFINITY, f64::min);
                prop_assert!(inside(from.into()));
                prop_assert!(distance(from.into()) <= FARTHER * least);
            }
        }
    }
}
