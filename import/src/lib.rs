//! 2D keypoints of other programs as a venue: whose keypoint is which of ours.

mod frame_number;
pub mod keypoints;
pub mod person;
