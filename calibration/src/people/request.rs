//! The request for a calibration from people, and the reasons why it fails.

use farfield_proto::camera::{CameraError, Intrinsics, LensModel};
use farfield_proto::keypoints::KeypointSet;

use crate::alignment::Anchors;
use crate::points::{CalibrationError, Lenses, Timing};

/// One keypoint of one body in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// Distorted pixels, (0, 0) the centre of the first one.
    pub px: [f64; 2],
    /// Confidence of the network, 0 to 1.
    pub score: f64,
}

/// One body in one picture: its keypoints in the order of [`PeopleRequest::keypoints`], `None` if not seen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detection {
    /// Per keypoint.
    pub keypoints: Vec<Option<Keypoint>>,
}

/// All bodies that a camera saw in one frame, in any order.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectedFrame {
    /// The frame's number.
    pub frame: f64,
    /// The bodies.
    pub bodies: Vec<Detection>,
}

/// One camera: its lens, and the people that it saw.
#[derive(Debug, Clone, PartialEq)]
pub struct PeopleCamera {
    /// Its name in the calibration.
    pub name: String,
    /// Width and height of its pictures, pixels.
    pub size_px: [u32; 2],
    /// Pinhole intrinsics from its own calibration.
    pub intrinsics: Intrinsics,
    /// Lens.
    pub lens: LensModel,
    /// Frames per second, unless [`Timing::Synchronised`].
    pub rate_hz: Option<f64>,
    /// Time of its frame 0, seconds, on any clock that all cameras share. Needed for [`Timing::Clocks`].
    pub offset_s: Option<f64>,
    /// Frames in increasing order; frames without people may be left out.
    pub frames: Vec<DetectedFrame>,
}

/// The request for a calibration from people.
#[derive(Debug, Clone, PartialEq)]
pub struct PeopleRequest {
    /// At least two cameras, of different names.
    pub cameras: Vec<PeopleCamera>,
    /// The keypoints of bodies; shoulders, hips and ankles of both sides must be among them.
    pub keypoints: KeypointSet,
    /// What is known about time.
    pub timing: Timing,
    /// Frames per second of synchronised cameras.
    pub rate_hz: f64,
    /// The parameters of the lenses that are adjusted.
    pub lenses: Lenses,
    /// Mean stature of the people in shoes, metres; it gives the scale if no distance and no places are known.
    pub stature_m: Option<f64>,
    /// Known facts about the venue.
    pub anchors: Anchors,
    /// Seed of the random samples: the same seed and the same input give the same bits.
    pub seed: u64,
}

impl PeopleRequest {
    /// A request for synchronised cameras of `rate_hz` with COCO's 17 keypoints: lenses as given, seed 1, no known facts.
    pub fn new(cameras: Vec<PeopleCamera>, rate_hz: f64) -> Self {
        Self {
            cameras,
            keypoints: KeypointSet::coco17(),
            timing: Timing::Synchronised,
            rate_hz,
            lenses: Lenses::Given,
            stature_m: None,
            anchors: Anchors::default(),
            seed: 1,
        }
    }
}

/// The reason why a calibration from people fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PeopleError {
    /// A camera's intrinsics are unusable.
    #[error(transparent)]
    Camera(CameraError),
    /// An error of any calibration.
    #[error(transparent)]
    Request(CalibrationError),
    /// The network lacks joints that are needed to locate people.
    #[error("the keypoints lack `{missing}`: shoulders, hips and ankles of both sides are needed")]
    Keypoints {
        /// The first missing keypoint.
        missing: String,
    },
    /// A number is unusable.
    #[error("`{field}`: found {found}, expected {expected}")]
    Number {
        /// The field.
        field: &'static str,
        /// Its value.
        found: f64,
        /// The accepted values.
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
        /// The number of keypoints of the body.
        found: usize,
        /// The number of keypoints of the network.
        expected: usize,
    },
    /// Keypoints lie outside of the picture.
    #[error(
        "camera `{camera}`: {outside} of {of} keypoints lie outside of its {}x{} picture: they belong to another camera, or \
         `size` is that of another resolution",
        size_px[0], size_px[1]
    )]
    OutsidePicture {
        /// The camera's name.
        camera: String,
        /// Keypoints outside.
        outside: usize,
        /// All keypoints.
        of: usize,
        /// Width and height.
        size_px: [u32; 2],
    },
    /// No two cameras saw enough bodies for a relative pose.
    #[error(
        "camera `{camera}`: found {found} bodies with ankles and shoulders, expected at least {least}: let people walk \
         where their whole bodies are in the picture"
    )]
    TooFewBodies {
        /// The camera that saw the most.
        camera: String,
        /// The number of bodies.
        found: usize,
        /// The number needed.
        least: usize,
    },
    /// No two cameras agree on any person.
    #[error(
        "no two cameras agree on their relative pose: the best are `{first}` and `{second}` with {moments} bodies \
         that both saw, {share_percent:.0} % of whose keypoints agree; expected half of {least} bodies or more. Check \
         clocks and intrinsics, and let people walk on curves where several cameras see them"
    )]
    NothingAgrees {
        /// One camera of the best pair.
        first: String,
        /// The other.
        second: String,
        /// Bodies that both saw.
        moments: usize,
        /// Share of their keypoints that agree.
        share_percent: f64,
        /// The number needed.
        least: usize,
    },
}
