//! Paints people over a backdrop.

use image::RgbImage;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::backdrop::{Backdrop, shifts_px};
use super::cast::{ConeOwner, Hits, NOTHING, TileMoment, shadow_box};
use super::figure::Figure;
use super::grain;
use super::place::Light;
use super::sensor::Sensor;
use super::shade::Shade;
use super::view::{CameraView, PixelBox, TILE};

/// The input of one picture.
pub struct Shot<'a> {
    /// The rays.
    pub view: &'a CameraView,
    /// The background of the figures. It has the size of the view and is exposed with no other
    /// sensor than this shot's.
    pub backdrop: &'a Backdrop,
    /// The light of the backdrop.
    pub light: &'a Light,
    /// The figures.
    pub figures: &'a [Figure<'a>],
    /// Rays per pixel where figures are; the rays of one pixel are spread over the moments.
    pub samples: usize,
    /// Converts light to bytes.
    pub sensor: &'a Sensor,
    /// Seed of this picture's noise.
    pub noise_seed: u64,
}

/// Paints a picture: distorted pixels of a camera, or the pixels of a crop.
///
/// The bytes depend on the shot alone, not on the number of threads.
///
/// # Panics
/// When the backdrop is smaller than the view.
pub fn paint(shot: &Shot<'_>) -> RgbImage {
    let [width, height] = shot.view.size_px();
    let stage = SharedParts::new(shot);
    let mut bytes = vec![0; width * height * 3];
    bytes
        .par_chunks_mut(width * 3 * TILE)
        .enumerate()
        .for_each(|(n, rows)| stage.paint_rows(n * TILE, rows));
    RgbImage::from_raw(width as u32, height as u32, bytes)
        .expect("as many bytes as pixels were made")
}

/// The light of one tile.
type TileLight = [[[f32; 3]; TILE]; TILE];

/// One sample of a tile's pixels: moment, position in the pixel, hits.
type TileSample = (usize, [f32; 2], Hits);

/// The parts of a picture that all tiles share.
struct SharedParts<'a> {
    shot: &'a Shot<'a>,
    shifts_px: Vec<[f32; 2]>,
    moments: Vec<TileMoment>,
    /// The shadow of each figure, and the pixels where it may fall on the floor.
    shades: Vec<(Shade, PixelBox)>,
    /// Whether the lens leaves parts of the picture black.
    has_blind: bool,
}

impl<'a> SharedParts<'a> {
    fn new(shot: &'a Shot<'a>) -> Self {
        let figures = shot.figures;
        let n_moments = figures.iter().map(Figure::n_moments).max().unwrap_or(0);
        let moments = (0..n_moments)
            .into_par_iter()
            .map(|moment| TileMoment::new(figures, moment, shot.view))
            .collect();
        let shades = figures
            .par_iter()
            .map(|figure| {
                let shade = Shade::new(figure.cones(figure.n_moments() / 2), shot.light);
                let bound = shadow_box(&shade, shot.view);
                (shade, bound)
            })
            .collect();
        Self {
            shot,
            shifts_px: shifts_px(shot.samples),
            moments,
            shades,
            has_blind: shot.view.has_blind(),
        }
    }

    fn paint_rows(&self, top: usize, rows: &mut [u8]) {
        let Shot {
            view,
            backdrop,
            sensor,
            ..
        } = self.shot;
        let width = view.size_px()[0];
        let n_rows = rows.len() / (3 * width);
        let mut values = vec![[0; 3]; n_rows * width];
        for left in (0..width).step_by(TILE) {
            let columns = TILE.min(width - left);
            let tile = self.tile(left, top);
            for y in 0..n_rows {
                let into = &mut values[y * width + left..][..columns];
                match &tile {
                    Some(light) => {
                        for (value, &light) in into.iter_mut().zip(&light[y]) {
                            *value = sensor.encode(light);
                        }
                    }
                    None => backdrop.copy_row(sensor, left, top + y, into),
                }
            }
        }
        let lines = values.chunks(width).zip(rows.chunks_mut(3 * width));
        for (y, (row, out)) in lines.enumerate() {
            let seed = grain::hash(self.shot.noise_seed) ^ (top + y) as u64;
            sensor.develop(row, seed, out);
        }
    }

    /// The light of one tile; `None` if only the backdrop is visible.
    fn tile(&self, left: usize, top: usize) -> Option<Box<TileLight>> {
        let near: Vec<&[u32]> = self.moments.iter().map(|m| m.near(left, top)).collect();
        let shades: Vec<&Shade> = self
            .shades
            .iter()
            .filter(|(_, b)| b.meets_tile(left, top))
            .map(|(shade, _)| shade)
            .collect();
        let is_empty = near.iter().all(|n| n.is_empty());
        if is_empty && shades.is_empty() {
            return None;
        }
        let [width, height] = self.shot.view.size_px();
        let mut light = Box::new([[[0.0; 3]; TILE]; TILE]);
        for (y, row) in light.iter_mut().enumerate().take(height - top) {
            for (x, pixel) in row.iter_mut().enumerate().take(width - left) {
                *pixel = self.shot.backdrop.light(left + x, top + y);
            }
        }
        if !shades.is_empty() {
            self.darken(left, top, &shades, &mut light);
        }
        if !is_empty {
            self.add_figures(left, top, &near, &mut light);
        }
        if self.has_blind {
            self.blacken(left, top, &mut light);
        }
        Some(light)
    }

    /// Removes the light where the lens draws nothing.
    fn blacken(&self, left: usize, top: usize, light: &mut TileLight) {
        let [width, height] = self.shot.view.size_px();
        for (y, row) in light.iter_mut().enumerate().take(height - top) {
            for (x, pixel) in row.iter_mut().enumerate().take(width - left) {
                if self.shot.view.is_blind(left + x, top + y) {
                    *pixel = [0.0; 3];
                }
            }
        }
    }

    /// Applies shadows to the floor of a tile.
    fn darken(&self, left: usize, top: usize, shades: &[&Shade], light: &mut TileLight) {
        let view = self.shot.view;
        let eye = view.eye_m.cast::<f32>();
        let back = view.rotation.transpose().cast::<f32>();
        let up = Vector3::z();
        let full = self.shot.light.on(&up, 1.0, 1.0);
        for (y, row) in light.iter_mut().enumerate() {
            let [u, v] = view.row(left, top + y, [0.0; 2]);
            for (x, pixel) in row.iter_mut().enumerate() {
                let ray = back * Vector3::new(u[x], v[x], 1.0);
                if ray.z > -1e-4 {
                    continue;
                }
                let p = eye - ray * (eye.z / ray.z);
                let floor = Vector3::new(p.x, p.y, 0.0);
                let (mut open, mut sunlit) = (1.0_f32, 1.0_f32);
                for shade in shades {
                    open *= shade.open([p.x, p.y]);
                    sunlit = sunlit.min(shade.sunlit(&floor, self.shot.light));
                }
                if open < 1.0 || sunlit < 1.0 {
                    let left_over = self.shot.light.on(&up, sunlit, open);
                    *pixel = std::array::from_fn(|c| pixel[c] * left_over[c] / full[c]);
                }
            }
        }
    }

    /// Casts the samples of a tile and blends the result over the existing light.
    fn add_figures(&self, left: usize, top: usize, near: &[&[u32]], light: &mut TileLight) {
        let view = self.shot.view;
        let [width, height] = view.size_px();
        let samples: Vec<TileSample> = self
            .shifts_px
            .iter()
            .enumerate()
            .map(|(i, &shift)| {
                let moment = i * near.len() / self.shifts_px.len();
                let mut hits = Hits::none();
                for y in 0..TILE {
                    let rays = view.row(left, top + y, shift);
                    for &c in near[moment] {
                        let (cast, _) = &self.moments[moment].casts[c as usize];
                        if cast.bound.y[0] <= top + y && top + y < cast.bound.y[1] {
                            cast.row(c, &rays, &mut hits.depth[y], &mut hits.cone[y]);
                        }
                    }
                }
                (moment, shift, hits)
            })
            .collect();
        for (y, row) in light.iter_mut().enumerate().take(height - top) {
            for (x, pixel) in row.iter_mut().enumerate().take(width - left) {
                *pixel = self.mix(&samples, [left, top], [x, y], *pixel);
            }
        }
    }

    /// The mean of a pixel's samples. A surface is shaded once per pixel, for any number of samples
    /// that hit it, except where a face needs its detail.
    fn mix(
        &self,
        samples: &[TileSample],
        [left, top]: [usize; 2],
        [x, y]: [usize; 2],
        behind: [f32; 3],
    ) -> [f32; 3] {
        let mut sum = [0.0; 3];
        let mut last: Option<(ConeOwner, [f32; 3])> = None;
        for (moment, shift, hits) in samples {
            let hit = hits.cone[y][x];
            let seen = if hit == NOTHING {
                behind
            } else {
                let (_, owner) = self.moments[*moment].casts[hit as usize];
                match last {
                    Some((same, light)) if same == owner && !self.has_detail(owner) => light,
                    _ => {
                        let [u, v] = self.shot.view.ray([left + x, top + y], *shift);
                        let ray = Vector3::new(u, v, 1.0);
                        let light = self.shaded(owner, *moment, &(ray * hits.depth[y][x]));
                        last = Some((owner, light));
                        light
                    }
                }
            };
            for c in 0..3 {
                sum[c] += seen[c];
            }
        }
        sum.map(|v| v / samples.len() as f32)
    }

    fn has_detail(&self, owner: ConeOwner) -> bool {
        self.shot.figures[owner.figure as usize].has_detail(owner.cone as usize)
    }

    /// Light from a point of a figure (camera axes).
    fn shaded(&self, owner: ConeOwner, moment: usize, p_c: &Vector3<f32>) -> [f32; 3] {
        let view = self.shot.view;
        let point_m = view.eye_m + view.rotation.tr_mul(&p_c.cast::<f64>());
        let light = self.shot.light;
        let sunlit = |p: &Vector3<f32>| {
            self.shades
                .iter()
                .map(|(shade, _)| shade.sunlit(p, light))
                .fold(1.0, f32::min)
        };
        let figure = &self.shot.figures[owner.figure as usize];
        figure.shaded(moment, owner.cone as usize, point_m, light, sunlit)
    }
}
