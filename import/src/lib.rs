//! 2D keypoints of other programs as a venue: their files, and cameras side by side.

pub mod assemble;
pub mod formats;
mod frame_number;
pub mod keypoints;
pub mod matching;
pub mod person;
pub mod report;
