//! Edits of a view's maps, after their peaks were assigned to persons.

use std::ops::Range;

use farfield_proto::patch::Written;
use nalgebra::Vector2;

use super::View;

/// Up to this distance, in sigmas of a peak, a notch has its full depth...
const NOTCH_FLOOR_SIGMAS: f64 = 2.0;
/// ...and here it ends. Flat at the peak, so that the rest of the peak keeps its form.
const NOTCH_END_SIGMAS: f64 = 3.5;

/// A peak of another person, in one map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Notch {
    /// Where the peak is, cells.
    pub(crate) at: Vector2<f64>,
    /// Its height, 0 to 1.
    pub(crate) height: f64,
    /// A peak of the map that stays (cells, height): where the two overlap, each cell is divided in
    /// proportion to both.
    pub(crate) stays: Option<(Vector2<f64>, f64)>,
    /// Share of the peak that is removed, 0 to 1.
    pub(crate) depth: f64,
}

impl View {
    /// Sigma of a peak in the maps, cells.
    pub(crate) fn peak_sigma_cells(&self) -> f64 {
        self.map_size().0 as f64 * self.peak_sigma_of_width
    }

    /// Whether two keypoints have their maps on one crop.
    pub(crate) fn share_a_crop(&self, a: usize, b: usize) -> bool {
        let crop = |k: usize| self.crop_of_keypoint.get(k);
        crop(a).is_some() && crop(a) == crop(b)
    }

    /// The highest value of a map among the cells within `reach` of `cell` along both axes (cells),
    /// 0 to 1.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub(crate) fn highest_near(&self, keypoint: usize, cell: Vector2<f64>, reach: f64) -> f64 {
        let (width, height) = self.map_size();
        let map = self.map(keypoint);
        let Written { rows, columns } = map.written();
        let first = columns.start;
        let columns = common(span(cell.x, reach, width), columns);
        let rows = common(span(cell.y, reach, height), rows);
        let highest = if columns.is_empty() {
            0
        } else {
            let columns = columns.start - first..columns.end - first;
            // A fold over a slice processes several cells at a time; an iterator over all rows does
            // not.
            let highest_of = |row: &[u8]| row.iter().fold(0u8, |most, &cell| most.max(cell));
            rows.fold(0u8, |most, y| {
                most.max(highest_of(&map.row(y)[columns.clone()]))
            })
        };
        f64::from(highest) / 255.0
    }

    /// Swaps the maps of two keypoints; no effect if they are on different crops.
    pub(crate) fn swap(&mut self, a: usize, b: usize) {
        if a == b || !self.share_a_crop(a, b) {
            return;
        }
        self.maps.swap(a, b);
        self.forget_peaks(a);
        self.forget_peaks(b);
    }

    /// Removes a peak of another person from the map of `keypoint`, smoothly.
    ///
    /// # Panics
    /// If the view has no such keypoint.
    pub(crate) fn carve(&mut self, keypoint: usize, notch: &Notch) {
        self.forget_peaks(keypoint);
        let sigma = self.peak_sigma_cells();
        let gauss = |r2: f64| libm::exp(-0.5 * r2 / (sigma * sigma));
        let (width, height) = self.map_size();
        let reach = NOTCH_END_SIGMAS * sigma;
        let (written, cells, stride) = self.maps.written_mut(keypoint);
        let Written { rows, columns } = written;
        let within = [
            common(span(notch.at.x, reach, width), columns),
            common(span(notch.at.y, reach, height), rows),
        ];
        disc(within, notch.at, reach, |[x, y], r2| {
            let cell = &mut cells[(y - rows.start) * stride + x - columns.start];
            if *cell == 0 {
                return;
            }
            let place = Vector2::new(x as f64, y as f64);
            let share = notch.stays.map_or(1.0, |(stays, height)| {
                let own = height * gauss((place - stays).norm_squared());
                let other = notch.height * gauss(r2);
                other / (own + other).max(f64::MIN_POSITIVE)
            });
            let out =
                (r2.sqrt() / sigma - NOTCH_FLOOR_SIGMAS) / (NOTCH_END_SIGMAS - NOTCH_FLOOR_SIGMAS);
            let inside = 1.0 - out.clamp(0.0, 1.0);
            let keep = 1.0 - notch.depth.clamp(0.0, 1.0) * share * inside;
            // Like `round`, which is a call for each cell.
            *cell = (f64::from(*cell) * keep + 0.5) as u8;
        });
    }
}

/// The cells, of `size` in a row, within `reach` of `center`; none for NaN.
pub(super) fn span(center: f64, reach: f64, size: usize) -> Range<usize> {
    // Casts saturate, and round towards zero.
    let (from, to) = (center - reach, center + reach);
    let below = (from as i32).max(0);
    let first = below as usize + usize::from(f64::from(below) < from);
    let end = if to >= 0.0 { to as i32 as usize + 1 } else { 0 };
    let end = end.min(size);
    first.min(end)..end
}

/// The intersection of two ranges.
pub(super) fn common(a: Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.max(b.start)..a.end.min(b.end)
}

/// Every cell of these columns and rows within `radius` of `center`, with its squared distance.
fn disc(
    [columns, rows]: [Range<usize>; 2],
    center: Vector2<f64>,
    radius: f64,
    mut each: impl FnMut([usize; 2], f64),
) {
    for y in rows {
        let dy2 = (y as f64 - center.y).powi(2);
        for x in columns.clone() {
            let r2 = (x as f64 - center.x).powi(2) + dy2;
            if r2 <= radius * radius {
                each([x, y], r2);
            }
        }
    }
}
