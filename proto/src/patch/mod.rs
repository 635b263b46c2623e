//! The patch codec: the part confidence maps of one person in one camera, as bytes.
//!
//! Almost every cell of a map is zero, and almost every other belongs to one peak that is nearly a
//! Gaussian. Each map is therefore written as its peaks, a few whole numbers each, and, where these are
//! not good enough for the [`CompressionLevel`] that was asked for, as corrections of what they show. Without
//! loss, cells above a floor are kept as 8 bit values. Everything is coded in adaptive contexts that
//! begin with what is known of people and networks; nothing depends on the patch before.
//!
//! A [`Decoder`] reads bytes of strangers: it never panics, and never holds more than [`MAX_CELLS`]
//! bytes of maps, and about three for each cell of one map. All machines draw the same maps from the
//! same bytes.

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
pub use maps::{EncodedMaps, MAX_CELLS, MAX_KEYPOINTS, MAX_SIDE, Maps, PatchError, quantize};
