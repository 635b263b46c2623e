//! The files that describe a venue.

use std::path::{Path, PathBuf};

use farfield_proto::calibration::Calibration;
use farfield_proto::frames::Pixel;
use farfield_proto::venue::Venue;

use super::{read_or_refused, text};

const CALIBRATION: &str = r"
[a]
size = [64, 48]
matrix = [[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.0]
";
const VENUE: &str = r#"
name = "v"
rate_hz = 60.0
calibration = "calibration.toml"
[[viewpoint]]
name = "n"
[[viewpoint.camera]]
name = "a"
source = { kind = "keypoints", path = "PATH" }
"#;

/// Calibration files of any content: read or refused.
pub(super) fn calibration_text(bytes: &[u8]) -> String {
    let calibration = Calibration::parse(text(bytes), Path::new("calibration.toml"));
    for camera in calibration.iter().flat_map(|it| it.cameras.values()) {
        let corner = camera.undistort(Pixel::new(0.0, 0.0));
        if camera.lens().is_fisheye() {
            assert!(
                corner.is_none_or(|ideal| ideal.vector_px().iter().all(|v| v.is_finite())),
                "what is used of a fisheye has a place among the pinhole's pixels"
            );
        } else {
            assert!(
                corner.is_some(),
                "a camera that was accepted sees its corner"
            );
        }
    }
    read_or_refused(&calibration)
}

/// Venue files of any content: read or refused.
pub(super) fn venue_text(bytes: &[u8]) -> String {
    let venue = Venue::parse(text(bytes), Path::new("venue.toml"), one_camera());
    read_or_refused(&venue)
}

/// A venue of one camera, `a`, with its keypoints in this file of this folder.
pub(super) fn keypoint_venue(folder: &Path, file: &str) -> Venue {
    let path: PathBuf = folder.join("venue.toml");
    let venue = Venue::parse(&VENUE.replace("PATH", file), &path, one_camera());
    venue.expect("the text above is a venue")
}

fn one_camera() -> Calibration {
    let calibration = Calibration::parse(CALIBRATION, Path::new("calibration.toml"));
    calibration.expect("the text above is a calibration")
}
