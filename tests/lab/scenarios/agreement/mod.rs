//! Cameras that are not what the venue says: the sample with real mistakes in it, and what a run says of each.

mod displaced;
mod in_part;
mod people;
mod scenes;
mod shelf;
mod treadmill;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use serde_json::{Value, json};

use crate::data::SampleFolder;
use crate::farfield::{FinishedCommand, command, finish, poses, run};

const CAMERAS: [&str; 4] = ["north-east", "north-west", "south-east", "south-west"];
/// Of the 17 COCO keypoints, the one on the other side.
const OTHER_SIDE: [usize; 17] = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15];
/// Width and height of the sample's pictures, pixels.
const SIZE_PX: [f64; 2] = [1920.0, 1200.0];

/// A copy of the sample venue with mistakes.
struct MistakenSample {
    folder: SampleFolder,
    /// Per camera its lines: the people of a tick.
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
        let (of_a, of_b) = (self.lines[a].clone(), self.lines[b].clone());
        self.lines.extend([(a, of_b), (b, of_a)]);
        self
    }

    /// What the camera shows happened so many ticks before.
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

    /// Changes every keypoint of these cameras: `from(k)` says which one it is, `pixel` where.
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

    /// The disagreements in the summary of a run with these mistakes.
    fn disagreements(&self) -> Vec<Value> {
        self.run(&[]);
        let summary = fs::read_to_string(self.path("out/summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        let found = summary["agreement"]["disagreements"].as_array().unwrap();
        for one in found {
            println!("{}", one["found"].as_str().unwrap());
        }
        found.clone()
    }

    fn is_told(&self, words: &[&str]) {
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

/// Median over all joints and ticks of the `sigma_m` of `out/poses.jsonl`, metres.
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
fn a_wrong_venue_does_not_look_sure() {
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
fn the_sample_as_it_is_agrees_and_passes_strictly() {
    let finished = MistakenSample::new().run(&["--strict"]);
    assert_eq!(warnings(&finished.stdout), [""; 0], "{}", finished.stdout);
    for camera in CAMERAS {
        let told = finished
            .stdout
            .lines()
            .find(|line| line.contains(camera))
            .unwrap();
        assert!(told.contains("agrees with the others"), "{told}");
    }
}

#[test]
fn swapped_sources_are_named_and_fail_strictly() {
    let sample = MistakenSample::new().swap("north-east", "north-west");
    sample.is_told(&["cameras north-east and north-west seem to be swapped"]);
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
    // One document, whatever happens.
    let said: Value = serde_json::from_str(&strict.stdout).unwrap();
    assert_eq!(said["exit_code"], 1, "{said}");
    assert_eq!(strict.code, 1, "{}", strict.stderr);
    assert!(
        strict.stderr.contains("the cameras do not agree"),
        "{}",
        strict.stderr
    );
}

#[test]
fn whichever_two_sources_are_swapped_they_are_named() {
    // Two that stand opposite each other show a mirrored hall, in which everything meets.
    for (index, a) in CAMERAS.into_iter().enumerate() {
        for b in CAMERAS.into_iter().skip(index + 1) {
            let sample = MistakenSample::new().swap(a, b);
            let found = sample.disagreements();
            assert_eq!(found[0]["cause"], "swapped", "{a} {b}: {found:?}");
            let named = found[0]["cameras"].as_array().unwrap();
            assert!(
                named.contains(&json!(a)) && named.contains(&json!(b)),
                "{found:?}"
            );
        }
    }
}

#[test]
fn a_late_source_is_named_with_its_lateness() {
    MistakenSample::new()
        .late("south-west", 3)
        .is_told(&["camera south-west is ", " ms) late against the others"]);
}

#[test]
fn a_source_that_is_seconds_late_is_told_of_however_short_the_recording_is() {
    for ticks in [30, 90] {
        MistakenSample::new().late("south-west", ticks).is_told(&[
            "camera south-west  DISAGREES",
            "warning: camera south-west ",
        ]);
    }
}

#[test]
fn lenses_that_are_not_as_calibrated_are_named() {
    let lens = "[-0.08, 0.02, 0.0, 0.0, 0.0]";
    MistakenSample::new()
        .replace("calibration.toml", |text| {
            text.replace(lens, "[-0.3, 0.1, 0.0, 0.0, 0.0]")
        })
        .is_told(&[
            "the lens distortions of all cameras are not as calibrated",
            "more;",
        ]);
    MistakenSample::new()
        .replace("calibration.toml", |text| {
            text.replacen(lens, "[0.3, 0.0, 0.0, 0.0, 0.0]", 1)
        })
        .is_told(&[
            "the lens distortion of camera north-east is not as calibrated",
            "less;",
        ]);
}

#[test]
fn mirrored_and_upside_down_sources_are_named() {
    let mirror: fn([f64; 2]) -> [f64; 2] = |[x, y]| [SIZE_PX[0] - 1.0 - x, y];
    MistakenSample::new()
        .change(&["south-east"], |k| OTHER_SIDE[k], mirror)
        .is_told(&["pictures of camera south-east seem to be mirrored"]);
    let turn: fn([f64; 2]) -> [f64; 2] = |[x, y]| [SIZE_PX[0] - 1.0 - x, SIZE_PX[1] - 1.0 - y];
    MistakenSample::new()
        .change(&["north-west"], |k| k, turn)
        .is_told(&["camera north-west seem to stand on their heads"]);
}

#[test]
fn a_file_of_keypoints_that_are_elsewhere_in_their_picture_is_named_with_where() {
    let exchanged: fn([f64; 2]) -> [f64; 2] = |[x, y]| [y, x];
    let halved: fn([f64; 2]) -> [f64; 2] = |[x, y]| [0.5 * x, 0.5 * y];
    let below: fn([f64; 2]) -> [f64; 2] = |[x, y]| [x, SIZE_PX[1] - 1.0 - y];
    for (written, told) in [
        (exchanged, "x and y are exchanged"),
        (halved, "multiplied by 2.00"),
        (below, "y is counted from below"),
    ] {
        MistakenSample::new()
            .change(&["north-west"], |k| k, written)
            .is_told(&[
                "what camera north-west shows is not where its calibration has it",
                told,
            ]);
    }
}

#[test]
fn a_file_with_its_keypoints_in_another_order_is_named() {
    MistakenSample::new()
        .change(&["south-east"], |k| OTHER_SIDE[k], |pixel| pixel)
        .is_told(&["left and right are exchanged in the keypoints of camera south-east"]);
    // Another list of keypoints: the arms come first, the face last.
    MistakenSample::new()
        .change(&["north-west"], |k| (k + 5) % 17, |pixel| pixel)
        .is_told(&["the keypoints of camera north-west are in another order"]);
}

#[test]
fn a_source_that_two_cameras_have_is_named() {
    let mut sample = MistakenSample::new();
    let shown = sample.lines["north-east"].clone();
    sample.lines.insert("south-east", shown);
    sample.is_told(&["cameras north-east and south-east seem to show the same pictures"]);
}

#[test]
fn a_calibration_in_another_unit_is_told_by_the_size_of_people() {
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
            .is_told(&[stature, "m tall", "is the calibration in metres?"]);
    }
    MistakenSample::new()
        .replace("calibration.toml", |text| scaled(text, 0.3))
        .is_told(&["nobody was found", "sizes that people do not have"]);
}

#[test]
fn a_floor_that_is_elsewhere_is_told_by_the_feet_of_people() {
    MistakenSample::new()
        .replace("venue.toml", |text| {
            text.replace("2.4]", "2.4]\nfloor_m = 0.5")
        })
        .is_told(&[
            "everybody who stands is 0.5",
            "m under the floor",
            "floor_m",
        ]);
    MistakenSample::new()
        .replace("venue.toml", |text| {
            text.replace("[-4.0, -4.0, -0.3]", "[-4.0, -4.0, -0.8]")
                .replace("2.4]", "2.4]\nfloor_m = -0.5")
        })
        .is_told(&["nobody stands on the floor: all feet are 0."]);
}

#[test]
fn focal_lengths_of_all_cameras_that_are_wrong_are_told_by_their_factor() {
    for (written, told) in [("1155.0", "to be 0.9"), ("1575.0", "to be 0.6")] {
        MistakenSample::new()
            .replace("calibration.toml", |text| text.replace("1050.0", written))
            .is_told(&[
                "the focal lengths of cameras north-east, north-west, south-west, south-east seem to be",
                told,
            ]);
    }
}

#[test]
fn a_recording_that_stands_still_to_its_end_is_named() {
    let mut sample = MistakenSample::new();
    let lines = sample.lines.get_mut("north-west").unwrap();
    let stopped = lines[20]["persons"].clone();
    for line in &mut lines[20..] {
        line["persons"] = stopped.clone();
    }
    sample.is_told(&[
        "the pictures of camera north-west stand still since tick 30 (1.0 s)",
        "while people move before it",
    ]);
}

#[test]
fn people_outside_the_field_are_told_of_beside_those_inside() {
    MistakenSample::new()
        .replace("venue.toml", |text| {
            text.replace("[-4.0, -4.0, -0.3]", "[0.0, -4.0, -0.3]")
        })
        .is_told(&[
            "person 1: ",
            "stood outside the field, where nobody new is followed",
        ]);
}

#[test]
fn why_nobody_was_found_is_said() {
    MistakenSample::new()
        .replace("venue.toml", |text| {
            // People's middles are above it.
            text.replace("max_m = [4.0, 4.0, 2.4]", "max_m = [4.0, 4.0, 0.3]")
        })
        .is_told(&["nobody was found", "stand outside the field, around ("]);
    // Another list of keypoints: the arms come first, the face last.
    MistakenSample::new()
        .change(&CAMERAS, |k| (k + 5) % 17, |pixel| pixel)
        .is_told(&["nobody was found", "order of the network's card"]);
    // Detected in pictures of half the size.
    MistakenSample::new()
        .change(&CAMERAS, |k| k, |[x, y]| [0.5 * x, 0.5 * y])
        .is_told(&[
            "nobody was found",
            "in smaller pictures than were calibrated",
        ]);
    let mut alone = MistakenSample::new();
    for camera in &CAMERAS[1..] {
        for line in alone.lines.get_mut(camera).unwrap() {
            line["persons"] = json!([]);
        }
    }
    alone.is_told(&["nobody was found", "only camera north-east sighted anybody"]);
}

#[test]
fn a_replay_says_why_nobody_was_found_in_the_words_of_the_run() {
    let sample = MistakenSample::new().replace("venue.toml", |text| {
        text.replace("max_m = [4.0, 4.0, 2.4]", "max_m = [4.0, 4.0, 0.3]")
    });
    // The slash at its end makes the folder.
    let recordings = sample.path("recordings");
    let finished = sample.run(&[&format!("--record={}/", recordings.display())]);
    let said = finished.stdout.lines();
    let said = said.skip_while(|line| *line != "nobody was found");
    let said: Vec<&str> = said
        .take_while(|line| *line == "nobody was found" || line.starts_with("  "))
        .collect();
    assert!(said.len() > 1, "{}", finished.stdout);
    let mut files = fs::read_dir(&recordings).unwrap();
    let file = files.next().unwrap().unwrap().path();
    let mut replay = command();
    replay.arg("replay").arg(&file);
    replay.arg("--out").arg(sample.path("replayed"));
    let replayed = finish(&replay.output().unwrap());
    assert_eq!(replayed.code, 0, "{}", replayed.stderr);
    assert!(
        replayed.stdout.contains(&said.join("\n")),
        "{}\nthe run said {said:#?}",
        replayed.stdout
    );
}
