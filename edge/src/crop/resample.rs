//! The crop's pixels: undistorted, rotated, scaled, normalised, as a tensor [3, height, width].

use farfield_proto::camera::CameraModel;
use farfield_proto::model_card::{Channels, NetworkInput, Normalize};

use super::geometry::CropGeometry;
use super::rgb::{RgbSampler, SampledRgb};
use super::warp::{Stretch, Warp};
use super::yuv::{SampledYuv, YuvSampler};
use crate::picture::{Picture, Plane};

/// Conversion of pixels to the values of a tensor: (pixel x scale - mean) / std per channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFormat {
    gain: [f32; 3],
    bias: [f32; 3],
    /// The colour (red, green, blue) of each channel of the tensor.
    source: [usize; 3],
    /// The value of unknown pixels per channel.
    unknown: [f32; 3],
}

impl PixelFormat {
    /// Red, green and blue as in a picture, 0 to 255; unknown pixels are 0.
    pub const RGB: Self = Self {
        gain: [1.0; 3],
        bias: [0.0; 3],
        source: [0, 1, 2],
        unknown: [0.0; 3],
    };

    /// The format of a network's card. Unknown pixels get the card's `pad`, or else its mean, which
    /// is 0 in the tensor.
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
/// Each plane of a picture is sampled separately. An enlarged plane is sampled bilinearly. A plane
/// reduced by s is first reduced by the whole factor round(s) (a box filter over the pixels of one
/// input pixel) and then sampled. If the remaining factor is above 1.1, four taps are averaged.
#[derive(Debug, Default)]
pub struct Cropper {
    warp: Warp,
    stretches: Vec<Stretch>,
    rgb: RgbSampler,
    yuv: YuvSampler,
    /// Red, green, blue of a row.
    row: [Vec<f32>; 3],
}

impl Cropper {
    /// Writes the crop as `into`, [3, height, width], the channels in the order of `format`.
    ///
    /// The distortion of `camera` is removed; without a camera the crop is in the picture's own
    /// pixels.
    ///
    /// Cost: one pass over the picture's pixels under the crop and one over the input's.
    ///
    /// # Panics
    /// If `into` is not 3 x width x height of the crop's input.
    pub fn crop(
        &mut self,
        picture: &Picture,
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
        let (step_px, bounds_px) = (crop.step_px(), self.warp.bounds());
        let size_px = picture.size_px().map(f64::from);
        let target = CropTarget {
            warp: &self.warp,
            camera,
            crop,
            format,
            size_px,
            // The mesh has an error of at most one pixel.
            is_inside: bounds_px.is_some_and(|[left, top, right, bottom]| {
                left.min(top) > 1.0 && right < size_px[0] - 2.0 && bottom < size_px[1] - 2.0
            }),
            stretches: &mut self.stretches,
            row: &mut self.row,
            into,
        };
        match picture {
            Picture::Rgb(image) => {
                let plane = Plane::of_rgb(image);
                match self.rgb.sample(&plane, bounds_px, step_px) {
                    Some(sampled) => target.fill_rgb(&sampled),
                    None => target.fill_unknown(),
                }
            }
            Picture::Yuv(picture) => match self.yuv.sample(picture, bounds_px, step_px) {
                Some(sampled) => target.fill_yuv(sampled),
                None => target.fill_unknown(),
            },
        }
    }
}

/// The output of one crop.
struct CropTarget<'a> {
    warp: &'a Warp,
    camera: Option<&'a CameraModel>,
    crop: &'a CropGeometry,
    format: &'a PixelFormat,
    size_px: [f64; 2],
    /// Whether the crop is completely inside the picture.
    is_inside: bool,
    stretches: &'a mut Vec<Stretch>,
    row: &'a mut [Vec<f32>; 3],
    into: &'a mut [f32],
}

impl CropTarget<'_> {
    /// The crop is completely outside the picture.
    fn fill_unknown(self) {
        let [width, height] = self.crop.input_px();
        let planes = self.into.chunks_exact_mut(width * height);
        for (plane, unknown) in planes.zip(self.format.unknown) {
            plane.fill(unknown);
        }
    }

    fn fill_rgb(self, sampled: &SampledRgb<'_>) {
        let [width, height] = self.crop.input_px();
        let PixelFormat {
            gain,
            bias,
            source,
            unknown,
        } = *self.format;
        let size_px = self.size_px;
        let (first, rest) = self.into.split_at_mut(width * height);
        let (second, third) = rest.split_at_mut(width * height);
        for y in 0..height {
            self.warp.row(self.crop, self.camera, y, self.stretches);
            let row = y * width..(y + 1) * width;
            let mut planes = first[row.clone()]
                .iter_mut()
                .zip(&mut second[row.clone()])
                .zip(&mut third[row]);
            sampled.row(self.stretches, |at, rgb| {
                let mut value = unknown;
                if is_inside(at, size_px) {
                    for (i, value) in value.iter_mut().enumerate() {
                        *value = rgb[source[i]] * gain[i] + bias[i];
                    }
                }
                if let Some(((a, b), c)) = planes.next() {
                    [*a, *b, *c] = value;
                }
            });
        }
    }

    fn fill_yuv(self, mut sampled: SampledYuv<'_>) {
        let [width, height] = self.crop.input_px();
        let format = self.format;
        for y in 0..height {
            self.warp.row(self.crop, self.camera, y, self.stretches);
            sampled.row(self.stretches, self.row);
            for channel in 0..3 {
                let into = &mut self.into[(channel * height + y) * width..][..width];
                let (gain, bias) = (format.gain[channel], format.bias[channel]);
                for (into, value) in into.iter_mut().zip(&self.row[format.source[channel]]) {
                    *into = value * gain + bias;
                }
                if !self.is_inside {
                    let positions = self.stretches.iter().flat_map(Stretch::positions);
                    for (into, at) in into.iter_mut().zip(positions) {
                        if !is_inside(at, self.size_px) {
                            *into = format.unknown[channel];
                        }
                    }
                }
            }
        }
    }
}

/// NaN fails every comparison, so positions beyond the lens model count as outside.
fn is_inside([x, y]: [f64; 2], [width, height]: [f64; 2]) -> bool {
    x >= -0.5 && x < width - 0.5 && y >= -0.5 && y < height - 0.5
}

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::BoundingBox;
    use farfield_proto::model_card::CellToInput;

    use image::RgbImage;

    use super::*;
    use crate::crop::CropShape;
    use crate::fixtures::{bent, pinhole};
    use crate::picture::{ColourCoding, YuvLayout, YuvPicture};

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
        Cropper::default().crop(
            &image.clone().into(),
            Some(camera),
            &crop,
            &PLAIN,
            &mut into,
        );
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
                    // A tenth of an input pixel: the mesh of a distorting lens is coarse at this
                    // size.
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

    /// Encodes a picture like a video: one colour value for two by two pixels.
    fn coded(image: &RgbImage, coding: ColourCoding) -> Picture {
        let (width, height) = image.dimensions();
        let [offset, gain] = coding.brightness();
        let mut bytes = Vec::new();
        let brightness = |p: &image::Rgb<u8>| {
            0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2])
        };
        bytes.extend(
            image
                .pixels()
                .map(|p| (brightness(p) / gain + offset).round() as u8),
        );
        let colour_gain = if coding.is_full_range {
            1.0
        } else {
            224.0 / 255.0
        };
        for (channel, scale) in [(2, 1.772), (0, 1.402)] {
            for (y, x) in
                (0..height.div_ceil(2)).flat_map(|y| (0..width.div_ceil(2)).map(move |x| (y, x)))
            {
                let around = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dx, dy)| {
                    let p =
                        image.get_pixel((2 * x + dx).min(width - 1), (2 * y + dy).min(height - 1));
                    (f32::from(p[channel]) - brightness(p)) / scale
                });
                let mean = around.iter().sum::<f32>() / 4.0;
                bytes.push((128.0 + mean * colour_gain).round() as u8);
            }
        }
        let layout = YuvLayout::Planar([2, 2]);
        let picture = YuvPicture::new([width, height], layout, coding, bytes.into());
        Picture::Yuv(picture.unwrap())
    }

    #[test]
    fn a_crop_of_a_video_equals_that_of_its_rgb_picture() {
        // An odd size, and smooth colours, because videos have no sharper ones.
        let image = RgbImage::from_fn(251, 253, |x, y| {
            image::Rgb([x as u8, y as u8, 255 - u32::midpoint(x, y) as u8])
        });
        let full_range = ColourCoding::FULL_RANGE;
        for coding in [ColourCoding::default(), full_range] {
            let coded = coded(&image, coding);
            for (size, rotation_rad) in [
                (40.0, 0.0),
                (48.0, 0.7),
                (62.0, 0.2),
                (90.0, -2.0),
                (230.0, 0.0),
            ] {
                let b = BoundingBox {
                    center_px: [120.0, 130.0],
                    size_px: [size, size],
                    rotation_rad,
                };
                let camera = bent("a", [251, 253]);
                let (crop, expected) = crop_of(&image, &camera, b);
                let mut found = vec![0.0; expected.len()];
                Cropper::default().crop(&coded, Some(&camera), &crop, &PLAIN, &mut found);
                let apart = expected.iter().zip(&found).map(|(a, b)| (a - b).abs());
                let worst = apart.fold(0.0, f32::max);
                // Rounding of luma and chroma to integers, and twice a step at the edges.
                assert!(worst < 6.0, "{size} px: {worst}");
                let mean = expected.iter().zip(&found).map(|(a, b)| a - b).sum::<f32>();
                let mean = mean / expected.len() as f32;
                assert!(mean.abs() < 0.3, "{size} px: {mean}");
            }
        }
    }

    #[test]
    fn a_reduced_crop_is_antialiased() {
        // The finest chequers: every pixel differs from its neighbours. Reduced, they are grey.
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
    fn pixels_outside_the_image_are_unknown() {
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
        Cropper::default().crop(&image.into(), None, &crop, &format, &mut into);
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
