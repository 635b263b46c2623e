//! Changes of an image between the scene and the network: occluders, lens, sensor and codec.

use std::ops::Range;

use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
use image::{DynamicImage, ImageDecoder as _, Rgb, RgbImage};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

/// An object in front of the people: a plain disc or beam, in image pixels.
pub(crate) struct Occluder {
    center_px: [f32; 2],
    /// Half lengths along its own axes.
    half_px: [f32; 2],
    axis: [f32; 2],
    round: bool,
    color: [u8; 3],
}

impl Occluder {
    /// A random object of 5 to 25 % of the image.
    pub(crate) fn draw(size_px: [u32; 2], rng: &mut ChaCha8Rng) -> Self {
        let size = size_px.map(|side| side as f32);
        let extent = size[0].max(size[1]);
        let round = rng.random_bool(0.4);
        let half = extent * rng.random_range(0.03..0.13);
        let long = if round {
            1.3
        } else {
            rng.random_range(1.0..8.0)
        };
        let angle: f32 = rng.random_range(0.0..std::f32::consts::PI);
        Self {
            center_px: size.map(|side| side * rng.random_range(0.1..0.9)),
            half_px: [half * long, half],
            axis: [angle.cos(), angle.sin()],
            round,
            color: rng.random(),
        }
    }

    pub(crate) fn covers(&self, x: f32, y: f32) -> bool {
        let [dx, dy] = [x - self.center_px[0], y - self.center_px[1]];
        let along = (dx * self.axis[0] + dy * self.axis[1]) / self.half_px[0];
        let across = (dy * self.axis[0] - dx * self.axis[1]) / self.half_px[1];
        if self.round {
            along * along + across * across < 1.0
        } else {
            along.abs() < 1.0 && across.abs() < 1.0
        }
    }

    pub(crate) fn paint(&self, picture: &mut RgbImage) {
        for (x, y, pixel) in picture.enumerate_pixels_mut() {
            if self.covers(x as f32, y as f32) {
                *pixel = Rgb(self.color);
            }
        }
    }
}

/// The image as a real camera might have taken it, blurred by up to `blur_px`.
pub(crate) fn taken(picture: RgbImage, blur_px: Range<f32>, rng: &mut ChaCha8Rng) -> RgbImage {
    let blurred = if rng.random_bool(0.4) {
        image::imageops::fast_blur(&picture, rng.random_range(blur_px))
    } else {
        picture
    };
    let moved = if rng.random_bool(0.15) {
        smeared(&blurred, rng)
    } else {
        blurred
    };
    let lit = with_noise(moved, rng);
    if rng.random_bool(0.3) {
        compressed(lit, rng.random_range(35..90))
    } else {
        lit
    }
}

/// Motion blur of the camera: the mean along a short line.
fn smeared(picture: &RgbImage, rng: &mut ChaCha8Rng) -> RgbImage {
    const TAPS: i32 = 5;
    let angle: f32 = rng.random_range(0.0..std::f32::consts::TAU);
    let length = 0.02 * picture.height() as f32 * rng.random_range(0.2..1.0);
    let shift = |tap: i32| {
        let s = length * (tap as f32 / TAPS as f32 - 0.5);
        [
            (s * angle.cos()).round() as i32,
            (s * angle.sin()).round() as i32,
        ]
    };
    let last = [picture.width(), picture.height()].map(|side| side.cast_signed() - 1);
    RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
        let mut sum = [0; 3];
        for [dx, dy] in (0..TAPS).map(shift) {
            let (x, y) = (
                (x.cast_signed() + dx).clamp(0, last[0]),
                (y.cast_signed() + dy).clamp(0, last[1]),
            );
            let Rgb(tap) = picture.get_pixel(x.cast_unsigned(), y.cast_unsigned());
            sum = std::array::from_fn(|c| sum[c] + i32::from(tap[c]));
        }
        Rgb(sum.map(|s| (s / TAPS) as u8))
    })
}

/// Exposure, contrast, white balance and sensor noise.
fn with_noise(mut picture: RgbImage, rng: &mut ChaCha8Rng) -> RgbImage {
    let gain: f32 = rng.random_range(0.7..1.3);
    let balance: [f32; 3] = std::array::from_fn(|_| gain * rng.random_range(0.9..1.1));
    let offset = rng.random_range(-20.0..20.0_f32);
    let noise: f32 = if rng.random_bool(0.6) {
        rng.random_range(0.5..9.0)
    } else {
        0.0
    };
    for Rgb(pixel) in picture.pixels_mut() {
        // Four bytes make a nearly normal draw.
        let bytes: [[u8; 4]; 3] = if noise > 0.0 {
            rng.random()
        } else {
            [[0; 4]; 3]
        };
        for c in 0..3 {
            let draw = bytes[c].iter().map(|&b| f32::from(b)).sum::<f32>() / 147.8 - 3.45;
            let grain = if noise > 0.0 { draw * noise } else { 0.0 };
            pixel[c] = (f32::from(pixel[c]) * balance[c] + offset + grain).clamp(0.0, 255.0) as u8;
        }
    }
    picture
}

/// Through JPEG and back; unchanged if the codec fails.
fn compressed(picture: RgbImage, quality: u8) -> RgbImage {
    let mut file = Vec::new();
    let (width, height) = picture.dimensions();
    if JpegEncoder::new_with_quality(&mut file, quality)
        .encode_image(&picture)
        .is_err()
    {
        return picture;
    }
    let Ok(decoder) = JpegDecoder::new(std::io::Cursor::new(&file)) else {
        return picture;
    };
    if decoder.dimensions() != (width, height) {
        return picture;
    }
    DynamicImage::from_decoder(decoder).map_or(picture, |back| back.to_rgb8())
}
