//! The patch codec: the part confidence maps of one person in one camera, as bytes.
//!
//! Almost every cell of a map is zero, and almost every other belongs to one peak that is nearly a Gaussian. Each map is
//! therefore written as its peaks, a few whole numbers each, and, where these are not close enough for the
//! [`CompressionLevel`], as corrections of what they leave (`gaussian`). Without loss, cells above a floor are kept as
//! 8 bit values (`lossless`). Both are written by an adaptive binary range coder (`entropy`) whose contexts begin with
//! probabilities measured on people and networks; no patch depends on the one before.
//!
//! A [`Decoder`] reads bytes of strangers: it never panics, never holds more than [`MAX_CELLS`] bytes of maps, and about
//! three bytes for each cell of one map. All machines decode the same maps from the same bytes.

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
