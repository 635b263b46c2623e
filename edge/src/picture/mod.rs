//! Pictures as their sources store them. Colours are converted where a crop needs them, never in a whole picture.

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
    /// Brightness, and mostly colour apart from it, as videos are coded.
    Yuv(YuvPicture),
}

/// A part of a picture in which values lie side by side, N a texel, row by row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane<'a, const N: usize> {
    pub(crate) texels: &'a [u8],
    /// Width and height, texels.
    pub(crate) size: [usize; 2],
    /// Pixels of the picture across and down for each texel, which lies in their middle.
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
    /// The pixel of the picture on which texel (0, 0) lies.
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

    /// All of it in red, green, blue.
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

    /// Bytes by which two pictures of a source are told apart; (mean - first) x second is how bright they are, 0 to 255.
    pub fn telling_bytes(&self) -> (&[u8], [f64; 2]) {
        let (bytes, coding) = match self {
            Self::Rgb(image) => (&image.as_raw()[..], ColourCoding::FULL_RANGE),
            Self::Yuv(picture) => (picture.brightness(), picture.coding()),
        };
        (bytes, coding.brightness().map(f64::from))
    }
}
