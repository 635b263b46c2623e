//! The picture without people, painted once per camera.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::place::Surroundings;
use super::sensor::Sensor;
use super::view::{CameraView, TILE};

/// Stored value of brightness 1.
const UNIT: f32 = 16384.0;

/// The picture of a place without its people, in linear light.
#[derive(Debug, Clone)]
pub struct Backdrop {
    pub(super) width: usize,
    pixels: Vec<[u16; 3]>,
    /// The same as sensor values; empty before [`Self::expose`].
    values: Vec<[u16; 3]>,
}

impl Backdrop {
    /// Paints `surroundings` as seen by `view`, with `samples` rays per pixel.
    pub fn new(view: &CameraView, surroundings: &Surroundings, samples: usize) -> Self {
        let [width, height] = view.size_px();
        let eye = view.eye_m.cast::<f32>();
        let place = surroundings.seen_from(&eye);
        let back = view.rotation.transpose().cast::<f32>();
        let shifts = shifts_px(samples);
        let has_blind = view.has_blind();
        let mut pixels = vec![[0; 3]; width * height];
        pixels
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, row)| {
                for x in (0..width).step_by(TILE) {
                    let mut sums = [[0.0; 3]; TILE];
                    for &shift in &shifts {
                        let [u, v] = view.row(x, y, shift);
                        for i in 0..TILE.min(width - x) {
                            let ray = back * Vector3::new(u[i], v[i], 1.0);
                            let light = place.along(&eye, &ray);
                            for c in 0..3 {
                                sums[i][c] += light[c];
                            }
                        }
                    }
                    for (pixel, sum) in row[x..].iter_mut().zip(sums) {
                        *pixel = sum.map(|v| (v / shifts.len() as f32 * UNIT).min(65535.0) as u16);
                    }
                    if has_blind {
                        for (i, pixel) in row[x..].iter_mut().take(TILE).enumerate() {
                            if view.is_blind(x + i, y) {
                                *pixel = [0; 3];
                            }
                        }
                    }
                }
            });
        Self {
            width,
            pixels,
            values: Vec::new(),
        }
    }

    /// Converts the picture to values of `sensor` once, for many pictures with the same sensor.
    pub fn expose(&mut self, sensor: &Sensor) {
        self.values = self
            .pixels
            .par_iter()
            .map(|p| sensor.encode(p.map(|v| f32::from(v) / UNIT)))
            .collect();
    }

    /// Copies sensor values of `into.len()` pixels of a row.
    pub(super) fn copy_row(&self, sensor: &Sensor, x: usize, y: usize, into: &mut [[u16; 3]]) {
        let start = y * self.width + x;
        match self.values.get(start..start + into.len()) {
            Some(values) => into.copy_from_slice(values),
            None => {
                for (i, value) in into.iter_mut().enumerate() {
                    *value = sensor.encode(self.light(x + i, y));
                }
            }
        }
    }

    /// Linear light of a pixel.
    #[inline]
    pub(super) fn light(&self, x: usize, y: usize) -> [f32; 3] {
        self.pixels[y * self.width + x].map(|v| f32::from(v) / UNIT)
    }
}

/// Positions of the samples of a pixel: around its centre, over slightly more than the pixel, like
/// the blur of a lens.
pub(super) fn shifts_px(samples: usize) -> Vec<[f32; 2]> {
    // The R2 sequence covers the square evenly for any number of samples.
    let part = |n: usize, step: f32| (step * n as f32).fract() * 1.4;
    let shifts: Vec<[f32; 2]> = (0..samples.max(1))
        .map(|n| [part(n, 0.754_877_7), part(n, 0.569_840_3)])
        .collect();
    let mean = |i: usize| shifts.iter().map(|s| s[i]).sum::<f32>() / shifts.len() as f32;
    let middle = [mean(0), mean(1)];
    shifts
        .iter()
        .map(|s| [s[0] - middle[0], s[1] - middle[1]])
        .collect()
}
