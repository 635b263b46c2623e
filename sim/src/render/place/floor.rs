//! The floor: its material and the lines of the field.

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

use super::light::color;
use crate::render::grain;

/// Beyond this distance fine texture is smaller than a pixel and only its mean is drawn, metres.
const FINE_M: f32 = 12.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Material {
    Grass,
    Wood,
    Tiles,
    Plain,
}

#[derive(Debug, Clone)]
pub(super) struct Floor {
    half_m: [f32; 2],
    material: Material,
    field: [f32; 3],
    around: [f32; 3],
    line: [f32; 3],
    line_m: f32,
    /// Lines of other games: axis, position, colour.
    others: Vec<(usize, f32, [f32; 3])>,
    seed: u64,
}

impl Floor {
    /// A floor with a field of twice `half_m` around the origin.
    pub(super) fn new(half_m: [f32; 2], rng: &mut ChaCha8Rng) -> Self {
        let material = match rng.random_range(0..10) {
            0..3 => Material::Grass,
            3..6 => Material::Wood,
            6..8 => Material::Tiles,
            _ => Material::Plain,
        };
        let shade: f32 = rng.random_range(0.7..1.3);
        let base = match material {
            Material::Grass => [0.09, 0.2, 0.045],
            Material::Wood => [0.45, 0.28, 0.14],
            Material::Tiles | Material::Plain => color(rng),
        }
        .map(|v| v * shade);
        let same = rng.random_bool(0.5);
        let count = if material == Material::Grass {
            0
        } else {
            rng.random_range(0..5)
        };
        Self {
            half_m,
            material,
            field: base,
            around: if same { base } else { color(rng) },
            line: if rng.random_bool(0.8) {
                [0.8; 3]
            } else {
                color(rng)
            },
            line_m: if rng.random_bool(0.85) {
                rng.random_range(0.04..0.12)
            } else {
                0.0
            },
            others: (0..count)
                .map(|_| {
                    let axis = rng.random_range(0..2);
                    let at = rng.random_range(-1.2..1.2) * half_m[axis];
                    (axis, at, color(rng))
                })
                .collect(),
            seed: rng.random(),
        }
    }

    /// Reflectance of a point at `distance_m` from the eye.
    pub(super) fn color_at(&self, p: [f32; 2], distance_m: f32) -> [f32; 3] {
        let inside = p[0].abs() < self.half_m[0] && p[1].abs() < self.half_m[1];
        let base = if inside { self.field } else { self.around };
        let fine = (1.0 - distance_m / FINE_M).max(0.0);
        let coarse = grain::smooth2(self.seed, [p[0] * 0.9, p[1] * 0.9]) - 0.5;
        let texture = match self.material {
            Material::Grass => {
                let mown = if (p[0] / 1.5).floor() as i32 & 1 == 0 {
                    0.06
                } else {
                    -0.06
                };
                let blades = grain::smooth2(self.seed, [p[0] * 70.0, p[1] * 70.0]) - 0.5;
                mown + 0.5 * blades * (0.25 + 0.75 * fine) + 0.15 * coarse
            }
            Material::Wood => {
                let plank = (p[1] / 0.09).floor();
                let piece = (p[0] / 1.3 + 0.37 * plank).floor();
                let tone = grain::cell(self.seed, [plank as i32, piece as i32, 0]) - 0.5;
                let vein = grain::smooth2(self.seed, [p[0] * 9.0, p[1] * 90.0]) - 0.5;
                0.16 * tone * (0.3 + 0.7 * fine) + 0.2 * vein * fine + 0.1 * coarse
            }
            Material::Tiles => {
                let odd = ((p[0].floor() + p[1].floor()) as i32).rem_euclid(2) as f32 - 0.5;
                let seam = (p[0] - p[0].floor()).min(p[1] - p[1].floor()) < 0.012;
                0.07 * odd - if seam { 0.3 * fine } else { 0.0 } + 0.12 * coarse
            }
            Material::Plain => {
                0.12 * coarse
                    + 0.12 * fine * (grain::smooth2(self.seed, [p[0] * 40.0, p[1] * 40.0]) - 0.5)
            }
        };
        let mut color = base.map(|v| v * (1.0 + texture));
        for &(axis, at, paint) in &self.others {
            if (p[axis] - at).abs() < 0.025 {
                color = paint;
            }
        }
        if self.is_line(p) { self.line } else { color }
    }

    /// Boundary, halfway line, circle and goal areas.
    fn is_line(&self, p: [f32; 2]) -> bool {
        let [hx, hy] = self.half_m;
        let on = |d: f32| d.abs() < self.line_m / 2.0;
        let (ax, ay) = (p[0].abs(), p[1].abs());
        let outer = self.line_m / 2.0;
        if ax > hx + outer || ay > hy + outer {
            return false;
        }
        let circle = (0.15 * hx.max(hy)).clamp(0.6, 9.15);
        let area = (0.3 * hx).min(6.0);
        on(ax - hx)
            || on(ay - hy)
            || on(p[0])
            || on(p[0].hypot(p[1]) - circle)
            || (hx > 4.0 && on((ax - hx).hypot((ay - 1.5).max(0.0)) - area))
    }
}
