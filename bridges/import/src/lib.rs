//! Imports 2D keypoints of other programs: writes `venue.toml`, `calibration.toml` and one keypoint
//! file per camera.
//!
//! [`formats::parse`] reads one file of another program. [`keypoints`] maps its keypoints to ours.
//! [`assemble`] aligns the cameras by frame number and warns about suspect data. [`import`] does
//! all of this for a folder. Everything is pure (bytes and text in, values and text out) except one
//! module that touches files.
//!
//! Image coordinates are distorted pixels; (0, 0) is the centre of the first pixel. Frame numbers
//! are those of the files; a frame is a tick of the venue.

pub mod assemble;
pub mod calibrations;
mod error;
mod files;
mod folder;
pub mod formats;
pub mod import;
pub mod keypoints;
pub mod matching;
pub mod person;
pub mod report;

pub use self::error::ImportError;
