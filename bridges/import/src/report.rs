//! What an import says of itself, for people and for programs.

use std::path::PathBuf;

use farfield_calibration::formats::Remark;
use serde::Serialize;

/// All that was made, and what the reader of it must know.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Whose keypoints they were.
    pub format: &'static str,
    /// Whose calibration it was.
    pub calibration_format: &'static str,
    /// The calibration's files.
    pub calibration: Vec<PathBuf>,
    /// The venue file that was written.
    pub venue: PathBuf,
    /// Frames per second.
    pub rate_hz: f64,
    /// First frame, which is a tick of the venue.
    pub first_frame: i64,
    /// Frames of every camera, with those that are empty.
    pub frames: i64,
    /// The cameras in the order of the calibration.
    pub cameras: Vec<CameraReport>,
    /// What the keypoints were called.
    pub model: String,
    /// Keypoints that became ours.
    pub mapped: Vec<&'static str>,
    /// Ours that the files have not.
    pub missing: Vec<&'static str>,
    /// What else the files have: a keypoint file of ours has COCO's 17.
    pub left_out: Vec<String>,
    /// What was assumed, put right, or is doubtful.
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
    /// Frames that were in the source.
    pub frames: usize,
    /// The first of them.
    pub first_frame: i64,
    /// The last of them.
    pub last_frame: i64,
    /// Frames in between, and of the other cameras, that it has not: they are empty lines.
    pub missing_frames: i64,
    /// People per frame of the source, mean.
    pub people_mean: f64,
    /// People per frame of the source, largest.
    pub people_max: usize,
}
