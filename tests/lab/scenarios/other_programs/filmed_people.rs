//! Calibration from people in videos: detection by networks, and reuse of their keypoints.

use std::fs;
use std::path::{Path, PathBuf};

use farfield_sim::embedded::{write_detector, write_network};
use serde_json::Value;

use crate::data::{checkout, onnx_runtime, recording};
use crate::farfield::{FinishedCommand, farfield};

/// Recorded ticks of the scene.
const TICKS: &str = "0..12";
/// One of so many frames is processed.
const EVERY: i64 = 3;
/// Accepted median error of a keypoint of the small embedded network, pixels: the size of a cell of its maps.
const OFF_PX: f64 = 8.0;

/// The scene of the demo with few small cameras, as images and as keypoints.
fn simulate(folder: &Path) -> [PathBuf; 2] {
    let text = fs::read_to_string(checkout().join("sim/scenes/court.toml")).unwrap();
    let clips = checkout().join("sim/clips");
    let text = text
        .replace("../clips", clips.to_str().unwrap())
        .replace("viewpoints = 4", "viewpoints = 2")
        .replace("per_viewpoint = 2", "per_viewpoint = 1")
        .replace("profile = \"standard\"", "profile = \"none\"")
        .replace("[960, 600]", "[640, 400]");
    let scene = folder.join("scene.toml");
    fs::write(&scene, text).unwrap();
    ["images", "keypoints"].map(|kind| {
        let out = folder.join(kind);
        let words = [
            "simulate",
            scene.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--as",
            kind,
            "--ticks",
            TICKS,
        ];
        let finished = farfield(&words);
        assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
        out
    })
}

/// The lines of a keypoint file with their ticks.
fn lines(path: &Path) -> Vec<(i64, Vec<Value>)> {
    let text = fs::read_to_string(path).unwrap();
    let lines = text.lines().map(|line| {
        let line: Value = serde_json::from_str(line).unwrap();
        (
            line["tick"].as_i64().unwrap(),
            line["persons"].as_array().unwrap().clone(),
        )
    });
    lines.collect()
}

fn keypoint(body: &Value, index: usize) -> Option<[f64; 2]> {
    let place = body["keypoints"][index].as_array()?;
    Some([place[0].as_f64()?, place[1].as_f64()?])
}

/// Distances of the keypoints that both bodies have, pixels.
fn distances_px(a: &Value, b: &Value) -> Vec<f64> {
    let both = (0..17).filter_map(|index| {
        let (a, b) = (keypoint(a, index)?, keypoint(b, index)?);
        Some((a[0] - b[0]).hypot(a[1] - b[1]))
    });
    both.collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values
        .get(values.len() / 2)
        .copied()
        .unwrap_or(f64::INFINITY)
}

/// Runs `farfield calibrate people`, with the embedded networks unless `more` contains others.
fn calibrate(folder: &Path, recordings: &Path, more: &[&str]) -> FinishedCommand {
    let networks = folder.join("networks");
    let cards = [
        write_network(&networks).unwrap(),
        write_detector(&networks).unwrap(),
    ];
    let cards = cards.map(|card| networks.join(card).display().to_string());
    let shown = |path: PathBuf| path.display().to_string();
    let mut words = vec!["calibrate".to_owned(), "people".to_owned()];
    words.push(recordings.display().to_string());
    let usual = [
        ("--network", cards[0].clone()),
        ("--detector", cards[1].clone()),
        ("--lens", shown(folder.join("images/calibration.toml"))),
        ("--seen", shown(folder.join("seen"))),
        ("--out", shown(folder.join("found.toml"))),
    ];
    for (option, value) in usual {
        if !more.contains(&option) {
            words.extend([option.to_owned(), value]);
        }
    }
    words.extend(more.iter().map(|word| (*word).to_owned()));
    farfield(&words)
}

#[test]
fn people_are_detected_in_images_and_their_files_are_reused() {
    if !onnx_runtime("people in pictures, on the way to a calibration") {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let [images, keypoints] = simulate(folder);
    let recordings = images.join("images");
    let options = ["--rate-hz", "30", "--looks-hz", "10"];
    let first = calibrate(folder, &recordings, &options);
    println!("{}\n{}", first.stdout, first.stderr);
    // A recording this short is not enough for a calibration (see `walked_calibration`), but its keypoints are written.
    assert_eq!(first.code, 2, "{}", first.stderr);
    assert!(
        first
            .stderr
            .contains("bodies with ankles and shoulders, expected at least 25"),
        "{}",
        first.stderr
    );
    let cameras = fs::read_dir(&recordings).unwrap();
    let cameras = cameras.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let cameras: Vec<String> = cameras.collect();
    assert_eq!(cameras.len(), 2, "{cameras:?}");
    for camera in &cameras {
        let name = format!("{camera}.jsonl");
        let detected = lines(&folder.join("seen").join(&name));
        let ticks: Vec<i64> = detected.iter().map(|(tick, _)| *tick).collect();
        assert_eq!(ticks, [0, EVERY, 2 * EVERY, 3 * EVERY], "{camera}");
        let truth = lines(&keypoints.join("keypoints").join(&name));
        let mut nearest_px = Vec::new();
        for (tick, bodies) in &detected {
            let there = &truth.iter().find(|(of, _)| of == tick).unwrap().1;
            for body in bodies {
                let each = there.iter().map(|it| median(distances_px(it, body)));
                nearest_px.push(each.fold(f64::INFINITY, f64::min));
            }
        }
        println!(
            "{camera}: {} bodies, {:.1} px",
            nearest_px.len(),
            median(nearest_px.clone())
        );
        assert!(nearest_px.len() >= 8, "{camera}: {}", nearest_px.len());
        assert!(median(nearest_px) < OFF_PX, "{camera}");
    }

    let seen = |name: &str| fs::read(folder.join("seen").join(format!("{name}.jsonl"))).unwrap();
    let before: Vec<Vec<u8>> = cameras.iter().map(|name| seen(name)).collect();
    fs::remove_file(folder.join(format!("seen/{}.jsonl", cameras[1]))).unwrap();
    let again = calibrate(
        folder,
        &recordings,
        &[&options[..], &["--replace"]].concat(),
    );
    assert_eq!(again.code, first.code, "{}", again.stderr);
    let taken_up = again.stderr.matches("from an earlier scan").count();
    assert_eq!(taken_up, 1, "{}", again.stderr);
    let after: Vec<Vec<u8>> = cameras.iter().map(|name| seen(name)).collect();
    assert!(before == after, "the same bytes");
    for name in ["found.toml", "found.html"] {
        fs::remove_file(folder.join(name)).ok();
    }
    let other = ["--rate-hz", "30", "--looks-hz", "15"];
    let refused = calibrate(folder, &recordings, &other);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    let why = ".jsonl already exists: --replace replaces it";
    assert!(refused.stderr.contains(why), "{}", refused.stderr);
}

#[test]
fn wrong_options_are_refused_before_images_are_read() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let [images, _] = simulate(folder);
    let recordings = images.join("images");
    let mut names: Vec<String> = fs::read_dir(&recordings)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let nowhere: &str = &format!("--at={}=nan,0,0", names[0]);
    let one: &str = &format!("--at={}=1,0,0", names[0]);
    let itself: &str = &format!("{0},{0}=3", names[0]);
    let other_rate: &str = &format!("--rate-hz={}=25", names[1]);
    let rate = ["--rate-hz", "30"];
    for (more, words) in [
        (&[][..], "no rate of camera"),
        (&["--at", "norht=0,0,3"], "unknown camera `norht`"),
        (&["--marks", "nowhere.toml"], "nowhere.toml"),
        (&["--looks-hz", "0"], "--looks-hz: found 0"),
        (&["--from-s", "3"], "--from-s"),
        (&[other_rate], "30.000"),
        (&["--stature-m", "175"], "stature_m"),
        (&["--clocks", "given"], "offset"),
        (
            &["--clocks", "unknown", "--looks-hz", "1"],
            "--looks-hz: found 1.000",
        ),
        (&[nowhere], "expected three finite numbers"),
        (&[one], "found 1 known places"),
        (&["--distance", itself], "to itself"),
        (&["--network", "nowhere.toml"], "nowhere.toml"),
        (&["--detector", "nowhere.toml"], "nowhere.toml"),
    ] {
        let more = if more.is_empty() {
            Vec::new()
        } else {
            [&rate[..], more].concat()
        };
        let refused = calibrate(folder, &recordings, &more);
        assert_eq!(refused.code, 2, "{more:?}: {}", refused.stderr);
        assert!(
            refused.stderr.contains(words),
            "{more:?}: {}",
            refused.stderr
        );
        assert!(!folder.join("seen").exists(), "{more:?}");
    }
}

#[test]
fn real_networks_detect_a_man_in_every_video() {
    let scenario = "a man on a treadmill, on the way to a calibration";
    let needed = [
        "data/pose2sim/single/videos",
        "data/pose2sim/single/calibration.toml",
        "models/tinypose_256x192.toml",
        "models/rtmdet_nano_person.toml",
    ];
    let [Some(videos), Some(lens), Some(network), Some(detector)] =
        needed.map(|path| recording(scenario, path))
    else {
        return;
    };
    if !onnx_runtime(scenario) {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let (seen, out) = (place.path().join("seen"), place.path().join("found.toml"));
    let words = ["calibrate", "people"].map(Path::new);
    let options = [
        ("--lens", &lens),
        ("--network", &network),
        ("--detector", &detector),
        ("--seen", &seen),
        ("--out", &out),
    ];
    let options = options
        .iter()
        .flat_map(|(option, value)| [Path::new(option), value.as_path()]);
    let words: Vec<&Path> = words
        .into_iter()
        .chain([videos.as_path()])
        .chain(options)
        .collect();
    let done = farfield(&words);
    println!("{}\n{}", done.stdout, done.stderr);
    // A person who stays in place does not determine the cameras.
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(
        done.stderr
            .contains("bodies with ankles and shoulders, expected at least 25"),
        "{}",
        done.stderr
    );
    for camera in ["cam01", "cam02", "cam03", "cam04"] {
        let detected = lines(&seen.join(format!("{camera}.jsonl")));
        assert_eq!(detected.len(), 9, "100 frames at 60 Hz, five a second");
        for (tick, bodies) in detected {
            let whole = bodies.iter().filter(|body| {
                let seen = (0..17).filter(|index| keypoint(body, *index).is_some());
                seen.count() >= 14
            });
            assert!(whole.count() >= 1, "{camera}, frame {tick}");
        }
    }
}
