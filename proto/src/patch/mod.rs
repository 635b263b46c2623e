//! The patch codec: the part confidence maps of one person in one camera, as bytes.
//!
//! Almost every cell of a map is zero, and almost every other belongs to one peak that is nearly a
//! Gaussian. Therefore a map is encoded as its peaks, a few integers each. If these are not
//! accurate enough for the [`CompressionLevel`], corrections of the error follow (`gaussian`).
//! Lossless patches contain cells above a floor as 8 bit values (`lossless`). Both use an adaptive
//! binary range coder (`entropy`) whose contexts start with probabilities measured on people and
//! networks. No patch depends on an earlier one.
//!
//! A [`Decoder`] reads untrusted bytes. It never panics, and never allocates more than
//! [`MAX_CELLS`] bytes for maps and about three bytes for each cell of one map. All machines decode
//! the same maps from the same bytes.

mod compression_level;
mod decode;
mod encode;
mod entropy;
mod gaussian;
mod lossless;
mod maps;
#[cfg(test)]
mod tests;

pub use compression_level::{CompressionLevel, FLOOR, UnknownCompressionLevel};
pub use decode::Decoder;
pub use encode::Encoder;
pub use maps::{
    EncodedMaps, MAX_CELLS, MAX_KEYPOINTS, MAX_SIDE, Maps, PatchError, Written, quantize,
};
