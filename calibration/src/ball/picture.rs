//! Pictures in memory of the caller (borrowed bytes, row by row), and errors of pictures and requests.

/// Greatest width and height, pixels.
const MOST_PX: u32 = 16_384;

/// Bytes of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelLayout {
    /// One byte.
    Grey8,
    /// Red, green, blue, one byte each (as in `image::RgbImage`).
    Rgb8,
}

impl PixelLayout {
    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            Self::Grey8 => 1,
            Self::Rgb8 => 3,
        }
    }
}

/// A view of a picture, or of a region of one. Nothing is copied.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    width: u32,
    height: u32,
    stride: usize,
    layout: PixelLayout,
    origin_px: [u32; 2],
    bytes: &'a [u8],
}

impl<'a> Picture<'a> {
    /// A picture of `size_px` (width, height) whose rows begin `stride` bytes apart.
    ///
    /// # Errors
    /// [`BallError`] if it has no pixels, too many, or `bytes` is too short.
    pub fn new(
        bytes: &'a [u8],
        size_px: [u32; 2],
        stride: usize,
        layout: PixelLayout,
    ) -> Result<Self, BallError> {
        let [width, height] = size_px;
        if !(1..=MOST_PX).contains(&width) || !(1..=MOST_PX).contains(&height) {
            return Err(BallError::Size {
                width,
                height,
                most: MOST_PX,
            });
        }
        let row = width as usize * layout.bytes();
        let expected = stride
            .saturating_mul(height as usize - 1)
            .saturating_add(row);
        if stride < row || bytes.len() < expected {
            return Err(BallError::Bytes {
                found: bytes.len(),
                stride,
                expected: expected.max(row * height as usize),
            });
        }
        Ok(Self {
            width,
            height,
            stride,
            layout,
            origin_px: [0, 0],
            bytes,
        })
    }

    /// A colour picture without gaps between rows, as `image::RgbImage::as_raw`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn rgb8(bytes: &'a [u8], size_px: [u32; 2]) -> Result<Self, BallError> {
        Self::new(bytes, size_px, 3 * size_px[0] as usize, PixelLayout::Rgb8)
    }

    /// A grey picture without gaps between rows.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn grey8(bytes: &'a [u8], size_px: [u32; 2]) -> Result<Self, BallError> {
        Self::new(bytes, size_px, size_px[0] as usize, PixelLayout::Grey8)
    }

    /// The same pixels as a part of a larger picture: `origin_px` is the position of the first pixel there, and sightings are in
    /// pixels of the larger picture.
    #[must_use]
    pub fn at_origin(self, origin_px: [u32; 2]) -> Self {
        Self { origin_px, ..self }
    }

    /// The part of `size_px` from pixel `from_px` on, in the same coordinates.
    ///
    /// # Errors
    /// [`BallError::Region`] if it is not inside this picture.
    pub fn region(&self, from_px: [u32; 2], size_px: [u32; 2]) -> Result<Self, BallError> {
        let whole_px = [self.width, self.height];
        let fits = |axis: usize| {
            let end = from_px[axis].checked_add(size_px[axis]);
            size_px[axis] > 0 && end.is_some_and(|end| end <= whole_px[axis])
        };
        let start = from_px[1] as usize * self.stride + from_px[0] as usize * self.layout.bytes();
        match self.bytes.get(start..) {
            Some(bytes) if fits(0) && fits(1) => Ok(Self {
                width: size_px[0],
                height: size_px[1],
                origin_px: [
                    self.origin_px[0].saturating_add(from_px[0]),
                    self.origin_px[1].saturating_add(from_px[1]),
                ],
                bytes,
                ..*self
            }),
            _ => Err(BallError::Region {
                from_px,
                size_px,
                whole_px,
            }),
        }
    }

    /// Width and height, pixels.
    pub fn size_px(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Position of its first pixel in the whole picture.
    pub fn origin_px(&self) -> [u32; 2] {
        self.origin_px
    }

    /// Layout of its pixels.
    pub fn layout(&self) -> PixelLayout {
        self.layout
    }

    /// The bytes of a row; empty below the picture.
    pub(super) fn row(&self, y: u32) -> &'a [u8] {
        let start = y as usize * self.stride;
        let end = start + self.width as usize * self.layout.bytes();
        self.bytes.get(start..end).unwrap_or(&[])
    }

    /// Bilinear colour at column `x` and row `y` of this picture; grey is returned in all three channels. `None` outside of the
    /// centres of its outermost pixels.
    pub(super) fn sample(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let (right, bottom) = (f64::from(self.width - 1), f64::from(self.height - 1));
        if !((0.0..=right).contains(&x) && (0.0..=bottom).contains(&y)) {
            return None;
        }
        // The last column and row are interpolated from the ones before.
        let column = (x as u32).min(self.width.saturating_sub(2));
        let line = (y as u32).min(self.height.saturating_sub(2));
        let (u, v) = (x - f64::from(column), y - f64::from(line));
        let upper = self.row(line);
        let lower = self.row((line + 1).min(self.height - 1));
        let step = self.layout.bytes();
        let here = column as usize * step;
        let next = if self.width > 1 { here + step } else { here };
        let channel = |c: usize| {
            let at = |row: &[u8], place: usize| row.get(place + c).map(|b| f64::from(*b));
            let above = at(upper, here)? * (1.0 - u) + at(upper, next)? * u;
            let below = at(lower, here)? * (1.0 - u) + at(lower, next)? * u;
            Some(above * (1.0 - v) + below * v)
        };
        match self.layout {
            PixelLayout::Grey8 => channel(0).map(|grey| [grey; 3]),
            PixelLayout::Rgb8 => Some([channel(0)?, channel(1)?, channel(2)?]),
        }
    }

    /// The colour of one pixel.
    pub(super) fn pixel(&self, x: u32, y: u32) -> Option<[f64; 3]> {
        let step = self.layout.bytes();
        let start = x as usize * step;
        let bytes = self.row(y).get(start..start + step)?;
        match bytes {
            [grey] => Some([f64::from(*grey); 3]),
            [r, g, b] => Some([r, g, b].map(|c| f64::from(*c))),
            _ => None,
        }
    }
}

/// Why a picture or a request cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BallError {
    /// A picture without pixels, or larger than any camera's.
    #[error("a picture of {width} x {height} pixels, expected 1 to {most} each way")]
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Greatest width and height.
        most: u32,
    },
    /// Fewer bytes than the picture needs.
    #[error("found {found} bytes in rows of {stride}, expected {expected}")]
    Bytes {
        /// Number of bytes.
        found: usize,
        /// Bytes from row to row.
        stride: usize,
        /// Number of bytes that are needed.
        expected: usize,
    },
    /// A region that is not inside the picture.
    #[error("a region of {size_px:?} pixels at {from_px:?}, expected one inside of {whole_px:?}")]
    Region {
        /// Upper left pixel of the region.
        from_px: [u32; 2],
        /// Width and height of the region.
        size_px: [u32; 2],
        /// Width and height of the picture.
        whole_px: [u32; 2],
    },
    /// A grey picture, and a request for a colour.
    #[error("found a grey picture, expected colours; search by brightness or motion")]
    Grey,
    /// Motion is detected relative to earlier pictures, which must have the same size and origin.
    #[error(
        "found a picture of {found_px:?} pixels after one of {expected_px:?}, expected the same"
    )]
    SizeChanged {
        /// Width, height, left and top of this picture.
        found_px: [u32; 4],
        /// Width, height, left and top of the earlier ones.
        expected_px: [u32; 4],
    },
    /// A frame that is not later than the one before.
    #[error("found frame {found} after frame {last}, expected increasing frames")]
    Order {
        /// The frame.
        found: u64,
        /// The frame before.
        last: u64,
    },
    /// More frames with candidates than are allowed.
    #[error("found more than {most} pictures with candidates in them")]
    TooMany {
        /// Greatest number.
        most: usize,
    },
    /// A request outside of its limits.
    #[error("`{field}`: found {found}, expected {expected}")]
    Request {
        /// Name of the number.
        field: &'static str,
        /// Its value.
        found: String,
        /// Allowed values.
        expected: &'static str,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_with_too_few_bytes_are_rejected() {
        let bytes = [0; 24];
        assert!(Picture::rgb8(&bytes, [4, 2]).is_ok());
        assert!(Picture::rgb8(&bytes, [4, 3]).is_err());
        assert!(Picture::new(&bytes, [4, 2], 11, PixelLayout::Rgb8).is_err());
        assert!(Picture::new(&bytes, [0, 2], 11, PixelLayout::Rgb8).is_err());
        assert!(
            Picture::new(&bytes, [u32::MAX, u32::MAX], usize::MAX, PixelLayout::Grey8).is_err()
        );
    }

    #[test]
    fn a_region_is_a_view_of_the_same_bytes() {
        let bytes: Vec<u8> = (0..20).collect();
        let whole = Picture::grey8(&bytes, [5, 4]).unwrap();
        let part = whole.region([1, 2], [3, 2]).unwrap();
        assert_eq!(part.row(0), [11, 12, 13]);
        assert_eq!(part.row(1), [16, 17, 18]);
        assert_eq!(part.origin_px(), [1, 2]);
        assert_eq!(part.sample(0.5, 0.5), Some([14.0; 3]));
        assert_eq!(part.sample(2.5, 0.5), None);
        assert!(whole.region([3, 0], [3, 1]).is_err());
        assert!(whole.region([u32::MAX, 0], [3, 1]).is_err());
    }
}
