//! Calibration from people: nobody carries anything. Cameras see people walk, as 2D keypoints; nobody says who is whom.
//!
//! [`calibrate`] starts from nothing but lenses and keypoints. Each camera alone finds how it stands over the floor, from
//! upright bodies of a usual stature; paths of feet propose how two cameras stand to each other, and all keypoints of the
//! bodies that fit decide; pairs become one rough world; then all cameras are adjusted to all keypoints of all bodies. Up
//! and floor are those of feet; metres come from stature, a known distance or known places.

mod adjust;
mod associate;
mod error;
mod file;
mod judged;
mod outcome;
mod plan;
mod request;
mod start;
mod thinning;
mod tracklet;
mod venue;
mod view;

pub use error::PeopleError;
pub use file::{FrameLines, KeypointFileError, parse};
pub use outcome::{PeopleStage, calibrate, check_request};
pub use request::{DetectedFrame, Detection, Keypoint, PeopleCamera, PeopleRequest};
pub use thinning::{MOST_KEYPOINTS, Thinning};
pub use view::LEAST_RATE_HZ;

#[cfg(test)]
mod tests;
