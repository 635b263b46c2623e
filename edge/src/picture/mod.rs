//! Pictures as stored by their sources. Colours are converted only for crops, never for a whole
//! picture.

mod colour;
mod pool;
mod yuv;

use image::{GrayImage, RgbImage};

pub(crate) use colour::YuvToRgb;
pub use colour::{ColourCoding, ColourMatrix};
pub use pool::{BufferPool, PooledBytes};
pub use yuv::{YuvLayout, YuvPicture};

/// A picture with the distortion of its lens.
#[derive(Debug, Clone, PartialEq)]
pub enum Picture {
    /// Red, green, blue.
    Rgb(RgbImage),
    /// Luma, usually with separate chroma, as in videos.
    Yuv(YuvPicture),
}

/// A part of a picture with values side by side, N per texel, row by row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane<'a, const N: usize> {
    pub(crate) texels: &'a [u8],
    /// Width and height, texels.
    pub(crate) size: [usize; 2],
    /// Pixels of the picture across and down per texel, which is in their middle.
    pub(crate) spacing_px: [usize; 2],
}

impl<'a> Plane<'a, 3> {
    pub(crate) fn of_rgb(image: &'a RgbImage) -> Self {
        Self {
            texels: image.as_raw(),
            size: [image.width() as usize, image.height() as usize],
            spacing_px: [1; 2],
        }
    }
}

impl<const N: usize> Plane<'_, N> {
    /// The pixel of the picture at texel (0, 0).
    pub(crate) fn origin_px(&self) -> [f64; 2] {
        self.spacing_px.map(|px| (px as f64 - 1.0) / 2.0)
    }
}

impl From<RgbImage> for Picture {
    fn from(image: RgbImage) -> Self {
        Self::Rgb(image)
    }
}

impl Picture {
    /// Width and height, pixels.
    pub fn size_px(&self) -> [u32; 2] {
        match self {
            Self::Rgb(image) => [image.width(), image.height()],
            Self::Yuv(picture) => picture.size_px(),
        }
    }

    /// The whole picture in RGB.
    pub fn into_rgb(self) -> RgbImage {
        match self {
            Self::Rgb(image) => image,
            Self::Yuv(picture) => picture.to_rgb(),
        }
    }

    /// Its brightness, 0 black to 255 white.
    pub fn to_grey(&self) -> GrayImage {
        match self {
            Self::Rgb(image) => image::imageops::grayscale(image),
            Self::Yuv(picture) => picture.to_grey(),
        }
    }

    /// Bytes that distinguish two pictures of a source. With the returned offset and gain, (mean -
    /// offset) x gain is the brightness, 0 to 255.
    pub fn sample_bytes(&self) -> (&[u8], [f64; 2]) {
        let (bytes, coding) = match self {
            Self::Rgb(image) => (&image.as_raw()[..], ColourCoding::FULL_RANGE),
            Self::Yuv(picture) => (picture.brightness(), picture.coding()),
        };
        (bytes, coding.brightness().map(f64::from))
    }
}
