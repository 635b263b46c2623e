//! What is kept of a tentative person until it is confirmed.

use farfield_proto::tick::Tick;

use crate::body::keypoint_estimate::KeypointEstimate;

/// The keypoint positions of one tick of a tentative person, kept until it is confirmed.
#[derive(Debug, Clone)]
pub(crate) struct TentativeTick {
    pub(crate) tick: Tick,
    pub(crate) estimates: Vec<KeypointEstimate>,
}
