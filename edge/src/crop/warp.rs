//! Source position of each input pixel: from the undistorted crop to the distorted picture.
//!
//! Without distortion the mapping is a similarity transform and is computed exactly. With
//! distortion the lens model is evaluated on a mesh of every [`MESH_STEP`]th pixel and interpolated
//! bilinearly. The error is at most h^2 / 8 of the second derivatives, with the mesh step h in
//! image pixels. It is below 0.05 px for a crop of 1000 px under a lens that moves the image's
//! corner by 100 px (see the test), far below the error of resampling. A fisheye bends more: below
//! 0.2 px for a crop of 1000 px in a picture of 1920, for 192 input pixels.

use farfield_proto::camera::CameraModel;

use super::geometry::CropGeometry;

/// Input pixels between two mesh nodes.
const MESH_STEP: usize = 8;

/// The mapping from input pixels to distorted pixels. Owns its buffers, set up per crop.
#[derive(Debug, Default)]
pub(super) struct Warp {
    /// Distorted positions of the nodes, row by row; NaN beyond the lens model.
    nodes: Vec<[f64; 2]>,
    columns: usize,
    rows: usize,
    step: [usize; 2],
    bent: bool,
    /// Whether the lens model can end inside the picture, as for a fisheye with a limited view.
    ends_within_pictures: bool,
    reach_px: f64,
}

/// Pixels of a row that are sampled along a straight line of the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    pub(super) pixels: usize,
    /// The distorted position of the first pixel; NaN beyond the lens model.
    pub(super) start_px: [f64; 2],
    /// The vector from each pixel to the next.
    pub(super) step_px: [f64; 2],
}

impl Warp {
    /// Prepares the mesh for one crop.
    pub(super) fn prepare(&mut self, crop: &CropGeometry, camera: Option<&CameraModel>) {
        let [width, height] = crop.input_px();
        self.bent = camera.is_some_and(|camera| !camera.lens().is_none());
        self.ends_within_pictures = camera.is_some_and(|camera| camera.lens().is_fisheye());
        // Positions between nodes are at most this far from them: a fisheye contracts.
        self.reach_px = 1.5 * MESH_STEP as f64 * crop.step_px().norm();
        // A similarity transform is bilinear, so its corners suffice.
        self.step = if self.bent {
            [MESH_STEP, MESH_STEP]
        } else {
            [(width - 1).max(1), (height - 1).max(1)]
        };
        self.columns = (width - 1).div_ceil(self.step[0]) + 1;
        self.rows = (height - 1).div_ceil(self.step[1]) + 1;
        self.nodes.clear();
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (x, y) = (column * self.step[0], row * self.step[1]);
                self.nodes.push(self.exact(crop, camera, x, y));
            }
        }
    }

    fn exact(
        &self,
        crop: &CropGeometry,
        camera: Option<&CameraModel>,
        x: usize,
        y: usize,
    ) -> [f64; 2] {
        let undistorted = crop.pixel(x as f64, y as f64);
        let Some(camera) = camera.filter(|_| self.bent) else {
            return [undistorted.x(), undistorted.y()];
        };
        camera
            .distort(undistorted)
            .map_or([f64::NAN; 2], |p| [p.x(), p.y()])
    }

    /// The smallest rectangle around all source positions: left, top, right, bottom in distorted
    /// pixels. `None` if a part of the crop is beyond the lens model; for a fisheye only if all of
    /// it is.
    pub(super) fn bounds(&self) -> Option<[f64; 4]> {
        if self.ends_within_pictures {
            return self.bounds_of_drawn();
        }
        let start = [
            f64::INFINITY,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NEG_INFINITY,
        ];
        self.nodes.iter().try_fold(start, |[l, t, r, b], &[x, y]| {
            (!x.is_nan()).then(|| [l.min(x), t.min(y), r.max(x), b.max(y)])
        })
    }

    fn bounds_of_drawn(&self) -> Option<[f64; 4]> {
        let mut drawn = self.nodes.iter().filter(|[x, _]| !x.is_nan());
        let &[x, y] = drawn.next()?;
        let [l, t, r, b] = drawn.fold([x, y, x, y], |[l, t, r, b], &[x, y]| {
            [l.min(x), t.min(y), r.max(x), b.max(y)]
        });
        let beyond = self.reach_px;
        Some([l - beyond, t - beyond, r + beyond, b + beyond])
    }

    /// Writes the source positions of input row `y`.
    pub(super) fn row(
        &self,
        crop: &CropGeometry,
        camera: Option<&CameraModel>,
        y: usize,
        into: &mut Vec<Stretch>,
    ) {
        into.clear();
        let row = (y / self.step[1]).min(self.rows.saturating_sub(2));
        let v = (y - row * self.step[1]) as f64 / self.step[1] as f64;
        let above = &self.nodes[row * self.columns..][..self.columns];
        let below = &self.nodes[(row + 1).min(self.rows - 1) * self.columns..][..self.columns];
        let node = |i: usize| {
            let (a, b) = (above[i], below[i]);
            [a[0] + v * (b[0] - a[0]), a[1] + v * (b[1] - a[1])]
        };
        let [width, _] = crop.input_px();
        for (i, first) in (0..width).step_by(self.step[0]).enumerate() {
            let pixels = self.step[0].min(width - first);
            let (left, right) = (
                node(i.min(self.columns - 1)),
                node((i + 1).min(self.columns - 1)),
            );
            if left[0].is_nan() || right[0].is_nan() {
                into.extend((first..first + pixels).map(|x| Stretch {
                    pixels: 1,
                    start_px: self.exact(crop, camera, x, y),
                    step_px: [0.0; 2],
                }));
                continue;
            }
            into.push(Stretch {
                pixels,
                start_px: left,
                step_px: [0, 1].map(|k| (right[k] - left[k]) / self.step[0] as f64),
            });
        }
    }
}

impl Stretch {
    /// The source positions of its pixels.
    pub(super) fn positions(&self) -> impl Iterator<Item = [f64; 2]> + use<> {
        let ([x, y], [across, down]) = (self.start_px, self.step_px);
        (0..self.pixels).map(move |j| [x + j as f64 * across, y + j as f64 * down])
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::BoundingBox;
    use farfield_proto::model_card::CellToInput;

    use super::*;
    use crate::crop::CropShape;
    use crate::fixtures::{bent, fisheye, pinhole};

    fn largest_error(camera: &CameraModel, b: BoundingBox) -> f64 {
        let shape = CropShape {
            input_px: [192, 256],
            cells: [48, 64],
            cell_to_input: CellToInput {
                scale: 4.0,
                offset: 0.0,
            },
        };
        let crop = CropGeometry::new(&b, shape).unwrap();
        let mut warp = Warp::default();
        warp.prepare(&crop, Some(camera));
        let mut row = Vec::new();
        let mut worst: f64 = 0.0;
        for y in 0..256 {
            warp.row(&crop, Some(camera), y, &mut row);
            for (x, p) in row.iter().flat_map(Stretch::positions).enumerate() {
                let exact = camera.distort(crop.pixel(x as f64, y as f64)).unwrap();
                worst = worst.max((p[0] - exact.x()).hypot(p[1] - exact.y()));
            }
        }
        worst
    }

    const LARGE: BoundingBox = BoundingBox {
        center_px: [900.0, 600.0],
        size_px: [750.0, 1000.0],
        rotation_rad: 0.3,
    };

    #[test]
    fn a_pinhole_is_followed_exactly() {
        assert!(largest_error(&pinhole("a", [1920, 1200]), LARGE) < 1e-9);
    }

    #[test]
    fn the_mesh_follows_a_bent_lens_to_a_twentieth_of_a_pixel() {
        let error = largest_error(&bent("a", [1920, 1200]), LARGE);
        assert!(error > 1e-6 && error < 0.05, "{error}");
    }

    #[test]
    fn the_mesh_follows_a_fisheye_to_a_fifth_of_a_pixel() {
        let error = largest_error(&fisheye("a", [1920, 1200]), LARGE);
        assert!(error > 1e-6 && error < 0.2, "{error}");
    }

    #[test]
    fn crop_bounds_at_the_rim_of_a_fisheye_contain_all_drawn_pixels() {
        let camera = fisheye("a", [1920, 1200]);
        let b = BoundingBox {
            center_px: [1950.0, 600.0],
            size_px: [500.0, 700.0],
            rotation_rad: 0.2,
        };
        let shape = CropShape {
            input_px: [192, 256],
            cells: [48, 64],
            cell_to_input: CellToInput {
                scale: 4.0,
                offset: 0.0,
            },
        };
        let crop = CropGeometry::new(&b, shape).unwrap();
        let mut warp = Warp::default();
        warp.prepare(&crop, Some(&camera));
        let [left, top, right, bottom] = warp.bounds().unwrap();
        assert!(right - left < 500.0 && bottom - top < 700.0);
        let mut row = Vec::new();
        let (mut drawn, mut unknown) = (0, 0);
        for y in 0..256 {
            warp.row(&crop, Some(&camera), y, &mut row);
            for [x, y] in row.iter().flat_map(Stretch::positions) {
                if x.is_nan() {
                    unknown += 1;
                } else {
                    drawn += 1;
                    assert!((left..right).contains(&x) && (top..bottom).contains(&y));
                }
            }
        }
        assert!(drawn > 1000 && unknown > 1000, "{drawn} {unknown}");
    }
}
