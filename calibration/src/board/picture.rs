//! A picture as its bytes.

/// A grey picture: one byte a pixel, row by row from the upper left.
#[derive(Debug, Clone, Copy)]
pub struct GrayPicture<'a> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width` x `height` bytes.
    pub pixels: &'a [u8],
}
