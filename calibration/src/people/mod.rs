//! Calibration from people who walk through the field, without any object and without known identities.
//!
//! [`calibrate`] needs only lenses and 2D keypoints. Each camera alone finds its pose relative to the floor, from upright
//! bodies of a usual stature. Paths of feet propose relative poses of two cameras, and all keypoints of the matching bodies
//! decide. Pairs are joined to one rough world; then all cameras are adjusted to all keypoints of all bodies. Up and floor
//! follow from feet; metres come from stature, a known distance or known places.

mod adjust;
mod assess;
mod associate;
mod evidence;
mod file;
mod findings;
mod outcome;
mod plan;
mod request;
mod start;
mod thinning;
mod tracklet;
mod venue;
mod view;

pub use file::{FrameLines, KeypointFileError, parse};
pub use outcome::{PeopleStage, calibrate, check_request};
pub use request::{DetectedFrame, Detection, Keypoint, PeopleCamera, PeopleError, PeopleRequest};
pub use thinning::{MOST_KEYPOINTS, Thinning};
pub use view::LEAST_RATE_HZ;

#[cfg(test)]
mod tests;
