//! The pixel formats of kernel cameras and their decoding.

use image::{ImageFormat, RgbImage};
use v4l::format::{Colorspace, Quantization};
use v4l::{Format, FourCC};

use crate::picture::{BufferPool, ColourCoding, ColourMatrix, Picture, YuvLayout, YuvPicture};

/// A pixel format: its kernel name and the layout of its values.
pub(super) struct PixelFormat {
    /// Three or four letters.
    pub(super) name: &'static str,
    arrangement: Arrangement,
}

impl PixelFormat {
    /// The kernel's name, padded with blanks to four letters.
    pub(super) fn fourcc(&self) -> FourCC {
        let mut letters = [b' '; 4];
        for (letter, byte) in letters.iter_mut().zip(self.name.bytes()) {
            *letter = byte;
        }
        FourCC::new(&letters)
    }
}

/// Layout of the values of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Arrangement {
    /// Luma, then pairs of U and V, one pair per two by two pixels.
    SemiPlanar,
    /// Luma, then U, then V, each with one value per two by two pixels.
    Planar,
    /// Pairs of pixels with one U and V; luma is the first or the second byte of each two.
    Pairs { brightness: usize },
    /// Red, green and blue in this order of bytes.
    Rgb([usize; 3]),
    /// A JPEG file.
    Jpeg,
    /// Luma with this number of bits.
    Grey { bits: u8 },
    /// A colour mosaic: one colour per pixel, of this number of bits.
    Mosaic { colours: MosaicColours, bits: u8 },
}

/// The colour that each pixel of a sensor measures, red (0), green (1) or blue (2): `[row %
/// 2][column % 2]`.
type MosaicColours = [[usize; 2]; 2];

const RGGB: MosaicColours = [[0, 1], [1, 2]];
const GRBG: MosaicColours = [[1, 0], [2, 1]];
const GBRG: MosaicColours = [[1, 2], [0, 1]];
const BGGR: MosaicColours = [[2, 1], [1, 0]];

const fn mosaic(name: &'static str, colours: MosaicColours, bits: u8) -> PixelFormat {
    pixel_format(name, Arrangement::Mosaic { colours, bits })
}

const fn grey(name: &'static str, bits: u8) -> PixelFormat {
    pixel_format(name, Arrangement::Grey { bits })
}

const fn pixel_format(name: &'static str, arrangement: Arrangement) -> PixelFormat {
    PixelFormat { name, arrangement }
}

/// All readable formats in order of preference: colour before grey, then the least work first.
pub(super) static FORMATS: [PixelFormat; 23] = [
    pixel_format("NV12", Arrangement::SemiPlanar),
    pixel_format("YU12", Arrangement::Planar),
    pixel_format("YUYV", Arrangement::Pairs { brightness: 0 }),
    pixel_format("UYVY", Arrangement::Pairs { brightness: 1 }),
    pixel_format("RGB3", Arrangement::Rgb([0, 1, 2])),
    pixel_format("BGR3", Arrangement::Rgb([2, 1, 0])),
    pixel_format("MJPG", Arrangement::Jpeg),
    mosaic("RGGB", RGGB, 8),
    mosaic("GRBG", GRBG, 8),
    mosaic("GBRG", GBRG, 8),
    mosaic("BA81", BGGR, 8),
    mosaic("RG10", RGGB, 10),
    mosaic("BA10", GRBG, 10),
    mosaic("GB10", GBRG, 10),
    mosaic("BG10", BGGR, 10),
    mosaic("RG12", RGGB, 12),
    mosaic("BA12", GRBG, 12),
    mosaic("GB12", GBRG, 12),
    mosaic("BG12", BGGR, 12),
    grey("GREY", 8),
    grey("Y10", 10),
    grey("Y12", 12),
    grey("Y16", 16),
];

/// Reads the pictures of one stream.
#[derive(Debug, Clone)]
pub(super) struct PictureDecoder {
    arrangement: Arrangement,
    size_px: [u32; 2],
    /// Bytes from one row to the next; at least the bytes of a row.
    stride: usize,
    coding: ColourCoding,
    pool: BufferPool,
}

impl PictureDecoder {
    /// For pictures in the driver's current format.
    pub(super) fn new(pixels: &PixelFormat, format: &Format) -> Self {
        let size_px = [format.width, format.height];
        let arrangement = pixels.arrangement;
        let width = size_px[0] as usize;
        let row_bytes = match arrangement {
            Arrangement::SemiPlanar | Arrangement::Planar | Arrangement::Jpeg => width,
            Arrangement::Pairs { .. } => width.div_ceil(2) * 4,
            Arrangement::Rgb(_) => width * 3,
            Arrangement::Grey { bits } | Arrangement::Mosaic { bits, .. } => width * bytes_of(bits),
        };
        Self {
            arrangement,
            size_px,
            stride: (format.stride as usize).max(row_bytes),
            coding: coding(arrangement, format),
            pool: BufferPool::default(),
        }
    }

    /// `None` if the bytes are no complete picture.
    pub(super) fn decode(&self, bytes: &[u8]) -> Option<Picture> {
        let [width, height] = self.size_px.map(|side| side as usize);
        match self.arrangement {
            Arrangement::SemiPlanar => {
                let (luma, pairs) = bytes.split_at_checked(self.stride * height)?;
                let [columns, lines] = [width.div_ceil(2), height.div_ceil(2)];
                self.yuv(YuvLayout::Planar([2, 2]), |out| {
                    rows(luma, self.stride, width, height)?.for_each(|row| out.extend(row));
                    for first in 0..2 {
                        let colour = rows(pairs, self.stride, 2 * columns, lines)?;
                        colour.for_each(|row| out.extend(row[first..].iter().step_by(2)));
                    }
                    Some(())
                })
            }
            Arrangement::Planar => {
                let (luma, colour) = bytes.split_at_checked(self.stride * height)?;
                let [columns, lines] = [width.div_ceil(2), height.div_ceil(2)];
                let stride = (self.stride / 2).max(columns);
                self.yuv(YuvLayout::Planar([2, 2]), |out| {
                    rows(luma, self.stride, width, height)?.for_each(|row| out.extend(row));
                    for plane in [colour, colour.get(stride * lines..)?] {
                        rows(plane, stride, columns, lines)?.for_each(|row| out.extend(row));
                    }
                    Some(())
                })
            }
            Arrangement::Pairs { brightness } => self.yuv(YuvLayout::Planar([2, 1]), |out| {
                let row_bytes = width.div_ceil(2) * 4;
                // First byte and distance of luma, U and V.
                let colour = 1 - brightness;
                for (first, apart, n) in [
                    (brightness, 2, width),
                    (colour, 4, row_bytes),
                    (colour + 2, 4, row_bytes),
                ] {
                    rows(bytes, self.stride, row_bytes, height)?
                        .for_each(|row| out.extend(row[first..].iter().step_by(apart).take(n)));
                }
                Some(())
            }),
            Arrangement::Grey { bits } => {
                self.yuv(YuvLayout::Grey, |out| self.single_values(bytes, bits, out))
            }
            Arrangement::Rgb(order) => {
                let mut rgb = Vec::with_capacity(3 * width * height);
                for row in rows(bytes, self.stride, 3 * width, height)? {
                    let pixels = row.chunks_exact(3);
                    rgb.extend(pixels.flat_map(|pixel| order.map(|at| pixel[at])));
                }
                self.rgb(rgb)
            }
            Arrangement::Mosaic { colours, bits } => {
                let mut values = Vec::with_capacity(width * height);
                self.single_values(bytes, bits, &mut values)?;
                self.rgb(without_mosaic(&values, [width, height], colours)?)
            }
            Arrangement::Jpeg => image::load_from_memory_with_format(bytes, ImageFormat::Jpeg)
                .ok()
                .map(|image| Picture::Rgb(image.into_rgb8()))
                .filter(|picture| picture.size_px() == self.size_px),
        }
    }

    fn yuv(
        &self,
        layout: YuvLayout,
        write: impl FnOnce(&mut Vec<u8>) -> Option<()>,
    ) -> Option<Picture> {
        let mut is_whole = false;
        let bytes = self.pool.write(layout.n_bytes(self.size_px), |out| {
            is_whole = write(out).is_some();
        });
        let bytes = is_whole.then_some(bytes)?;
        YuvPicture::new(self.size_px, layout, self.coding, bytes).map(Picture::Yuv)
    }

    fn rgb(&self, rgb: Vec<u8>) -> Option<Picture> {
        RgbImage::from_raw(self.size_px[0], self.size_px[1], rgb).map(Picture::Rgb)
    }

    /// The upper eight bits of every value.
    fn single_values(&self, bytes: &[u8], bits: u8, out: &mut Vec<u8>) -> Option<()> {
        let [width, height] = self.size_px.map(|side| side as usize);
        let lines = rows(bytes, self.stride, width * bytes_of(bits), height)?;
        if bits == 8 {
            lines.for_each(|row| out.extend(row));
        } else {
            let upper = |two: &[u8]| (u16::from_le_bytes([two[0], two[1]]) >> (bits - 8)).min(255);
            lines.for_each(|row| out.extend(row.chunks_exact(2).map(|two| upper(two) as u8)));
        }
        Some(())
    }
}

/// Values of more than eight bits take two bytes, the lower byte first.
fn bytes_of(bits: u8) -> usize {
    usize::from(bits).div_ceil(8)
}

/// Colour coding as reported by the driver.
fn coding(arrangement: Arrangement, format: &Format) -> ColourCoding {
    let matrix = match format.colorspace {
        Colorspace::Rec709 => ColourMatrix::Bt709,
        Colorspace::Rec2020 => ColourMatrix::Bt2020,
        _ => ColourMatrix::Bt601,
    };
    let is_full_range = match format.quantization {
        Quantization::FullRange => true,
        Quantization::LimitedRange => false,
        // Grey cameras deliver sensor values, whatever the kernel's default for video is.
        Quantization::Default => {
            matches!(arrangement, Arrangement::Grey { .. })
                || matches!(format.colorspace, Colorspace::JPEG)
        }
    };
    ColourCoding {
        matrix,
        is_full_range,
    }
}

/// The first `n` rows of a plane without padding; `None` if there are fewer.
fn rows(
    bytes: &[u8],
    stride: usize,
    row_bytes: usize,
    n: usize,
) -> Option<impl Iterator<Item = &[u8]>> {
    if row_bytes == 0 || bytes.len() < stride * n.checked_sub(1)? + row_bytes {
        return None;
    }
    let lines = bytes.chunks(stride).take(n);
    Some(lines.map(move |row| &row[..row_bytes]))
}

/// Demosaicing: each colour is the mean of the nearest pixels that measured it. `None` for pictures
/// with less than two rows or columns.
fn without_mosaic(
    values: &[u8],
    [width, height]: [usize; 2],
    colours: MosaicColours,
) -> Option<Vec<u8>> {
    const GREEN: usize = 1;
    // Weights (quarters) of the neighbouring pixels in green, and in red and blue.
    const AROUND: [[[u16; 3]; 3]; 2] = [
        [[0, 1, 0], [1, 4, 1], [0, 1, 0]],
        [[1, 2, 1], [2, 4, 2], [1, 2, 1]],
    ];
    if width < 2 || height < 2 {
        return None;
    }
    // Pixels outside are mirrored at the edge, which continues the mosaic.
    let around =
        |at: usize, n: usize| [at.abs_diff(1), at, if at + 1 < n { at + 1 } else { n - 2 }];
    let mut rgb = Vec::with_capacity(3 * values.len());
    for y in 0..height {
        let lines = around(y, height).map(|line| &values[line * width..][..width]);
        for x in 0..width {
            let mut quarters = [2; 3];
            for (down, line) in lines.iter().enumerate() {
                for (across, column) in around(x, width).into_iter().enumerate() {
                    let colour = colours[(y + down + 1) % 2][(x + across + 1) % 2];
                    let shares = &AROUND[usize::from(colour != GREEN)];
                    quarters[colour] += shares[down][across] * u16::from(line[column]);
                }
            }
            rgb.extend(quarters.map(|sum| (sum / 4) as u8));
        }
    }
    Some(rgb)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(name: &str, size_px: [u32; 2], stride: u32, bytes: &[u8]) -> Option<RgbImage> {
        let pixels = FORMATS.iter().find(|known| known.name == name).unwrap();
        let mut format = Format::new(size_px[0], size_px[1], pixels.fourcc());
        format.stride = stride;
        PictureDecoder::new(pixels, &format)
            .decode(bytes)
            .map(Picture::into_rgb)
    }

    /// White, black in the first row, red in the second, in BT.601 limited range.
    fn is_white_black_red(image: &RgbImage) {
        assert_eq!(image.get_pixel(0, 0).0, [255, 255, 255]);
        assert_eq!(image.get_pixel(1, 0).0, [0, 0, 0]);
        let [red, green, blue] = image.get_pixel(0, 1).0;
        assert!(red > 252 && green < 3 && blue < 3, "{red} {green} {blue}");
    }

    #[test]
    fn rows_of_pixel_pairs_lose_their_padding() {
        let bytes = [235, 128, 16, 128, 0, 0, 81, 90, 81, 240];
        is_white_black_red(&decoded("YUYV", [2, 2], 6, &bytes).unwrap());
        assert!(decoded("YUYV", [2, 2], 6, &bytes[..9]).is_none());
        let bytes = [128, 235, 128, 16, 0, 0, 90, 81, 240, 81];
        is_white_black_red(&decoded("UYVY", [2, 2], 6, &bytes).unwrap());
    }

    #[test]
    fn planes_are_found_behind_their_strides() {
        // Four columns and two rows, padded to eight: luma, then colour for two by two pixels.
        let luma = [81, 81, 145, 145, 0, 0, 0, 0].repeat(2);
        let semi_planar = [&luma[..], &[90, 240, 54, 34, 0, 0, 0, 0]].concat();
        let planar = [&luma[..], &[90, 54, 0, 0, 240, 34, 0, 0]].concat();
        for (name, bytes) in [("NV12", semi_planar), ("YU12", planar)] {
            let image = decoded(name, [4, 2], 8, &bytes).unwrap();
            let [red, green] = [image.get_pixel(0, 1).0, image.get_pixel(3, 1).0];
            assert!(red[0] > 252 && red[1] < 3 && red[2] < 3, "{red:?}");
            assert!(green[1] > 252 && green[0] < 3 && green[2] < 3, "{green:?}");
            let short = &bytes[..bytes.len() - 5];
            assert!(decoded(name, [4, 2], 8, short).is_none());
        }
    }

    #[test]
    fn values_of_many_bits_keep_the_upper_eight() {
        let grey = |name: &str, bytes: &[u8]| {
            decoded(name, [2, 1], 0, bytes).map(|image| [0, 1].map(|x| image.get_pixel(x, 0).0[0]))
        };
        assert_eq!(grey("GREY", &[0, 200]), Some([0, 200]));
        assert_eq!(grey("Y10", &[255, 3, 0, 2]), Some([255, 128]));
        assert_eq!(grey("Y16", &[0, 255, 255, 1]), Some([255, 1]));
        assert_eq!(grey("Y12", &[255, 15, 0]), None);
    }

    #[test]
    fn one_colour_seen_through_any_mosaic_is_that_colour() {
        let colour = [200, 90, 10];
        for (name, colours) in [
            ("RGGB", RGGB),
            ("GRBG", GRBG),
            ("GBRG", GBRG),
            ("BA81", BGGR),
        ] {
            let at = |i: usize| colour[colours[i / 5 % 2][i % 5 % 2]];
            let bytes: Vec<u8> = (0..5 * 3).map(at).collect();
            let image = decoded(name, [5, 3], 0, &bytes).unwrap();
            assert!(image.pixels().all(|pixel| pixel.0 == colour), "{image:?}");
        }
    }

    #[test]
    fn invalid_bytes_are_no_picture() {
        assert!(decoded("MJPG", [2, 2], 0, b"no jpeg").is_none());
        for format in &FORMATS {
            assert!(decoded(format.name, [4, 4], 0, &[]).is_none());
            assert!(decoded(format.name, [0, 0], 0, &[0; 64]).is_none());
        }
    }
}
