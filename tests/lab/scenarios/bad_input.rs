//! Bad input: exit code 2, one message with the file and the field, and no unfinished file.

use std::fs;
use std::path::Path;

use crate::data::{SampleFolder, checkout};
use crate::farfield::{FinishedCommand, command, finish};

impl SampleFolder {
    fn run(&self, more: &[&str]) -> FinishedCommand {
        let mut command = command();
        command
            .arg("run")
            .arg(self.path("venue.toml"))
            .arg("--out")
            .arg(self.path("out"))
            .args(more);
        finish(&command.output().unwrap())
    }
}

/// Runs the spoilt sample and checks that the refusal contains all `words`.
fn is_refused(sample: &SampleFolder, more: &[&str], words: &[&str]) {
    let finished = sample.run(more);
    assert_eq!(
        finished.code, 2,
        "stdout: {}\nstderr: {}",
        finished.stdout, finished.stderr
    );
    for word in words {
        assert!(
            finished.stderr.contains(word),
            "{word:?} is not in: {}",
            finished.stderr
        );
    }
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
    assert!(
        !sample.path("out").exists(),
        "something was written although the input was refused"
    );
    println!("refused: {}", finished.stderr.trim());
}

#[test]
fn a_calibration_without_one_of_the_cameras_is_refused() {
    let sample = SampleFolder::new();
    sample.replace(
        "calibration.toml",
        "[south-west]\nname = \"south-west\"",
        "[elsewhere]\nname = \"elsewhere\"",
    );
    is_refused(&sample, &[], &["venue.toml", "south-west"]);
}

#[test]
fn a_singular_camera_matrix_is_refused() {
    let sample = SampleFolder::new();
    sample.replace(
        "calibration.toml",
        "matrix = [[1050.0, 0.0",
        "matrix = [[0.0, 0.0",
    );
    is_refused(&sample, &[], &["calibration.toml", "north-east", "matrix"]);
}

#[test]
fn a_calibration_with_nan_is_refused() {
    let sample = SampleFolder::new();
    sample.replace(
        "calibration.toml",
        "translation = [",
        "translation = [nan, 1.0, 2.0] #",
    );
    is_refused(
        &sample,
        &[],
        &["calibration.toml", "north-east", "translation"],
    );
}

#[test]
fn a_venue_that_names_an_unknown_camera_is_refused() {
    let sample = SampleFolder::new();
    sample.replace(
        "venue.toml",
        "[[viewpoint.camera]]\nname = \"north-west\"",
        "[[viewpoint.camera]]\nname = \"north-wets\"",
    );
    is_refused(&sample, &[], &["venue.toml", "north-wets"]);
}

#[test]
fn a_source_that_is_not_there_is_refused() {
    let sample = SampleFolder::new();
    fs::remove_file(sample.path("south-east.jsonl")).unwrap();
    is_refused(&sample, &[], &["south-east.jsonl"]);
}

#[test]
fn an_unknown_field_of_the_venue_is_refused_with_the_nearest_name() {
    let sample = SampleFolder::new();
    sample.replace("venue.toml", "rate_hz", "rate_hertz");
    is_refused(&sample, &[], &["venue.toml", "rate_hertz", "rate_hz"]);
}

#[test]
fn sources_of_different_lengths_are_refused_unless_the_ticks_lie_inside_all() {
    let sample = SampleFolder::new();
    let text = fs::read_to_string(sample.path("north-west.jsonl")).unwrap();
    let shorter: String = text
        .lines()
        .take(90)
        .flat_map(|line| [line, "\n"])
        .collect();
    fs::write(sample.path("north-west.jsonl"), shorter).unwrap();
    is_refused(&sample, &[], &["north-west", "90", "120"]);
    assert_eq!(sample.run(&["--ticks", "0..60"]).code, 0);
}

#[test]
fn ticks_outside_the_clip_are_refused() {
    is_refused(
        &SampleFolder::new(),
        &["--ticks", "60..400"],
        &["400", "120"],
    );
}

#[test]
fn a_broken_line_of_keypoints_is_refused_with_its_line_number() {
    let sample = SampleFolder::new();
    let text = fs::read_to_string(sample.path("north-east.jsonl")).unwrap();
    let broken: String = text
        .lines()
        .enumerate()
        .map(|(i, l)| {
            if i == 41 {
                "{\"tick\": 41,\n".into()
            } else {
                format!("{l}\n")
            }
        })
        .collect();
    fs::write(sample.path("north-east.jsonl"), broken).unwrap();
    is_refused(&sample, &[], &["north-east.jsonl", "42"]);
}

#[test]
fn an_output_folder_that_is_not_empty_is_refused_and_left_alone() {
    let sample = SampleFolder::new();
    fs::create_dir(sample.path("out")).unwrap();
    fs::write(sample.path("out/notes.txt"), "mine").unwrap();
    let finished = sample.run(&[]);
    assert_eq!(finished.code, 2, "{}", finished.stderr);
    assert!(finished.stderr.contains("out"));
    assert_eq!(fs::read_dir(sample.path("out")).unwrap().count(), 1);
}

/// A person given by hand, complete enough for a body.
const PERSON: &str = "left_shoulder = [0.1, 0.2, 1.4], right_shoulder = [-0.2, 0.2, 1.4], left_hip = [0.05, 0.2, 0.95], right_hip = [-0.15, 0.2, 0.95], nose = [-0.05, 0.3, 1.65]";

fn give_person(sample: &SampleFolder, tick: i64, keypoints_m: &str) {
    let text = fs::read_to_string(sample.path("venue.toml")).unwrap();
    let text = format!("{text}\n[[person]]\ntick = {tick}\nkeypoints_m = {{ {keypoints_m} }}\n");
    fs::write(sample.path("venue.toml"), text).unwrap();
}

#[test]
fn a_person_given_outside_the_ticks_of_the_run_is_refused() {
    // Symptom to prevent: such a person was missing from the results without a message.
    let sample = SampleFolder::new();
    give_person(&sample, 400, PERSON);
    is_refused(
        &sample,
        &[],
        &["venue.toml", "person[0].tick", "400", "0..120"],
    );
    let sample = SampleFolder::new();
    give_person(&sample, 3, PERSON);
    is_refused(
        &sample,
        &["--ticks", "10..20"],
        &["venue.toml", "person[0].tick", "3", "10..20"],
    );
}

#[test]
fn a_person_given_with_too_few_keypoints_is_refused() {
    let sample = SampleFolder::new();
    give_person(&sample, 0, "nose = [0.0, 0.0, 1.6]");
    is_refused(&sample, &[], &["venue.toml", "person[0].keypoints_m", "5"]);
}

#[test]
fn a_given_person_with_an_unknown_keypoint_is_refused() {
    let Some(sample) = video_sample("an unknown keypoint") else {
        return;
    };
    give_person(&sample, 0, &PERSON.replace("nose", "nsoe"));
    is_refused(
        &sample,
        &[],
        &["venue.toml", "person[0].keypoints_m.nsoe", "`nose`"],
    );
}

#[test]
fn images_without_a_detector_are_refused() {
    // Symptom to prevent: the run found no people and asked whether the detector was correct.
    let Some(sample) = video_sample("no detector") else {
        return;
    };
    is_refused(
        &sample,
        &[],
        &["venue.toml", "`detector`", "[[person]]", "models/CARD.toml"],
    );
}

#[test]
fn one_viewpoint_alone_is_refused() {
    let sample = SampleFolder::new();
    for name in ["north-west", "south-west", "south-east"] {
        let viewpoint = format!("[[viewpoint]]\nname = \"{name}\"\n");
        sample.replace("venue.toml", &viewpoint, "");
    }
    is_refused(
        &sample,
        &[],
        &["venue.toml", "there is one viewpoint", "[[viewpoint]]"],
    );
}

/// A venue of four short videos with the small test network; `None` without ffmpeg.
fn video_sample(scenario: &str) -> Option<SampleFolder> {
    let sample = SampleFolder::new();
    let names = ["north-east", "north-west", "south-west", "south-east"];
    for name in names {
        if !make_video(&sample.path(&format!("{name}.mp4")), "1920x1200", 30, 12) {
            println!("SKIPPED {scenario}: no ffmpeg");
            return None;
        }
        sample.replace(
            "venue.toml",
            &format!("kind = \"keypoints\", path = \"{name}.jsonl\""),
            &format!("kind = \"video\", path = \"{name}.mp4\""),
        );
    }
    for file in [
        "hues17_128x96.onnx",
        "hues17_128x96.toml",
        "hues14_128x96.onnx",
        "hues14_128x96.toml",
    ] {
        fs::copy(
            checkout().join("edge/testdata").join(file),
            sample.path(file),
        )
        .unwrap();
    }
    sample.replace(
        "venue.toml",
        "rate_hz",
        "network = \"hues17_128x96.toml\"\nrate_hz",
    );
    Some(sample)
}

fn make_video(path: &Path, size: &str, rate_hz: u32, frames: u32) -> bool {
    let source = format!("testsrc2=size={size}:rate={rate_hz}");
    let mut ffmpeg = std::process::Command::new("ffmpeg");
    ffmpeg.args([
        "-nostdin",
        "-loglevel",
        "error",
        "-y",
        "-f",
        "lavfi",
        "-i",
        &source,
        "-frames:v",
        &frames.to_string(),
    ]);
    ffmpeg.args(["-pix_fmt", "yuv420p"]).arg(path);
    ffmpeg.status().is_ok_and(|status| status.success())
}

#[test]
fn a_video_cut_in_the_middle_is_refused() {
    let Some(sample) = video_sample("a cut video") else {
        return;
    };
    let path = sample.path("south-west.mkv");
    assert!(make_video(&path, "1920x1200", 30, 30));
    sample.replace("venue.toml", "south-west.mp4", "south-west.mkv");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    is_refused(&sample, &[], &["south-west.mkv"]);
}

#[test]
fn a_video_of_another_rate_is_refused() {
    let Some(sample) = video_sample("another rate") else {
        return;
    };
    assert!(make_video(
        &sample.path("north-west.mp4"),
        "1920x1200",
        25,
        12
    ));
    is_refused(&sample, &[], &["north-west.mp4", "25", "30"]);
}

#[test]
fn a_video_of_another_size_than_calibrated_is_refused() {
    let Some(sample) = video_sample("another size") else {
        return;
    };
    assert!(make_video(
        &sample.path("south-east.mp4"),
        "640x480",
        30,
        12
    ));
    is_refused(&sample, &[], &["south-east.mp4", "640", "1920"]);
}

#[test]
fn a_network_that_is_not_onnx_is_refused() {
    let Some(sample) = video_sample("not ONNX") else {
        return;
    };
    fs::write(sample.path("hues17_128x96.onnx"), "this is not a network").unwrap();
    is_refused(&sample, &[], &["hues17_128x96.onnx"]);
}

#[test]
fn a_network_with_fourteen_maps_is_refused() {
    let Some(sample) = video_sample("fourteen maps") else {
        return;
    };
    sample.replace("venue.toml", "hues17_128x96.toml", "hues14_128x96.toml");
    is_refused(&sample, &[], &["hues14_128x96", "14", "17"]);
}

#[test]
fn a_network_card_that_is_not_there_is_refused() {
    let Some(sample) = video_sample("a missing card") else {
        return;
    };
    sample.replace("venue.toml", "hues17_128x96.toml", "nowhere.toml");
    is_refused(&sample, &[], &["nowhere.toml"]);
}
