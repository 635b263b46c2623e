//! Files of 2D keypoints of any content: read to their end or refused, never a panic.
#![no_main]

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use farfield_edge::source::{open, probe};
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
const VENUE: &str = r#"
name = "v"
rate_hz = 60.0
calibration = "calibration.toml"
[[viewpoint]]
name = "n"
[[viewpoint.camera]]
name = "a"
source = { kind = "keypoints", path = "keypoints.jsonl" }
"#;

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("farfield-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder can be made");
    folder
});
static CAMERA: LazyLock<Venue> = LazyLock::new(|| {
    let calibration = Calibration::parse(CALIBRATION, Path::new("calibration.toml"));
    let calibration = calibration.expect("the text above is a calibration");
    Venue::parse(VENUE, &FOLDER.join("venue.toml"), calibration).expect("the text above is a venue")
});

fuzz_target!(|bytes: &[u8]| {
    let venue = &*CAMERA;
    let path = FOLDER.join("keypoints.jsonl");
    std::fs::write(path, bytes).expect("a temporary file can be written");
    let Ok(info) = probe(&venue.cameras[0], venue) else {
        return;
    };
    let ticks = info.ticks.expect("a file has an end");
    let Ok(mut source) = open(&venue.cameras[0], venue, ticks.start) else {
        return;
    };
    while let Ok(Some(frame)) = source.next_frame() {
        black_box(frame);
    }
});
