//! Calibration files of any content: read or refused, never a panic.
#![no_main]

use std::path::Path;

use farfield_proto::calibration::Calibration;
use farfield_proto::frames::Pixel;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(calibration) = Calibration::parse(text, Path::new("calibration.toml")) else { return };
    for camera in calibration.cameras.values() {
        assert!(camera.undistort(Pixel::new(0.0, 0.0)).is_some(), "a camera that was accepted sees its corner");
    }
});
