//! What can be wrong with an edge's parts, or with what it is given.

use farfield_proto::id::ViewpointIndex;
use farfield_proto::tick::Tick;

use crate::inference::NetworkError;

/// Why an edge cannot start, or a step cannot be taken.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The venue has no such viewpoint.
    #[error("the venue has no viewpoint number {}", index.0)]
    UnknownViewpoint {
        /// What was asked for.
        index: ViewpointIndex,
    },
    /// A camera gives pictures, and there is no network to read them.
    #[error("camera `{camera}` gives pictures, but the venue names no `network`")]
    NoNetwork {
        /// The camera.
        camera: String,
    },
    /// The maps would not fit the wire.
    #[error("{what} is {got}, at most {limit} can be sent")]
    TooLarge {
        /// Which number.
        what: &'static str,
        /// What it is.
        got: usize,
        /// What the wire holds.
        limit: usize,
    },
    /// Keypoint files know COCO's 17 keypoints, the network others.
    #[error(
        "camera `{camera}` gives COCO's 17 keypoints, but the network knows others; one venue has one set"
    )]
    OtherKeypoints {
        /// The camera of kind `keypoints`.
        camera: String,
    },
    /// The frames do not belong to the cameras of the viewpoint.
    #[error("{got} frames for {expected} cameras")]
    FrameCount {
        /// How many came.
        got: usize,
        /// How many cameras the viewpoint has.
        expected: usize,
    },
    /// The frames of one step are of several ticks.
    #[error("camera `{camera}`: its frame is of tick {got}, others of {expected}")]
    MixedTicks {
        /// The camera.
        camera: String,
        /// The tick of its frame.
        got: Tick,
        /// The tick of the frames before it.
        expected: Tick,
    },
    /// The frames are of another tick than the request.
    #[error("frames of tick {got} for a request of tick {expected}")]
    OtherTick {
        /// The tick of the frames.
        got: Tick,
        /// The tick of the request.
        expected: Tick,
    },
    /// A frame is not what the calibration or the venue file says of its camera.
    #[error("camera `{camera}`: {problem}")]
    WrongFrame {
        /// The camera.
        camera: String,
        /// What came and what was expected.
        problem: String,
    },
    /// The boxes are another viewpoint's.
    #[error("boxes for viewpoint number {}, this is {}", got.0, expected.0)]
    OtherViewpoint {
        /// For whom they are.
        got: ViewpointIndex,
        /// Who this is.
        expected: ViewpointIndex,
    },
    /// The network or the detector failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
}
