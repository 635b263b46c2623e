//! 2D keypoints of other programs as a venue: what their files say.

pub mod formats;
mod frame_number;
pub mod keypoints;
pub mod person;
