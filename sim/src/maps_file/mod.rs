//! Maps made beforehand: what one camera's network would say at every tick of a scene, computed before
//! a run and kept in a file, so that during the run a crop's maps cost some tens of microseconds and
//! two cores measure the link and not the simulator.
//!
//! A file holds, for every tick and person in the image, the peaks of every keypoint's map in image
//! pixels, leaked and false ones among them; the maps of any crop are painted from them. [`Course`]
//! says which moment of the scene each tick shows: a recording may lead back to its first tick, and is
//! then repeated for as long as anybody asks.
//!
//! ```text
//! "FARFIELD-MAPS", a zero, the version: 1 byte
//! length: u32, little endian; header: postcard
//! per tick: length: u32, little endian; observation: postcard
//! BLAKE3 of all before: 32 bytes
//! ```

mod course;
mod read;
mod source;
mod write;

use serde::{Deserialize, Serialize};

pub use course::Course;
pub use read::{MapsFile, MapsFileError};
pub use source::MapsSource;
pub(crate) use source::{load, same_rate, ticks_of};
pub use write::write_maps;

/// What a file begins with; the last byte is the version.
const MAGIC: [u8; 15] = *b"FARFIELD-MAPS\0\x01";
/// Bytes of the checksum at the end.
const CHECKSUM_BYTES: usize = blake3::OUT_LEN;

/// What a file says of itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// The camera's name.
    pub camera: String,
    /// Width and height of its pictures.
    pub size_px: [u32; 2],
    /// Ticks per second.
    pub rate_hz: f64,
    /// Number of ticks.
    pub ticks: u32,
    /// Whether the last tick leads to the first, so that the recording has no end.
    pub repeats: bool,
    /// Capture instant of every frame less its tick's time, microseconds.
    pub capture_offset_us: i32,
    /// How the camera fails, in tests of what becomes of a venue then.
    pub failure: Option<CameraFailure>,
}

/// A camera that fails at a tick of its recording, and does not recover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CameraFailure {
    /// The first tick that is wrong, counted from the recording's first.
    pub from: u32,
    /// What happens.
    pub kind: FailureKind,
}

/// The ways in which a camera fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum FailureKind {
    /// The same picture comes again and again.
    Freezes,
    /// Pictures are black.
    TurnsBlack,
    /// Nothing comes any more: an error.
    Dies,
}

#[cfg(test)]
mod tests;
