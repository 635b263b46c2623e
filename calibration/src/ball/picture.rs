//! Pictures as others hold them: borrowed bytes, row by row.

use super::error::BallError;

/// Most pixels of a row, and rows.
const MOST_PX: u32 = 16_384;

/// How a pixel is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelLayout {
    /// One byte.
    Grey8,
    /// Red, green, blue, a byte each (as `image::RgbImage` has it).
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

/// A picture, or a region of one, that somebody else owns; nothing is copied.
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
    /// [`BallError`] where it has no pixels, or `bytes` does not hold them.
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

    /// A colour picture without gaps between rows: `image::RgbImage::as_raw`.
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

    /// The same pixels as a part of a larger picture, in whose pixels sightings are then given: `origin_px` is where its first
    /// pixel lies there.
    #[must_use]
    pub fn at_origin(self, origin_px: [u32; 2]) -> Self {
        Self { origin_px, ..self }
    }

    /// The part of it of `size_px` from pixel `from_px` on, in the same coordinates.
    ///
    /// # Errors
    /// [`BallError::Region`] where it reaches outside.
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

    /// Where its first pixel lies in the whole picture.
    pub fn origin_px(&self) -> [u32; 2] {
        self.origin_px
    }

    /// How its pixels are written.
    pub fn layout(&self) -> PixelLayout {
        self.layout
    }

    /// The bytes of a row; none below the picture.
    pub(super) fn row(&self, y: u32) -> &'a [u8] {
        let start = y as usize * self.stride;
        let end = start + self.width as usize * self.layout.bytes();
        self.bytes.get(start..end).unwrap_or(&[])
    }

    /// The colour at column `x` and row `y` of this picture, between pixels bilinear; grey counts in all three channels. `None`
    /// outside of the centres of its outermost pixels.
    pub(super) fn sample(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let (right, bottom) = (f64::from(self.width - 1), f64::from(self.height - 1));
        if !((0.0..=right).contains(&x) && (0.0..=bottom).contains(&y)) {
            return None;
        }
        // The last column and row are reached from the one before.
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

    /// The colour of a whole pixel.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_its_bytes_do_not_hold_is_refused() {
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
