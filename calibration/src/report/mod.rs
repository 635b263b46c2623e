//! The report on a calibration: figures for each camera, and findings.

mod coverage;
mod field;
mod field_map;
mod finding;

pub use coverage::{PictureCoverage, PictureEdge};
pub(crate) use field::field_camera;
pub use field::{FIELD_SIGHT_PX, FieldReport};
pub use field_map::{FieldCamera, FieldCell, FieldGrid, field_map};
pub use finding::{Cause, Finding};
pub(crate) use finding::{
    HalvesCheck, empty_picture, finding, halves_apart, other_focal_length, uncertain_place,
};

/// Angles with a larger standard deviation are undetermined, degrees.
const HALF_TURN_DEG: f64 = 180.0;

/// The report on one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraReport {
    /// The camera's name.
    pub name: String,
    /// Sights in the last adjustment.
    pub sights: usize,
    /// Share of them within four standard deviations.
    pub used_share: f64,
    /// Root of the mean squared length of their residuals, pixels.
    pub rms_px: f64,
    /// Standard deviation of a sight along each axis, pixels.
    pub noise_px: f64,
    /// Standard deviation of the pinhole's position after similarity alignment of all cameras, metres.
    pub position_sigma_m: f64,
    /// Standard deviation of its rotation, degrees.
    pub rotation_sigma_deg: f64,
    /// Its adjusted focal length relative to the given one.
    pub focal_ratio: f64,
    /// Time of frame 0, seconds, on the clock of the camera with the most sights.
    pub offset_s: f64,
    /// Frames per second of that clock.
    pub rate_hz: f64,
    /// Distance of its pinhole between calibrations from the first and the second half of the data, metres.
    pub halves_m: f64,
    /// Rotation between them, degrees.
    pub halves_deg: f64,
    /// The 95th percentile of the distances between the projections of its sights in both, pixels.
    pub halves_px: f64,
    /// The same at the points, across the line of sight, metres.
    pub halves_across_m: f64,
    /// The distribution of its fitting sights in its picture.
    pub coverage: PictureCoverage,
}

impl CameraReport {
    /// Standard deviation of its rotation, degrees; `None` if the sights do not determine it (more than half a turn).
    pub fn determined_rotation_deg(&self) -> Option<f64> {
        Some(self.rotation_sigma_deg).filter(|deg| *deg <= HALF_TURN_DEG)
    }
}

/// The report on the people.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeopleReport {
    /// Their median stature, metres, shoes included.
    pub stature_m: f64,
    /// The factor on all distances that would make it the given stature, or that of usual adults.
    pub world_scale: f64,
}

/// The report on all cameras.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// One per camera with a pose.
    pub cameras: Vec<CameraReport>,
    /// The stature of people in the result; `None` without people.
    pub people: Option<PeopleReport>,
    /// Root mean square residual of the known places, metres.
    pub anchors_rms_m: Option<f64>,
    /// The accuracy over the field; `None` if the scale or the floor is unknown.
    pub field: Option<FieldReport>,
    /// All findings, errors first.
    pub findings: Vec<Finding>,
}

impl Report {
    /// Whether there are no errors.
    pub fn passes(&self) -> bool {
        !self.findings.iter().any(Finding::is_wrong)
    }
}
