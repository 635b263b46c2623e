//! 2D keypoints of other programs as a venue: what a user already has becomes `venue.toml`, `calibration.toml` and a
//! keypoint file per camera.
//!
//! [`formats::parse`] reads one file of another program; [`keypoints`] says which of its keypoints are which of ours;
//! [`assemble`] puts cameras side by side on one count of frames and says what is doubtful; [`import`] does all of it for
//! a folder. All of it is pure, bytes and text in, values and text out, but for one module that touches files.
//!
//! Distances in pictures are pixels with the lens's distortion in them, (0, 0) the centre of the first pixel. Frames are
//! counted as the files count them; a frame is a tick of the venue.

pub mod assemble;
pub mod calibrations;
mod error;
mod files;
mod folder;
pub mod formats;
mod frame_number;
pub mod import;
pub mod keypoints;
pub mod matching;
pub mod person;
pub mod report;
mod settings;
mod venue_text;

pub use self::error::ImportError;
