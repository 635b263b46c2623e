//! Part confidence maps, their encoded form, and their largest size.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Largest width and height of a map, cells.
pub const MAX_SIDE: usize = 256;
/// Most maps of a patch.
pub const MAX_KEYPOINTS: usize = 64;
/// Most cells of a patch; the decoder allocates one byte for each.
pub const MAX_CELLS: usize = MAX_SIDE * MAX_SIDE * MAX_KEYPOINTS;

/// The encoded maps of one person in one camera.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EncodedMaps {
    /// Cells in a row.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Maps.
    pub keypoints: u8,
    /// The cells, encoded by [`super::Encoder`].
    pub bytes: Vec<u8>,
}

impl EncodedMaps {
    /// Checks the size, before any allocation.
    ///
    /// # Errors
    /// [`PatchError::Size`] when a side is zero or above [`MAX_SIDE`], or there are no or more than
    /// [`MAX_KEYPOINTS`] maps.
    pub fn check_size(&self) -> Result<(), PatchError> {
        let sides = [self.width, self.height].map(usize::from);
        let keypoints = usize::from(self.keypoints);
        if sides.iter().all(|s| (1..=MAX_SIDE).contains(s))
            && (1..=MAX_KEYPOINTS).contains(&keypoints)
        {
            Ok(())
        } else {
            let [width, height] = sides;
            Err(PatchError::Size {
                width,
                height,
                keypoints,
            })
        }
    }
}

/// Why encoded maps cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PatchError {
    /// The stated size is impossible.
    #[error(
        "{keypoints} maps of {width} x {height} cells, expected 1 to {MAX_KEYPOINTS} of at most {MAX_SIDE} x {MAX_SIDE}"
    )]
    Size {
        /// Cells in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Maps.
        keypoints: usize,
    },
    /// The bytes end before the maps do.
    #[error("the bytes end within map {keypoint}")]
    TooShort {
        /// The map, from 0.
        keypoint: usize,
    },
    /// The maps end before the bytes do.
    #[error("{left} bytes are left over after the maps")]
    TooLong {
        /// Number of bytes left.
        left: usize,
    },
}

/// The rows and columns outside which all cells of a map are zero.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Written {
    /// Rows.
    pub rows: Range<usize>,
    /// Columns.
    pub columns: Range<usize>,
}

impl Written {
    /// Extends it over more rows and columns.
    pub(super) fn include(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let both = |a: &Range<usize>, b: Range<usize>| {
            if a.is_empty() {
                b
            } else {
                a.start.min(b.start)..a.end.max(b.end)
            }
        };
        if !rows.is_empty() && !columns.is_empty() {
            self.rows = both(&self.rows, rows);
            self.columns = both(&self.columns, columns);
        }
    }
}

/// Part confidence maps: one map of `width` x `height` cells per keypoint, value = cell / 255.
#[derive(Debug, Clone, Default)]
pub struct Maps {
    pub(super) width: usize,
    pub(super) height: usize,
    keypoints: usize,
    pub(super) cells: Vec<u8>,
    /// Per map. Maps of a crowd are larger than a processor's caches, and most of their cells are
    /// zero.
    written: Vec<Written>,
}

impl PartialEq for Maps {
    fn eq(&self, other: &Self) -> bool {
        let shape = |maps: &Self| (maps.width, maps.height, maps.keypoints);
        shape(self) == shape(other) && self.cells == other.cells
    }
}

impl Eq for Maps {}

impl Maps {
    /// Empty maps (all cells 0). Larger values than [`MAX_SIDE`] and [`MAX_KEYPOINTS`] are reduced
    /// to these.
    pub fn new(width: usize, height: usize, keypoints: usize) -> Self {
        let mut maps = Self::default();
        maps.resize(width, height, keypoints);
        maps
    }

    /// Changes the size and sets all cells to 0, without freeing memory. Larger values than
    /// [`MAX_SIDE`] and [`MAX_KEYPOINTS`] are reduced to these.
    pub fn resize(&mut self, width: usize, height: usize, keypoints: usize) {
        let [width, height] = [width, height].map(|side| side.min(MAX_SIDE));
        let keypoints = keypoints.min(MAX_KEYPOINTS);
        if (width, height, keypoints) == (self.width, self.height, self.keypoints) {
            for (k, written) in self.written.iter_mut().enumerate() {
                let Range { start, end } = std::mem::take(written).rows;
                let first = k * height;
                self.cells[(first + start) * width..(first + end) * width].fill(0);
            }
            return;
        }
        (self.width, self.height, self.keypoints) = (width, height, keypoints);
        self.cells.clear();
        self.cells.resize(width * height * keypoints, 0);
        self.written.clear();
        self.written.resize(keypoints, Written::default());
    }

    /// Cells in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Maps.
    pub fn keypoints(&self) -> usize {
        self.keypoints
    }

    /// The map of keypoint `k` (below [`Self::keypoints`]), row by row.
    ///
    /// # Panics
    /// When there is no such keypoint.
    pub fn cells(&self, k: usize) -> &[u8] {
        let area = self.width * self.height;
        &self.cells[k * area..(k + 1) * area]
    }

    /// The mutable map of keypoint `k` (below [`Self::keypoints`]), row by row.
    ///
    /// # Panics
    /// When there is no such keypoint.
    pub fn cells_mut(&mut self, k: usize) -> &mut [u8] {
        let (columns, rows) = (0..self.width, 0..self.height);
        let (cells, written) = self.cells_and_written(k);
        *written = Written { rows, columns };
        cells
    }

    /// The region of keypoint `k`'s map that may have nonzero cells.
    ///
    /// # Panics
    /// When there is no such keypoint.
    pub fn written(&self, k: usize) -> &Written {
        &self.written[k]
    }

    /// The map of keypoint `k` and its written region, for callers that write a part and extend the
    /// region.
    pub(super) fn cells_and_written(&mut self, k: usize) -> (&mut [u8], &mut Written) {
        let area = self.width * self.height;
        (
            &mut self.cells[k * area..(k + 1) * area],
            &mut self.written[k],
        )
    }
}

/// A probability as a cell: clamped to 0..1, rounded to the nearest 255th; NaN is 0.
pub fn quantize(value: f32) -> u8 {
    // `as` saturates and converts NaN to 0.
    (value * 255.0).round() as u8
}
