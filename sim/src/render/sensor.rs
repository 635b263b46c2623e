//! From light to bytes: exposure, tone curve, noise.

use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::grain;

/// Entries of the curve's table for a brightness of 1.
const STEPS: usize = 4096;
/// Number of tabulated noise draws; rows start at different ones.
const DRAWS: usize = 1 << 16;
/// Extra draws after the last possible start of a row.
const ROW: usize = 8192 * 3;
/// Units of the tabulated draws per standard deviation.
const UNIT: f32 = 32.0;

/// A camera's sensor.
#[derive(Debug, Clone)]
pub struct Sensor {
    /// Encoded value times 256, by linear light.
    curve: Vec<u16>,
    /// Factors on red, green and blue.
    gains: Vector3<f32>,
    /// Standard deviation of the noise by encoded value, times 256 / [`UNIT`].
    sigma: [i32; 256],
    draws: Vec<i8>,
}

impl Sensor {
    /// A sensor with exposure, white balance and noise from `seed`. `noise` scales the noise, 0 for
    /// none.
    pub fn from_seed(seed: u64, noise: f32) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x7365_6e73_6f72);
        let exposure: f32 = rng.random_range(0.75..1.25);
        let gamma: f32 = rng.random_range(0.42..0.5);
        let lift: f32 = rng.random_range(0.0..0.03);
        let curve = (0..=STEPS)
            .map(|n| {
                let light = n as f32 / STEPS as f32;
                let value = lift + (1.0 - lift) * light.powf(gamma);
                (value * 255.0 * 256.0) as u16
            })
            .collect();
        let read: f32 = rng.random_range(0.5..2.5);
        let shot: f32 = rng.random_range(0.5..3.5);
        let sigma = std::array::from_fn(|v| {
            let s = (read * read + shot * shot * v as f32 / 255.0).sqrt();
            (noise * s * 256.0 / UNIT) as i32
        });
        let mut normal = || {
            let sum: f32 = (0..6).map(|_| rng.random_range(-1.0..1.0_f32)).sum();
            (sum / 2.0_f32.sqrt() * UNIT) as i8
        };
        let draws = (0..DRAWS + ROW).map(|_| normal()).collect();
        let gains = Vector3::new(
            rng.random_range(0.93..1.07),
            1.0,
            rng.random_range(0.93..1.07),
        ) * exposure;
        Self {
            curve,
            gains,
            sigma,
            draws,
        }
    }

    /// The encoded value times 256 of linear light.
    #[inline]
    pub(super) fn encode(&self, light: [f32; 3]) -> [u16; 3] {
        std::array::from_fn(|c| {
            let step = (light[c] * self.gains[c]).clamp(0.0, 1.0) * STEPS as f32;
            let low = step as usize;
            let part = step - low as f32;
            let (a, b) = (self.curve[low], self.curve[(low + 1).min(STEPS)]);
            a + (f32::from(b - a) * part) as u16
        })
    }

    /// Writes one row of encoded values with the noise of one picture.
    pub(super) fn develop(&self, row: &[[u16; 3]], noise_seed: u64, into: &mut [u8]) {
        let start = grain::hash(noise_seed) as usize % DRAWS;
        let values = row.as_flattened();
        // Rows longer than the draws restart.
        for (values, into) in values.chunks(ROW).zip(into.chunks_mut(ROW)) {
            self.develop_chunk(values, &self.draws[start..], into);
        }
    }

    fn develop_chunk(&self, values: &[u16], draws: &[i8], into: &mut [u8]) {
        for ((out, &value), &draw) in into.iter_mut().zip(values).zip(draws) {
            let sigma = self.sigma[usize::from(value >> 8)];
            let noisy = i32::from(value) + 128 + i32::from(draw) * sigma;
            *out = (noisy >> 8).clamp(0, 255) as u8;
        }
    }
}
