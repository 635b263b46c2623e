//! Precomputed maps: the output of one camera's simulated network at every tick of a scene, stored
//! in a file. During a run, the maps of a crop then cost some tens of microseconds, so that a
//! machine with two cores measures the link and not the simulator.
//!
//! For every tick and person in the image, a file contains the peaks of every keypoint's map in
//! image pixels, with leaked and false ones. The maps of any crop are painted from them. [`Course`]
//! defines which moment of the scene each tick shows. A recording may return to its first tick; it
//! is then repeated without end.
//!
//! ```text
//! "FARFIELD-MAPS", a zero, the version: 1 byte
//! length: u32, little endian; header: postcard
//! per tick: length: u32, little endian; observation: postcard
//! BLAKE3 of all before: 32 bytes
//! ```

mod read;
mod source;
mod write;

use serde::{Deserialize, Serialize};

pub use read::{MapsFile, MapsFileError};
pub use source::MapsSource;
pub(crate) use source::{load, same_rate, ticks_of};
pub use write::{Course, write_maps};

/// Start of a file; the last byte is the version.
const MAGIC: [u8; 15] = *b"FARFIELD-MAPS\0\x01";
/// Bytes of the checksum at the end.
const CHECKSUM_BYTES: usize = blake3::OUT_LEN;

/// The header of a file.
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
    /// Capture time of every frame minus the time of its tick, microseconds.
    pub capture_offset_us: i32,
    /// A simulated failure of the camera, for tests.
    pub failure: Option<CameraFailure>,
}

/// A camera that fails at a tick of its recording, and does not recover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CameraFailure {
    /// The first affected tick, counted from the start of the recording.
    pub from: u32,
    /// The kind of failure.
    pub kind: FailureKind,
}

/// The ways in which a camera fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum FailureKind {
    /// The same picture is repeated.
    Freezes,
    /// Pictures are black.
    TurnsBlack,
    /// No more frames: an error.
    Dies,
}

#[cfg(test)]
mod tests;
