//! Position of a crop: a similarity transform from input pixels and map cells to undistorted image
//! pixels.

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::frames::{Pixel, Undistorted};
use farfield_proto::grid::CellGrid;
use farfield_proto::model_card::{CellToInput, HeatmapCard};
use nalgebra::Vector2;

/// The sizes of a crop's input and maps, and their relation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropShape {
    /// Width and height of the input, pixels.
    pub input_px: [usize; 2],
    /// Width and height of the maps, cells.
    pub cells: [u16; 2],
    /// Input pixel = scale x cell + offset.
    pub cell_to_input: CellToInput,
}

impl CropShape {
    /// The shape in a network's card.
    pub fn of_card(card: &HeatmapCard) -> Self {
        Self {
            input_px: [card.input.width as usize, card.input.height as usize],
            cells: [card.output.width as u16, card.output.height as u16],
            cell_to_input: card.cell_to_input,
        }
    }

    /// An input without maps, as for a detector; the grid of its crops is unused.
    pub fn without_maps(input_px: [usize; 2]) -> Self {
        Self {
            input_px,
            cells: [1, 1],
            cell_to_input: CellToInput {
                scale: 1.0,
                offset: 0.0,
            },
        }
    }

    /// The shape of drawn maps: cells are input pixels.
    pub fn of_grid(cells: [u16; 2]) -> Self {
        Self {
            input_px: cells.map(usize::from),
            cells,
            cell_to_input: CellToInput {
                scale: 1.0,
                offset: 0.0,
            },
        }
    }
}

/// A crop of the undistorted image.
///
/// The edges of the (grown) box are the outer edges of the input's border pixels, so the centre of
/// the box is the input's centre ((width - 1) / 2, (height - 1) / 2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropGeometry {
    grid: CellGrid,
    shape: CropShape,
}

impl CropGeometry {
    /// Fits the input to `b`, which is grown to the input's aspect and never cut. `None` if the box
    /// is too small or too far away for a valid grid.
    pub fn new(b: &BoundingBox, shape: CropShape) -> Option<Self> {
        if !b.is_valid() {
            return None;
        }
        let input = Vector2::new(shape.input_px[0] as f64, shape.input_px[1] as f64);
        let size = Vector2::from(b.size_px.map(f64::from));
        let pixels_per_input = (size.x / input.x).max(size.y / input.y);
        let (sin, cos) = f64::from(b.rotation_rad).sin_cos();
        // Cells and input pixels both run along the box's axes.
        let step = Vector2::new(cos, sin) * pixels_per_input;
        let from_center =
            Vector2::repeat(shape.cell_to_input.offset) - (input - Vector2::repeat(1.0)) / 2.0;
        let origin = Vector2::from(b.center_px.map(f64::from))
            + Vector2::new(
                from_center.x * step.x - from_center.y * step.y,
                from_center.x * step.y + from_center.y * step.x,
            );
        let step_of_cell = step * shape.cell_to_input.scale;
        // The transmitted, rounded grid is the reference: pixels are sampled at its positions.
        let grid = CellGrid {
            origin_px: [origin.x as f32, origin.y as f32],
            step_px: [step_of_cell.x as f32, step_of_cell.y as f32],
            width: shape.cells[0],
            height: shape.cells[1],
        };
        let grid = grid.snapped();
        grid.is_valid().then_some(Self { grid, shape })
    }

    /// The grid of the maps, as sent to fusion.
    pub fn grid(&self) -> CellGrid {
        self.grid
    }

    /// Width and height of the input, pixels.
    pub fn input_px(&self) -> [usize; 2] {
        self.shape.input_px
    }

    /// The undistorted pixel at an input pixel (fractions allowed).
    pub fn pixel(&self, x: f64, y: f64) -> Pixel<Undistorted> {
        let CellToInput { scale, offset } = self.shape.cell_to_input;
        self.grid.pixel((x - offset) / scale, (y - offset) / scale)
    }

    /// The input pixel at an undistorted pixel; the inverse of [`Self::pixel`].
    pub fn input(&self, pixel: Pixel<Undistorted>) -> Vector2<f64> {
        let CellToInput { scale, offset } = self.shape.cell_to_input;
        self.grid.cell(pixel) * scale + Vector2::repeat(offset)
    }

    /// Vector between neighbouring input pixels in image pixels; a length above 1 means that the
    /// crop is reduced.
    pub fn step_px(&self) -> Vector2<f64> {
        Vector2::from(self.grid.step_px.map(f64::from)) / self.shape.cell_to_input.scale
    }
}

/// The upright box around a rotated one.
pub fn enclosing_upright(b: &BoundingBox) -> BoundingBox {
    let (sin, cos) = b.rotation_rad.sin_cos();
    let [width, height] = b.size_px;
    BoundingBox {
        center_px: b.center_px,
        size_px: [
            (width * cos).abs() + (height * sin).abs(),
            (width * sin).abs() + (height * cos).abs(),
        ],
        rotation_rad: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SHAPE: CropShape = CropShape {
        input_px: [192, 256],
        cells: [48, 64],
        cell_to_input: CellToInput {
            scale: 4.0,
            offset: 1.5,
        },
    };

    fn boxes() -> impl Strategy<Value = BoundingBox> {
        let center = prop::array::uniform2(-500.0f32..3000.0);
        let size = prop::array::uniform2(20.0f32..2000.0);
        (center, size, -3.2f32..3.2).prop_map(|(center_px, size_px, rotation_rad)| BoundingBox {
            center_px,
            size_px,
            rotation_rad,
        })
    }

    proptest! {
        #[test]
        fn input_and_pixel_are_inverse(b in boxes(), x in -10.0f64..200.0, y in -10.0f64..270.0) {
            let crop = CropGeometry::new(&b, SHAPE).unwrap();
            let back = crop.input(crop.pixel(x, y));
            prop_assert!((back.x - x).abs() < 1e-6 && (back.y - y).abs() < 1e-6);
        }

        #[test]
        fn the_crop_holds_the_whole_box(b in boxes(), u in -0.5f64..0.5, v in -0.5f64..0.5) {
            let crop = CropGeometry::new(&b, SHAPE).unwrap();
            let (sin, cos) = f64::from(b.rotation_rad).sin_cos();
            let (along, down) = (u * f64::from(b.size_px[0]), v * f64::from(b.size_px[1]));
            let p = Pixel::new(
                f64::from(b.center_px[0]) + along * cos - down * sin,
                f64::from(b.center_px[1]) + along * sin + down * cos,
            );
            let at = crop.input(p);
            // Grids are rounded to quarter pixels of the image, steps to 1/256: a fifth of a pixel
            // at most.
            let slack = 0.5 + 0.01 + 0.2 / crop.step_px().norm();
            prop_assert!(at.x > -slack && at.x < 191.0 + slack, "{at}");
            prop_assert!(at.y > -slack && at.y < 255.0 + slack, "{at}");
        }

        #[test]
        fn the_upright_box_encloses_the_rotated_one(b in boxes(), u in -0.5f32..0.5, v in -0.5f32..0.5) {
            let around = enclosing_upright(&b);
            let (sin, cos) = b.rotation_rad.sin_cos();
            let (along, down) = (u * b.size_px[0], v * b.size_px[1]);
            prop_assert!((along * cos - down * sin).abs() <= around.size_px[0] / 2.0 + 1e-2);
            prop_assert!((along * sin + down * cos).abs() <= around.size_px[1] / 2.0 + 1e-2);
        }
    }

    #[test]
    fn a_wide_box_is_grown_in_height() {
        let b = BoundingBox {
            center_px: [100.0, 100.0],
            size_px: [384.0, 100.0],
            rotation_rad: 0.0,
        };
        let crop = CropGeometry::new(&b, SHAPE).unwrap();
        assert!((crop.step_px() - Vector2::new(2.0, 0.0)).norm() < 1e-6);
        let center = crop.pixel(95.5, 127.5);
        assert!((center.x() - 100.0).abs() < 1e-3 && (center.y() - 100.0).abs() < 1e-3);
    }

    #[test]
    fn cells_are_placed_by_the_card() {
        let b = BoundingBox {
            center_px: [300.0, 200.0],
            size_px: [192.0, 256.0],
            rotation_rad: 0.4,
        };
        let crop = CropGeometry::new(&b, SHAPE).unwrap();
        let (by_cell, by_input) = (crop.grid().pixel(10.0, 20.0), crop.pixel(41.5, 81.5));
        assert!((by_cell.vector_px() - by_input.vector_px()).norm() < 1e-9);
    }

    #[test]
    fn a_box_without_a_size_has_no_crop() {
        let b = BoundingBox {
            center_px: [0.0, 0.0],
            size_px: [0.0, 10.0],
            rotation_rad: 0.0,
        };
        assert_eq!(CropGeometry::new(&b, SHAPE), None);
    }
}
