//! `farfield check`, and runs that are refused for what it finds.

use std::fs;
use std::process::Command;

use serde_json::Value;

use super::{lines, says};
use crate::data::SampleFolder;
use crate::farfield::FinishedCommand;

fn check(folder: &SampleFolder) -> FinishedCommand {
    folder.farfield(&["check", "venue.toml", "--json"])
}

#[test]
fn the_sample_is_as_it_should_be_and_every_camera_is_drawn() {
    let folder = SampleFolder::new();
    let finished = folder.farfield(&["check", "venue.toml", "--out", "drawn"]);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    assert!(
        finished.stdout.ends_with("all is as it should be\n"),
        "{}",
        finished.stdout
    );
    for camera in ["north-east", "north-west", "south-east", "south-west"] {
        let picture = fs::read(folder.path(&format!("drawn/check_{camera}.png"))).unwrap();
        assert!(picture.starts_with(b"\x89PNG"));
    }
}

/// What is spoilt: a file, what stands in it, what shall; and the words that must be said of it.
type Mistake<'a> = (&'a str, &'a str, &'a str, &'a str, &'a [&'a str]);

/// Every mistake in the sample is said by a check (exit code 1); those that a run can never be right with are
/// refused by a run, too.
#[test]
fn mistakes_are_found_without_a_run() {
    let north_east = "path = \"north-east.jsonl\"";
    let mistakes: [Mistake<'_>; 8] = [
        (
            "calibration.toml",
            "distortions = [-0.08, 0.02",
            "distortions = [5.0, 0.02",
            "failed",
            &["north-east", "distortion", "distortions"],
        ),
        (
            "calibration.toml",
            "rotation = [",
            "rotation = [96.7, 3.1, 0.5]\nas_it_was = [",
            "failed",
            &["calibration.toml:", "radians", "degrees"],
        ),
        (
            "venue.toml",
            north_east,
            "path = \"north-west.jsonl\"",
            "failed",
            &["`north-east` and `north-west` have one source"],
        ),
        (
            "venue.toml",
            north_east,
            "path = \"nort-east.jsonl\"",
            "failed",
            &["nort-east.jsonl", "correct `source`"],
        ),
        (
            "calibration.toml",
            "distortions = [-0.08, 0.02",
            "distortions = [0.0, 0.3",
            "warning",
            &["north-east", "distortion"],
        ),
        (
            "calibration.toml",
            "matrix = [[1050.0",
            "matrix = [[1155.0",
            "warning",
            &["north-east", "fx is 1155 px and fy 1050 px", "`matrix`"],
        ),
        (
            "venue.toml",
            "[[viewpoint]]\nname = \"north-west\"\n",
            "",
            "warning",
            &["`north-west`", "9.0 m from `north-east`", "[[viewpoint]]"],
        ),
        (
            "venue.toml",
            "calibration = \"calibration.toml\"",
            "calibration = \"calibration.toml\"\n[security]\ncertificates = \"certs\"",
            "failed",
            &["no such folder", "farfield certs"],
        ),
    ];
    for (file, from, to, verdict, words) in mistakes {
        let folder = SampleFolder::new();
        folder.replace(file, from, to);
        let finished = check(&folder);
        let said = lines(&finished);
        assert_eq!(
            finished.code,
            i32::from(verdict == "failed"),
            "{to}: {said:#?}"
        );
        assert!(says(&said, verdict, words), "{to}: {said:#?}");
    }
}

#[test]
fn a_venue_of_one_viewpoint_fails() {
    let folder = SampleFolder::new();
    for name in ["north-west", "south-west", "south-east"] {
        let viewpoint = format!("[[viewpoint]]\nname = \"{name}\"\n");
        folder.replace("venue.toml", &viewpoint, "");
    }
    let finished = check(&folder);
    assert_eq!(finished.code, 1, "{}", finished.stderr);
    let words = ["there is one viewpoint", "`[[viewpoint]]`"];
    assert!(
        says(&lines(&finished), "failed", &words),
        "{}",
        finished.stdout
    );
}

#[test]
fn a_recording_that_two_cameras_share_under_two_names_is_found() {
    let folder = SampleFolder::new();
    fs::copy(
        folder.path("south-east.jsonl"),
        folder.path("south-west.jsonl"),
    )
    .unwrap();
    let finished = check(&folder);
    let words = ["`south-west` and `south-east` show the same"];
    assert!(
        says(&lines(&finished), "failed", &words),
        "{}",
        finished.stdout
    );
}

#[test]
fn recordings_of_different_lengths_are_told_with_the_ticks_that_all_have() {
    let folder = SampleFolder::new();
    let text = fs::read_to_string(folder.path("south-east.jsonl")).unwrap();
    let cut: Vec<&str> = text.lines().take(20).collect();
    fs::write(folder.path("south-east.jsonl"), cut.join("\n") + "\n").unwrap();
    let finished = check(&folder);
    assert_eq!(finished.code, 0);
    let words = ["differ in length", "farfield run venue.toml --ticks 0..20"];
    assert!(
        says(&lines(&finished), "warning", &words),
        "{}",
        finished.stdout
    );
}

/// As a tracker of half the rate leaves it: every frame is written twice.
#[test]
fn keypoints_that_are_held_are_told_of_by_a_check_and_a_run() {
    let folder = SampleFolder::new();
    let text = fs::read_to_string(folder.path("south-east.jsonl")).unwrap();
    let frames: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let held = |tick: usize| {
        let mut frame = frames[tick - tick % 2].clone();
        frame["tick"] = tick.into();
        format!("{frame}\n")
    };
    let held: String = (0..frames.len()).map(held).collect();
    fs::write(folder.path("south-east.jsonl"), held).unwrap();
    let told = "camera `south-east`: 60 of 120 lines";
    let finished = check(&folder);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    let words = [told, "15.0 pictures per second, written at 30", "`rate_hz`"];
    assert!(
        says(&lines(&finished), "warning", &words),
        "{}",
        finished.stdout
    );
    let finished = folder.farfield(&["run", "venue.toml", "--out", "out", "--ticks", "0..5"]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    let doubt = format!("doubtful: {told}");
    assert!(finished.stderr.contains(&doubt), "{}", finished.stderr);
}

/// Files in which every line is well-formed.
#[test]
fn keypoint_files_without_anybody_and_of_larger_pictures_are_told_of_by_a_check_and_a_run() {
    let twice_as_large = |line: &str| {
        let mut frame: Value = serde_json::from_str(line).unwrap();
        let persons = frame["persons"].as_array_mut().unwrap().iter_mut();
        for point in persons.flat_map(|it| it["keypoints"].as_array_mut().unwrap()) {
            for axis in 0..2 {
                if let Some(at_px) = point.get(axis).and_then(Value::as_f64) {
                    point[axis] = (2.0 * at_px).into();
                }
            }
        }
        format!("{frame}\n")
    };
    let without_anybody = |line: &str| {
        let mut frame: Value = serde_json::from_str(line).unwrap();
        frame["persons"] = Value::Array(Vec::new());
        format!("{frame}\n")
    };
    let folder = SampleFolder::new();
    let spoil = |name: &str, spoilt: &dyn Fn(&str) -> String| {
        let text = fs::read_to_string(folder.path(name)).unwrap();
        let text: String = text.lines().map(spoilt).collect();
        fs::write(folder.path(name), text).unwrap();
    };
    spoil("north-east.jsonl", &twice_as_large);
    spoil("south-west.jsonl", &without_anybody);
    let finished = check(&folder);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    let said = lines(&finished);
    let larger = ["camera `north-east`", "outside its picture of 1920 x 1200"];
    let nobody = [
        "camera `south-west`",
        "none of its 120 lines contains a person",
    ];
    assert!(says(&said, "warning", &larger), "{said:#?}");
    assert!(says(&said, "warning", &nobody), "{said:#?}");
    let finished = folder.farfield(&["run", "venue.toml", "--out", "out", "--ticks", "0..5"]);
    for words in larger.iter().chain(&nobody) {
        assert!(
            finished.stderr.contains(words),
            "{words}: {}",
            finished.stderr
        );
    }
    // Three ticks are over before anybody can be found.
    let finished = folder.farfield(&["run", "venue.toml", "--out", "short", "--ticks", "0..3"]);
    let short = "doubtful: 3 ticks at 30 a second are 0.10 s";
    assert!(finished.stderr.contains(short), "{}", finished.stderr);
}

#[test]
fn a_field_under_peoples_hips_is_told_of_by_a_check_and_a_run() {
    let folder = SampleFolder::new();
    folder.replace(
        "venue.toml",
        "max_m = [4.0, 4.0, 2.4]",
        "max_m = [4.0, 4.0, 0.2]",
    );
    let finished = check(&folder);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    let words = [
        "`[field]` ends 0.20 m above its floor",
        "expected room for people who stand",
        "max_m[2] 2.5 m above it",
    ];
    assert!(
        says(&lines(&finished), "warning", &words),
        "{}",
        finished.stdout
    );
    let finished = folder.farfield(&["run", "venue.toml", "--out", "out", "--ticks", "0..5"]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    assert!(finished.stderr.contains(words[0]), "{}", finished.stderr);
}

/// As a program leaves them that reads pictures 1, 10, 100 and 2 in this order.
#[test]
fn keypoints_whose_lines_are_sorted_by_the_names_of_pictures_are_told_of_by_a_check_and_a_run() {
    let folder = SampleFolder::new();
    for camera in ["north-east", "north-west", "south-east", "south-west"] {
        let file = folder.path(&format!("{camera}.jsonl"));
        let text = fs::read_to_string(&file).unwrap();
        let mut frames: Vec<&str> = text.lines().collect();
        let mut by_name: Vec<usize> = (0..frames.len()).collect();
        by_name.sort_by_key(usize::to_string);
        frames = by_name.iter().map(|&i| frames[i]).collect();
        let lines = frames.iter().enumerate().map(|(tick, line)| {
            let mut frame: Value = serde_json::from_str(line).unwrap();
            frame["tick"] = tick.into();
            format!("{frame}\n")
        });
        fs::write(file, lines.collect::<String>()).unwrap();
    }
    let finished = check(&folder);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    let words = ["`north-east`: at ", "`south-west`: at ", "1, 10, 100, 2"];
    assert!(
        says(&lines(&finished), "warning", &words),
        "{}",
        finished.stdout
    );
    let finished = folder.farfield(&["run", "venue.toml", "--out", "out", "--ticks", "0..5"]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    let doubt = "doubtful: camera `north-east`: at ";
    assert!(finished.stderr.contains(doubt), "{}", finished.stderr);
}

#[test]
fn a_venue_file_that_cannot_be_read_is_refused() {
    let folder = SampleFolder::new();
    folder.replace("venue.toml", "rate_hz = 30.0", "rate_herz = 30.0");
    let finished = check(&folder);
    assert_eq!(finished.code, 2, "{}", finished.stderr);
    assert!(
        finished.stderr.contains("did you mean `rate_hz`"),
        "{}",
        finished.stderr
    );
}

#[test]
fn a_run_is_refused_for_what_is_surely_wrong_and_says_what_is_doubtful() {
    let folder = SampleFolder::new();
    folder.replace(
        "calibration.toml",
        "distortions = [-0.08, 0.02",
        "distortions = [5.0, 0.02",
    );
    let finished = folder.farfield(&["run", "venue.toml", "--out", "out"]);
    assert_eq!(finished.code, 2, "{}", finished.stderr);
    for word in [
        "calibration.toml",
        "north-east",
        "distortion",
        "farfield check",
    ] {
        assert!(
            finished.stderr.contains(word),
            "{word}: {}",
            finished.stderr
        );
    }
    assert!(!folder.path("out").exists());
    let folder = SampleFolder::new();
    folder.replace(
        "calibration.toml",
        "distortions = [-0.08, 0.02",
        "distortions = [0.0, 0.3",
    );
    let finished = folder.farfield(&["run", "venue.toml", "--out", "out", "--ticks", "0..5"]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    assert!(
        finished
            .stderr
            .contains("doubtful: calibration.toml: camera `north-east`"),
        "{}",
        finished.stderr
    );
}

/// Makes half a second of video; false, with a word, where there is no ffmpeg.
fn video(folder: &SampleFolder, name: &str, picture: &str) -> bool {
    coded_video(folder, name, picture, "")
}

/// The same with more options of the encoder.
fn coded_video(folder: &SampleFolder, name: &str, picture: &str, coded: &str) -> bool {
    let made = Command::new("ffmpeg")
        .args([
            "-nostdin", "-v", "error", "-f", "lavfi", "-t", "0.5", "-i", picture,
        ])
        .args(["-pix_fmt", "yuv420p", "-preset", "ultrafast"])
        .args(coded.split_whitespace())
        .arg(folder.path(name))
        .status();
    if made.is_ok_and(|status| status.success()) {
        return true;
    }
    println!("SKIPPED a test of videos: no ffmpeg");
    false
}

#[test]
fn videos_of_another_rate_another_size_and_the_same_content_are_named() {
    let folder = SampleFolder::new();
    let videos = [
        ("north-east", "testsrc2=size=1920x1200:rate=60"),
        ("north-west", "testsrc2=size=320x240:rate=60"),
        ("south-west", "testsrc=size=1920x1200:rate=60000/1001"),
        ("south-east", "testsrc2=size=1920x1200:rate=60"),
    ];
    for (corner, picture) in videos {
        if !video(&folder, &format!("{corner}.mp4"), picture) {
            return;
        }
        let was = format!("kind = \"keypoints\", path = \"{corner}.jsonl\"");
        let is = format!("kind = \"video\", path = \"{corner}.mp4\"");
        folder.replace("venue.toml", &was, &is);
    }
    let rate_and_network = "rate_hz = 60.0\nnetwork = \"no.toml\"";
    folder.replace("venue.toml", "rate_hz = 30.0", rate_and_network);
    let said = lines(&check(&folder));
    for words in [
        [
            "`south-west` has 59.940",
            "3.6 s after an hour",
            "ffmpeg -i IN -vf fps=60.000000",
        ],
        ["320x240", "`north-west`", "cropped"],
        [
            "`north-east` and `south-east` show the same",
            "byte for byte",
            "`source`",
        ],
        ["no.toml", "`network`", "card"],
    ] {
        assert!(says(&said, "failed", &words), "{words:?}: {said:#?}");
    }
}

#[test]
fn a_video_that_is_black_is_told_of() {
    let folder = SampleFolder::new();
    if !video(
        &folder,
        "north-east.mp4",
        "color=black:size=1920x1200:rate=30",
    ) {
        return;
    }
    folder.replace(
        "venue.toml",
        "kind = \"keypoints\", path = \"north-east.jsonl\"",
        "kind = \"video\", path = \"north-east.mp4\"",
    );
    folder.replace(
        "venue.toml",
        "rate_hz = 30.0",
        "rate_hz = 30.0\nnetwork = \"no.toml\"",
    );
    let said = lines(&check(&folder));
    let words = ["camera `north-east`", "its first pictures are black", "cap"];
    assert!(says(&said, "warning", &words), "{said:#?}");
}

#[test]
fn a_video_that_is_interlaced_is_named_by_every_command_that_reads_it() {
    // Symptom: "all is as it should be", and a fast hand is there twice, in alternate lines. Cause: nothing asked for
    // the order of fields.
    let folder = SampleFolder::new();
    let picture = "testsrc2=size=1920x1200:rate=60,tinterlace=interleave_top,setfield=tff";
    let is_made = coded_video(
        &folder,
        "north-east.mp4",
        picture,
        "-flags +ilme+ildct -top 1",
    );
    if !is_made {
        return;
    }
    folder.replace(
        "venue.toml",
        "kind = \"keypoints\", path = \"north-east.jsonl\"",
        "kind = \"video\", path = \"north-east.mp4\"",
    );
    folder.replace(
        "venue.toml",
        "rate_hz = 30.0",
        "rate_hz = 30.0\nnetwork = \"no.toml\"",
    );
    let fields = "is interlaced, top field first: 60 fields a second, read as 30 pictures";
    let words = ["camera `north-east`", fields, "`rate_hz` = 60"];
    let said = lines(&check(&folder));
    assert!(says(&said, "warning", &words), "{said:#?}");
    let lens = ["--lens", "calibration.toml"];
    for command in [
        ["run", "venue.toml", "--out", "out", "--ticks", "0..15"].as_slice(),
        &["calibrate", "ball", ".", lens[0], lens[1]],
        &[
            "calibrate",
            "board",
            "north-east.mp4",
            "--chessboard",
            "4x7",
            "--square-mm",
            "60",
            "--camera",
            "north-east",
        ],
    ] {
        let said = folder.farfield(command).stderr;
        assert!(said.contains(fields), "{command:?}: {said}");
    }
}
