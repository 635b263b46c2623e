//! The surroundings of the people: floor, field, walls, stands, sky and clutter, drawn from a seed.

mod floor;
mod light;

use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use self::floor::Floor;
pub use self::light::Light;
use self::light::color;
pub(super) use self::light::times;
use super::grain;

/// Clutter closer to a camera would fill its picture, metres.
const CLEAR_M: f32 = 2.0;

/// The place without its people.
#[derive(Debug, Clone)]
pub struct Surroundings {
    pub(super) light: Light,
    floor: Floor,
    /// Half sizes of the room, x and y, and its height, metres.
    room_m: [f32; 3],
    wall: Wall,
    blocks: Vec<Block>,
    seed: u64,
}

#[derive(Debug, Clone)]
struct Wall {
    color: [f32; 3],
    dado: [f32; 3],
    dado_m: f32,
    panel_m: f32,
    stands: bool,
    open_air: bool,
}

/// A box on the floor.
#[derive(Debug, Clone)]
struct Block {
    low: Vector3<f32>,
    high: Vector3<f32>,
    color: [f32; 3],
    second: [f32; 3],
    stripe_m: f32,
}

impl Surroundings {
    /// A field of `size_m` (x by y, around the origin); the cameras at `eyes_m` must be inside the
    /// walls, world metres.
    pub fn new(size_m: [f64; 2], eyes_m: &[Vector3<f64>], seed: u64) -> Self {
        let light = Light::from_seed(seed);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0070_6c61_6365);
        let half = size_m.map(|v| v as f32 / 2.0);
        let outdoor = if light.indoors { 1.0 } else { 3.0 };
        let mut room_m = [0, 1].map(|i| half[i] + outdoor * rng.random_range(2.5..9.0));
        for eye in eyes_m {
            room_m[0] = room_m[0].max(eye.x.abs() as f32 + 1.0);
            room_m[1] = room_m[1].max(eye.y.abs() as f32 + 1.0);
        }
        let wall = Wall {
            color: color(&mut rng),
            dado: color(&mut rng),
            dado_m: rng.random_range(0.0..2.2),
            panel_m: rng.random_range(0.6..3.5),
            stands: rng.random_bool(0.35),
            open_air: !light.indoors && rng.random_bool(0.6),
        };
        let count = rng.random_range(3..18);
        let blocks = (0..count).map(|_| block(&mut rng, half, room_m)).collect();
        Self {
            floor: Floor::new(half, &mut rng),
            room_m: [room_m[0], room_m[1], rng.random_range(4.5..11.0)],
            light,
            wall,
            blocks,
            seed,
        }
    }

    /// The light.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// The blocks that a camera sees behind its people; blocks in front would be painted over them.
    pub(super) fn seen_from(&self, eye_m: &Vector3<f32>) -> Self {
        let field = eye_m.xy().norm();
        let is_behind = |b: &&Block| {
            let middle = ((b.low + b.high) / 2.0).xy() - eye_m.xy();
            middle.norm() > field.max(CLEAR_M)
        };
        let blocks = self.blocks.iter().filter(is_behind).cloned().collect();
        Self {
            blocks,
            ..self.clone()
        }
    }

    /// Linear brightness along a ray of the world.
    pub(super) fn along(&self, eye: &Vector3<f32>, ray: &Vector3<f32>) -> [f32; 3] {
        let mut nearest = f32::INFINITY;
        let mut hit = None;
        for (n, block) in self.blocks.iter().enumerate() {
            if let Some((t, normal)) = block.entry(eye, ray)
                && t < nearest
            {
                (nearest, hit) = (t, Some((n, normal)));
            }
        }
        let (wall_t, wall_normal) = self.wall_ahead(eye, ray);
        if let Some((n, normal)) = hit.filter(|_| nearest < wall_t) {
            let p = eye + ray * nearest;
            let lit = self
                .light
                .on(&normal, 0.8, 0.6 + 0.4 * (p.z / 0.4).min(1.0));
            return times(self.blocks[n].color_at(&p), lit);
        }
        let floor_t = if ray.z < 0.0 {
            -eye.z / ray.z
        } else {
            f32::INFINITY
        };
        if floor_t < wall_t {
            let p = eye + ray * floor_t;
            let edge = (self.room_m[0] - p.x.abs()).min(self.room_m[1] - p.y.abs());
            let open = if self.wall.open_air {
                1.0
            } else {
                0.7 + 0.3 * (edge / 1.2).clamp(0.0, 1.0)
            };
            return times(
                self.floor.color_at([p.x, p.y], floor_t * ray.norm()),
                self.light.on(&Vector3::z(), 1.0, open),
            );
        }
        let p = eye + ray * wall_t;
        if p.z > self.room_m[2] || (self.wall.open_air && p.z > 0.0) {
            return self.above(eye, ray);
        }
        self.wall_color(&p, &wall_normal)
    }

    /// The wall that a ray hits, and its normal.
    fn wall_ahead(&self, eye: &Vector3<f32>, ray: &Vector3<f32>) -> (f32, Vector3<f32>) {
        let ahead = |i: usize| {
            let side = self.room_m[i].copysign(ray[i]);
            let t = (side - eye[i]) / ray[i];
            if t > 0.0 { t } else { f32::INFINITY }
        };
        let (x, y) = (ahead(0), ahead(1));
        if x < y {
            (x, Vector3::new(-ray.x.signum(), 0.0, 0.0))
        } else {
            (y, Vector3::new(0.0, -ray.y.signum(), 0.0))
        }
    }

    fn wall_color(&self, p: &Vector3<f32>, normal: &Vector3<f32>) -> [f32; 3] {
        let wall = &self.wall;
        let (along, side) = if normal.x == 0.0 {
            (p.x, normal.y)
        } else {
            (p.y, 2.0 * normal.x)
        };
        let lit = self
            .light
            .on(normal, 0.7, 0.65 + 0.35 * (p.z / 0.5).min(1.0));
        let seed = self.seed ^ u64::from(side.to_bits());
        if wall.stands && p.z > 1.0 {
            // Seats, many of them occupied.
            let row = (p.z / 0.42).floor();
            let place = (along / 0.5 + 0.5 * row).floor();
            let id = [row as i32, place as i32, 1];
            let [fx, fz] = [
                along / 0.5 + 0.5 * row - place - 0.5,
                p.z / 0.42 - row - 0.45,
            ];
            let taken = grain::cell(seed, id) < 0.6 && (fx / 0.38).hypot(fz / 0.45) < 1.0;
            let tint = if taken {
                let c = |n| grain::cell(seed ^ n, id);
                if fz > 0.12 {
                    [0.55 * c(9) + 0.1, 0.35 * c(9) + 0.07, 0.25 * c(9) + 0.05]
                } else {
                    [c(5).powi(2), c(6).powi(2), c(7).powi(2)]
                }
            } else {
                wall.dado.map(|v| 0.5 * v)
            };
            return times(tint, lit);
        }
        let panel = (along / wall.panel_m).floor();
        let shade = 0.9 + 0.2 * grain::cell(seed, [panel as i32, 0, 2]);
        let seam = (along / wall.panel_m - panel) * wall.panel_m < 0.02;
        let picture = grain::cell(seed, [panel as i32, 0, 3]) < 0.25 && (1.2..2.4).contains(&p.z);
        let base = if p.z < wall.dado_m {
            wall.dado
        } else {
            wall.color
        };
        let base = if picture {
            let c = |n| grain::cell(seed, [panel as i32, (p.z * 2.5) as i32, n]);
            [c(4), c(5), c(6)]
        } else {
            base
        };
        times(base.map(|v| v * shade * if seam { 0.6 } else { 1.0 }), lit)
    }

    /// Sky with a row of trees, or a ceiling with lamps.
    fn above(&self, eye: &Vector3<f32>, ray: &Vector3<f32>) -> [f32; 3] {
        if self.light.indoors {
            let t = (self.room_m[2] - eye.z) / ray.z.max(1e-3);
            let p = eye + ray * t;
            let (i, j) = ((p.x / 3.0).floor(), (p.y / 1.7).floor());
            let lamp = (p.x - 3.0 * i - 1.5).abs() < 0.7 && (p.y - 1.7 * j - 0.85).abs() < 0.12;
            return if lamp { [1.4; 3] } else { [0.22, 0.22, 0.23] };
        }
        let unit = ray.normalize();
        let azimuth = unit.y.atan2(unit.x);
        let trees = 0.02
            + 0.09 * grain::smooth2(self.seed, [azimuth * 9.0, 0.0])
            + 0.03 * grain::smooth2(self.seed, [azimuth * 60.0, 7.0]);
        if unit.z < trees {
            let leaf = 0.5 + grain::smooth2(self.seed, [azimuth * 150.0, unit.z * 160.0]);
            return [0.05 * leaf, 0.09 * leaf, 0.04 * leaf];
        }
        let high = (unit.z * 1.6).min(1.0);
        let cloud = grain::smooth2(self.seed, [azimuth * 4.0, unit.z * 8.0]);
        std::array::from_fn(|c| {
            [0.95 - 0.45 * high, 0.97 - 0.25 * high, 1.0][c] * (0.8 + 0.2 * cloud)
        })
    }
}

impl Block {
    fn entry(&self, eye: &Vector3<f32>, ray: &Vector3<f32>) -> Option<(f32, Vector3<f32>)> {
        let mut near = 0.0_f32;
        let mut far = f32::INFINITY;
        let mut axis = 0;
        for i in 0..3 {
            let (a, b) = (
                (self.low[i] - eye[i]) / ray[i],
                (self.high[i] - eye[i]) / ray[i],
            );
            let (a, b) = (a.min(b), a.max(b));
            if a > near {
                (near, axis) = (a, i);
            }
            far = far.min(b);
        }
        let mut normal = Vector3::zeros();
        normal[axis] = -ray[axis].signum();
        (near < far && near > 0.0).then_some((near, normal))
    }

    fn color_at(&self, p: &Vector3<f32>) -> [f32; 3] {
        let stripe = ((p.x + p.y) / self.stripe_m).floor() as i32;
        if stripe.rem_euclid(2) == 0 {
            self.color
        } else {
            self.second
        }
    }
}

/// A bench, a bag or a board somewhere between field and walls.
fn block(rng: &mut ChaCha8Rng, half: [f32; 2], room: [f32; 2]) -> Block {
    let size: [f32; 3] = if rng.random_bool(0.3) {
        [rng.random_range(1.5..5.0), 0.08, rng.random_range(0.6..1.1)]
    } else {
        [
            rng.random_range(0.15..1.3),
            rng.random_range(0.15..0.7),
            rng.random_range(0.15..1.9),
        ]
    };
    // Along one of the four sides.
    let side = rng.random_range(0..4);
    let (i, j) = if side < 2 { (0, 1) } else { (1, 0) };
    let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
    let out = half[j]
        + rng
            .random_range(0.6..3.0_f32)
            .min((room[j] - half[j] - 0.6).max(0.5));
    let mut low = Vector3::zeros();
    low[i] = rng.random_range(-half[i]..half[i]);
    low[j] = sign * out - size[1] / 2.0;
    let mut extent = Vector3::zeros();
    extent[i] = size[0];
    extent[j] = size[1];
    extent[2] = size[2];
    let first = color(rng);
    Block {
        low,
        high: low + extent,
        color: first,
        second: if rng.random_bool(0.3) {
            color(rng)
        } else {
            first
        },
        stripe_m: rng.random_range(0.2..1.5),
    }
}
