//! Why no calibration could be made.

use farfield_proto::camera::CameraError;

use crate::points::CalibrationError;

/// Why no calibration could be made from people.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PeopleError {
    /// A camera's intrinsics cannot be used.
    #[error(transparent)]
    Camera(CameraError),
    /// What any calibration would refuse.
    #[error(transparent)]
    Request(CalibrationError),
    /// A network that does not know the joints that tell where people stand.
    #[error("the keypoints lack `{missing}`: shoulders, hips and ankles of both sides are needed")]
    Keypoints {
        /// The first one that is missing.
        missing: String,
    },
    /// A number is none that can be used.
    #[error("`{field}`: found {found}, expected {expected}")]
    Number {
        /// What it is.
        field: &'static str,
        /// Its value.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// Frames are not in order.
    #[error("camera `{camera}`: found frame {found} after {before}, expected increasing numbers")]
    Frames {
        /// The camera's name.
        camera: String,
        /// The frame.
        found: f64,
        /// The one before.
        before: f64,
    },
    /// A body has another number of keypoints than the network.
    #[error(
        "camera `{camera}`, frame {frame}: found a body of {found} keypoints, expected {expected}"
    )]
    KeypointCount {
        /// The camera's name.
        camera: String,
        /// The frame.
        frame: f64,
        /// How many there are.
        found: usize,
        /// How many the network has.
        expected: usize,
    },
    /// Keypoints lie outside of the picture.
    #[error(
        "camera `{camera}`: {outside} of {of} keypoints lie outside of its {}x{} picture: they are of another camera, or \
         `size` is of another resolution",
        size_px[0], size_px[1]
    )]
    OutsidePicture {
        /// The camera's name.
        camera: String,
        /// Keypoints outside.
        outside: usize,
        /// All of them.
        of: usize,
        /// Width and height.
        size_px: [u32; 2],
    },
    /// Nobody was seen well enough to tell how any two cameras stand.
    #[error(
        "camera `{camera}`: found {found} bodies with ankles and shoulders, expected at least {least}: let people walk \
         where their whole bodies are in the picture"
    )]
    TooFewBodies {
        /// The camera that saw the most.
        camera: String,
        /// How many.
        found: usize,
        /// How many are needed.
        least: usize,
    },
    /// No two cameras agree about anybody.
    #[error(
        "no two cameras agree on how they stand to each other: the best are `{first}` and `{second}` with {moments} bodies \
         that both saw, {share_percent:.0} % of whose keypoints agree; expected half of {least} bodies or more. Look at \
         clocks and intrinsics, and let people walk on curves where several cameras see them"
    )]
    NothingAgrees {
        /// One camera of the best pair.
        first: String,
        /// The other.
        second: String,
        /// Bodies that both saw.
        moments: usize,
        /// Share of their keypoints that agrees.
        share_percent: f64,
        /// How many are needed.
        least: usize,
    },
}
