//! The report of an import, for people and for programs.

use std::path::PathBuf;

use farfield_calibration::formats::Remark;
use serde::Serialize;

/// What an import wrote, and what the reader must know about it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Format of the keypoints.
    pub format: &'static str,
    /// Format of the calibration.
    pub calibration_format: &'static str,
    /// The calibration's files.
    pub calibration: Vec<PathBuf>,
    /// The venue file that was written.
    pub venue: PathBuf,
    /// Frames per second.
    pub rate_hz: f64,
    /// First frame, which is also the first tick of the venue.
    pub first_frame: i64,
    /// Frames of every camera, including the empty ones.
    pub frames: i64,
    /// The cameras in the order of the calibration.
    pub cameras: Vec<CameraReport>,
    /// Name of the keypoint model.
    pub model: String,
    /// Keypoints that were imported: of COCO and of feet.
    pub mapped: Vec<&'static str>,
    /// COCO keypoints that the files lack.
    pub missing: Vec<&'static str>,
    /// Other keypoints of the files.
    pub left_out: Vec<String>,
    /// What was assumed, corrected, or is suspect.
    pub remarks: Vec<Remark>,
}

/// One camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraReport {
    /// Its name in the calibration, and in the venue.
    pub name: String,
    /// The file or folder of its keypoints.
    pub source: String,
    /// The keypoint file that was written.
    pub keypoints: PathBuf,
    /// Frames in the source.
    pub frames: usize,
    /// First frame in the source.
    pub first_frame: i64,
    /// Last frame in the source.
    pub last_frame: i64,
    /// Frames of the import that the source lacks; they are written as empty lines.
    pub missing_frames: i64,
    /// Mean number of people per frame of the source.
    pub people_mean: f64,
    /// Largest number of people in a frame of the source.
    pub people_max: usize,
}
