//! A small picture of a camera for people: without distortion, as a JPEG file of limited size.

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::message::thumbnail::MAX_THUMBNAIL_PX;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::crop::{CropGeometry, CropShape, Cropper, PixelFormat};
use crate::picture::Picture;

/// Longer side, pixels, and JPEG qualities (1 to 100), from the best thumbnail to the smallest.
const SIZES: [(u16, &[u8]); 4] = [
    (MAX_THUMBNAIL_PX, &[60, 40]),
    (240, &[40]),
    (160, &[40, 25]),
    (112, &[25]),
];
/// No camera gives a thumbnail in fewer bytes.
pub const MIN_THUMBNAIL_BYTES: usize = 700;

/// Makes thumbnails. Owns its buffers.
#[derive(Debug, Default)]
pub struct ThumbnailMaker {
    cropper: Cropper,
    values: Vec<f32>,
    pixels: Vec<u8>,
}

impl ThumbnailMaker {
    /// The `picture` of `camera` as a JPEG file of at most `most_bytes`, in the best possible
    /// quality; `None` if none fits.
    ///
    /// It shows the camera's whole undistorted image; pixels beyond the lens model are black.
    ///
    /// Cost: one pass over the picture for each size that is tried.
    pub fn make(
        &mut self,
        picture: &Picture,
        camera: &CameraModel,
        most_bytes: usize,
    ) -> Option<Vec<u8>> {
        if most_bytes < MIN_THUMBNAIL_BYTES {
            return None;
        }
        for (longest_px, qualities) in SIZES {
            let size_px = self.shrink(picture, camera, longest_px)?;
            for &quality in qualities {
                let file = self.encode(size_px, quality)?;
                if file.len() <= most_bytes {
                    return Some(file);
                }
            }
        }
        None
    }

    /// Writes the undistorted image, with a longer side of at most `longest_px`, into `pixels`;
    /// returns its width and height.
    fn shrink(
        &mut self,
        picture: &Picture,
        camera: &CameraModel,
        longest_px: u16,
    ) -> Option<[u16; 2]> {
        let [width, height] = camera.size_px().map(|side| side as f32);
        let scale = (f32::from(longest_px) / width.max(height)).min(1.0);
        let side = |px: f32| ((px * scale).round() as u16).max(1);
        let size_px = [side(width), side(height)];
        let whole = BoundingBox {
            center_px: [(width - 1.0) / 2.0, (height - 1.0) / 2.0],
            size_px: [width, height],
            rotation_rad: 0.0,
        };
        let shape = CropShape::without_maps(size_px.map(usize::from));
        let crop = CropGeometry::new(&whole, shape)?;
        let n_pixels = usize::from(size_px[0]) * usize::from(size_px[1]);
        self.values.resize(3 * n_pixels, 0.0);
        let values = &mut self.values[..];
        self.cropper
            .crop(picture, Some(camera), &crop, &PixelFormat::RGB, values);
        self.pixels.resize(3 * n_pixels, 0);
        for (channel, plane) in self.values.chunks_exact(n_pixels).enumerate() {
            let into = self.pixels.iter_mut().skip(channel).step_by(3);
            for (pixel, value) in into.zip(plane) {
                *pixel = value.round() as u8;
            }
        }
        Some(size_px)
    }

    fn encode(&self, [width, height]: [u16; 2], quality: u8) -> Option<Vec<u8>> {
        let mut file = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut file, quality);
        let (width, height) = (width.into(), height.into());
        let encoded = encoder.encode(&self.pixels, width, height, ExtendedColorType::Rgb8);
        encoded.ok().map(|()| file)
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Pixel;
    use farfield_proto::message::thumbnail::{MAX_THUMBNAIL_BYTES, Thumbnail};
    use farfield_proto::wire::Message as _;
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::fixtures::{bent, pinhole};

    /// Grey with noise, which is hard to compress, and a red square of 200 x 200 pixels around
    /// `at`.
    fn picture(size: [u32; 2], at: [u32; 2]) -> Picture {
        let mut state = 7u32;
        let image = RgbImage::from_fn(size[0], size[1], |x, y| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (state >> 26) as u8;
            if x.abs_diff(at[0]) < 100 && y.abs_diff(at[1]) < 100 {
                Rgb([230, noise, noise])
            } else {
                Rgb([90 + noise, 90 + noise, 90 + noise])
            }
        });
        image.into()
    }

    fn thumbnail(file: Vec<u8>) -> Thumbnail {
        Thumbnail {
            session: farfield_proto::id::SessionId(1),
            tick: farfield_proto::tick::Tick(1),
            viewpoint: farfield_proto::id::ViewpointIndex(0),
            camera: farfield_proto::id::CameraIndex(0),
            jpeg: file,
        }
    }

    /// The centre of the red pixels.
    fn middle_of_red(image: &RgbImage) -> [f64; 2] {
        let red = image
            .enumerate_pixels()
            .filter(|(_, _, p)| p[0] > 160 && p[1] < 110);
        let (sum, n) = red.fold(([0.0; 2], 0.0), |([x, y], n), (px, py, _)| {
            ([x + f64::from(px), y + f64::from(py)], n + 1.0)
        });
        sum.map(|s| s / n)
    }

    #[test]
    fn a_thumbnail_shows_the_undistorted_image() {
        let size = [1280, 720];
        for camera in [pinhole("a", size), bent("a", size)] {
            let seen = Pixel::new(1000.0, 200.0);
            let drawn = camera.distort(seen).unwrap();
            let image = picture(size, [drawn.x() as u32, drawn.y() as u32]);
            let file = ThumbnailMaker::default().make(&image, &camera, MAX_THUMBNAIL_BYTES);
            let file = file.unwrap();
            let shown = image::load_from_memory(&file).unwrap().into_rgb8();
            assert_eq!(shown.dimensions(), (320, 180));
            let [x, y] = middle_of_red(&shown);
            assert!((x - 250.0).abs() < 2.0 && (y - 50.0).abs() < 2.0, "{x} {y}");
            thumbnail(file).check().unwrap();
        }
    }

    #[test]
    fn fewer_bytes_give_a_smaller_thumbnail_or_none() {
        let size = [1920, 1080];
        let (camera, image) = (pinhole("a", size), picture(size, [900, 500]));
        let mut maker = ThumbnailMaker::default();
        let mut last = MAX_THUMBNAIL_BYTES;
        for most in [20_000, 5_000, 2_000, 1_300] {
            let file = maker.make(&image, &camera, most).unwrap();
            assert!(
                file.len() <= most && file.len() <= last,
                "{most}: {}",
                file.len()
            );
            last = file.len();
            thumbnail(file).check().unwrap();
        }
        let whole = maker.make(&image, &camera, MAX_THUMBNAIL_BYTES).unwrap();
        assert!(last < whole.len(), "{last}");
        assert_eq!(maker.make(&image, &camera, MIN_THUMBNAIL_BYTES - 1), None);
        assert_eq!(maker.make(&image, &camera, 0), None);
    }

    #[test]
    fn a_small_or_upright_picture_is_not_enlarged() {
        for (size, expected) in [([64, 48], (64, 48)), ([720, 1280], (180, 320))] {
            let (camera, image) = (pinhole("a", size), picture(size, [30, 20]));
            let file = ThumbnailMaker::default().make(&image, &camera, MAX_THUMBNAIL_BYTES);
            let shown = image::load_from_memory(&file.unwrap()).unwrap();
            assert_eq!((shown.width(), shown.height()), expected);
        }
    }
}
