//! What cannot be looked at.

/// Why a picture, or what is looked for in it, cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BallError {
    /// A picture without pixels, or larger than any camera's.
    #[error("a picture of {width} x {height} pixels, expected 1 to {most} each way")]
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Most of either.
        most: u32,
    },
    /// The bytes do not hold the picture.
    #[error("found {found} bytes in rows of {stride}, expected {expected}")]
    Bytes {
        /// Bytes that are there.
        found: usize,
        /// Bytes from row to row.
        stride: usize,
        /// Bytes that are needed.
        expected: usize,
    },
    /// A region that is not inside the picture.
    #[error("a region of {size_px:?} pixels at {from_px:?}, expected one inside of {whole_px:?}")]
    Region {
        /// Its upper left pixel.
        from_px: [u32; 2],
        /// Its width and height.
        size_px: [u32; 2],
        /// Width and height of the picture.
        whole_px: [u32; 2],
    },
    /// Grey pictures have no colour.
    #[error("found a grey picture, expected colours; look by brightness or motion")]
    Grey,
    /// What moves is told against earlier pictures, which must be of the same size and place.
    #[error(
        "found a picture of {found_px:?} pixels after one of {expected_px:?}, expected the same"
    )]
    SizeChanged {
        /// Width, height, left and top now.
        found_px: [u32; 4],
        /// And before.
        expected_px: [u32; 4],
    },
    /// Frames go forward.
    #[error("found frame {found} after frame {last}, expected frames that rise")]
    Order {
        /// The frame.
        found: u64,
        /// The one before.
        last: u64,
    },
    /// More frames than are kept.
    #[error("found more than {most} pictures with something in them")]
    TooMany {
        /// Most that are kept.
        most: usize,
    },
    /// What is asked for is nothing that can be looked for.
    #[error("`{field}`: found {found}, expected {expected}")]
    Request {
        /// Which number.
        field: &'static str,
        /// What it is.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
}
