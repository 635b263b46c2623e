//! Sampling of RGB pictures in the order of the equations: the same bits on every machine.

use nalgebra::Vector2;

use super::ONE_TAP_MAX;
use super::reduce::{Raster, Reducer, Region, factor, texels_per_input};
use super::warp::Stretch;
use crate::picture::Plane;

/// Positions of the four taps around the centre of an input pixel, texels.
type Taps = [[f32; 2]; 4];

/// Samples pictures. Owns its buffers.
#[derive(Debug, Default)]
pub(super) struct RgbSampler {
    reducer: Reducer<f32>,
}

/// A picture prepared for one crop.
pub(super) enum SampledRgb<'a> {
    Bytes(Raster<'a, u8>, Option<Taps>),
    Means(Raster<'a, f32>, Option<Taps>),
}

impl RgbSampler {
    /// Prepares the picture for a crop with pixels within `bounds_px` (left, top, right, bottom;
    /// `None` for the whole picture) and the pixel distance `step_px`. `None` if the crop is
    /// outside the picture.
    pub(super) fn sample<'a>(
        &'a mut self,
        plane: &Plane<'a, 3>,
        bounds_px: Option<[f64; 4]>,
        step_px: Vector2<f64>,
    ) -> Option<SampledRgb<'a>> {
        let factor = factor(texels_per_input(plane, step_px));
        let region = Region::of_crop(bounds_px, factor, plane)?;
        let step = step_px / factor as f64;
        let taps = (step.norm() > ONE_TAP_MAX).then(|| {
            let (u, v) = (step.x as f32 / 4.0, step.y as f32 / 4.0);
            [
                [u - v, v + u],
                [u + v, v - u],
                [-u - v, u - v],
                [v - u, -v - u],
            ]
        });
        Some(if factor == 1 {
            SampledRgb::Bytes(Raster::of_plane(plane), taps)
        } else {
            SampledRgb::Means(self.reducer.reduce(plane, region, factor), taps)
        })
    }
}

impl SampledRgb<'_> {
    /// Calls `emit` with the position and the colour of each pixel; outside the picture the colour
    /// of the edge is used.
    pub(super) fn row(&self, stretches: &[Stretch], emit: impl FnMut([f64; 2], [f32; 3])) {
        match self {
            Self::Bytes(raster, None) => {
                sample_row(raster, stretches, |x, y| bilinear(raster, x, y), emit);
            }
            Self::Means(raster, None) => {
                sample_row(raster, stretches, |x, y| bilinear(raster, x, y), emit);
            }
            Self::Bytes(raster, Some(taps)) => {
                sample_row(
                    raster,
                    stretches,
                    |x, y| four_taps(raster, taps, x, y),
                    emit,
                );
            }
            Self::Means(raster, Some(taps)) => {
                sample_row(
                    raster,
                    stretches,
                    |x, y| four_taps(raster, taps, x, y),
                    emit,
                );
            }
        }
    }
}

/// `sample` takes texels.
fn sample_row<T>(
    raster: &Raster<'_, T>,
    stretches: &[Stretch],
    sample: impl Fn(f32, f32) -> [f32; 3],
    mut emit: impl FnMut([f64; 2], [f32; 3]),
) {
    let [per_px, _] = raster.texel_px.map(|px| 1.0 / px);
    let [left, top] = raster.origin_px;
    for at in stretches.iter().flat_map(Stretch::positions) {
        let (x, y) = (
            (at[0] - left) as f32 * per_px,
            (at[1] - top) as f32 * per_px,
        );
        emit(at, sample(x, y));
    }
}

fn four_taps<T: Copy + Into<f32>>(raster: &Raster<'_, T>, taps: &Taps, x: f32, y: f32) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for [dx, dy] in taps {
        let rgb = bilinear(raster, x + dx, y + dy);
        for (s, v) in sum.iter_mut().zip(rgb) {
            *s += 0.25 * v;
        }
    }
    sum
}

/// The raster at (`x`, `y`) texels; its border continues outside.
#[inline]
fn bilinear<T: Copy + Into<f32>>(raster: &Raster<'_, T>, x: f32, y: f32) -> [f32; 3] {
    let [width, height] = raster.size;
    let x = x.clamp(0.0, (width - 1) as f32);
    let y = y.clamp(0.0, (height - 1) as f32);
    let (x0, y0) = (x as usize, y as usize);
    let (u, v) = (x - x0 as f32, y - y0 as f32);
    let right = if x0 + 1 < width { 3 } else { 0 };
    let below = if y0 + 1 < height { 3 * width } else { 0 };
    let at = 3 * (y0 * width + x0);
    // One bound check for all twelve loads.
    let window = &raster.texels[at..=at + below + right + 2];
    let mut rgb = [0.0; 3];
    for (c, value) in rgb.iter_mut().enumerate() {
        let (a, b): (f32, f32) = (window[c].into(), window[c + right].into());
        let (d, e): (f32, f32) = (window[c + below].into(), window[c + below + right].into());
        let (upper, lower) = (a + u * (b - a), d + u * (e - d));
        *value = upper + v * (lower - upper);
    }
    rgb
}
