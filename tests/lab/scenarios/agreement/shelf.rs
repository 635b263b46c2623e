//! The Shelf recording with keypoints of `OpenPose`: four people who hardly move, and rough keypoints.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;

use crate::data::recording;
use crate::farfield::run;

const SCENARIO: &str = "mistakes on the Shelf";
const CAMERAS: [&str; 5] = ["cam0", "cam1", "cam2", "cam3", "cam4"];

/// The recording and a folder for changed copies; `None`, reported on stdout, where it is missing.
struct Shelf {
    folder: PathBuf,
    dir: tempfile::TempDir,
}

impl Shelf {
    fn new() -> Option<Self> {
        let venue = recording(SCENARIO, "data/shelf/venue.toml")?;
        let dir = tempfile::tempdir().unwrap();
        let folder = fs::canonicalize(venue.parent()?).unwrap();
        for file in ["venue.toml", "calibration.toml"] {
            fs::copy(folder.join(file), dir.path().join(file)).unwrap();
        }
        Some(Self { folder, dir })
    }

    /// The unchanged lines of a camera.
    fn lines(&self, camera: &str) -> Vec<Value> {
        let text = fs::read_to_string(self.folder.join(format!("{camera}.jsonl"))).unwrap();
        let lines = text.lines().map(|line| serde_json::from_str(line).unwrap());
        lines.collect()
    }

    /// Writes the recording with `cam1` delayed by `late_ticks`.
    fn write(&self, late_ticks: usize) {
        for camera in CAMERAS {
            let file = format!("{camera}.jsonl");
            let lines = self.lines(camera);
            let late = if camera == "cam1" { late_ticks } else { 0 };
            let shown = lines.iter().enumerate().map(|(i, line)| {
                let mut line = line.clone();
                line["persons"] = lines[i.saturating_sub(late)]["persons"].clone();
                format!("{line}\n")
            });
            fs::write(self.dir.path().join(&file), shown.collect::<String>()).unwrap();
        }
    }

    /// Writes the recording with the lines of `cam1` changed from `from_line` on.
    fn write_changed(&self, from_line: usize, changed: impl Fn(&mut Value)) {
        self.write(0);
        let path = self.dir.path().join("cam1.jsonl");
        let text = fs::read_to_string(&path).unwrap();
        let lines = text.lines().enumerate().map(|(index, line)| {
            let mut line: Value = serde_json::from_str(line).unwrap();
            if index >= from_line {
                changed(&mut line);
            }
            format!("{line}\n")
        });
        let lines = lines.collect::<String>();
        fs::write(path, lines).unwrap();
    }

    /// Writes the recording with the people of two cameras swapped from `from_line` on.
    fn write_exchanged(&self, [a, b]: [&str; 2], from_line: usize) {
        self.write(0);
        for (own, other) in [(a, b), (b, a)] {
            let (own_lines, other_lines) = (self.lines(own), self.lines(other));
            let pieces = own_lines.iter().take(from_line);
            let pieces = pieces.chain(other_lines.iter().skip(from_line));
            let lines = pieces.map(|line| format!("{line}\n"));
            let path = self.dir.path().join(format!("{own}.jsonl"));
            fs::write(path, lines.collect::<String>()).unwrap();
        }
    }

    /// Writes the recording with whole lines of these cameras delayed by `late_ticks`.
    fn write_late(&self, cameras: &[&str], late_ticks: usize) {
        self.write(0);
        for camera in cameras {
            let lines = self.lines(camera);
            let shown = lines.iter().enumerate().map(|(index, line)| {
                let mut late = lines[index.saturating_sub(late_ticks)].clone();
                late["tick"] = line["tick"].clone();
                format!("{late}\n")
            });
            let path = self.dir.path().join(format!("{camera}.jsonl"));
            fs::write(path, shown.collect::<String>()).unwrap();
        }
    }

    /// Writes the recording with `cam1` empty from `from_line` on.
    fn write_black(&self, from_line: usize) {
        self.write_changed(from_line, |line| {
            line["persons"] = Value::Array(Vec::new());
            let peaks = line.get_mut("peaks").and_then(Value::as_array_mut);
            for peaks_of_keypoint in peaks.into_iter().flatten() {
                *peaks_of_keypoint = Value::Array(Vec::new());
            }
        });
    }

    /// Writes the recording with the keypoints of `cam1` moved from `from_line` on.
    fn write_moved(&self, from_line: usize, moved: fn([f64; 2]) -> [f64; 2]) {
        self.write_changed(from_line, |line| {
            points_of(line, &mut |point| {
                let [x, y] = moved([0, 1].map(|axis| point[axis].as_f64().unwrap()));
                (point[0], point[1]) = (x.into(), y.into());
            });
        });
    }

    /// Sets the `distortions` of one camera, or of all.
    fn distort(&self, camera: Option<&str>, distortions: &str) {
        let path = self.dir.path().join("calibration.toml");
        let text = fs::read_to_string(self.folder.join("calibration.toml")).unwrap();
        let mut section = "";
        let lines = text.lines().map(|line| {
            if let Some(name) = line.strip_prefix('[').and_then(|it| it.strip_suffix(']')) {
                section = name;
            }
            if line.starts_with("distortions") && camera.is_none_or(|camera| camera == section) {
                format!("distortions = {distortions}\n")
            } else {
                format!("{line}\n")
            }
        });
        fs::write(path, lines.collect::<String>()).unwrap();
    }

    fn disagreements(&self, name: &str) -> Vec<Value> {
        let out = self.dir.path().join(name);
        run(&self.dir.path().join("venue.toml"), &out, &[]);
        let summary = fs::read_to_string(out.join("summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        let disagreements = summary["agreement"]["disagreements"].as_array().unwrap();
        for one in disagreements {
            println!("Shelf, {name}: {}", one["found"].as_str().unwrap());
        }
        disagreements.clone()
    }
}

/// Applies `each` to every `[x, y, score]` of a line, at any depth.
fn points_of(value: &mut Value, each: &mut impl FnMut(&mut Vec<Value>)) {
    match value {
        Value::Array(point) if point.len() == 3 && point.iter().all(Value::is_number) => {
            each(point);
        }
        Value::Array(all) => all.iter_mut().for_each(|value| points_of(value, each)),
        Value::Object(all) => all.values_mut().for_each(|value| points_of(value, each)),
        _ => {}
    }
}

#[test]
fn a_late_camera_is_reported_although_people_hardly_move() {
    let Some(shelf) = Shelf::new() else {
        return;
    };
    for (ticks, off) in [(0, 0.0), (3, 1.2), (30, 1.0), (90, 1.0)] {
        shelf.write(ticks);
        let name = format!("late-{ticks}");
        let disagreements = shelf.disagreements(&name);
        if ticks == 0 {
            assert_eq!(disagreements, [] as [Value; 0]);
            continue;
        }
        assert_eq!(disagreements.len(), 1, "{name}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "late", "{name}");
        assert_eq!(disagreements[0]["cameras"], serde_json::json!(["cam1"]));
        let reported = disagreements[0]["ticks"].as_f64().unwrap();
        assert!((reported - ticks as f64).abs() < off, "{name}: {reported}");
    }
}

#[test]
fn wrong_lens_distortions_are_reported() {
    let Some(shelf) = Shelf::new() else {
        return;
    };
    shelf.write(0);
    for (name, camera, distortions) in [
        ("cam1-barrel", Some("cam1"), "[-0.3, 0.1, 0.0, 0.0, 0.0]"),
        ("cam1-pincushion", Some("cam1"), "[0.3, 0.0, 0.0, 0.0, 0.0]"),
        ("cam2-pincushion", Some("cam2"), "[0.3, 0.0, 0.0, 0.0, 0.0]"),
        ("all-barrel", None, "[-0.3, 0.1, 0.0, 0.0, 0.0]"),
    ] {
        shelf.distort(camera, distortions);
        let disagreements = shelf.disagreements(name);
        assert_eq!(disagreements.len(), 1, "{name}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "distortion", "{name}");
        let expected = camera.map_or(CAMERAS.to_vec(), |camera| vec![camera]);
        assert_eq!(
            disagreements[0]["cameras"],
            serde_json::json!(expected),
            "{name}"
        );
    }
}

#[test]
fn a_black_camera_is_reported() {
    let Some(shelf) = Shelf::new() else {
        return;
    };
    for from_line in [0, 120] {
        shelf.write_black(from_line);
        let disagreements = shelf.disagreements(&format!("black-{from_line}"));
        assert_eq!(disagreements.len(), 1, "{from_line}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "silent", "{from_line}");
        assert_eq!(disagreements[0]["cameras"], serde_json::json!(["cam1"]));
        let since = disagreements[0]["since_tick"].as_i64();
        // The first line has tick 300, and detection passes are one second apart.
        let is_expected = match since {
            None => from_line == 0,
            Some(tick) => (420..=440).contains(&tick),
        };
        assert!(is_expected, "{from_line}: {since:?}");
    }
}

#[test]
fn a_camera_knocked_or_zoomed_midway_is_reported_with_the_ticks() {
    let Some(shelf) = Shelf::new() else {
        return;
    };
    // Focal length 1,098 pixels, principal point [516, 388]; the first line has tick 300.
    let turned: fn([f64; 2]) -> [f64; 2] = |[x, y]| [x + 28.0, y + 10.0];
    let zoomed: fn([f64; 2]) -> [f64; 2] =
        |[x, y]| [516.0 + 1.12 * (x - 516.0), 388.0 + 1.12 * (y - 388.0)];
    for (cause, moved) in [("turned", turned), ("focal_length", zoomed)] {
        for from_line in [150, 180] {
            shelf.write_moved(from_line, moved);
            let name = format!("{cause}-{from_line}");
            let disagreements = shelf.disagreements(&name);
            assert_eq!(disagreements.len(), 1, "{name}: {disagreements:?}");
            assert_eq!(disagreements[0]["cause"], cause, "{name}");
            assert_eq!(
                disagreements[0]["cameras"],
                serde_json::json!(["cam1"]),
                "{name}"
            );
            let from = disagreements[0]["part_ticks"][0].as_i64().unwrap();
            assert!((440..=480).contains(&from), "{name}: {from}");
        }
    }
}

#[test]
fn two_cameras_swapped_midway_are_reported_with_the_ticks() {
    let Some(shelf) = Shelf::new() else {
        return;
    };
    shelf.write_exchanged(["cam0", "cam2"], 150);
    let disagreements = shelf.disagreements("exchanged");
    assert_eq!(disagreements.len(), 1, "{disagreements:?}");
    assert_eq!(disagreements[0]["cause"], "swapped");
    assert_eq!(
        disagreements[0]["cameras"],
        serde_json::json!(["cam0", "cam2"])
    );
    let from = disagreements[0]["part_ticks"][0].as_i64().unwrap();
    assert!((440..=480).contains(&from), "{from}");
}

#[test]
fn two_of_five_cameras_with_the_same_delay_are_both_reported() {
    let Some(shelf) = Shelf::new() else {
        return;
    };
    let late = ["cam1", "cam3"];
    shelf.write_late(&late, 15);
    let disagreements = shelf.disagreements("two-late");
    assert_eq!(disagreements.len(), 2, "{disagreements:?}");
    for (one, camera) in disagreements.iter().zip(late) {
        assert_eq!(one["cause"], "late");
        assert_eq!(one["cameras"], serde_json::json!([camera]));
        let ticks = one["ticks"].as_f64().unwrap();
        assert!((ticks - 15.0).abs() < 1.5, "{ticks}");
    }
}
