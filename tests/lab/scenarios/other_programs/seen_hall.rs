//! The hall of the sample with a file a camera of what it saw, calibrated anew as a user does it.

use std::fs;
use std::path::{Path, PathBuf};

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;

use crate::data::SampleFolder;
use crate::farfield::{FinishedCommand, farfield};

/// The calibration in a file.
pub(super) fn calibration(path: &Path) -> Calibration {
    Calibration::parse(&fs::read_to_string(path).unwrap(), path).unwrap()
}

/// The sample, what its cameras saw, and where they stand.
pub(super) struct SeenHall {
    pub(super) folder: SampleFolder,
    pub(super) truth: Calibration,
    files: Vec<PathBuf>,
}

impl SeenHall {
    /// With a file `CAMERA.extension` of what `seen_by` says of each camera and its number.
    pub(super) fn new(extension: &str, seen_by: impl Fn(&CameraModel, usize) -> String) -> Self {
        let folder = SampleFolder::new();
        let truth = calibration(&folder.path("calibration.toml"));
        let mut files = Vec::new();
        for (number, camera) in truth.cameras.values().enumerate() {
            let path = folder.path(&format!("{}.{extension}", camera.name()));
            fs::write(&path, seen_by(camera, number)).unwrap();
            files.push(path);
        }
        Self {
            folder,
            truth,
            files,
        }
    }

    /// Runs `farfield calibrate KIND` with the true lenses.
    pub(super) fn calibrate(&self, kind: &str, more: &[&str]) -> FinishedCommand {
        let lens = self.folder.path("calibration.toml");
        let out = self.folder.path("found.toml");
        let mut words = vec!["calibrate".to_owned(), kind.to_owned()];
        words.extend(self.files.iter().map(|path| path.display().to_string()));
        words.extend(["--lens".to_owned(), lens.display().to_string()]);
        words.extend(["--out".to_owned(), out.display().to_string()]);
        words.extend(more.iter().map(|word| (*word).to_owned()));
        farfield(&words)
    }
}
