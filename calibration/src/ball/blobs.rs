//! Connected components of a mask, built row by row.

/// Most runs of a picture: a mask with more is not of one thing.
const MOST_RUNS: usize = 200_000;
/// Missing pixels of a row across which two runs become one.
const GAP_PX: u32 = 1;

/// Consecutive pixels of one row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    pub(super) row: u32,
    /// First column.
    pub(super) from: u32,
    /// The column after the last.
    pub(super) to: u32,
}

/// Connected runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blob {
    /// Root of its runs.
    pub(super) root: usize,
    pub(super) area_px: f64,
    /// First and last column.
    pub(super) columns: [u32; 2],
    /// First and last row.
    pub(super) rows: [u32; 2],
    /// Sums of columns and of rows over its pixels.
    sums: [f64; 2],
}

impl Blob {
    /// Mean position of its pixels.
    pub(super) fn middle_px(&self) -> [f64; 2] {
        self.sums.map(|sum| sum / self.area_px.max(1.0))
    }

    /// Width and height of its box.
    pub(super) fn size_px(&self) -> [f64; 2] {
        [self.columns, self.rows].map(|[first, last]| f64::from(last - first + 1))
    }
}

/// The blobs of one picture; the buffers are used again for the next.
#[derive(Debug, Clone, Default)]
pub(super) struct Blobs {
    runs: Vec<Run>,
    /// Parent of each run in the union-find forest; a root is its own parent.
    parents: Vec<usize>,
    found: Vec<Blob>,
    /// Index in `found` of the blob of each run.
    places: Vec<usize>,
    /// The runs of the row before.
    above: std::ops::Range<usize>,
    last_row: u32,
}

impl Blobs {
    pub(super) fn clear(&mut self) {
        self.runs.clear();
        self.parents.clear();
        self.found.clear();
        self.above = 0..0;
        self.last_row = 0;
    }

    /// Adds the next row of the mask; rows come in order.
    pub(super) fn add_row(&mut self, row: u32, mask: &[bool]) {
        let first = self.runs.len();
        let mut at = 0;
        while let Some(start) = mask.get(at..).and_then(|rest| rest.iter().position(|m| *m)) {
            let from = at + start;
            let length = mask
                .get(from..)
                .and_then(|rest| rest.iter().position(|m| !*m));
            let to = length.map_or(mask.len(), |length| from + length);
            at = to;
            let run = Run {
                row,
                from: from as u32,
                to: to as u32,
            };
            let is_full = self.runs.len() >= MOST_RUNS;
            match self.runs.get_mut(first..).and_then(<[Run]>::last_mut) {
                Some(last) if run.from <= last.to + GAP_PX => last.to = run.to,
                _ if is_full => break,
                _ => {
                    self.parents.push(self.runs.len());
                    self.runs.push(run);
                }
            }
        }
        if self.last_row + 1 == row {
            self.join(first);
        }
        self.above = first..self.runs.len();
        self.last_row = row;
    }

    /// Joins the runs from `first` on with the runs of the row above that they touch, corners included.
    fn join(&mut self, first: usize) {
        let mut upper = self.above.start;
        for lower in first..self.runs.len() {
            while upper < self.above.end {
                let (a, b) = (self.runs[upper], self.runs[lower]);
                if a.to >= b.from && b.to >= a.from {
                    let (x, y) = (self.root(upper), self.root(lower));
                    let (low, high) = (x.min(y), x.max(y));
                    self.parents[high] = low;
                }
                // A run above that ends later may touch the next run below too.
                if a.to > b.to {
                    break;
                }
                upper += 1;
            }
        }
    }

    fn root(&mut self, mut index: usize) -> usize {
        while self.parents[index] != index {
            self.parents[index] = self.parents[self.parents[index]];
            index = self.parents[index];
        }
        index
    }

    /// The blobs in the order of their first pixels, after the last row.
    pub(super) fn blobs(&mut self) -> &[Blob] {
        self.found.clear();
        self.places.clear();
        for index in 0..self.runs.len() {
            let root = self.root(index);
            let run = self.runs[index];
            if root == index {
                self.found.push(Blob {
                    root,
                    area_px: 0.0,
                    columns: [run.from, run.to - 1],
                    rows: [run.row, run.row],
                    sums: [0.0; 2],
                });
            }
            let place = if root == index {
                self.found.len() - 1
            } else {
                self.places[root]
            };
            self.places.push(place);
            let blob = &mut self.found[place];
            let length = f64::from(run.to - run.from);
            blob.area_px += length;
            blob.columns = [
                blob.columns[0].min(run.from),
                blob.columns[1].max(run.to - 1),
            ];
            blob.rows[1] = run.row;
            blob.sums[0] += length * 0.5 * f64::from(run.from + run.to - 1);
            blob.sums[1] += length * f64::from(run.row);
        }
        &self.found
    }

    /// The result of [`Self::blobs`].
    pub(super) fn all(&self) -> &[Blob] {
        &self.found
    }

    /// The runs of `blob`.
    pub(super) fn runs_of(&self, blob: &Blob) -> impl Iterator<Item = Run> + '_ {
        let from = self.runs.partition_point(|run| run.row < blob.rows[0]);
        let to = self.runs.partition_point(|run| run.row <= blob.rows[1]);
        let place = self.places.get(blob.root).copied();
        let own = (from..to).filter(move |index| self.places.get(*index).copied() == place);
        own.map(|index| self.runs[index])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn blobs_of(picture: &[&str]) -> Vec<Blob> {
        let mut blobs = Blobs::default();
        for (y, row) in picture.iter().enumerate() {
            let mask: Vec<bool> = row.bytes().map(|b| b == b'#').collect();
            blobs.add_row(y as u32, &mask);
        }
        blobs.blobs().to_vec()
    }

    #[test]
    fn arms_that_meet_below_are_one_blob() {
        let found = blobs_of(&["#...#....", "#...#...#", "##..#....", ".####...#"]);
        let areas: Vec<f64> = found.iter().map(|blob| blob.area_px).collect();
        assert_eq!(areas, [11.0, 1.0, 1.0]);
        assert_eq!(found[0].columns, [0, 4]);
        assert_eq!(found[0].rows, [0, 3]);
    }

    #[test]
    fn the_middle_is_the_mean_of_the_pixels() {
        let found = blobs_of(&["....", ".##.", ".##."]);
        assert!(found[0].middle_px().iter().all(|m| (m - 1.5).abs() < 1e-12));
        assert!(found[0].size_px().iter().all(|s| (s - 2.0).abs() < 1e-12));
    }

    /// Areas of all components, by flood fill.
    fn flooded(mask: &[Vec<bool>]) -> Vec<usize> {
        let mut left = mask.to_vec();
        let mut areas = Vec::new();
        for y in 0..left.len() {
            for x in 0..left[y].len() {
                let mut open = if left[y][x] { vec![(x, y)] } else { Vec::new() };
                let mut area = 0;
                while let Some((x, y)) = open.pop() {
                    if !std::mem::take(&mut left[y][x]) {
                        continue;
                    }
                    area += 1;
                    let rows = left
                        .iter()
                        .enumerate()
                        .take(y + 2)
                        .skip(y.saturating_sub(1));
                    for (ny, row) in rows {
                        let cells = row.iter().enumerate().take(x + 2).skip(x.saturating_sub(1));
                        open.extend(cells.filter(|(_, m)| **m).map(|(nx, _)| (nx, ny)));
                    }
                }
                if area > 0 {
                    areas.push(area);
                }
            }
        }
        areas.sort_unstable();
        areas
    }

    proptest! {
        #[test]
        fn blobs_equal_those_of_flood_fill(
            cells in prop::collection::vec(prop::collection::vec(prop::bool::weighted(0.4), 12), 1..12),
        ) {
            // Gaps of one pixel are closed here too.
            let mask: Vec<Vec<bool>> = cells.iter().map(|row| {
                let mut row = row.clone();
                for x in 1..row.len().saturating_sub(1) {
                    row[x] = row[x] || (row[x - 1] && row[x + 1]);
                }
                row
            }).collect();
            let mut blobs = Blobs::default();
            for (y, row) in mask.iter().enumerate() {
                blobs.add_row(y as u32, row);
            }
            let found = blobs.blobs().to_vec();
            let mut areas: Vec<usize> = found.iter().map(|blob| blob.area_px as usize).collect();
            areas.sort_unstable();
            prop_assert_eq!(areas, flooded(&mask));
            for blob in found {
                let runs: f64 = blobs.runs_of(&blob).map(|run| f64::from(run.to - run.from)).sum();
                prop_assert!((runs - blob.area_px).abs() < 1e-9);
            }
        }
    }
}
