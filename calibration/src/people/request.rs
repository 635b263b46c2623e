//! What a calibration from people is asked for.

use farfield_proto::camera::{Intrinsics, LensModel};
use farfield_proto::keypoints::KeypointSet;

use crate::alignment::Anchors;
use crate::points::{Lenses, Timing};

/// One keypoint of one body in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// Distorted pixels, (0, 0) the centre of the first one.
    pub px: [f64; 2],
    /// How sure the network was, 0 to 1.
    pub score: f64,
}

/// One body in one picture: its keypoints in the order of [`PeopleRequest::keypoints`], `None` where not seen.
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

/// One camera: its lens, and whom it saw.
#[derive(Debug, Clone, PartialEq)]
pub struct PeopleCamera {
    /// Its name in the calibration.
    pub name: String,
    /// Width and height of its pictures, pixels.
    pub size_px: [u32; 2],
    /// Pinhole, as its own calibration found it.
    pub intrinsics: Intrinsics,
    /// Lens.
    pub lens: LensModel,
    /// Frames per second, where not [`Timing::Synchronised`].
    pub rate_hz: Option<f64>,
    /// Time of its frame 0, seconds, on any clock that all cameras share. Needed for [`Timing::Clocks`].
    pub offset_s: Option<f64>,
    /// Frames in increasing order; those without anybody may be left out.
    pub frames: Vec<DetectedFrame>,
}

/// A calibration that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct PeopleRequest {
    /// At least two cameras, of different names.
    pub cameras: Vec<PeopleCamera>,
    /// Which keypoints bodies have. Shoulders, hips and ankles of both sides must be among them.
    pub keypoints: KeypointSet,
    /// What is known of time.
    pub timing: Timing,
    /// Frames per second of synchronised cameras.
    pub rate_hz: f64,
    /// What of the lenses may move.
    pub lenses: Lenses,
    /// Mean stature of the people, metres, in shoes; the scale where no distance and no places are known.
    pub stature_m: Option<f64>,
    /// What is known of the venue.
    pub anchors: Anchors,
    /// Seed of the random samples: the same seed and the same input give the same bits.
    pub seed: u64,
}

impl PeopleRequest {
    /// A request with nothing known but synchronised cameras of `rate_hz` and COCO's 17 keypoints: lenses as given, seed 1.
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
