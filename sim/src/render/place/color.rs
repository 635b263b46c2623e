//! Random colours of objects.

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

/// A random paint: greys and pale colours are more likely than strong ones.
pub(super) fn color(rng: &mut ChaCha8Rng) -> [f32; 3] {
    let value: f32 = rng.random_range(0.08..0.8_f32).powi(2) + 0.03;
    let strength: f32 = rng.random_range(0.0..1.0_f32).powi(2) * 0.8;
    std::array::from_fn(|_| value * (1.0 - strength * rng.random_range(0.0..1.0)))
}

pub(in crate::render) fn times(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}
