//! Shadows of bodies: heights along the sun's rays, and the share of the sky that they hide from
//! the floor.

use nalgebra::Vector3;

use super::place::Light;
use crate::body::Cone;

/// Cell of the height map, metres.
const CELL_M: f32 = 0.025;
/// Cell of the sky map, metres.
const SKY_CELL_M: f32 = 0.09;
/// Radius around a body in which it hides the sky, metres.
const SKY_REACH_M: f32 = 0.7;
/// A surface less than this below the map's surface is the same surface, metres.
const BIAS_M: f32 = 0.05;

/// A grid over the floor.
#[derive(Debug, Clone)]
struct FloorGrid {
    corner_m: [f32; 2],
    cell_m: f32,
    size: [usize; 2],
    values: Vec<f32>,
}

impl FloorGrid {
    fn new(low_m: [f32; 2], high_m: [f32; 2], cell_m: f32, value: f32) -> Self {
        let size = [0, 1].map(|i| ((high_m[i] - low_m[i]) / cell_m).ceil().max(1.0) as usize + 2);
        Self {
            corner_m: low_m,
            cell_m,
            size,
            values: vec![value; size[0] * size[1]],
        }
    }

    /// Interpolates `value` of the four cells around a point of the floor; `None` outside.
    fn around(&self, at_m: [f32; 2], value: impl Fn(f32) -> f32) -> Option<f32> {
        let x = (at_m[0] - self.corner_m[0]) / self.cell_m - 0.5;
        let y = (at_m[1] - self.corner_m[1]) / self.cell_m - 0.5;
        let inside =
            x >= 0.0 && y >= 0.0 && x < (self.size[0] - 1) as f32 && y < (self.size[1] - 1) as f32;
        if !inside {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let at = |i: usize, j: usize| value(self.values[j * self.size[0] + i]);
        let upper = at(i, j) * (1.0 - fx) + at(i + 1, j) * fx;
        let lower = at(i, j + 1) * (1.0 - fx) + at(i + 1, j + 1) * fx;
        Some(upper * (1.0 - fy) + lower * fy)
    }
}

/// The shadow of one body.
#[derive(Debug, Clone)]
pub(super) struct Shade {
    /// Height of the body's sunny side, by the point where the sun's ray meets the floor; below the
    /// floor if there is none.
    heights: FloorGrid,
    /// Share of the sky that is visible from the floor.
    sky: FloorGrid,
}

impl Shade {
    pub(super) fn new(cones: &[Cone], light: &Light) -> Self {
        let lean = lean_of(light);
        let mut low = [f32::MAX; 2];
        let mut high = [f32::MIN; 2];
        for (p, r) in cones.iter().flat_map(ends) {
            let r = r * 1.0_f32.hypot(lean[0].hypot(lean[1])) + CELL_M;
            for i in 0..2 {
                low[i] = low[i].min(p[i] - lean[i] * p[2] - r);
                high[i] = high[i].max(p[i] - lean[i] * p[2] + r);
            }
        }
        let mut heights = FloorGrid::new(low, high, CELL_M, -1.0);
        for cone in cones {
            raise(&mut heights, cone, lean, light);
        }
        Self {
            heights,
            sky: open_sky(cones),
        }
    }

    /// Corners of the floor that the shadow may reach, world metres.
    pub(super) fn corners_m(&self) -> impl Iterator<Item = [f32; 2]> {
        [&self.heights, &self.sky].into_iter().flat_map(|g| {
            let far = [0, 1].map(|i| g.corner_m[i] + g.size[i] as f32 * g.cell_m);
            [
                g.corner_m,
                far,
                [g.corner_m[0], far[1]],
                [far[0], g.corner_m[1]],
            ]
        })
    }

    /// Share of the sun that reaches a point, 0 to 1.
    pub(super) fn sunlit(&self, p: &Vector3<f32>, light: &Light) -> f32 {
        let lean = lean_of(light);
        let at = [p.x - lean[0] * p.z, p.y - lean[1] * p.z];
        let limit = p.z + BIAS_M;
        self.heights
            .around(at, |top| if top > limit { 0.0 } else { 1.0 })
            .unwrap_or(1.0)
    }

    /// Share of the sky that is visible from a point of the floor, 0 to 1.
    pub(super) fn open(&self, at_m: [f32; 2]) -> f32 {
        self.sky.around(at_m, |v| v).unwrap_or(1.0)
    }
}

/// Displacement of a shadow on the floor per metre of height.
fn lean_of(light: &Light) -> [f32; 2] {
    [
        light.to_sun.x / light.to_sun.z,
        light.to_sun.y / light.to_sun.z,
    ]
}

fn ends(cone: &Cone) -> [([f32; 3], f32); 2] {
    [
        (cone.origin_m, cone.reach_m[0]),
        (cone.tip_m, cone.reach_m[1]),
    ]
    .map(|(p, r)| ([p.x as f32, p.y as f32, p.z as f32], r as f32))
}

/// Enters the heights of one cone.
fn raise(grid: &mut FloorGrid, cone: &Cone, lean: [f32; 2], light: &Light) {
    let mut low = [usize::MAX; 2];
    let mut high = [0; 2];
    for (p, r) in ends(cone) {
        let r = r * 1.0_f32.hypot(lean[0].hypot(lean[1]));
        for i in 0..2 {
            let at = (p[i] - lean[i] * p[2] - grid.corner_m[i]) / grid.cell_m;
            let reach = r / grid.cell_m;
            low[i] = low[i].min((at - reach).max(0.0) as usize);
            high[i] = high[i].max(((at + reach).max(0.0) as usize + 2).min(grid.size[i]));
        }
    }
    let down: Vector3<f64> = -light.to_sun.cast::<f64>();
    for j in low[1]..high[1] {
        for i in low[0]..high[0] {
            let x = f64::from(grid.corner_m[0] + (i as f32 + 0.5) * grid.cell_m);
            let y = f64::from(grid.corner_m[1] + (j as f32 + 0.5) * grid.cell_m);
            if let Some(t) = cone.entry(&Vector3::new(x, y, 0.0), &down) {
                let top = &mut grid.values[j * grid.size[0] + i];
                *top = top.max((t * down.z) as f32);
            }
        }
    }
}

/// The sky map of the floor under the balls of a body; each hides its share of the sky.
fn open_sky(cones: &[Cone]) -> FloorGrid {
    let balls: Vec<([f32; 3], f32)> = cones
        .iter()
        .map(|cone| {
            let c = (cone.origin_m + cone.tip_m) / 2.0;
            let r = f64::midpoint(cone.reach_m[0], cone.reach_m[1]) + 0.15 * cone.length;
            ([c.x as f32, c.y as f32, c.z as f32], r as f32)
        })
        .filter(|(c, _)| c[2] < 1.2)
        .collect();
    let mut low = [f32::MAX; 2];
    let mut high = [f32::MIN; 2];
    for (c, r) in &balls {
        for i in 0..2 {
            low[i] = low[i].min(c[i] - r - SKY_REACH_M);
            high[i] = high[i].max(c[i] + r + SKY_REACH_M);
        }
    }
    if balls.is_empty() {
        (low, high) = ([0.0; 2], [0.0; 2]);
    }
    let mut grid = FloorGrid::new(low, high, SKY_CELL_M, 1.0);
    for j in 0..grid.size[1] {
        for i in 0..grid.size[0] {
            let x = grid.corner_m[0] + (i as f32 + 0.5) * SKY_CELL_M;
            let y = grid.corner_m[1] + (j as f32 + 0.5) * SKY_CELL_M;
            let hidden: f32 = balls
                .iter()
                .map(|(c, r)| {
                    let d2 = (c[0] - x).powi(2) + (c[1] - y).powi(2) + c[2] * c[2];
                    let d2 = d2.max(r * r);
                    r * r * c[2].max(0.0) / (d2 * d2.sqrt())
                })
                .sum();
            // Parts also hide each other, so their sum is too large.
            let border = i.min(j).min(grid.size[0] - 1 - i).min(grid.size[1] - 1 - j);
            let fade = (border as f32 / 3.0).min(1.0);
            grid.values[j * grid.size[0] + i] = 1.0 - (0.5 * hidden).min(0.75) * fade;
        }
    }
    grid
}
