//! Shrinking a picture by a whole factor: the antialiasing filter of a crop.

use image::RgbImage;

/// A part of a picture, possibly shrunk: RGB interleaved, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Raster<'a, T> {
    pub(super) texels: &'a [T],
    pub(super) width: usize,
    pub(super) height: usize,
    /// Picture pixel of the centre of texel (0, 0).
    pub(super) origin_px: [f32; 2],
    /// Picture pixels per texel.
    pub(super) factor: f32,
}

/// A rectangle of whole pixels inside a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelRegion {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl PixelRegion {
    /// The whole picture.
    pub(super) fn whole(image: &RgbImage) -> Self {
        Self {
            left: 0,
            top: 0,
            width: image.width() as usize,
            height: image.height() as usize,
        }
    }

    /// The pixels of `image` within `margin` of [left, top, right, bottom]; `None` when there are
    /// none.
    pub(super) fn around(bounds: [f64; 4], margin: f64, image: &RgbImage) -> Option<Self> {
        let span = |from: f64, to: f64, size: u32| {
            let first = (from - margin).floor().clamp(0.0, f64::from(size)) as usize;
            let end = ((to + margin).ceil() + 1.0).clamp(0.0, f64::from(size)) as usize;
            (end > first).then(|| (first, end - first))
        };
        let (left, width) = span(bounds[0], bounds[2], image.width())?;
        let (top, height) = span(bounds[1], bounds[3], image.height())?;
        Some(Self {
            left,
            top,
            width,
            height,
        })
    }
}

/// Means over blocks of `factor` x `factor` pixels. Owns its buffers.
#[derive(Debug, Default)]
pub(super) struct Reducer {
    /// Sums over the rows of a block, per column and channel; 16 bits hold 257 rows.
    sums: Vec<u16>,
    texels: Vec<f32>,
}

/// Largest factor: 256 rows of 8-bit values still fit 16-bit sums.
pub(super) const MAX_FACTOR: usize = 256;

impl Reducer {
    /// Shrinks `region` of `image` by `factor`. Blocks at the right and lower edge may hold fewer
    /// pixels; they are means of what is there.
    pub(super) fn reduce(
        &mut self,
        image: &RgbImage,
        region: PixelRegion,
        factor: usize,
    ) -> Raster<'_, f32> {
        let (width, height) = (
            region.width.div_ceil(factor),
            region.height.div_ceil(factor),
        );
        let stride = 3 * image.width() as usize;
        self.texels.clear();
        self.texels.reserve(3 * width * height);
        for block in 0..height {
            let first = block * factor;
            let rows = factor.min(region.height - first);
            self.sums.clear();
            self.sums.resize(3 * region.width, 0);
            for y in 0..rows {
                let from = (region.top + first + y) * stride + 3 * region.left;
                let row = &image.as_raw()[from..from + 3 * region.width];
                for (sum, &value) in self.sums.iter_mut().zip(row) {
                    *sum += u16::from(value);
                }
            }
            for columns in self.sums.chunks(3 * factor) {
                let mut rgb = [0u32; 3];
                for texel in columns.chunks_exact(3) {
                    for (sum, &value) in rgb.iter_mut().zip(texel) {
                        *sum += u32::from(value);
                    }
                }
                let weight = 1.0 / (rows * columns.len() / 3) as f32;
                self.texels.extend(rgb.map(|sum| sum as f32 * weight));
            }
        }
        let center = 0.5 * (factor - 1) as f32;
        Raster {
            texels: &self.texels,
            width,
            height,
            origin_px: [region.left as f32 + center, region.top as f32 + center],
            factor: factor as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_the_mean_of_its_pixels() {
        let image = RgbImage::from_fn(5, 4, |x, y| image::Rgb([x as u8 * 10, y as u8 * 10, 7]));
        let mut reducer = Reducer::default();
        let raster = reducer.reduce(&image, PixelRegion::whole(&image), 2);
        assert_eq!((raster.width, raster.height), (3, 2));
        let red: Vec<f32> = raster.texels.iter().step_by(3).map(|v| v.round()).collect();
        assert_eq!(red, [5.0, 25.0, 40.0, 5.0, 25.0, 40.0]);
        let green: Vec<f32> = raster
            .texels
            .iter()
            .skip(1)
            .step_by(3)
            .map(|v| v.round())
            .collect();
        assert_eq!(green, [5.0, 5.0, 5.0, 25.0, 25.0, 25.0]);
    }

    #[test]
    fn a_region_ends_at_the_picture() {
        let image = RgbImage::new(100, 50);
        let region = PixelRegion::around([-20.0, 10.2, 30.6, 80.0], 2.0, &image).unwrap();
        assert_eq!(
            region,
            PixelRegion {
                left: 0,
                top: 8,
                width: 34,
                height: 42
            }
        );
        assert_eq!(
            PixelRegion::around([120.0, 0.0, 130.0, 10.0], 2.0, &image),
            None
        );
    }
}
