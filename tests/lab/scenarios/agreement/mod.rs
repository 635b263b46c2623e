//! Cameras that differ from the venue: runs of the sample with real mistakes, and the disagreements they report.

mod displaced;
mod in_part;
mod people;
mod shelf;
mod treadmill;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use serde_json::{Value, json};

use crate::data::SampleFolder;
use crate::farfield::{FinishedCommand, command, farfield, finish, poses, run};

const CAMERAS: [&str; 4] = ["north-east", "north-west", "south-east", "south-west"];
/// For each of the 17 COCO keypoints, its counterpart on the other side of the body.
const OTHER_SIDE: [usize; 17] = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15];
/// Width and height of the sample's images, pixels.
const SIZE_PX: [f64; 2] = [1920.0, 1200.0];

/// A copy of the sample venue with mistakes.
struct MistakenSample {
    folder: SampleFolder,
    /// Lines of each camera's file: the people of one tick.
    lines: BTreeMap<&'static str, Vec<Value>>,
}

impl MistakenSample {
    fn new() -> Self {
        let folder = SampleFolder::new();
        let lines = CAMERAS.map(|camera| {
            let text = fs::read_to_string(folder.path(&format!("{camera}.jsonl"))).unwrap();
            let lines = text.lines().map(|line| serde_json::from_str(line).unwrap());
            (camera, lines.collect())
        });
        Self {
            folder,
            lines: lines.into(),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path(name)
    }

    fn swap(mut self, a: &'static str, b: &'static str) -> Self {
        let (lines_of_a, lines_of_b) = (self.lines[a].clone(), self.lines[b].clone());
        self.lines.extend([(a, lines_of_b), (b, lines_of_a)]);
        self
    }

    /// Delays a camera by `ticks`.
    fn late(mut self, camera: &'static str, ticks: usize) -> Self {
        let own = self.lines.get_mut(camera).unwrap();
        let n = own.len();
        let first = own[0].clone();
        own.splice(0..0, std::iter::repeat_n(first, ticks));
        own.truncate(n);
        for (tick, line) in own.iter_mut().enumerate() {
            line["tick"] = json!(tick);
        }
        self
    }

    /// Changes every keypoint of these cameras: takes keypoint `from(k)` and moves it by `pixel`.
    fn change(
        mut self,
        cameras: &[&'static str],
        from: fn(usize) -> usize,
        pixel: fn([f64; 2]) -> [f64; 2],
    ) -> Self {
        for camera in cameras {
            for line in self.lines.get_mut(camera).unwrap() {
                for person in line["persons"].as_array_mut().unwrap() {
                    let old = person["keypoints"].as_array().unwrap().clone();
                    let new = (0..old.len()).map(|k| match old[from(k)].as_array() {
                        Some(keypoint) => {
                            let at =
                                pixel([0, 1].map(|axis: usize| keypoint[axis].as_f64().unwrap()));
                            json!([at[0], at[1], keypoint[2]])
                        }
                        None => Value::Null,
                    });
                    person["keypoints"] = new.collect();
                }
            }
        }
        self
    }

    fn replace(self, file: &str, change: impl Fn(&str) -> String) -> Self {
        let path = self.path(file);
        let text = fs::read_to_string(&path).unwrap();
        let changed = change(&text);
        assert_ne!(changed, text, "{file} is as it was");
        fs::write(path, changed).unwrap();
        self
    }

    fn write(&self) {
        for (camera, lines) in &self.lines {
            let lines: Vec<String> = lines.iter().map(Value::to_string).collect();
            let path = self.path(&format!("{camera}.jsonl"));
            fs::write(path, lines.join("\n") + "\n").unwrap();
        }
    }

    fn run(&self, more: &[&str]) -> FinishedCommand {
        self.write();
        run(&self.path("venue.toml"), &self.path("out"), more)
    }

    /// Disagreements in the summary of a run with these mistakes.
    fn disagreements(&self) -> Vec<Value> {
        self.run(&[]);
        let summary = fs::read_to_string(self.path("out/summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        let disagreements = summary["agreement"]["disagreements"].as_array().unwrap();
        for one in disagreements {
            println!("{}", one["found"].as_str().unwrap());
        }
        disagreements.clone()
    }

    fn assert_printed(&self, words: &[&str]) {
        let finished = self.run(&[]);
        for word in words {
            assert!(
                finished.stdout.contains(word),
                "no {word:?} in\n{}",
                finished.stdout
            );
        }
        println!("{}", warnings(&finished.stdout).join("\n"));
    }
}

/// Median `sigma_m` over all joints and ticks of `out/poses.jsonl`, metres.
fn median_sigma_m(sample: &MistakenSample) -> f64 {
    let mut all: Vec<f64> = poses(&sample.path("out"))
        .iter()
        .flat_map(|pose| pose["sigma_m"].as_object().unwrap().clone())
        .filter_map(|(_, sigma_m)| sigma_m.as_f64())
        .collect();
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

#[test]
fn a_wrong_venue_raises_the_standard_deviations() {
    let right = MistakenSample::new();
    right.run(&[]);
    let wrong = MistakenSample::new().swap("north-east", "north-west");
    wrong.run(&[]);
    let (right_m, wrong_m) = (median_sigma_m(&right), median_sigma_m(&wrong));
    println!("median sigma: {right_m:.4} m as it is, {wrong_m:.4} m swapped");
    assert!(wrong_m > 1.3 * right_m, "{wrong_m} m, {right_m} m as it is");
}

fn warnings(stdout: &str) -> Vec<&str> {
    let lines = stdout.lines();
    lines
        .filter(|line| line.starts_with("warning: ") || line.starts_with("  "))
        .collect()
}

#[test]
fn the_unchanged_sample_agrees_and_passes_strictly() {
    let finished = MistakenSample::new().run(&["--strict"]);
    assert_eq!(warnings(&finished.stdout), [""; 0], "{}", finished.stdout);
    for camera in CAMERAS {
        let line = finished
            .stdout
            .lines()
            .find(|line| line.contains(camera))
            .unwrap();
        assert!(line.contains("agrees with the others"), "{line}");
    }
}

#[test]
fn swapped_sources_are_reported_and_fail_strictly() {
    let sample = MistakenSample::new().swap("north-east", "north-west");
    sample.assert_printed(&["cameras north-east and north-west seem to be swapped"]);
    let summary = fs::read_to_string(sample.path("out/summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["agreement"]["disagreements"][0]["cause"], "swapped");
    fs::remove_dir_all(sample.path("out")).unwrap();
    let mut strict = command();
    strict
        .arg("run")
        .arg(sample.path("venue.toml"))
        .arg("--strict");
    strict.arg("--out").arg(sample.path("out"));
    strict.arg("--json");
    let strict = finish(&strict.output().unwrap());
    // With `--json`, standard output is one document.
    let document: Value = serde_json::from_str(&strict.stdout).unwrap();
    assert_eq!(document["exit_code"], 1, "{document}");
    assert_eq!(strict.code, 1, "{}", strict.stderr);
    assert!(
        strict.stderr.contains("the cameras do not agree"),
        "{}",
        strict.stderr
    );
}

#[test]
fn any_two_swapped_sources_are_reported() {
    // Opposite cameras show a mirrored room in which all lines of sight still meet.
    for (index, a) in CAMERAS.into_iter().enumerate() {
        for b in CAMERAS.into_iter().skip(index + 1) {
            let sample = MistakenSample::new().swap(a, b);
            let disagreements = sample.disagreements();
            assert_eq!(
                disagreements[0]["cause"], "swapped",
                "{a} {b}: {disagreements:?}"
            );
            let cameras = disagreements[0]["cameras"].as_array().unwrap();
            assert!(
                cameras.contains(&json!(a)) && cameras.contains(&json!(b)),
                "{disagreements:?}"
            );
        }
    }
}

#[test]
fn a_late_source_is_reported_with_its_delay() {
    MistakenSample::new()
        .late("south-west", 3)
        .assert_printed(&["camera south-west is ", " ms) late relative to the others"]);
}

#[test]
fn a_source_seconds_late_is_reported_in_a_short_recording() {
    for ticks in [30, 90] {
        MistakenSample::new()
            .late("south-west", ticks)
            .assert_printed(&[
                "camera south-west  DISAGREES",
                "warning: camera south-west ",
            ]);
    }
}

#[test]
fn wrong_lens_distortions_are_reported() {
    let lens = "[-0.08, 0.02, 0.0, 0.0, 0.0]";
    MistakenSample::new()
        .replace("calibration.toml", |text| {
            text.replace(lens, "[-0.3, 0.1, 0.0, 0.0, 0.0]")
        })
        .assert_printed(&[
            "the lens distortions of all cameras are not as calibrated",
            "more;",
        ]);
    MistakenSample::new()
        .replace("calibration.toml", |text| {
            text.replacen(lens, "[0.3, 0.0, 0.0, 0.0, 0.0]", 1)
        })
        .assert_printed(&[
            "the lens distortion of camera north-east is not as calibrated",
            "less;",
        ]);
}

#[test]
fn mirrored_and_upside_down_sources_are_reported() {
    let mirror: fn([f64; 2]) -> [f64; 2] = |[x, y]| [SIZE_PX[0] - 1.0 - x, y];
    MistakenSample::new()
        .change(&["south-east"], |k| OTHER_SIDE[k], mirror)
        .assert_printed(&["pictures of camera south-east seem to be mirrored"]);
    let turn: fn([f64; 2]) -> [f64; 2] = |[x, y]| [SIZE_PX[0] - 1.0 - x, SIZE_PX[1] - 1.0 - y];
    MistakenSample::new()
        .change(&["north-west"], |k| k, turn)
        .assert_printed(&["camera north-west seem to be upside down"]);
}

#[test]
fn a_camera_with_changed_pixel_coordinates_is_reported() {
    let exchanged: fn([f64; 2]) -> [f64; 2] = |[x, y]| [y, x];
    let halved: fn([f64; 2]) -> [f64; 2] = |[x, y]| [0.5 * x, 0.5 * y];
    let below: fn([f64; 2]) -> [f64; 2] = |[x, y]| [x, SIZE_PX[1] - 1.0 - y];
    for (written, words) in [
        (exchanged, "x and y are exchanged"),
        (halved, "multiplied by 2.00"),
        (below, "y is counted from below"),
    ] {
        MistakenSample::new()
            .change(&["north-west"], |k| k, written)
            .assert_printed(&[
                "the keypoints of camera north-west do not fit its calibrated pictures",
                words,
            ]);
    }
}

#[test]
fn a_camera_with_another_keypoint_order_is_reported() {
    MistakenSample::new()
        .change(&["south-east"], |k| OTHER_SIDE[k], |pixel| pixel)
        .assert_printed(&["left and right are exchanged in the keypoints of camera south-east"]);
    // Another keypoint order: arms first, face last.
    MistakenSample::new()
        .change(&["north-west"], |k| (k + 5) % 17, |pixel| pixel)
        .assert_printed(&["the keypoints of camera north-west are in another order"]);
}

#[test]
fn a_source_used_by_two_cameras_is_reported() {
    let mut sample = MistakenSample::new();
    let shown = sample.lines["north-east"].clone();
    sample.lines.insert("south-east", shown);
    sample.assert_printed(&["cameras north-east and south-east seem to show the same pictures"]);
}

#[test]
fn people_reveal_a_calibration_in_another_unit() {
    let scaled = |text: &str, factor: f64| {
        let lines = text
            .lines()
            .map(|line| match line.strip_prefix("translation = ") {
                Some(numbers) => {
                    let numbers: Vec<f64> = serde_json::from_str(numbers).unwrap();
                    let scaled: Vec<f64> = numbers.iter().map(|n| n * factor).collect();
                    format!("translation = {scaled:?}\n")
                }
                None => format!("{line}\n"),
            });
        lines.collect::<String>()
    };
    for (factor, stature) in [
        (1.0 / 1.6, "everybody is 1."),
        (1.0 / 1.8, "everybody is 0.9"),
    ] {
        MistakenSample::new()
            .replace("calibration.toml", |text| scaled(text, factor))
            .assert_printed(&[stature, "m tall", "is the calibration in metres?"]);
    }
    MistakenSample::new()
        .replace("calibration.toml", |text| scaled(text, 0.3))
        .assert_printed(&["implausible sizes"]);
}

#[test]
fn feet_reveal_a_wrong_floor_height() {
    MistakenSample::new()
        .replace("venue.toml", |text| {
            text.replace("2.4]", "2.4]\nfloor_m = 0.5")
        })
        .assert_printed(&[
            "everybody who stands is 0.4",
            "m under the floor",
            "floor_m",
        ]);
    MistakenSample::new()
        .replace("venue.toml", |text| {
            text.replace("[-4.0, -4.0, -0.3]", "[-4.0, -4.0, -0.8]")
                .replace("2.4]", "2.4]\nfloor_m = -0.5")
        })
        .assert_printed(&["all feet are 0.", "m above the floor"]);
}

#[test]
fn wrong_focal_lengths_of_all_cameras_are_reported_with_their_factor() {
    for (written, words) in [("1155.0", "to be 0.9"), ("1575.0", "to be 0.6")] {
        MistakenSample::new()
            .replace("calibration.toml", |text| text.replace("1050.0", written))
            .assert_printed(&[
                "the focal lengths of cameras north-east, north-west, south-west, south-east seem to be",
                words,
            ]);
    }
}

#[test]
fn a_camera_that_freezes_to_the_end_is_reported() {
    let mut sample = MistakenSample::new();
    let lines = sample.lines.get_mut("north-west").unwrap();
    let stopped = lines[20]["persons"].clone();
    for line in &mut lines[20..] {
        line["persons"] = stopped.clone();
    }
    sample.assert_printed(&[
        "the pictures of camera north-west have not changed since tick 30 (1.0 s)",
        "while people move in front of it",
    ]);
}

#[test]
fn people_outside_the_field_are_reported() {
    MistakenSample::new()
        .replace("venue.toml", |text| {
            text.replace("[-4.0, -4.0, -0.3]", "[0.0, -4.0, -0.3]")
        })
        .assert_printed(&[
            "person 1: ",
            "stood outside the field, where no new track starts",
        ]);
}

#[test]
fn runs_without_people_report_the_reason() {
    MistakenSample::new()
        .replace("venue.toml", |text| {
            // The middle of a body is above 0.3 m.
            text.replace("max_m = [4.0, 4.0, 2.4]", "max_m = [4.0, 4.0, 0.3]")
        })
        .assert_printed(&["stand outside the field, around ("]);
    // Another keypoint order: arms first, face last.
    MistakenSample::new()
        .change(&CAMERAS, |k| (k + 5) % 17, |pixel| pixel)
        .assert_printed(&["order of the network's card"]);
    // Detected in images of half the size.
    MistakenSample::new()
        .change(&CAMERAS, |k| k, |[x, y]| [0.5 * x, 0.5 * y])
        .assert_printed(&["in smaller pictures than were calibrated"]);
    let mut alone = MistakenSample::new();
    for camera in &CAMERAS[1..] {
        for line in alone.lines.get_mut(camera).unwrap() {
            line["persons"] = json!([]);
        }
    }
    alone.assert_printed(&["only camera north-east sighted anybody"]);
}

#[test]
fn a_replay_reports_the_same_reason_as_its_run() {
    let sample = MistakenSample::new().replace("venue.toml", |text| {
        text.replace("max_m = [4.0, 4.0, 2.4]", "max_m = [4.0, 4.0, 0.3]")
    });
    // A trailing slash makes the folder.
    let recordings = sample.path("recordings");
    let finished = sample.run(&[&format!("--record={}/", recordings.display())]);
    let lines = finished.stdout.lines();
    let lines = lines.skip_while(|line| !line.contains("stand outside the field"));
    let reason: Vec<&str> = lines.take_while(|line| line.starts_with("  ")).collect();
    assert!(!reason.is_empty(), "{}", finished.stdout);
    let mut files = fs::read_dir(&recordings).unwrap();
    let file = files.next().unwrap().unwrap().path();
    let mut replay = command();
    replay.arg("replay").arg(&file);
    replay.arg("--out").arg(sample.path("replayed"));
    let replayed = finish(&replay.output().unwrap());
    assert_eq!(replayed.code, 0, "{}", replayed.stderr);
    assert!(
        replayed.stdout.contains(&reason.join("\n")),
        "{}\nthe run printed {reason:#?}",
        replayed.stdout
    );
}

#[test]
fn ten_scenes_with_free_running_cameras_raise_no_alarm() {
    let scenes = ["own", "hug", "lost"];
    let run = farfield(&[&["agreement"], &scenes[..], &["--seconds", "3"]].concat());
    println!("{}", run.stdout);
    assert_eq!(run.code, 0, "{}\n{}", run.stdout, run.stderr);
    assert!(
        run.stdout.contains("10 scenes, 0 false alarms"),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout.contains("agrees with the others"),
        "{}",
        run.stdout
    );
}
