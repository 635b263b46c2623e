//! Rays against cones, a row of pixels at a time, and the cones and shadows that may touch each
//! tile of a picture.

use nalgebra::Vector3;

use super::figure::Figure;
use super::shade::Shade;
use super::view::{CameraView, PixelBox, TILE};
use crate::body::Cone;

/// No hit.
pub(super) const NOTHING: u32 = u32::MAX;
/// Smallest depth that is drawn, metres.
const NEAR_M: f32 = 0.1;

/// A cone in one view. Rays are affine in (u, v), so the direction in the cone's local coordinates
/// costs six multiplications; the eye is the same for all rays.
#[derive(Debug, Clone)]
pub(super) struct Cast {
    /// Direction = `d[0]` + u `d[1]` + v `d[2]`, local.
    d: [[f32; 3]; 3],
    /// The eye, local.
    eye: [f32; 3],
    length: f32,
    ra: f32,
    rb: f32,
    /// Sine of the flank's slope, and the square of its cosine.
    slope: f32,
    cos2: f32,
    /// Ends in camera axes, and the larger radius, metres.
    ends_c: [Vector3<f32>; 2],
    reach_m: f32,
    /// Pixels that may show it.
    pub(super) bound: PixelBox,
}

/// The nearest hits of a tile: depth along the ray (u, v, 1), and the index of the cone.
pub(super) struct Hits {
    pub(super) depth: [[f32; TILE]; TILE],
    pub(super) cone: [[u32; TILE]; TILE],
}

impl Hits {
    pub(super) fn none() -> Self {
        Self {
            depth: [[f32::INFINITY; TILE]; TILE],
            cone: [[NOTHING; TILE]; TILE],
        }
    }
}

impl Cast {
    /// `None` if the view does not show the cone.
    pub(super) fn new(cone: &Cone, view: &CameraView) -> Option<Self> {
        let ends = [cone.origin_m, cone.tip_m].map(|p| view.rotation * (p - view.eye_m));
        let bound = view.bound(&ends, &cone.reach_m)?;
        let axes = cone.to_local * view.rotation.transpose();
        let eye = cone.to_local * (view.eye_m - cone.origin_m);
        let row = |c: usize| {
            [
                axes[(0, c)] as f32,
                axes[(1, c)] as f32,
                axes[(2, c)] as f32,
            ]
        };
        let slope = if cone.length > 0.0 {
            (cone.radii[0] - cone.radii[1]) / cone.length
        } else {
            0.0
        };
        Some(Self {
            d: [row(2), row(0), row(1)],
            eye: [eye.x as f32, eye.y as f32, eye.z as f32],
            length: cone.length as f32,
            ra: cone.radii[0] as f32,
            rb: cone.radii[1] as f32,
            slope: slope as f32,
            cos2: (1.0 - slope * slope).max(1e-4) as f32,
            ends_c: ends.map(Vector3::<f64>::cast),
            reach_m: cone.reach_m[0].max(cone.reach_m[1]) as f32,
            bound,
        })
    }

    /// Whether a ray within `spread` of (u, v) may hit.
    pub(super) fn is_near(&self, [u, v]: [f32; 2], spread: f32) -> bool {
        let ray = Vector3::new(u, v, 1.0).normalize();
        let [a, b] = self.ends_c;
        let axis = b - a;
        // The point of the axis nearest to the ray; distances are perpendicular to the ray.
        let square = |p: Vector3<f32>| p - ray * ray.dot(&p);
        let (qa, qx) = (square(a), square(axis));
        let share = (-qa.dot(&qx) / qx.norm_squared().max(1e-9)).clamp(0.0, 1.0);
        let reach = self.reach_m + spread * a.z.max(b.z).max(0.0) * 1.5;
        (qa + qx * share).norm_squared() < reach * reach
    }

    /// Updates the nearest hits along one row of rays.
    #[inline]
    pub(super) fn row(
        &self,
        index: u32,
        rays: &[[f32; TILE]; 2],
        depth: &mut [f32; TILE],
        cone: &mut [u32; TILE],
    ) {
        let entries = self.entries(rays);
        for i in 0..TILE {
            let nearer = entries[i] < depth[i] && entries[i] > NEAR_M;
            depth[i] = if nearer { entries[i] } else { depth[i] };
            cone[i] = if nearer { index } else { cone[i] };
        }
    }

    /// Depths at which a row of rays enters; infinite for a miss. Same equations as
    /// [`Cone::entry`], but without branches, so that several rays are computed at once.
    #[expect(
        clippy::needless_bitwise_bool,
        reason = "a lazy operator is a branch, and keeps the loop from computing lanes at once"
    )]
    #[inline(never)]
    fn entries(&self, [u, v]: &[[f32; TILE]; 2]) -> [f32; TILE] {
        let [d0, du, dv] = self.d;
        let [ex, ey, ez] = self.eye;
        let (ra, length) = (self.ra, self.length);
        let (ra2, rb2) = (ra * ra, self.rb * self.rb);
        let (c2, lean) = (self.cos2, self.slope * self.ra);
        let top = length * c2;
        let positive = |v: f32| if v > 0.0 { v } else { 0.0 };
        let least = |a: f32, b: f32| if a < b { a } else { b };
        let mut entries = [f32::INFINITY; TILE];
        for i in 0..TILE {
            let dx = d0[0] + u[i] * du[0] + v[i] * dv[0];
            let dy = d0[1] + u[i] * du[1] + v[i] * dv[1];
            let dz = d0[2] + u[i] * du[2] + v[i] * dv[2];
            let dd = dx * dx + dy * dy + dz * dz;
            let per = 1.0 / dd;
            // Starts near the cone: squares of distant metres would lose the precision of its
            // radius.
            let t0 = -(dx * ex + dy * ey + dz * (ez - 0.5 * length)) * per;
            let ox = ex + t0 * dx;
            let oy = ey + t0 * dy;
            let oz = ez + t0 * dz;
            let oo = ox * ox + oy * oy + oz * oz;
            let b = ox * dx + oy * dy + oz * dz;
            let k2 = c2 * dd - dz * dz;
            let k1 = c2 * b - oz * dz + dz * lean;
            let k0 = c2 * oo - oz * oz + 2.0 * oz * lean - ra2;
            let h = k1 * k1 - k0 * k2;
            let tc = (-positive(h).sqrt() - k1) / k2;
            let y = oz - lean + tc * dz;
            let on_flank = (h >= 0.0) & (y > 0.0) & (y < top);
            let ha = b * b - dd * (oo - ra2);
            let ta = (-b - positive(ha).sqrt()) * per;
            let bb = b - length * dz;
            let hb = bb * bb - dd * (oo - 2.0 * length * oz + length * length - rb2);
            let tb = (-bb - positive(hb).sqrt()) * per;
            let flank = if on_flank { tc } else { f32::INFINITY };
            let start = if ha >= 0.0 { ta } else { f32::INFINITY };
            let end = if hb >= 0.0 { tb } else { f32::INFINITY };
            entries[i] = t0 + least(flank, least(start, end));
        }
        entries
    }
}

/// The figure of a cone, and the cone's index in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ConeOwner {
    pub(super) figure: u16,
    pub(super) cone: u16,
}

/// A view at one moment, sorted into tiles.
pub(super) struct TileMoment {
    pub(super) casts: Vec<(Cast, ConeOwner)>,
    columns: usize,
    /// Indices in `casts` per tile, row by row.
    bins: Vec<Vec<u32>>,
}

impl TileMoment {
    pub(super) fn new(figures: &[Figure<'_>], moment: usize, view: &CameraView) -> Self {
        let [columns, rows] = view.size_px().map(|n| n.div_ceil(TILE));
        let mut tiles = Self {
            casts: Vec::new(),
            columns,
            bins: vec![Vec::new(); columns * rows],
        };
        for (f, figure) in figures.iter().enumerate() {
            for (c, cone) in figure.cones(moment).iter().enumerate() {
                let owner = ConeOwner {
                    figure: f as u16,
                    cone: c as u16,
                };
                if let Some(cast) = Cast::new(cone, view) {
                    tiles.add(cast, owner, view);
                }
            }
        }
        tiles
    }

    fn add(&mut self, cast: Cast, owner: ConeOwner, view: &CameraView) {
        let n = self.casts.len() as u32;
        let PixelBox { x, y } = cast.bound;
        for row in y[0] / TILE..y[1].div_ceil(TILE) {
            for column in x[0] / TILE..x[1].div_ceil(TILE) {
                let (middle, spread) = tile_cone(view, column * TILE, row * TILE);
                if cast.is_near(middle, spread) {
                    self.bins[row * self.columns + column].push(n);
                }
            }
        }
        self.casts.push((cast, owner));
    }

    /// Indices in [`Self::casts`] of cones that may touch the tile of a pixel.
    pub(super) fn near(&self, left: usize, top: usize) -> &[u32] {
        &self.bins[top / TILE * self.columns + left / TILE]
    }
}

/// The middle ray of a tile, and the largest distance of its rays from it.
fn tile_cone(view: &CameraView, left: usize, top: usize) -> ([f32; 2], f32) {
    let ends = [
        view.row(left, top, [-1.0; 2]),
        view.row(left, top + TILE - 1, [1.0; 2]),
    ];
    let corners = ends.map(|[u, v]| [[u[0], v[0]], [u[TILE - 1], v[TILE - 1]]]);
    let corners = [corners[0][0], corners[0][1], corners[1][0], corners[1][1]];
    let mean = |i: usize| corners.iter().map(|c| c[i]).sum::<f32>() / 4.0;
    let middle = [mean(0), mean(1)];
    let spread = corners
        .iter()
        .map(|c| (c[0] - middle[0]).hypot(c[1] - middle[1]))
        .fold(0.0, f32::max);
    (middle, spread)
}

/// The pixels where a shadow may fall.
pub(super) fn shadow_box(shade: &Shade, view: &CameraView) -> PixelBox {
    let [width, height] = view.size_px();
    let whole = PixelBox {
        x: [0, width],
        y: [0, height],
    };
    let mut bound: Option<PixelBox> = None;
    for [x, y] in shade.corners_m() {
        let p = Vector3::new(f64::from(x), f64::from(y), 0.0);
        let p_c = view.rotation * (p - view.eye_m);
        if p_c.z < 0.2 {
            return whole;
        }
        // Corners outside the picture still bound it.
        let Some(at) = view.clamped(&p_c) else {
            return whole;
        };
        bound = Some(bound.map_or(at, |f| f.with(&at)));
    }
    bound.unwrap_or(whole)
}
