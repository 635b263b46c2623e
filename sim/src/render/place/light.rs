//! Light and random colours of a venue, drawn from a seed.

use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// One distant lamp or the sun, the sky or ceiling above, and the reflection of the floor.
///
/// Powers are linear red, green, blue. A white wall that faces a power of 1 has brightness 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Unit vector to the sun, world axes; its z is above 0.4.
    pub to_sun: Vector3<f32>,
    /// Power of the sun.
    pub sun: [f32; 3],
    /// Power of the sky.
    pub sky: [f32; 3],
    /// Power from below.
    pub floor: [f32; 3],
    /// Whether there is a ceiling.
    pub indoors: bool,
}

impl Light {
    /// Sun, clouds or a hall's lamps.
    pub fn from_seed(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x006c_6967_6874);
        let azimuth: f32 = rng.random_range(0.0..std::f32::consts::TAU);
        let elevation: f32 = rng.random_range(0.55..1.35);
        let to_sun = Vector3::new(
            azimuth.cos() * elevation.cos(),
            azimuth.sin() * elevation.cos(),
            elevation.sin(),
        );
        let indoors = rng.random_bool(0.55);
        // Share of the direct light: hard sun, thin clouds, many lamps.
        let direct: f32 = if indoors {
            rng.random_range(0.15..0.5)
        } else {
            rng.random_range(0.2..0.8)
        };
        let total: f32 = rng.random_range(0.95..1.25);
        let warmth: f32 = rng.random_range(-0.08..0.14);
        let sun = [1.0 + warmth, 1.0, 1.0 - warmth].map(|v| v * total * direct);
        let blue = if indoors { 0.0 } else { 0.12 * direct };
        let sky = [1.0 - blue, 1.0, 1.0 + blue].map(|v| v * total * (1.0 - direct));
        let bounce: f32 = rng.random_range(0.2..0.5);
        let tint: [f32; 3] = std::array::from_fn(|_| rng.random_range(0.75..1.0));
        let floor = std::array::from_fn(|c| bounce * tint[c] * (0.4 * sun[c] + 0.6 * sky[c]));
        Self {
            to_sun,
            sun,
            sky,
            floor,
            indoors,
        }
    }

    /// Light on a surface. `normal` is a unit vector; `sunlit` and `open` are the shares of the sun
    /// and of the remaining light that reach it, 0 to 1.
    pub(in crate::render) fn on(&self, normal: &Vector3<f32>, sunlit: f32, open: f32) -> [f32; 3] {
        let direct = normal.dot(&self.to_sun).max(0.0) * sunlit;
        let above = (0.5 + 0.5 * normal.z) * open;
        let below = (0.5 - 0.5 * normal.z) * open;
        std::array::from_fn(|c| self.sun[c] * direct + self.sky[c] * above + self.floor[c] * below)
    }
}

/// A random paint: greys and pale colours are more likely than strong ones.
pub(super) fn color(rng: &mut ChaCha8Rng) -> [f32; 3] {
    let value: f32 = rng.random_range(0.08..0.8_f32).powi(2) + 0.03;
    let strength: f32 = rng.random_range(0.0..1.0_f32).powi(2) * 0.8;
    std::array::from_fn(|_| value * (1.0 - strength * rng.random_range(0.0..1.0)))
}

pub(in crate::render) fn times(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}
