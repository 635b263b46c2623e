//! Draws pictures of a ball through a camera's lens, with a known centre.

use std::sync::Arc;

use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::adjustment::CameraState;
use crate::ball::{BallLens, Picture};

/// Spacing of the grid on which the lens is inverted; linear interpolation between nodes is accurate to 1e-4 px.
const NODE_PX: f64 = 8.0;
/// Samples of a pixel in each direction, at the rim of a ball.
const SAMPLES: i32 = 5;

/// A ball in front of the camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ball {
    /// Centre in camera axes, metres, at the middle of the exposure.
    pub(crate) centre_c: Vector3<f64>,
    /// Displacement during the exposure.
    pub(crate) path_c: Vector3<f64>,
    pub(crate) radius_m: f64,
    pub(crate) colour: [f64; 3],
    /// How much darker it is below than above, share.
    pub(crate) shade: f64,
    /// Hidden pixels: those whose distance from the centre along the first two numbers is more than the third, in radii.
    pub(crate) hidden: Option<[f64; 3]>,
}

/// A flat thing of one colour in the picture, with half axes in pixels: a box if `is_box`, else an ellipse.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patch {
    pub(crate) middle_px: [f64; 2],
    pub(crate) half_px: [f64; 2],
    pub(crate) is_box: bool,
    pub(crate) colour: [f64; 3],
}

/// Contents of a part of a camera's picture.
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    pub(crate) camera: CameraState,
    pub(crate) origin_px: [u32; 2],
    pub(crate) size_px: [u32; 2],
    pub(crate) background: [f64; 3],
    /// Amplitude of the background's texture, levels.
    pub(crate) texture: f64,
    /// The background if it was drawn before.
    pub(crate) drawn: Option<Arc<Vec<[f64; 3]>>>,
    /// Standard deviation of each byte, levels.
    pub(crate) noise: f64,
    pub(crate) patches: Vec<Patch>,
    pub(crate) ball: Option<Ball>,
}

pub(crate) const ORANGE: [f64; 3] = [235.0, 110.0, 25.0];
pub(crate) const SIZE_PX: [u32; 2] = [1920, 1200];

/// A camera at the origin whose lens has distortion.
pub(crate) fn camera(focal_px: f64) -> CameraState {
    let intrinsics = Intrinsics {
        fx_px: focal_px,
        fy_px: 1.002 * focal_px,
        cx_px: 961.3,
        cy_px: 597.8,
    };
    let lens = Distortion {
        k1: -0.09,
        k2: 0.03,
        p1: 0.0004,
        ..Distortion::default()
    };
    CameraState::at_origin(intrinsics, lens)
}

pub(crate) fn lens_of(camera: &CameraState) -> BallLens {
    BallLens::new(SIZE_PX, camera.intrinsics, camera.lens()).unwrap()
}

/// A ball of 0.11 m radius in front of `camera`, whose centre is drawn at `px`.
pub(crate) fn ball_at(camera: &CameraState, px: [f64; 2], distance_m: f64) -> Ball {
    let bearing = camera.bearing(px, camera.fold_radius()).unwrap();
    Ball {
        centre_c: bearing * distance_m,
        path_c: Vector3::zeros(),
        radius_m: 0.11,
        colour: ORANGE,
        shade: 0.4,
        hidden: None,
    }
}

impl Patch {
    /// Covered share of a pixel.
    fn cover(&self, px: [f64; 2]) -> f64 {
        let off = [0, 1].map(|axis| (px[axis] - self.middle_px[axis]) / self.half_px[axis]);
        let away = if self.is_box {
            off[0].abs().max(off[1].abs())
        } else {
            libm::hypot(off[0], off[1])
        };
        let rim = self.half_px[0].min(self.half_px[1]);
        ((1.0 - away) * rim + 0.5).clamp(0.0, 1.0)
    }
}

impl Scene {
    /// A scene in the part of the camera's picture about `middle_px`.
    pub(crate) fn about(camera: &CameraState, middle_px: [f64; 2], size_px: [u32; 2]) -> Self {
        let origin = |axis: usize| {
            let most = f64::from(SIZE_PX[axis] - size_px[axis]);
            (middle_px[axis] - 0.5 * f64::from(size_px[axis]))
                .round()
                .clamp(0.0, most) as u32
        };
        Self {
            // Balls are placed in camera axes.
            camera: CameraState::at_origin(camera.intrinsics, camera.lens()),
            origin_px: [origin(0), origin(1)],
            size_px,
            background: [120.0, 125.0, 115.0],
            texture: 30.0,
            drawn: None,
            noise: 0.0,
            patches: Vec::new(),
            ball: None,
        }
    }

    pub(crate) fn picture<'a>(&self, bytes: &'a [u8]) -> Picture<'a> {
        Picture::rgb8(bytes, self.size_px)
            .unwrap()
            .at_origin(self.origin_px)
    }

    pub(crate) fn bytes(&self, rng: &mut ChaCha8Rng) -> Vec<u8> {
        let mut colours = match &self.drawn {
            Some(drawn) => drawn.to_vec(),
            None => self.background(),
        };
        self.add_patches(&mut colours);
        if let Some(ball) = &self.ball {
            let steps = if ball.path_c.norm() > 0.0 { 15 } else { 1 };
            let covers: Vec<Vec<(usize, f64, [f64; 3])>> = (0..steps)
                .map(|i| {
                    let share = (f64::from(i) + 0.5) / f64::from(steps) - 0.5;
                    self.covered(ball, &(ball.centre_c + ball.path_c * share))
                })
                .collect();
            let behind = colours.clone();
            for (index, cover, colour) in covers.into_iter().flatten() {
                for c in 0..3 {
                    colours[index][c] += cover * (colour[c] - behind[index][c]) / f64::from(steps);
                }
            }
        }
        let mut noisy = |level: f64| {
            // The sum of eight uniform bytes is nearly normal.
            let bytes: [u8; 8] = if self.noise > 0.0 {
                rng.random()
            } else {
                [0; 8]
            };
            let sum: u32 = bytes.iter().map(|b| u32::from(*b)).sum();
            let noise = if self.noise > 0.0 {
                (f64::from(sum) - 1020.0) / 209.0
            } else {
                0.0
            };
            (level + self.noise * noise).round().clamp(0.0, 255.0) as u8
        };
        colours.into_iter().flatten().map(&mut noisy).collect()
    }

    /// The picture without patches and ball.
    pub(crate) fn background(&self) -> Vec<[f64; 3]> {
        let [width, height] = self.size_px;
        let mut colours = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                let px = [x + self.origin_px[0], y + self.origin_px[1]].map(f64::from);
                let fine = texture(px, 5.0, 1) + texture(px, 23.0, 2) + texture(px, 90.0, 3);
                let of_channel = |c: usize| 0.3 * texture(px, 40.0, 7 + c as u32) + fine / 3.0;
                colours.push([0, 1, 2].map(|c| self.background[c] + self.texture * of_channel(c)));
            }
        }
        colours
    }

    fn add_patches(&self, colours: &mut [[f64; 3]]) {
        let origin = self.origin_px.map(f64::from);
        let width = self.size_px[0] as usize;
        for patch in &self.patches {
            let range = |axis: usize| {
                let most = f64::from(self.size_px[axis]) - 1.0;
                let at = |off: f64| {
                    (patch.middle_px[axis] - origin[axis] + off).clamp(0.0, most) as usize
                };
                at(-patch.half_px[axis] - 2.0)..=at(patch.half_px[axis] + 2.0)
            };
            for y in range(1) {
                for x in range(0) {
                    let px = [x as f64 + origin[0], y as f64 + origin[1]];
                    let cover = patch.cover(px);
                    let colour = &mut colours[y * width + x];
                    *colour = [0, 1, 2].map(|c| colour[c] + cover * (patch.colour[c] - colour[c]));
                }
            }
        }
    }

    /// Indices of the pixels that the ball covers, their covered shares, and its colours there.
    fn covered(&self, ball: &Ball, centre_c: &Vector3<f64>) -> Vec<(usize, f64, [f64; 3])> {
        let fold = self.camera.fold_radius();
        let Some(middle) = self.camera.project(centre_c, fold) else {
            return Vec::new();
        };
        let sine = ball.radius_m / centre_c.norm();
        let squared = (1.0 - sine * sine) * centre_c.norm_squared();
        let radius_px = 1.6 * self.camera.intrinsics.fx_px * sine + 4.0;
        let Some(grid) = Grid::about(&self.camera, middle.into(), radius_px) else {
            return Vec::new();
        };
        // A ray is inside the cone about the centre if (b c)^2 > cos^2 |b|^2 |c|^2.
        let is_inside = |px: [f64; 2]| {
            let n = grid.at(px);
            let ray = Vector3::new(n.x, n.y, 1.0);
            let along = ray.dot(centre_c);
            let is_in = along * along > squared * ray.norm_squared();
            let rim = ball.hidden.is_none_or(|[x, y, most]| {
                let seen = (px[0] - middle.x) * x + (px[1] - middle.y) * y;
                seen < most * sine * self.camera.intrinsics.fx_px
            });
            is_in && rim
        };
        let [left, top] = self.origin_px.map(f64::from);
        let [width, height] = self.size_px.map(f64::from);
        let range = |middle: f64, first: f64, size: f64| {
            let from = (middle - radius_px).floor().max(first);
            let to = (middle + radius_px).ceil().min(first + size - 1.0);
            (from as i64)..=(to as i64)
        };
        let mut found = Vec::new();
        for y in range(middle.y, top, height) {
            for x in range(middle.x, left, width) {
                let px = [x as f64, y as f64];
                let corners = [
                    [-0.6, -0.6],
                    [0.6, -0.6],
                    [-0.6, 0.6],
                    [0.6, 0.6],
                    [0.0, 0.0],
                ];
                let count = corners
                    .iter()
                    .filter(|c| is_inside([px[0] + c[0], px[1] + c[1]]))
                    .count();
                let cover = match count {
                    0 => 0.0,
                    5 => 1.0,
                    _ => sampled(|off| is_inside([px[0] + off[0], px[1] + off[1]])),
                };
                if cover > 0.0 {
                    let down = (px[1] - middle.y) / (sine * self.camera.intrinsics.fx_px);
                    let light = 1.0 - 0.5 * ball.shade * (1.0 + down.clamp(-1.0, 1.0));
                    let index = (px[1] - top) * width + (px[0] - left);
                    found.push((index as usize, cover, ball.colour.map(|c| light * c)));
                }
            }
        }
        found
    }
}

fn sampled(is_inside: impl Fn([f64; 2]) -> bool) -> f64 {
    let place = |i: i32| (f64::from(i) + 0.5) / f64::from(SAMPLES) - 0.5;
    let mut count = 0;
    for i in 0..SAMPLES {
        for j in 0..SAMPLES {
            count += i32::from(is_inside([place(i), place(j)]));
        }
    }
    f64::from(count) / f64::from(SAMPLES * SAMPLES)
}

/// Pinhole coordinates on a grid: the inverse of the lens.
struct Grid {
    first: [f64; 2],
    columns: usize,
    nodes: Vec<Vector2<f64>>,
}

impl Grid {
    fn about(camera: &CameraState, middle: [f64; 2], radius_px: f64) -> Option<Self> {
        let first = middle.map(|m| m - radius_px - 2.0);
        let columns = (2.0 * (radius_px + 2.0) / NODE_PX).ceil() as usize + 2;
        let fold = camera.fold_radius();
        let mut nodes = Vec::new();
        for y in 0..columns {
            for x in 0..columns {
                let px = [first[0] + NODE_PX * x as f64, first[1] + NODE_PX * y as f64];
                let bearing = camera.bearing(px, fold)?;
                nodes.push(bearing.xy() / bearing.z);
            }
        }
        Some(Self {
            first,
            columns,
            nodes,
        })
    }

    fn at(&self, px: [f64; 2]) -> Vector2<f64> {
        let [u, v] = [0, 1].map(|axis| (px[axis] - self.first[axis]) / NODE_PX);
        let (x, y) = (u as usize, v as usize);
        let (u, v) = (u - x as f64, v - y as f64);
        let node = |x: usize, y: usize| self.nodes[y * self.columns + x];
        let above = node(x, y) * (1.0 - u) + node(x + 1, y) * u;
        let below = node(x, y + 1) * (1.0 - u) + node(x + 1, y + 1) * u;
        above * (1.0 - v) + below * v
    }
}

/// Smooth noise of -1 to 1, a function of the position in the picture only.
fn texture(px: [f64; 2], size_px: f64, kind: u32) -> f64 {
    let [u, v] = px.map(|p| p / size_px);
    let (x, y) = (u.floor(), v.floor());
    let (u, v) = (u - x, v - y);
    let level = |x: f64, y: f64| {
        let mut h = (x as i64 as u32).wrapping_mul(0x9E37_79B1)
            ^ (y as i64 as u32).wrapping_mul(0x85EB_CA6B)
            ^ kind.wrapping_mul(0xC2B2_AE35);
        h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
        f64::from(h ^ (h >> 15)) / f64::from(u32::MAX) * 2.0 - 1.0
    };
    let above = level(x, y) * (1.0 - u) + level(x + 1.0, y) * u;
    let below = level(x, y + 1.0) * (1.0 - u) + level(x + 1.0, y + 1.0) * u;
    above * (1.0 - v) + below * v
}

pub(crate) fn seeded(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}
