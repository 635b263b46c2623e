//! The ray of the world for every pixel of a picture.

use farfield_edge::crop::CropGeometry;
use farfield_proto::camera::{CameraModel, Intrinsics};
use farfield_proto::frames::{Pixel, Undistorted};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Side of the tiles of a picture, pixels.
pub(super) const TILE: usize = 16;
/// Spacing of the pixels with exact rays; rays between them are interpolated. The error is a
/// fiftieth of a pixel for lenses that bend by a third of the radius, and a tenth of a pixel in the
/// used part of a fisheye.
const STEP: usize = 8;
/// Balls closer to the camera are not drawn, metres.
const NEAR_M: f64 = 0.1;

/// The geometry of a picture: its eye and its rays.
///
/// Rays are (u, v, 1) in camera axes (x right, y down, z forward).
#[derive(Debug, Clone)]
pub struct CameraView {
    pub(super) eye_m: Vector3<f64>,
    /// Rotation from world axes to camera axes.
    pub(super) rotation: Matrix3<f64>,
    pub(super) size_px: [usize; 2],
    nodes: [usize; 2],
    uv: Vec<[f32; 2]>,
    /// For a fisheye, per node, whether the lens model draws nothing there; empty for other lenses.
    blind: Vec<bool>,
    optics: Optics,
}

#[derive(Debug, Clone)]
enum Optics {
    Lens(CameraModel),
    Crop(CameraModel, CropGeometry),
}

/// Pixels that an object may touch: columns from `x[0]` to `x[1]`, rows likewise, ends excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelBox {
    pub(super) x: [usize; 2],
    pub(super) y: [usize; 2],
}

impl PixelBox {
    /// The box that contains both.
    pub(super) fn with(&self, other: &Self) -> Self {
        let join = |a: [usize; 2], b: [usize; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self {
            x: join(self.x, other.x),
            y: join(self.y, other.y),
        }
    }

    /// Whether the box touches the tile that starts at pixel (`left`, `top`).
    pub(super) fn meets_tile(&self, left: usize, top: usize) -> bool {
        self.x[0] < left + TILE && self.x[1] > left && self.y[0] < top + TILE && self.y[1] > top
    }
}

impl CameraView {
    /// The whole picture of a camera with its lens. For a fisheye it includes the unused part,
    /// black where it is more than 80 degrees off the axis.
    pub fn of_camera(camera: &CameraModel) -> Self {
        let size = camera.size_px().map(|v| v as usize);
        Self::new(camera, size, Optics::Lens(camera.clone()), |x, y| {
            camera.undistort_wide(Pixel::new(x, y))
        })
    }

    /// A crop of a camera's picture, resampled to the input of a network. Its pixels are those of
    /// [`CropGeometry`], without lens distortion.
    pub fn of_crop(camera: &CameraModel, geometry: &CropGeometry) -> Self {
        let optics = Optics::Crop(camera.clone(), *geometry);
        Self::new(camera, geometry.input_px(), optics, |x, y| {
            Some(geometry.pixel(x, y))
        })
    }

    fn new(
        camera: &CameraModel,
        size_px: [usize; 2],
        optics: Optics,
        pixel: impl Fn(f64, f64) -> Option<Pixel<Undistorted>>,
    ) -> Self {
        let nodes = size_px.map(|n| n.div_ceil(TILE) * TILE / STEP + 1);
        let k = *camera.intrinsics();
        let at = |x: usize, y: usize| {
            pixel((x * STEP) as f64, (y * STEP) as f64).map(|p| normalised(&k, p))
        };
        let is_fisheye = matches!(&optics, Optics::Lens(camera) if camera.lens().is_fisheye());
        let mut blind = Vec::new();
        let mut uv = Vec::with_capacity(nodes[0] * nodes[1]);
        for y in 0..nodes[1] {
            for x in 0..nodes[0] {
                // Only nodes beyond the picture's edge, or in the black part of a fisheye, may have
                // no ray; they extrapolate the row or the column.
                let before = |step: usize, room: usize| {
                    (room >= 2).then(|| {
                        let n: usize = uv.len();
                        let (a, b): ([f32; 2], [f32; 2]) = (uv[n - step], uv[n - 2 * step]);
                        [2.0 * a[0] - b[0], 2.0 * a[1] - b[1]]
                    })
                };
                let ray = at(x, y);
                if is_fisheye {
                    blind.push(ray.is_none());
                }
                let node = ray
                    .map(|p| [p.x as f32, p.y as f32])
                    .or_else(|| before(1, x))
                    .or_else(|| before(nodes[0], y))
                    .unwrap_or_default();
                uv.push(node);
            }
        }
        let motion = camera.camera_from_world().isometry();
        Self {
            eye_m: camera.center().coordinates_m().coords,
            rotation: motion.rotation.to_rotation_matrix().into_inner(),
            size_px,
            nodes,
            uv,
            blind,
            optics,
        }
    }

    /// Width and height, pixels.
    pub fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// Whether some pixels are black because of the lens.
    pub(super) fn has_blind(&self) -> bool {
        self.blind.contains(&true)
    }

    /// Whether a pixel is black: one of the nodes around it has no ray.
    pub(super) fn is_blind(&self, x: usize, y: usize) -> bool {
        let first = y / STEP * self.nodes[0] + x / STEP;
        let below = first + self.nodes[0];
        [first, first + 1, below, below + 1]
            .into_iter()
            .any(|node| self.blind.get(node).copied().unwrap_or(false))
    }

    /// The ray (u, v, 1) of a pixel, moved by `shift_px`.
    pub(super) fn ray(&self, [x, y]: [usize; 2], shift_px: [f32; 2]) -> [f32; 2] {
        let [column, row] = [x / STEP, y / STEP];
        let first = row * self.nodes[0] + column;
        let along = ((x - column * STEP) as f32 + shift_px[0]) / STEP as f32;
        let down = ((y - row * STEP) as f32 + shift_px[1]) / STEP as f32;
        std::array::from_fn(|i| {
            let at = |n: usize| self.uv[n][i];
            let upper = at(first) + (at(first + 1) - at(first)) * along;
            let below = first + self.nodes[0];
            let lower = at(below) + (at(below + 1) - at(below)) * along;
            upper + (lower - upper) * down
        })
    }

    /// Rays of one row of a tile, from pixel (`x`, `y`) on, moved by `shift_px`.
    pub(super) fn row(&self, x: usize, y: usize, shift_px: [f32; 2]) -> [[f32; TILE]; 2] {
        let row = (y / STEP).min(self.nodes[1] - 2);
        let down = ((y - row * STEP) as f32 + shift_px[1]) / STEP as f32;
        let first = row * self.nodes[0] + x / STEP;
        let node = |i: usize| {
            let (a, b) = (self.uv[first + i], self.uv[first + self.nodes[0] + i]);
            [a[0] + (b[0] - a[0]) * down, a[1] + (b[1] - a[1]) * down]
        };
        let mut rays = [[0.0; TILE]; 2];
        for half in 0..TILE / STEP {
            let (a, b) = (node(half), node(half + 1));
            for i in 0..STEP {
                let across = (i as f32 + shift_px[0]) / STEP as f32;
                rays[0][half * STEP + i] = a[0] + (b[0] - a[0]) * across;
                rays[1][half * STEP + i] = a[1] + (b[1] - a[1]) * across;
            }
        }
        rays
    }

    /// The pixels that two balls and the volume between them may touch; `None` if they are behind
    /// the camera or outside the picture. Centres in camera axes, metres.
    pub(super) fn bound(
        &self,
        centers_c: &[Vector3<f64>; 2],
        radii_m: &[f64; 2],
    ) -> Option<PixelBox> {
        let [width, height] = self.size_px;
        let whole = PixelBox {
            x: [0, width],
            y: [0, height],
        };
        if centers_c.iter().zip(radii_m).all(|(c, r)| c.z + r < NEAR_M) {
            return None;
        }
        let mut low = Vector2::repeat(f64::MAX);
        let mut high = Vector2::repeat(f64::MIN);
        for (c, &r) in centers_c.iter().zip(radii_m) {
            if c.z - r < NEAR_M {
                return Some(whole);
            }
            let range = |x: f64| {
                let (a, b) = (x - r, x + r);
                [
                    (a / (c.z - r)).min(a / (c.z + r)),
                    (b / (c.z - r)).max(b / (c.z + r)),
                ]
            };
            let (u, v) = (range(c.x), range(c.y));
            let corners = [(u[0], v[0]), (u[1], v[0]), (u[0], v[1]), (u[1], v[1])];
            // A fisheye bends distant edges, most where they pass the axis.
            let (u_0, v_0) = (0.0f64.clamp(u[0], u[1]), 0.0f64.clamp(v[0], v[1]));
            let bent = [(u[0], v_0), (u[1], v_0), (u_0, v[0]), (u_0, v[1])];
            let bent = bent.into_iter().filter(|_| !self.blind.is_empty());
            for (u, v) in corners.into_iter().chain(bent) {
                let Some(px) = self.pixel_of(u, v) else {
                    return Some(whole);
                };
                low = low.inf(&px);
                high = high.sup(&px);
            }
        }
        // Edges of the box bend with the lens, and the samples of a pixel extend beyond it.
        let clamp = |v: f64, to: usize| v.clamp(0.0, to as f64) as usize;
        let pixels = PixelBox {
            x: [
                clamp(low.x.floor() - 3.0, width),
                clamp(high.x.ceil() + 4.0, width),
            ],
            y: [
                clamp(low.y.floor() - 3.0, height),
                clamp(high.y.ceil() + 4.0, height),
            ],
        };
        (pixels.x[0] < pixels.x[1] && pixels.y[0] < pixels.y[1]).then_some(pixels)
    }

    /// The pixel of a point (camera axes, in front of the camera), clamped to the picture.
    pub(super) fn clamped(&self, p_c: &Vector3<f64>) -> Option<PixelBox> {
        let px = self.pixel_of(p_c.x / p_c.z, p_c.y / p_c.z)?;
        let at = |v: f64, size: usize| v.clamp(0.0, size as f64) as usize;
        let [x, y] = [at(px.x, self.size_px[0]), at(px.y, self.size_px[1])];
        Some(PixelBox {
            x: [x, x + 1],
            y: [y, y + 1],
        })
    }

    /// The pixel of the ray (u, v, 1).
    fn pixel_of(&self, u: f64, v: f64) -> Option<Vector2<f64>> {
        let (Optics::Lens(camera) | Optics::Crop(camera, _)) = &self.optics;
        let k = camera.intrinsics();
        let px = Pixel::new(u * k.fx_px + k.cx_px, v * k.fy_px + k.cy_px);
        match &self.optics {
            Optics::Lens(camera) => camera.distort_wide(px).map(|p| p.vector_px()),
            Optics::Crop(_, geometry) => Some(geometry.input(px)),
        }
    }
}

fn normalised(k: &Intrinsics, p: Pixel<Undistorted>) -> Vector2<f64> {
    Vector2::new((p.x() - k.cx_px) / k.fx_px, (p.y() - k.cy_px) / k.fy_px)
}
