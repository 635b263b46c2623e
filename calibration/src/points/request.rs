//! The request for a calibration from a single moving point, and the reasons why it fails.

use farfield_proto::camera::{CameraError, Intrinsics, LensModel};
use nalgebra::Vector3;

use super::file::Sighting;
use crate::alignment::Anchors;

/// One camera: its lens, and its sightings of the point.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCamera {
    /// Its name in the calibration.
    pub name: String,
    /// Width and height of its pictures, pixels.
    pub size_px: [u32; 2],
    /// Pinhole intrinsics from its own calibration; see [`Lenses`].
    pub intrinsics: Intrinsics,
    /// Lens.
    pub lens: LensModel,
    /// Frames per second of its video. Needed unless [`Timing::Synchronised`]; a nominal rate is enough for
    /// [`Timing::Unknown`].
    pub rate_hz: Option<f64>,
    /// Time of its frame 0, seconds, on any clock that all cameras share. Needed for [`Timing::Clocks`].
    pub offset_s: Option<f64>,
    /// The sightings, in the order of their frames ([`super::parse`]).
    pub sightings: Vec<Sighting>,
}

/// What is known about the times of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// Frames of the same number were taken at the same time.
    Synchronised,
    /// Rates and offsets are given and correct.
    Clocks,
    /// Rates are approximate; offsets are not known.
    Unknown,
}

/// The parameters of the lenses that are adjusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lenses {
    /// None: lenses stay as given.
    Given,
    /// Focal lengths, with the given ones as prior.
    Focal,
    /// Focal lengths, principal points and distortion, with the given ones as prior.
    All,
}

/// The request for a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct PointRequest {
    /// At least two cameras, of different names.
    pub cameras: Vec<PointCamera>,
    /// What is known about time.
    pub timing: Timing,
    /// The parameters of the lenses that are adjusted.
    pub lenses: Lenses,
    /// Largest distance of agreeing sights while poses are rough, pixels: 3 for a light or a ball; more if lenses are not
    /// known well.
    pub gate_px: f64,
    /// Seed of the random samples: the same seed and the same input give the same bits.
    pub seed: u64,
    /// Known facts about the venue.
    pub anchors: Anchors,
    /// The board whose corners the cameras saw, if any. The number of a sight is then [`super::CORNERS_PER_INSTANT`] times the
    /// instant, plus the corner's number.
    pub board: Option<RigidBoard>,
}

impl PointRequest {
    /// A request without known facts: gate 3 px, seed 1, lenses as given, no anchors.
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

/// A board whose inner corners are numbered row by row, as `OpenCV` numbers those of a `ChArUco` board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBoard {
    /// Squares along a row and along a column.
    pub squares: [u32; 2],
    /// Side of a square, metres.
    pub square_m: f64,
}

impl RigidBoard {
    /// Its inner corners relative to their middle, metres.
    pub(super) fn shape(&self) -> Vec<Vector3<f64>> {
        let [columns, rows] = self.squares.map(|n| n.saturating_sub(1));
        let place =
            |i: u32, count: u32| self.square_m * (f64::from(i) - 0.5 * (f64::from(count) - 1.0));
        let corners = (0..rows).flat_map(|v| (0..columns).map(move |u| (u, v)));
        corners
            .map(|(u, v)| Vector3::new(place(u, columns), place(v, rows), 0.0))
            .collect()
    }

    /// The number of its inner corners.
    pub(super) fn corner_count(&self) -> usize {
        let [columns, rows] = self.squares.map(|n| n.saturating_sub(1) as usize);
        columns.saturating_mul(rows)
    }
}

/// The reason why a calibration fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A camera's intrinsics are unusable.
    #[error(transparent)]
    Camera(CameraError),
    /// Fewer than two cameras.
    #[error("found {found} cameras, expected at least 2")]
    TooFewCameras {
        /// The number of cameras.
        found: usize,
    },
    /// A camera has too few sightings.
    #[error(
        "camera `{camera}`: found {found} sightings inside the range of its lens, expected at least {least}"
    )]
    TooFewSightings {
        /// The camera's name.
        camera: String,
        /// The number of sightings.
        found: usize,
        /// The number needed.
        least: usize,
    },
    /// Sightings lie outside of the picture.
    #[error(
        "camera `{camera}`: {outside} of {of} sightings lie outside of its {}x{} picture: they belong to another camera, or \
         `size` is that of another resolution",
        size_px[0], size_px[1]
    )]
    OutsidePicture {
        /// The camera's name.
        camera: String,
        /// Sightings outside.
        outside: usize,
        /// All sightings.
        of: usize,
        /// Width and height.
        size_px: [u32; 2],
    },
    /// A frame rate is missing or invalid.
    #[error("camera `{camera}`: `rate_hz`: found {found:?}, expected 0.1 to 100000")]
    Rate {
        /// The camera's name.
        camera: String,
        /// The rate.
        found: f64,
    },
    /// Two cameras have one name.
    #[error("two cameras are called `{camera}`, expected different names")]
    SameName {
        /// The name.
        camera: String,
    },
    /// An offset is missing.
    #[error(
        "camera `{camera}`: `offset_s` is missing or not finite, expected seconds where clocks are given"
    )]
    Offset {
        /// The camera's name.
        camera: String,
    },
    /// No two cameras agree.
    #[error(
        "no two cameras agree on their relative pose: found at best {share_percent:.0} % of {moments} common \
         moments that agree, in cameras `{first}` and `{second}`; expected half of 15 or more. Check rates, offsets and \
         intrinsics, or carry the point where several cameras see it"
    )]
    NothingAgrees {
        /// One camera of the best pair.
        first: String,
        /// The other.
        second: String,
        /// Moments that both saw.
        moments: usize,
        /// Share of them that agree.
        share_percent: f64,
    },
    /// A number of the request, or a known fact about the venue, is unusable.
    #[error("{0}")]
    Request(String),
    /// The result cannot be aligned with the known facts about the venue.
    #[error("{0}")]
    Alignment(String),
}
