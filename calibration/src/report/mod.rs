//! What is said of a calibration: per camera numbers, and what speaks against it.

mod coverage;
mod field;
mod field_map;
mod finding;
mod of_camera;

pub use coverage::{PictureCoverage, PictureEdge};
pub(crate) use field::field_camera;
pub use field::{FIELD_SIGHT_PX, FieldReport};
pub use field_map::{FieldCamera, FieldCell, FieldGrid, field_map};
pub(crate) use finding::finding;
pub use finding::{Cause, Finding};
pub(crate) use of_camera::{empty_picture, other_focal_length, uncertain_place};

/// A standard deviation of an angle beyond which nothing is known of it, degrees.
const HALF_TURN_DEG: f64 = 180.0;

/// What is said of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraReport {
    /// The camera's name.
    pub name: String,
    /// Sights that the last adjustment looked at.
    pub sights: usize,
    /// Share of them within four standard deviations.
    pub used_share: f64,
    /// Root of the mean squared length of the residuals of those, pixels.
    pub rms_px: f64,
    /// Standard deviation of a sight along each axis, pixels.
    pub noise_px: f64,
    /// Standard deviation of the pinhole's place after similarity alignment of all cameras, metres.
    pub position_sigma_m: f64,
    /// Standard deviation of its rotation, degrees.
    pub rotation_sigma_deg: f64,
    /// Its focal length now over the given one.
    pub focal_ratio: f64,
    /// Time of frame 0, seconds, on the clock of the camera with the most sights.
    pub offset_s: f64,
    /// Frames per second of that clock.
    pub rate_hz: f64,
    /// How far first and second half of the data, adjusted apart, put its pinhole from each other, metres.
    pub halves_m: f64,
    /// And how far they turn it, degrees.
    pub halves_deg: f64,
    /// How far they draw apart what it saw: 95 % of its sights by less, pixels.
    pub halves_px: f64,
    /// The same where the point is, across the line of sight, metres.
    pub halves_across_m: f64,
    /// Where in its picture the sights are that fit.
    pub coverage: PictureCoverage,
}

impl CameraReport {
    /// Standard deviation of its rotation, degrees; `None` where the sights do not determine it: beyond half a turn nothing is
    /// known.
    pub fn determined_rotation_deg(&self) -> Option<f64> {
        Some(self.rotation_sigma_deg).filter(|deg| *deg <= HALF_TURN_DEG)
    }
}

/// What is said of the people.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeopleReport {
    /// Their median stature, metres, shoes included.
    pub stature_m: f64,
    /// The factor on all distances that would make it the given one, or that of usual adults.
    pub world_scale: f64,
}

/// What is said of all cameras.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// Per camera that has a pose.
    pub cameras: Vec<CameraReport>,
    /// How tall people come out; `None` where there were none.
    pub people: Option<PeopleReport>,
    /// Distance of the known places to where they were found, root mean square, metres.
    pub anchors_rms_m: Option<f64>,
    /// How well which part of the field is known; `None` where nothing says how long a metre is or where the floor is.
    pub field: Option<FieldReport>,
    /// What speaks against it, what is wrong first.
    pub findings: Vec<Finding>,
}

impl Report {
    /// Whether nothing is wrong.
    pub fn passes(&self) -> bool {
        !self.findings.iter().any(Finding::is_wrong)
    }
}
