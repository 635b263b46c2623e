//! Sampling of videos, with luma and chroma in planes of bytes, in integer arithmetic, which is
//! faster than floating point.
//!
//! Colours are converted after sampling, only for the pixels of the input.

use nalgebra::Vector2;

use super::ONE_TAP_MAX;
use super::reduce::{Raster, Reducer, Region, factor, texels_per_input};
use super::warp::Stretch;
use crate::picture::{Plane, YuvPicture, YuvToRgb};

/// Positions have units of texels / 2^16, interpolation weights of 1 / 2^8.
const TEXEL: f64 = 65536.0;
/// Sampled values have units of 1 / 2^16.
const PER_VALUE: f32 = 1.0 / 65536.0;
/// Largest distance of positions from the first texel, texels: the sum of two does not overflow.
const MAX_POSITION: f64 = 16383.0;

/// Samples pictures. Owns its buffers.
#[derive(Debug, Default)]
pub(super) struct YuvSampler {
    reducers: [Reducer<u8>; 3],
    rows: [Vec<i32>; 3],
}

/// A picture prepared for one crop.
pub(super) struct SampledYuv<'a> {
    coding: YuvToRgb,
    brightness: Sampled<'a, 1>,
    colour: Option<Sampled<'a, 2>>,
    rows: &'a mut [Vec<i32>; 3],
}

/// Planes of one geometry.
struct Sampled<'a, const N: usize> {
    rasters: [Raster<'a, u8>; N],
    /// Positions of taps around the centre of an input pixel, texels / 2^16.
    taps: Vec<[i32; 2]>,
}

impl YuvSampler {
    /// Prepares `picture` for a crop with pixels within `bounds_px` (left, top, right, bottom;
    /// `None` for the whole picture) and the pixel distance `step_px`. `None` if the crop is
    /// outside the picture.
    pub(super) fn sample<'a>(
        &'a mut self,
        picture: &'a YuvPicture,
        bounds_px: Option<[f64; 4]>,
        step_px: Vector2<f64>,
    ) -> Option<SampledYuv<'a>> {
        let planes = picture.planes();
        let [for_brightness, for_u, for_v] = &mut self.reducers;
        let of = |plane: &Plane<'a, 1>, reducer: &'a mut Reducer<u8>| {
            let factor = factor(texels_per_input(plane, step_px));
            let region = Region::of_crop(bounds_px, factor, plane)?;
            Some(if factor == 1 {
                Raster::of_plane(plane)
            } else {
                reducer.reduce(plane, region, factor)
            })
        };
        let brightness = of(&planes.brightness, for_brightness)?;
        let step = step_px / f64::from(brightness.texel_px[0]);
        let taps = if step.norm() > ONE_TAP_MAX {
            let [u, v] = [step.x, step.y].map(|it| (it * TEXEL / 4.0) as i32);
            vec![
                [u - v, v + u],
                [u + v, v - u],
                [-u - v, u - v],
                [v - u, -v - u],
            ]
        } else {
            vec![[0; 2]]
        };
        let colour = match planes.colour {
            // Chroma of videos has half the resolution of luma, so texels skipped by a single tap
            // are invisible.
            Some([u, v]) => Some(Sampled {
                rasters: [of(&u, for_u)?, of(&v, for_v)?],
                taps: vec![[0; 2]],
            }),
            None => None,
        };
        Some(SampledYuv {
            coding: picture.coding().to_rgb(),
            brightness: Sampled {
                rasters: [brightness],
                taps,
            },
            colour,
            rows: &mut self.rows,
        })
    }
}

impl SampledYuv<'_> {
    /// Writes red, green and blue of a row of pixels; outside the picture the colour of the edge is
    /// used.
    pub(super) fn row(&mut self, stretches: &[Stretch], rgb: &mut [Vec<f32>; 3]) {
        let [y, u, v] = &mut *self.rows;
        self.brightness.row(stretches, [&mut *y]);
        for values in &mut *rgb {
            values.resize(y.len(), 0.0);
        }
        let [red, green, blue] = rgb;
        let rgb = red.iter_mut().zip(green).zip(blue).zip(y);
        match &self.colour {
            Some(colour) => {
                colour.row(stretches, [&mut *u, v]);
                for ((((red, green), blue), y), (u, v)) in rgb.zip(u.iter().zip(v)) {
                    let (y, u, v) = (*y as f32, *u as f32, *v as f32);
                    [*red, *green, *blue] =
                        self.coding.rgb(y * PER_VALUE, u * PER_VALUE, v * PER_VALUE);
                }
            }
            None => {
                for (((red, green), blue), y) in rgb {
                    let y = *y as f32 * PER_VALUE;
                    [*red, *green, *blue] = self.coding.rgb(y, 128.0, 128.0);
                }
            }
        }
    }
}

impl<const N: usize> Sampled<'_, N> {
    fn row(&self, stretches: &[Stretch], mut into: [&mut Vec<i32>; N]) {
        let Some(raster) = self.rasters.first() else {
            return;
        };
        let scale = Scale::new(raster);
        let n = stretches.iter().map(|it| it.pixels).sum();
        for values in &mut into {
            values.clear();
            values.resize(n, 0);
        }
        let shift = self.taps.len().ilog2();
        let mut first = 0;
        for stretch in stretches {
            let line = scale.line(stretch);
            let pixels = first..first + stretch.pixels;
            first = pixels.end;
            for (raster, values) in self.rasters.iter().zip(&mut into) {
                for &tap in &self.taps {
                    let values = &mut values[pixels.clone()];
                    add_samples(raster, &line, tap, shift, scale.last, values);
                }
            }
        }
    }
}

/// Conversion from pixels of the picture to texels / 2^16.
struct Scale {
    origin_px: [f64; 2],
    per_px: [f64; 2],
    /// Slightly inside the last texel, so that there is a texel to the right and below.
    last: [i32; 2],
}

/// A stretch in texels / 2^16.
struct Line {
    start: [i32; 2],
    step: [i32; 2],
}

impl Scale {
    fn new(raster: &Raster<'_, u8>) -> Self {
        Self {
            origin_px: raster.origin_px,
            per_px: raster.texel_px.map(|px| TEXEL / f64::from(px)),
            last: raster.size.map(|n| {
                let texels = (n.saturating_sub(1) as f64).min(MAX_POSITION);
                ((texels * TEXEL) as i32 - 1).max(0)
            }),
        }
    }

    fn line(&self, stretch: &Stretch) -> Line {
        let farthest = MAX_POSITION * TEXEL;
        let fixed =
            |px: f64, axis: usize| (px * self.per_px[axis]).clamp(-farthest, farthest) as i32;
        let start = |axis: usize| fixed(stretch.start_px[axis] - self.origin_px[axis], axis);
        Line {
            start: [start(0), start(1)],
            step: [fixed(stretch.step_px[0], 0), fixed(stretch.step_px[1], 1)],
        }
    }
}

/// Adds the values along `line`, displaced by `tap`, each divided by 2^`shift`. A separate
/// function, so that the compiler keeps all values in registers.
#[inline(never)]
fn add_samples(
    raster: &Raster<'_, u8>,
    line: &Line,
    tap: [i32; 2],
    shift: u32,
    last: [i32; 2],
    values: &mut [i32],
) {
    let ([width, height], texels) = (raster.size, raster.texels);
    let [last_x, last_y] = last;
    let right = usize::from(width > 1);
    let below = if height > 1 { width } else { 0 };
    let (mut x, mut y) = (line.start[0] + tap[0], line.start[1] + tap[1]);
    for value in values {
        let (at_x, at_y) = (x.clamp(0, last_x), y.clamp(0, last_y));
        let at = (at_y >> 16) as usize * width + (at_x >> 16) as usize;
        let (u, v) = ((at_x >> 8) & 255, (at_y >> 8) & 255);
        let window = &texels[at..=at + below + right];
        let (a, b) = (i32::from(window[0]), i32::from(window[right]));
        let (c, d) = (i32::from(window[below]), i32::from(window[below + right]));
        let (upper, lower) = ((a << 8) + u * (b - a), (c << 8) + u * (d - c));
        *value += ((upper << 8) + v * (lower - upper)) >> shift;
        x = x.wrapping_add(line.step[0]);
        y = y.wrapping_add(line.step[1]);
    }
}
