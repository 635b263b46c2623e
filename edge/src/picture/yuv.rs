//! Pictures with luma and chroma in separate planes.

use image::{GrayImage, RgbImage};

use super::Plane;
use super::colour::ColourCoding;
use super::pool::PooledBytes;

/// The planes of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum YuvLayout {
    /// Luma only.
    Grey,
    /// Luma, then two planes of chroma, each with one value for this many pixels across and down,
    /// centred among them.
    Planar([u8; 2]),
}

/// A picture of byte planes, one after the other, each row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct YuvPicture {
    size_px: [u32; 2],
    layout: YuvLayout,
    coding: ColourCoding,
    bytes: PooledBytes,
}

/// The planes of a picture.
pub(crate) struct YuvPlanes<'a> {
    pub(crate) brightness: Plane<'a, 1>,
    /// U (blue) and V (red); `None` for grey pictures.
    pub(crate) colour: Option<[Plane<'a, 1>; 2]>,
}

impl YuvLayout {
    /// Bytes of a picture of that size.
    pub fn n_bytes(self, size_px: [u32; 2]) -> usize {
        let brightness = size_px[0] as usize * size_px[1] as usize;
        let [width, height] = self.colour_size(size_px);
        brightness + 2 * width * height
    }

    fn spacing_px(self) -> [usize; 2] {
        match self {
            Self::Grey => [1; 2],
            Self::Planar(spacing) => spacing.map(|px| usize::from(px).max(1)),
        }
    }

    /// Width and height of a chroma plane.
    fn colour_size(self, [width, height]: [u32; 2]) -> [usize; 2] {
        let [across, down] = self.spacing_px();
        match self {
            Self::Grey => [0; 2],
            Self::Planar(_) => [
                (width as usize).div_ceil(across),
                (height as usize).div_ceil(down),
            ],
        }
    }
}

impl YuvPicture {
    /// A picture of these bytes; `None` if their number does not match the layout.
    pub fn new(
        size_px: [u32; 2],
        layout: YuvLayout,
        coding: ColourCoding,
        bytes: PooledBytes,
    ) -> Option<Self> {
        (bytes.len() == layout.n_bytes(size_px)).then_some(Self {
            size_px,
            layout,
            coding,
            bytes,
        })
    }

    /// Width and height, pixels.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Interpretation of its values.
    pub fn coding(&self) -> ColourCoding {
        self.coding
    }

    /// The plane of luma.
    pub fn brightness(&self) -> &[u8] {
        &self.bytes[..self.size_px[0] as usize * self.size_px[1] as usize]
    }

    pub(crate) fn planes(&self) -> YuvPlanes<'_> {
        let brightness = self.brightness();
        let rest = &self.bytes[brightness.len()..];
        let (u, v) = rest.split_at(rest.len() / 2);
        let colour = |texels| Plane {
            texels,
            size: self.layout.colour_size(self.size_px),
            spacing_px: self.layout.spacing_px(),
        };
        YuvPlanes {
            brightness: Plane {
                texels: brightness,
                size: self.size_px.map(|side| side as usize),
                spacing_px: [1; 2],
            },
            colour: (self.layout != YuvLayout::Grey).then(|| [u, v].map(colour)),
        }
    }

    /// The whole picture in RGB; chroma is not interpolated.
    pub fn to_rgb(&self) -> RgbImage {
        let YuvPlanes { brightness, colour } = self.planes();
        let coding = self.coding.to_rgb();
        RgbImage::from_fn(self.size_px[0], self.size_px[1], |x, y| {
            let value = |plane: &Plane<'_, 1>| {
                let [across, down] = plane.spacing_px;
                let at = y as usize / down * plane.size[0] + x as usize / across;
                f32::from(plane.texels[at])
            };
            let [u, v] = colour.map_or([128.0; 2], |planes| [value(&planes[0]), value(&planes[1])]);
            let rgb = coding.rgb(value(&brightness), u, v);
            image::Rgb(rgb.map(|it| (it + 0.5) as u8))
        })
    }

    /// Its brightness, 0 black to 255 white.
    pub fn to_grey(&self) -> GrayImage {
        let [offset, gain] = self.coding.brightness();
        let grey = |&value: &u8| ((f32::from(value) - offset) * gain + 0.5) as u8;
        let values: Vec<u8> = self.brightness().iter().map(grey).collect();
        let [width, height] = self.size_px;
        GrayImage::from_raw(width, height, values).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_odd_size_has_colour_up_to_its_edges() {
        let layout = YuvLayout::Planar([2, 2]);
        assert_eq!(layout.n_bytes([3, 3]), 9 + 2 * 4);
        let mut bytes = vec![100; 9];
        // Neutral chroma, except for red at the lower right.
        bytes.extend([128, 128, 128, 90]);
        bytes.extend([128, 128, 128, 240]);
        let coding = ColourCoding::default();
        let picture = YuvPicture::new([3, 3], layout, coding, bytes.into()).unwrap();
        let rgb = picture.to_rgb();
        assert_eq!(rgb.get_pixel(0, 0).0, [98; 3]);
        let red = rgb.get_pixel(2, 2).0;
        assert!(red[0] == 255 && red[1] < 40, "{red:?}");
        assert_eq!(picture.to_grey().get_pixel(2, 2).0, [98]);
    }

    #[test]
    fn a_wrong_number_of_bytes_is_no_picture() {
        let of = |n| {
            let (layout, coding) = (YuvLayout::Grey, ColourCoding::FULL_RANGE);
            YuvPicture::new([4, 2], layout, coding, vec![7; n].into())
        };
        assert!(of(8).is_some() && of(7).is_none() && of(9).is_none());
        assert_eq!(of(8).unwrap().to_rgb().get_pixel(3, 1).0, [7; 3]);
    }
}
