//! Errors of an edge's parts and inputs.

use farfield_proto::id::ViewpointIndex;
use farfield_proto::tick::Tick;

use crate::inference::NetworkError;

/// Why an edge cannot start or process a tick.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The venue has no such viewpoint.
    #[error("the venue has no viewpoint number {}", index.0)]
    UnknownViewpoint {
        /// The requested viewpoint.
        index: ViewpointIndex,
    },
    /// A camera delivers pictures, but there is no network.
    #[error("camera `{camera}` gives pictures, but the venue names no `network`")]
    NoNetwork {
        /// The camera.
        camera: String,
    },
    /// The maps exceed the limits of messages.
    #[error("{what} is {got}, at most {limit} can be sent")]
    TooLarge {
        /// The limited quantity.
        what: &'static str,
        /// Its value.
        got: usize,
        /// Its limit.
        limit: usize,
    },
    /// Keypoint files have other keypoints than the network.
    #[error(
        "camera `{camera}` has other keypoints than the network; expected one set: the venue's field `keypoints` names that of keypoint files, \"coco17\" by default"
    )]
    OtherKeypoints {
        /// The camera of kind `keypoints`.
        camera: String,
    },
    /// The frames do not match the cameras of the viewpoint.
    #[error("{got} frames for {expected} cameras")]
    FrameCount {
        /// Number of frames.
        got: usize,
        /// Number of cameras.
        expected: usize,
    },
    /// The frames of one step have different ticks.
    #[error("camera `{camera}`: its frame is of tick {got}, others of {expected}")]
    MixedTicks {
        /// The camera.
        camera: String,
        /// The tick of its frame.
        got: Tick,
        /// The tick of the previous frames.
        expected: Tick,
    },
    /// The frames and the request have different ticks.
    #[error("frames of tick {got} for a request of tick {expected}")]
    OtherTick {
        /// The tick of the frames.
        got: Tick,
        /// The tick of the request.
        expected: Tick,
    },
    /// A frame does not match the calibration or the venue file.
    #[error("camera `{camera}`: {problem}")]
    WrongFrame {
        /// The camera.
        camera: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// The boxes belong to another viewpoint.
    #[error("boxes for viewpoint number {}, this is {}", got.0, expected.0)]
    OtherViewpoint {
        /// The viewpoint of the boxes.
        got: ViewpointIndex,
        /// The viewpoint of this edge.
        expected: ViewpointIndex,
    },
    /// The network or the detector failed.
    #[error(transparent)]
    Network(#[from] NetworkError),
}
