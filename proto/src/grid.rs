//! The geometry of a crop: the positions of a map's cells in the image.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::frames::{Pixel, Undistorted};

/// The short form has origins in multiples of 1/4 pixel.
const ORIGINS_PER_PX: f32 = 4.0;
/// The short form has steps in multiples of 1/256 pixel.
const STEPS_PER_PX: f32 = 256.0;

/// The grid of a heatmap on the undistorted image: a similarity from cells to pixels.
///
/// ```text
///   pixel(x, y) = origin + x step + y perp(step),   perp((a, b)) = (-b, a)
/// ```
///
/// `x` runs along the crop's width, `y` down its height; |step| is native pixels per cell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CellGrid {
    /// Undistorted pixel of the centre of cell (0, 0).
    pub origin_px: [f32; 2],
    /// Undistorted pixels from one cell to its right neighbour.
    pub step_px: [f32; 2],
    /// Cells in a row.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

impl CellGrid {
    /// The undistorted pixel of a cell position (cells may be fractional).
    pub fn pixel(&self, x: f64, y: f64) -> Pixel<Undistorted> {
        let (sx, sy) = (f64::from(self.step_px[0]), f64::from(self.step_px[1]));
        Pixel::new(
            f64::from(self.origin_px[0]) + x * sx - y * sy,
            f64::from(self.origin_px[1]) + x * sy + y * sx,
        )
    }

    /// The fractional cell position (x, y) of an undistorted pixel; inverse of [`Self::pixel`].
    pub fn cell(&self, pixel: Pixel<Undistorted>) -> Vector2<f64> {
        let (sx, sy) = (f64::from(self.step_px[0]), f64::from(self.step_px[1]));
        let dx = pixel.x() - f64::from(self.origin_px[0]);
        let dy = pixel.y() - f64::from(self.origin_px[1]);
        let norm = sx * sx + sy * sy;
        Vector2::new((dx * sx + dy * sy) / norm, (dy * sx - dx * sy) / norm)
    }

    /// Native image pixels per cell; above 1 the crop was reduced, below 1 it was enlarged.
    pub fn pixels_per_cell(&self) -> f64 {
        libm::hypot(f64::from(self.step_px[0]), f64::from(self.step_px[1]))
    }

    /// The nearest grid with a short form on the wire: its origin in quarter pixels, its step in
    /// 1/256 pixels. A step so small that this would change it by more than a hundredth is
    /// unchanged.
    ///
    /// Crops must use a snapped grid: then the wire loses nothing.
    #[must_use]
    pub fn snapped(&self) -> Self {
        // The wire has no negative zero.
        let near = |value: f32, per_px: f32| (value * per_px).round() / per_px + 0.0;
        if self.pixels_per_cell() * f64::from(STEPS_PER_PX) < 50.0 {
            return *self;
        }
        Self {
            origin_px: self.origin_px.map(|value| near(value, ORIGINS_PER_PX)),
            step_px: self.step_px.map(|value| near(value, STEPS_PER_PX)),
            ..*self
        }
    }

    /// The short form: origin in quarter pixels and step in 1/256 pixels; `None` if they are not
    /// integers.
    pub(crate) fn short(&self) -> Option<[i32; 4]> {
        let whole = |value: f32, per_px: f32| {
            let scaled = value * per_px;
            let whole = scaled as i32;
            // Equal after decoding, bit for bit: no NaN, no negative zero.
            let back = whole as f32 / per_px;
            (whole.unsigned_abs() < 1 << 20 && back.to_bits() == value.to_bits()).then_some(whole)
        };
        let [ox, oy] = self.origin_px.map(|value| whole(value, ORIGINS_PER_PX));
        let [sx, sy] = self.step_px.map(|value| whole(value, STEPS_PER_PX));
        Some([ox?, oy?, sx?, sy?])
    }

    /// The grid of [`Self::short`].
    pub(crate) fn from_short(short: [i32; 4], width: u16, height: u16) -> Self {
        let [ox, oy, sx, sy] = short.map(|value| value as f32);
        Self {
            origin_px: [ox / ORIGINS_PER_PX, oy / ORIGINS_PER_PX],
            step_px: [sx / STEPS_PER_PX, sy / STEPS_PER_PX],
            width,
            height,
        }
    }

    /// Whether every number is finite, the step is not zero and the grid is within
    /// [`crate::patch::MAX_SIDE`].
    pub fn is_valid(&self) -> bool {
        let finite = self
            .origin_px
            .iter()
            .chain(&self.step_px)
            .all(|v| v.is_finite());
        let sides = [self.width, self.height];
        finite
            && self.pixels_per_cell() > 1e-6
            && sides
                .iter()
                .all(|&s| s > 0 && usize::from(s) <= crate::patch::MAX_SIDE)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_snapped_grid_has_a_short_form_and_is_close(
            origin in prop::array::uniform2(-4000.0f32..9000.0),
            angle in -3.2f32..3.2,
            scale in 0.2f32..40.0,
        ) {
            let step_px = [scale * angle.cos(), scale * angle.sin()];
            let grid = CellGrid { origin_px: origin, step_px, width: 48, height: 64 };
            let snapped = grid.snapped();
            let short = snapped.short().unwrap();
            prop_assert_eq!(CellGrid::from_short(short, 48, 64), snapped);
            let off = grid.pixel(47.0, 63.0).vector_px() - snapped.pixel(47.0, 63.0).vector_px();
            prop_assert!(off.norm() < 0.4, "{off}");
        }

        #[test]
        fn cell_and_pixel_are_inverse(
            origin in prop::array::uniform2(-4000.0f32..4000.0),
            angle in -3.2f32..3.2,
            scale in 0.1f32..40.0,
            x in -10.0f64..100.0,
            y in -10.0f64..100.0,
        ) {
            let step_px = [scale * angle.cos(), scale * angle.sin()];
            let grid = CellGrid { origin_px: origin, step_px, width: 48, height: 64 };
            let back = grid.cell(grid.pixel(x, y));
            prop_assert!((back.x - x).abs() < 1e-6 && (back.y - y).abs() < 1e-6);
        }
    }
}
