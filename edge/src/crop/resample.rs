//! The crop's pixels: undistorted, rotated, scaled, normalised, as a tensor [3, height, width].

use farfield_proto::camera::CameraModel;
use farfield_proto::model_card::{Channels, NetworkInput, Normalize};
use image::RgbImage;

use super::geometry::CropGeometry;
use super::reduce::{MAX_FACTOR, PixelRegion, Raster, Reducer};
use super::warp::Warp;

/// Texels per input pixel above which one bilinear tap would skip texels, and four are averaged.
const ONE_TAP_MAX: f64 = 1.1;

/// How pixels become the values of a tensor: (pixel x scale - mean) / std per channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFormat {
    gain: [f32; 3],
    bias: [f32; 3],
    /// Which of red, green, blue each channel of the tensor takes.
    source: [usize; 3],
    /// The value of unknown pixels per channel.
    unknown: [f32; 3],
}

impl PixelFormat {
    /// Values as a picture has them, 0 to 255: red, green, blue; unknown pixels are 0.
    pub const RGB: Self = Self {
        gain: [1.0; 3],
        bias: [0.0; 3],
        source: [0, 1, 2],
        unknown: [0.0; 3],
    };

    /// The format that a network's card asks for. Unknown pixels get the card's `pad` where it has
    /// one, else its mean, which is 0 in the tensor.
    pub fn new(input: &NetworkInput, normalize: &Normalize) -> Self {
        let gain = normalize.std.map(|std| normalize.scale / std);
        let bias = [0, 1, 2].map(|c| -normalize.mean[c] / normalize.std[c]);
        let source = match input.channels {
            Channels::Rgb => [0, 1, 2],
            Channels::Bgr => [2, 1, 0],
        };
        let unknown = match input.pad {
            Some(pad) => [0, 1, 2].map(|c| f32::from(pad) * gain[c] + bias[c]),
            None => [0.0; 3],
        };
        Self {
            gain,
            bias,
            source,
            unknown,
        }
    }
}

/// Cuts crops out of pictures. Owns its buffers; keep one per thread.
///
/// A crop that enlarges is sampled bilinearly. One that shrinks by s is first reduced by the
/// whole factor round(s) (a box filter over the pixels that fall on one input pixel), and
/// sampled from that; where the rest is still above 1.1, four taps are averaged.
#[derive(Debug, Default)]
pub struct Cropper {
    warp: Warp,
    reducer: Reducer,
    positions: Vec<[f64; 2]>,
}

/// Where the four taps of an input pixel lie around its centre, in texels.
type Taps = [[f32; 2]; 4];

impl Cropper {
    /// Writes the crop as `into`, [3, height, width], the channels in the order of `format`.
    ///
    /// The lens of `camera` is undone; without a camera the crop is in the picture's own pixels.
    ///
    /// Cost: one pass over the picture's pixels under the crop and one over the input's.
    ///
    /// # Panics
    /// When `into` is not 3 x width x height of the crop's input.
    pub fn crop(
        &mut self,
        image: &RgbImage,
        camera: Option<&CameraModel>,
        crop: &CropGeometry,
        format: &PixelFormat,
        into: &mut [f32],
    ) {
        let [width, height] = crop.input_px();
        assert_eq!(
            into.len(),
            3 * width * height,
            "the tensor must hold the crop"
        );
        self.warp.prepare(crop, camera);
        self.positions.resize(width, [0.0; 2]);
        let step = crop.step_px();
        let factor = (step.norm().round() as usize).clamp(1, MAX_FACTOR);
        let region = match self.warp.bounds() {
            // A margin of two texels, so that no block in use is a partial one.
            Some(bounds) => PixelRegion::around(bounds, 2.0 * factor as f64, image),
            None => Some(PixelRegion::whole(image)),
        };
        let Some(region) = region else {
            for (channel, plane) in into.chunks_exact_mut(width * height).enumerate() {
                plane.fill(format.unknown[channel]);
            }
            return;
        };
        let (warp, positions) = (&self.warp, &mut self.positions);
        let mut target = CropTarget {
            warp,
            camera,
            crop,
            format,
            positions,
            into,
        };
        if factor == 1 {
            let raster = Raster {
                texels: image.as_raw().as_slice(),
                width: image.width() as usize,
                height: image.height() as usize,
                origin_px: [0.0; 2],
                factor: 1.0,
            };
            target.fill(&raster, image);
        } else {
            target.fill(&self.reducer.reduce(image, region, factor), image);
        }
    }
}

/// One crop in the making.
struct CropTarget<'a> {
    warp: &'a Warp,
    camera: Option<&'a CameraModel>,
    crop: &'a CropGeometry,
    format: &'a PixelFormat,
    positions: &'a mut [[f64; 2]],
    into: &'a mut [f32],
}

impl CropTarget<'_> {
    fn fill<T: Copy + Into<f32>>(&mut self, raster: &Raster<'_, T>, image: &RgbImage) {
        let [width, height] = self.crop.input_px();
        let step = self.crop.step_px() / f64::from(raster.factor);
        if step.norm() > ONE_TAP_MAX {
            let (u, v) = (step.x as f32 / 4.0, step.y as f32 / 4.0);
            let taps = [
                [u - v, v + u],
                [u + v, v - u],
                [-u - v, u - v],
                [v - u, -v - u],
            ];
            self.rows(raster, image, width, height, |r, x, y| {
                four_taps(r, &taps, x, y)
            });
        } else {
            self.rows(raster, image, width, height, bilinear);
        }
    }

    fn rows<T: Copy + Into<f32>>(
        &mut self,
        raster: &Raster<'_, T>,
        image: &RgbImage,
        width: usize,
        height: usize,
        sample: impl Fn(&Raster<'_, T>, f32, f32) -> [f32; 3],
    ) {
        let (right, bottom) = (
            f64::from(image.width()) - 0.5,
            f64::from(image.height()) - 0.5,
        );
        let per_px = 1.0 / raster.factor;
        let [left, top] = raster.origin_px.map(f64::from);
        let PixelFormat {
            gain,
            bias,
            source,
            unknown,
        } = *self.format;
        let (first, rest) = self.into.split_at_mut(width * height);
        let (second, third) = rest.split_at_mut(width * height);
        for y in 0..height {
            self.warp.row(self.crop, self.camera, y, self.positions);
            let row = y * width..(y + 1) * width;
            let planes = first[row.clone()]
                .iter_mut()
                .zip(&mut second[row.clone()])
                .zip(&mut third[row]);
            for (&[px, py], ((a, b), c)) in self.positions.iter().zip(planes) {
                // NaN fails every comparison: beyond the lens model is outside too.
                let inside = px >= -0.5 && px < right && py >= -0.5 && py < bottom;
                let value = if inside {
                    let rgb = sample(
                        raster,
                        (px - left) as f32 * per_px,
                        (py - top) as f32 * per_px,
                    );
                    [0, 1, 2].map(|i| rgb[source[i]] * gain[i] + bias[i])
                } else {
                    unknown
                };
                [*a, *b, *c] = value;
            }
        }
    }
}

fn four_taps<T: Copy + Into<f32>>(raster: &Raster<'_, T>, taps: &Taps, x: f32, y: f32) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for [dx, dy] in taps {
        let rgb = bilinear(raster, x + dx, y + dy);
        for (s, v) in sum.iter_mut().zip(rgb) {
            *s += 0.25 * v;
        }
    }
    sum
}

/// The raster at (`x`, `y`) texels; its border goes on outside.
#[inline]
fn bilinear<T: Copy + Into<f32>>(raster: &Raster<'_, T>, x: f32, y: f32) -> [f32; 3] {
    let x = x.clamp(0.0, (raster.width - 1) as f32);
    let y = y.clamp(0.0, (raster.height - 1) as f32);
    let (x0, y0) = (x as usize, y as usize);
    let (u, v) = (x - x0 as f32, y - y0 as f32);
    let right = if x0 + 1 < raster.width { 3 } else { 0 };
    let below = if y0 + 1 < raster.height {
        3 * raster.width
    } else {
        0
    };
    let at = 3 * (y0 * raster.width + x0);
    // One bound check for all twelve loads.
    let window = &raster.texels[at..=at + below + right + 2];
    [0, 1, 2].map(|c| {
        let (a, b): (f32, f32) = (window[c].into(), window[c + right].into());
        let (d, e): (f32, f32) = (window[c + below].into(), window[c + below + right].into());
        let (upper, lower) = (a + u * (b - a), d + u * (e - d));
        upper + v * (lower - upper)
    })
}

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::BoundingBox;
    use farfield_proto::model_card::CellToInput;

    use super::*;
    use crate::crop::CropShape;
    use crate::fixtures::{bent, pinhole};

    const PLAIN: PixelFormat = PixelFormat {
        gain: [1.0; 3],
        bias: [0.0; 3],
        source: [0, 1, 2],
        unknown: [-1.0; 3],
    };

    fn crop_of(image: &RgbImage, camera: &CameraModel, b: BoundingBox) -> (CropGeometry, Vec<f32>) {
        let shape = CropShape {
            input_px: [48, 64],
            cells: [12, 16],
            cell_to_input: CellToInput {
                scale: 4.0,
                offset: 1.5,
            },
        };
        let crop = CropGeometry::new(&b, shape).unwrap();
        let mut into = vec![0.0; 3 * 48 * 64];
        Cropper::default().crop(image, Some(camera), &crop, &PLAIN, &mut into);
        (crop, into)
    }

    /// A picture whose red is its column and whose green is its row.
    fn ramp(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 0]))
    }

    #[test]
    fn an_upright_crop_of_its_own_size_is_the_picture() {
        let image = ramp(200, 200);
        let b = BoundingBox {
            center_px: [80.5, 90.5],
            size_px: [48.0, 64.0],
            rotation_rad: 0.0,
        };
        let (_, tensor) = crop_of(&image, &pinhole("a", [200, 200]), b);
        assert!((tensor[0] - 57.0).abs() < 1e-3 && (tensor[48 * 64] - 59.0).abs() < 1e-3);
        assert!((tensor[48 * 64 - 1] - 104.0).abs() < 1e-3);
    }

    #[test]
    fn every_crop_shows_the_picture_where_its_geometry_says() {
        let image = ramp(250, 250);
        for camera in [pinhole("a", [250, 250]), bent("a", [250, 250])] {
            for (size, rotation_rad) in [
                (40.0, 0.0),
                (40.0, 0.7),
                (90.0, -2.0),
                (140.0, 0.3),
                (180.0, 0.0),
            ] {
                let b = BoundingBox {
                    center_px: [120.0, 130.0],
                    size_px: [size, size],
                    rotation_rad,
                };
                let (crop, tensor) = crop_of(&image, &camera, b);
                for (x, y) in [(0, 0), (47, 3), (20, 40), (33, 63)] {
                    let p = camera
                        .distort(crop.pixel(f64::from(x), f64::from(y)))
                        .unwrap();
                    let at = (y * 48 + x) as usize;
                    let inside = camera.sees(crop.pixel(f64::from(x), f64::from(y)));
                    let near = p.x().min(p.y()).min(249.0 - p.x()).min(249.0 - p.y());
                    // A tenth of an input pixel: the mesh of a bent lens is coarse at this size.
                    let tolerance = 0.1 * crop.step_px().norm().max(1.0);
                    if inside && near > 8.0 {
                        let (column, row) = (tensor[at], tensor[48 * 64 + at]);
                        assert!((f64::from(column) - p.x()).abs() < tolerance);
                        assert!((f64::from(row) - p.y()).abs() < tolerance);
                    }
                    assert_eq!(tensor[at] < 0.0, !inside);
                }
            }
        }
    }

    #[test]
    fn a_crop_that_shrinks_is_antialiased() {
        // The finest chequers: every pixel differs from its neighbours. Shrunk, they are grey.
        let image = RgbImage::from_fn(1000, 1000, |x, y| {
            image::Rgb([if (x + y) % 2 == 0 { 255 } else { 0 }; 3])
        });
        for (height, rotation_rad) in [
            (128.0, 0.0),
            (150.0, 0.0),
            (200.0, 0.4),
            (420.0, 0.0),
            (600.0, 1.0),
        ] {
            let b = BoundingBox {
                center_px: [500.3, 500.1],
                size_px: [10.0, height],
                rotation_rad,
            };
            let (_, tensor) = crop_of(&image, &pinhole("a", [1000, 1000]), b);
            let worst = tensor.iter().map(|v| (v - 127.5).abs()).fold(0.0, f32::max);
            assert!(worst < 30.0, "{height} px: {worst}");
        }
    }

    #[test]
    fn what_lies_outside_the_image_is_unknown() {
        let image = RgbImage::from_pixel(100, 100, image::Rgb([200; 3]));
        let b = BoundingBox {
            center_px: [0.0, 50.0],
            size_px: [48.0, 64.0],
            rotation_rad: 0.0,
        };
        let (_, tensor) = crop_of(&image, &pinhole("a", [100, 100]), b);
        let row = &tensor[48 * 30..48 * 31];
        assert!(row[..23].iter().all(|&v| v < 0.0) && row[25..].iter().all(|&v| v > 0.0));
        let b = BoundingBox {
            center_px: [-900.0, 50.0],
            ..b
        };
        let (_, tensor) = crop_of(&image, &pinhole("a", [100, 100]), b);
        assert!(tensor.iter().all(|&v| v < 0.0));
    }

    #[test]
    fn channels_are_normalised_in_the_order_of_the_card() {
        let input = NetworkInput {
            name: "x".into(),
            width: 48,
            height: 64,
            channels: Channels::Bgr,
            letterbox: None,
            pad: None,
        };
        let normalize = Normalize {
            scale: 1.0,
            mean: [10.0, 20.0, 30.0],
            std: [2.0, 4.0, 5.0],
        };
        let format = PixelFormat::new(&input, &normalize);
        let image = RgbImage::from_pixel(100, 100, image::Rgb([100, 120, 140]));
        let shape = CropShape::of_grid([48, 64]);
        let b = BoundingBox {
            center_px: [0.0, 50.0],
            size_px: [48.0, 64.0],
            rotation_rad: 0.0,
        };
        let crop = CropGeometry::new(&b, shape).unwrap();
        let mut into = vec![9.0; 3 * 48 * 64];
        Cropper::default().crop(&image, None, &crop, &format, &mut into);
        let last = 48 * 64 - 1;
        let at = |c: usize| into[c * 48 * 64 + last];
        assert!(
            (at(0) - 65.0).abs() < 1e-3
                && (at(1) - 25.0).abs() < 1e-3
                && (at(2) - 14.0).abs() < 1e-3
        );
        assert!(
            into[0].abs() < 1e-6 && into[48 * 64].abs() < 1e-6,
            "the card's mean is 0"
        );
    }
}
