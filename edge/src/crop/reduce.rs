//! Reduction of a plane by a whole factor: the antialiasing filter of a crop.

use nalgebra::Vector2;

use crate::picture::Plane;

/// Largest factor: 256 rows of 8-bit values fit 16-bit sums.
const MAX_FACTOR: usize = 256;

/// A part of a plane, possibly reduced: values side by side, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Raster<'a, T> {
    pub(super) texels: &'a [T],
    /// Width and height, texels.
    pub(super) size: [usize; 2],
    /// Picture pixel of the centre of texel (0, 0).
    pub(super) origin_px: [f64; 2],
    /// Picture pixels per texel, across and down.
    pub(super) texel_px: [f32; 2],
}

impl<'a> Raster<'a, u8> {
    /// All of `plane` at full size.
    pub(super) fn of_plane<const N: usize>(plane: &Plane<'a, N>) -> Self {
        Self {
            texels: plane.texels,
            size: plane.size,
            origin_px: plane.origin_px(),
            texel_px: plane.spacing_px.map(|px| px as f32),
        }
    }
}

/// A rectangle of whole texels inside a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Region {
    first: [usize; 2],
    size: [usize; 2],
}

/// Blocks of margin around a crop, so that no used block is partial.
const MARGIN_BLOCKS: usize = 2;

impl Region {
    /// The part of `plane` for a crop within these bounds, or the whole plane without bounds;
    /// `None` if it is empty.
    pub(super) fn of_crop<const N: usize>(
        bounds_px: Option<[f64; 4]>,
        factor: usize,
        plane: &Plane<'_, N>,
    ) -> Option<Self> {
        match bounds_px {
            Some(bounds_px) => Self::around(bounds_px, (MARGIN_BLOCKS * factor) as f64, plane),
            None => Some(Self::whole(plane)),
        }
    }

    /// The whole plane.
    fn whole<const N: usize>(plane: &Plane<'_, N>) -> Self {
        Self {
            first: [0; 2],
            size: plane.size,
        }
    }

    /// The texels of `plane` within `margin` texels around left, top, right, bottom of the picture;
    /// `None` if there are none.
    fn around<const N: usize>(
        bounds_px: [f64; 4],
        margin: f64,
        plane: &Plane<'_, N>,
    ) -> Option<Self> {
        let [left, top, right, bottom] = bounds_px;
        let origin_px = plane.origin_px();
        let span = |axis: usize, from_px: f64, to_px: f64| {
            let size = plane.size[axis] as f64;
            let texel = |px: f64| (px - origin_px[axis]) / plane.spacing_px[axis] as f64;
            let first = (texel(from_px) - margin).floor().clamp(0.0, size) as usize;
            let end = ((texel(to_px) + margin).ceil() + 1.0).clamp(0.0, size) as usize;
            (end > first).then(|| (first, end - first))
        };
        let (first_column, width) = span(0, left, right)?;
        let (first_row, height) = span(1, top, bottom)?;
        Some(Self {
            first: [first_column, first_row],
            size: [width, height],
        })
    }
}

/// The stored type of a mean.
pub(super) trait Mean {
    fn from_sum(sum: u32, weight: MeanWeight) -> Self;
}

/// The reciprocal of a count.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeanWeight {
    exact: f32,
    /// In units of 1 / 2^32: integer arithmetic without a division per texel.
    fixed: u64,
}

impl MeanWeight {
    fn new(count: usize) -> Self {
        Self {
            exact: 1.0 / count as f32,
            fixed: (1 << 32) / count as u64,
        }
    }
}

impl Mean for f32 {
    fn from_sum(sum: u32, weight: MeanWeight) -> Self {
        sum as f32 * weight.exact
    }
}

/// Rounded to the nearest integer.
impl Mean for u8 {
    fn from_sum(sum: u32, weight: MeanWeight) -> Self {
        ((u64::from(sum) * weight.fixed + (1 << 31)) >> 32) as u8
    }
}

/// Texels of a plane per pixel of the input.
pub(super) fn texels_per_input<const N: usize>(plane: &Plane<'_, N>, step_px: Vector2<f64>) -> f64 {
    let spacing_px = plane.spacing_px[0].max(plane.spacing_px[1]);
    step_px.norm() / spacing_px as f64
}

/// The factor for a crop with this many texels per pixel of its input.
pub(super) fn factor(texels_per_input: f64) -> usize {
    (texels_per_input.round() as usize).clamp(1, MAX_FACTOR)
}

/// Means over blocks of `factor` x `factor` texels. Owns its buffers.
#[derive(Debug, Default)]
pub(super) struct Reducer<T> {
    /// Sums over the rows of a block, per column and value; 16 bits hold 257 rows.
    sums: Vec<u16>,
    means: Vec<T>,
}

impl<T: Mean> Reducer<T> {
    /// Reduces `region` of `plane` by `factor`. Blocks at the right and lower edge can have fewer
    /// texels; they are means of these.
    pub(super) fn reduce<const N: usize>(
        &mut self,
        plane: &Plane<'_, N>,
        region: Region,
        factor: usize,
    ) -> Raster<'_, T> {
        let ([left, top], [region_width, region_height]) = (region.first, region.size);
        let (width, height) = (
            region_width.div_ceil(factor),
            region_height.div_ceil(factor),
        );
        let stride = N * plane.size[0];
        self.means.clear();
        self.means.reserve(N * width * height);
        for block in 0..height {
            let first = block * factor;
            let rows = factor.min(region_height - first);
            let whole = MeanWeight::new(rows * factor);
            self.sums.clear();
            self.sums.resize(N * region_width, 0);
            for y in 0..rows {
                let from = (top + first + y) * stride + N * left;
                let row = &plane.texels[from..from + N * region_width];
                for (sum, &value) in self.sums.iter_mut().zip(row) {
                    *sum += u16::from(value);
                }
            }
            for columns in self.sums.chunks(N * factor) {
                let mut sums = [0u32; N];
                for texel in columns.chunks_exact(N) {
                    for (sum, &value) in sums.iter_mut().zip(texel) {
                        *sum += u32::from(value);
                    }
                }
                let weight = if columns.len() == N * factor {
                    whole
                } else {
                    MeanWeight::new(rows * columns.len() / N)
                };
                for sum in sums {
                    self.means.push(T::from_sum(sum, weight));
                }
            }
        }
        let origin_px = plane.origin_px();
        let origin_px = [0, 1].map(|axis| {
            let texels = region.first[axis] as f64 + 0.5 * (factor - 1) as f64;
            origin_px[axis] + texels * plane.spacing_px[axis] as f64
        });
        Raster {
            texels: &self.means,
            size: [width, height],
            origin_px,
            texel_px: plane.spacing_px.map(|px| (px * factor) as f32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane<const N: usize>(texels: &[u8], size: [usize; 2]) -> Plane<'_, N> {
        Plane {
            texels,
            size,
            spacing_px: [1; 2],
        }
    }

    #[test]
    fn a_block_is_the_mean_of_its_texels() {
        let image =
            image::RgbImage::from_fn(5, 4, |x, y| image::Rgb([x as u8 * 10, y as u8 * 10, 7]));
        let plane = plane::<3>(image.as_raw(), [5, 4]);
        let mut reducer = Reducer::default();
        let raster = reducer.reduce(&plane, Region::whole(&plane), 2);
        assert_eq!(raster.size, [3, 2]);
        let means: &[f32] = raster.texels;
        let red: Vec<f32> = means.iter().step_by(3).map(|v| v.round()).collect();
        assert_eq!(red, [5.0, 25.0, 40.0, 5.0, 25.0, 40.0]);
        let green: Vec<f32> = means.iter().skip(1).step_by(3).map(|v| v.round()).collect();
        assert_eq!(green, [5.0, 5.0, 5.0, 25.0, 25.0, 25.0]);
    }

    #[test]
    fn a_region_ends_at_the_plane() {
        let texels = [0; 5000];
        let plane = plane::<1>(&texels, [100, 50]);
        let region = Region::around([-20.0, 10.2, 30.6, 80.0], 2.0, &plane).unwrap();
        assert_eq!((region.first, region.size), ([0, 8], [34, 42]));
        assert_eq!(Region::around([120.0, 0.0, 130.0, 10.0], 2.0, &plane), None);
    }

    #[test]
    fn a_chroma_sample_is_centred_among_its_pixels() {
        let texels = [0; 50 * 25];
        let half = Plane::<1> {
            spacing_px: [2; 2],
            ..plane(&texels, [50, 25])
        };
        let near =
            |found: [f64; 2], expected: f64| found.iter().all(|it| (it - expected).abs() < 1e-9);
        assert!(near(Raster::of_plane(&half).origin_px, 0.5));
        let region = Region::around([20.5, 10.5, 40.5, 20.5], 0.0, &half).unwrap();
        assert_eq!((region.first, region.size), ([10, 5], [11, 6]));
        let mut reducer = Reducer::<u8>::default();
        let raster = reducer.reduce(&half, region, 3);
        let [x, y] = raster.origin_px;
        assert!(near([x, y + 10.0], 22.5), "{x} {y}");
        assert!(near(raster.texel_px.map(f64::from), 6.0));
    }
}
