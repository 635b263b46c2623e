//! A man on a treadmill, with mistakes in his videos: real cameras and a real network.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::data::{cases, onnx_runtime, recording};
use crate::farfield::run;

const SCENARIO: &str = "mistakes on the treadmill";
const CAMERAS: [&str; 4] = ["cam01", "cam02", "cam03", "cam04"];
/// Ticks of a run. A permanent mistake shows in a third of them, and inference on every image takes time.
const FIRST_TICKS: &str = "0..30";
const ALL_TICKS: &str = "0..100";
/// Widths of the cameras' pictures, pixels.
const WIDTHS_PX: [u32; 4] = [1080, 1080, 1088, 1088];

/// The recording and a folder for changed videos.
struct Treadmill {
    folder: PathBuf,
    dir: tempfile::TempDir,
}

impl Treadmill {
    /// `None`, reported on stdout, where the recording, ONNX Runtime or ffmpeg is missing.
    fn new() -> Option<Self> {
        let venue = recording(SCENARIO, "data/pose2sim/single/venue.toml")?;
        if !onnx_runtime(SCENARIO) {
            return None;
        }
        Some(Self {
            folder: fs::canonicalize(venue.parent()?).unwrap(),
            dir: tempfile::tempdir().unwrap(),
        })
    }

    fn video(&self, camera: &str) -> PathBuf {
        self.folder.join("videos").join(format!("{camera}.mp4"))
    }

    /// The video of a camera after an ffmpeg filter, with its length unchanged.
    fn filtered(&self, camera: &str, filter: &str, name: &str) -> PathBuf {
        let path = self.dir.path().join(format!("{camera}-{name}.mp4"));
        if path.exists() {
            return path;
        }
        let ended = Command::new("ffmpeg")
            .args(["-v", "error", "-i"])
            .arg(self.video(camera))
            .args(["-vf", filter, "-frames:v", "100"])
            .args(["-c:v", "libx264", "-crf", "12", "-preset", "veryfast"])
            .arg(&path)
            .status()
            .unwrap();
        assert!(ended.success());
        path
    }

    /// The video of camera `of`, as wide as those of camera `as_of`.
    fn as_wide_as(&self, of: usize, as_of: usize) -> PathBuf {
        let filter = match (WIDTHS_PX[of], WIDTHS_PX[as_of]) {
            (own, other) if own == other => return self.video(CAMERAS[of]),
            (1080, _) => "pad=1088:1920:4:0",
            _ => "crop=1080:1920:4:0",
        };
        self.filtered(CAMERAS[of], filter, "as-wide")
    }

    /// Disagreements of a run with other videos for these cameras.
    fn disagreements(&self, name: &str, videos: &[(&str, &Path)], ticks: &str) -> Vec<Value> {
        let mut venue = fs::read_to_string(self.folder.join("venue.toml")).unwrap();
        for camera in CAMERAS {
            let other = videos.iter().find(|(of, _)| *of == camera);
            let video = other.map_or_else(|| self.video(camera), |(_, video)| video.to_path_buf());
            let own = format!("\"videos/{camera}.mp4\"");
            assert!(venue.contains(&own));
            venue = venue.replace(&own, &format!("{:?}", video.display().to_string()));
        }
        let models = fs::canonicalize(self.folder.join("../../../models")).unwrap();
        let full = |file: &str| format!("{:?}", self.folder.join(file).display().to_string());
        let venue = venue
            .replace("../../../models", &models.display().to_string())
            .replace("\"calibration.toml\"", &full("calibration.toml"));
        let path = self.dir.path().join(format!("{name}.toml"));
        fs::write(&path, venue).unwrap();
        let out = self.dir.path().join(name);
        run(&path, &out, &["--ticks", ticks]);
        let summary = fs::read_to_string(out.join("summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        let disagreements = summary["agreement"]["disagreements"]
            .as_array()
            .unwrap()
            .clone();
        for one in &disagreements {
            println!("treadmill, {name}: {}", one["found"].as_str().unwrap());
        }
        disagreements
    }
}

#[test]
fn swapped_pairs_are_reported_within_half_a_second() {
    let Some(treadmill) = Treadmill::new() else {
        return;
    };
    // These pairs contain all four cameras and images of both widths.
    let pairs = [(0, 3), (1, 2), (0, 1), (2, 3), (0, 2), (1, 3)];
    for (a, b) in cases("swapped pairs on the treadmill", pairs, 2) {
        let (first, second) = (CAMERAS[a], CAMERAS[b]);
        let videos = [treadmill.as_wide_as(b, a), treadmill.as_wide_as(a, b)];
        let name = format!("swapped-{}-{}", a + 1, b + 1);
        let changed = [(first, &*videos[0]), (second, &*videos[1])];
        let disagreements = treadmill.disagreements(&name, &changed, FIRST_TICKS);
        assert_eq!(disagreements.len(), 1, "{name}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "swapped", "{name}");
        assert_eq!(
            disagreements[0]["cameras"],
            serde_json::json!([first, second])
        );
    }
}

#[test]
fn a_shift_in_time_is_found_to_a_fifth_of_a_tick() {
    let Some(treadmill) = Treadmill::new() else {
        return;
    };
    for ticks in cases("a late video on the treadmill", [1, 30, 3], 2) {
        let filter = format!("tpad=start={ticks}:start_mode=clone");
        let name = format!("late-{ticks}");
        let video = treadmill.filtered("cam02", &filter, &name);
        let disagreements = treadmill.disagreements(&name, &[("cam02", &*video)], ALL_TICKS);
        assert_eq!(disagreements.len(), 1, "{name}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "late", "{name}");
        let reported = disagreements[0]["ticks"].as_f64().unwrap();
        assert!(
            (reported - f64::from(ticks)).abs() < 0.2,
            "{name}: {reported}"
        );
    }
}

#[test]
fn mirrored_and_upside_down_videos_are_reported() {
    let Some(treadmill) = Treadmill::new() else {
        return;
    };
    for (filter, cause) in [("hflip", "mirrored"), ("hflip,vflip", "half_turned")] {
        let video = treadmill.filtered("cam02", filter, cause);
        let disagreements = treadmill.disagreements(cause, &[("cam02", &*video)], FIRST_TICKS);
        assert_eq!(disagreements.len(), 1, "{cause}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], cause);
        assert_eq!(disagreements[0]["cameras"], serde_json::json!(["cam02"]));
    }
}
