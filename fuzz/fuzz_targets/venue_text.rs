//! Venue files of any content: read or refused, never a panic.
#![no_main]

use std::hint::black_box;
use std::path::Path;

use farfield_proto::calibration::Calibration;
use farfield_proto::venue::Venue;
use libfuzzer_sys::fuzz_target;

const CALIBRATION: &str = r#"
[a]
size = [64, 48]
matrix = [[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.0]
"#;

fuzz_target!(|text: &str| {
    let calibration = Calibration::parse(CALIBRATION, Path::new("calibration.toml"));
    let calibration = calibration.expect("the text above is a calibration");
    black_box(Venue::parse(text, Path::new("venue.toml"), calibration).is_ok());
});
