//! Which cones and shadows may touch which tile of a picture.

use nalgebra::Vector3;

use super::cast::Cast;
use super::figure::Figure;
use super::shade::Shade;
use super::view::{CameraView, PixelBox, TILE};

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
