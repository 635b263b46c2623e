//! What a calibration from a single moving point is asked for.

use farfield_proto::camera::{Intrinsics, LensModel};

use super::file::Sighting;
use super::rigid_board::RigidBoard;
use crate::alignment::Anchors;

/// One camera: its lens, and where it saw the point.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCamera {
    /// Its name in the calibration.
    pub name: String,
    /// Width and height of its pictures, pixels.
    pub size_px: [u32; 2],
    /// Pinhole, as its own calibration found it; see [`Lenses`].
    pub intrinsics: Intrinsics,
    /// Lens.
    pub lens: LensModel,
    /// Frames per second of its video. Needed unless [`Timing::Synchronised`]; a nominal one is enough for
    /// [`Timing::Unknown`].
    pub rate_hz: Option<f64>,
    /// Time of its frame 0, seconds, on any clock that all cameras share. Needed for [`Timing::Clocks`].
    pub offset_s: Option<f64>,
    /// The sightings, in the order of their frames ([`super::parse`]).
    pub sightings: Vec<Sighting>,
}

/// What is known of when frames were taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// Frames of the same number were taken at the same moment.
    Synchronised,
    /// Rates and offsets are given, and right.
    Clocks,
    /// Rates are about as given; offsets are not known.
    Unknown,
}

/// What of the lenses may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lenses {
    /// As given.
    Given,
    /// Focal lengths, about the given ones.
    Focal,
    /// Focal lengths, principal points and distortion, about the given ones.
    All,
}

/// A calibration that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct PointRequest {
    /// At least two cameras, of different names.
    pub cameras: Vec<PointCamera>,
    /// What is known of time.
    pub timing: Timing,
    /// What of the lenses may move.
    pub lenses: Lenses,
    /// Distance in pixels within which sights agree while poses are rough. 3 for a light or a ball; more where lenses
    /// are badly known.
    pub gate_px: f64,
    /// Seed of the random samples: the same seed and the same input give the same bits.
    pub seed: u64,
    /// What is known of the venue.
    pub anchors: Anchors,
    /// The board whose corners the cameras saw, where they saw one: the number of a sight is [`super::CORNERS_PER_INSTANT`] times
    /// the instant, plus the corner's number.
    pub board: Option<RigidBoard>,
}

impl PointRequest {
    /// A request with nothing known but the cameras: gate 3 px, seed 1, lenses as given, no anchors.
    pub fn new(cameras: Vec<PointCamera>, timing: Timing) -> Self {
        Self {
            cameras,
            timing,
            lenses: Lenses::Given,
            gate_px: 3.0,
            seed: 1,
            anchors: Anchors::default(),
            board: None,
        }
    }
}
