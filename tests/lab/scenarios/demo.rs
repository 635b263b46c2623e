//! `farfield demo` and `farfield simulate` for a newcomer: the program without any other file.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::data::{checkout, onnx_runtime};
use crate::farfield::{FinishedCommand, command, farfield, finish, poses, run};

/// Checks that a demo has left the files of a run and no unfinished one.
fn check_files_of_run(out: &Path) {
    for file in [
        "poses.jsonl",
        "summary.json",
        "truth.jsonl",
        "venue/venue.toml",
    ] {
        assert!(out.join(file).is_file(), "{file} is missing");
    }
    for entry in fs::read_dir(out).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(
            !name.contains("tmp") && !name.contains("lock"),
            "{name} was left"
        );
    }
}

fn demo(out: &Path, more: &[&str]) -> FinishedCommand {
    let mut args = vec!["demo".as_ref(), "--out".as_ref(), out.as_os_str()];
    args.extend(more.iter().map(|arg| std::ffi::OsStr::new(*arg)));
    farfield(&args)
}

fn score(poses: &Path, truth: &Path) -> Value {
    let scored = farfield(&[
        "evaluate".as_ref(),
        poses.as_os_str(),
        truth.as_os_str(),
        "--json".as_ref(),
    ]);
    serde_json::from_str(&scored.stdout).unwrap_or_else(|e| panic!("{e}: {}", scored.stderr))
}

/// Checks that all four players are tracked from the first tick to the last, each with one id, close to the truth.
fn check_four_players(out: &Path, truth: &Path, worst_mm: f64) {
    let score = score(&out.join("poses.jsonl"), truth);
    let actors = score["actors"].as_object().unwrap();
    assert_eq!(actors.len(), 4);
    for (actor, score) in actors {
        let mpjpe_mm = score["mpjpe_mm"].as_f64().unwrap();
        assert!(mpjpe_mm < worst_mm, "actor {actor}: {mpjpe_mm} mm");
        assert_eq!(score["gaps"], 0, "actor {actor}");
    }
    assert_eq!(score["identity"]["switches"], 0, "{score}");
    let mut ids: Vec<u64> = poses(out)
        .iter()
        .map(|pose| pose["person"].as_u64().unwrap())
        .collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids, [1, 2, 3, 4]);
}

#[test]
fn the_demo_from_maps_tracks_four_players_and_prints_scores() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let finished = demo(&out, &["--maps", "--ticks", "45"]);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    check_files_of_run(&out);
    check_four_players(&out, &out.join("truth.jsonl"), 40.0);
    for words in [
        "4 simulated people and a ball",
        "   1.0 of 1.5 s   4 of 4 people tracked",
        "MPJPE",
        "identity: switches 0",
        "skeletons over the images: ",
    ] {
        assert!(
            finished.stdout.contains(words),
            "{words:?} in\n{}",
            finished.stdout
        );
    }
    // Drawn by default, of the middle tick.
    assert!(out.join("overlay_north-east-1_22.png").is_file());
    // The venue of the demo is an ordinary one, and the same run gives the same bytes.
    let again = dir.path().join("again");
    run(&out.join("venue/venue.toml"), &again, &[]);
    let bytes = |out: &Path| fs::read(out.join("poses.jsonl")).unwrap();
    assert!(bytes(&out) == bytes(&again), "poses.jsonl differs");
}

#[test]
fn a_demo_without_an_end_finishes_its_files_at_ctrl_c() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut child = command()
        .args(["demo", "--maps", "--forever", "--out"])
        .arg(&out)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let first = lines.find(|line| line.as_ref().unwrap().contains("of 4 people tracked"));
    let id = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    let ended = finish(&child.wait_with_output().unwrap());
    assert!(first.is_some(), "{}", ended.stderr);
    assert_eq!(ended.code, 130, "{}", ended.stderr);
    assert!(
        rest.iter().any(|line| line.starts_with("identity: ")),
        "{rest:?}"
    );
    check_files_of_run(&out);
    let ticks = |file: &str| {
        let text = fs::read_to_string(out.join(file)).unwrap();
        let last: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        last["tick"].as_i64().unwrap()
    };
    assert_eq!(ticks("poses.jsonl"), ticks("truth.jsonl"));
}

#[test]
fn the_demo_reads_images_with_the_embedded_network() {
    if !onnx_runtime("the demo with pixels") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let finished = demo(&out, &["--ticks", "18", "--overlay", "3"]);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    check_files_of_run(&out);
    // A detected person starts with the keypoints of a small network in one image per viewpoint.
    check_four_players(&out, &out.join("truth.jsonl"), 250.0);
    let given = dir.path().join("given");
    let from_given = demo(&given, &["--ticks", "18", "--given"]);
    assert_eq!(
        from_given.code, 0,
        "{}\n{}",
        from_given.stdout, from_given.stderr
    );
    check_four_players(&given, &given.join("truth.jsonl"), 90.0);
    assert!(out.join("overlay_north-east-1_3.png").is_file());
    assert!(
        finished.stdout.contains("inference by "),
        "{}",
        finished.stdout
    );
}

#[test]
fn a_simulated_recording_of_keypoints_runs() {
    let dir = tempfile::tempdir().unwrap();
    let (venue, out) = (dir.path().join("venue"), dir.path().join("out"));
    let scene = checkout().join("sim/scenes/court.toml");
    let finished = farfield(&[
        "simulate".as_ref(),
        scene.as_os_str(),
        "--out".as_ref(),
        venue.as_os_str(),
        "--as".as_ref(),
        "keypoints".as_ref(),
        "--ticks".as_ref(),
        "30..75".as_ref(),
    ]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    assert!(
        finished
            .stdout
            .contains("outside the clinical range of motion"),
        "{}",
        finished.stdout
    );
    run(&venue.join("venue.toml"), &out, &[]);
    check_four_players(&out, &venue.join("truth.jsonl"), 40.0);
}

#[test]
fn simulated_images_have_the_size_and_number_of_the_scene() {
    let dir = tempfile::tempdir().unwrap();
    let venue = dir.path().join("venue");
    let scene = small_scene(dir.path());
    let finished = farfield(&[
        "simulate".as_ref(),
        scene.as_os_str(),
        "--out".as_ref(),
        venue.as_os_str(),
        "--as".as_ref(),
        "images".as_ref(),
        "--ticks".as_ref(),
        "2..5".as_ref(),
    ]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    let text = fs::read_to_string(venue.join("venue.toml")).unwrap();
    for words in [
        "first_tick = 2",
        "network = \"models/",
        "[[person]]\ntick = 2",
    ] {
        assert!(text.contains(words), "{words:?} in\n{text}");
    }
    let pictures = venue.join("images/north-east-1");
    assert_eq!(fs::read_dir(&pictures).unwrap().count(), 3);
    if onnx_runtime("a simulated recording of pictures") {
        run(&venue.join("venue.toml"), &dir.path().join("out"), &[]);
    }
}

/// The court with very small images.
fn small_scene(folder: &Path) -> std::path::PathBuf {
    let text = fs::read_to_string(checkout().join("sim/scenes/court.toml")).unwrap();
    let clips = checkout().join("sim/clips");
    let text = text.replace("../clips", clips.to_str().unwrap());
    let size = text
        .lines()
        .find(|line| line.starts_with("size_px"))
        .unwrap()
        .to_owned();
    let path = folder.join("scene.toml");
    fs::write(&path, text.replace(&size, "size_px = [320, 200]")).unwrap();
    path
}

/// Runs `farfield` with `args`. Checks that the refusal contains all `words`, and that nothing exists at `out`.
fn is_refused(args: &[&str], out: &Path, words: &[&str]) {
    let finished = farfield(args);
    assert_eq!(finished.code, 2, "{}\n{}", finished.stdout, finished.stderr);
    for word in words {
        assert!(
            finished.stderr.contains(word),
            "{word:?} in: {}",
            finished.stderr
        );
    }
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
    assert!(!out.exists(), "something was written");
    println!("refused: {}", finished.stderr.trim());
}

#[test]
fn a_wrong_scene_is_refused_with_file_and_field() {
    let dir = tempfile::tempdir().unwrap();
    let scene = small_scene(dir.path());
    let text = fs::read_to_string(&scene).unwrap();
    let (scene, out) = (scene.to_str().unwrap(), dir.path().join("new/out"));
    let out_name = out.to_str().unwrap();
    for (from, to, words) in [
        ("rate_hz", "rate_herz", ["scene.toml:2", "rate_hz"]),
        ("run.bvh", "runn.bvh", ["runn.bvh", "clip"]),
        (
            "seconds = 20.0",
            "seconds = -1.0",
            ["scene.toml:3", "seconds"],
        ),
    ] {
        assert!(text.contains(from), "{from}");
        fs::write(scene, text.replacen(from, to, 1)).unwrap();
        is_refused(
            &["simulate", scene, "--out", out_name, "--as", "images"],
            &out,
            &words,
        );
        is_refused(
            &["demo", "--scene", scene, "--out", out_name, "--maps"],
            &out,
            &words,
        );
    }
}

#[test]
fn impossible_simulations_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let scene = small_scene(dir.path());
    let (scene, out) = (scene.to_str().unwrap(), dir.path().join("out"));
    let out_name = out.to_str().unwrap();
    let simulate = ["simulate", scene, "--out", out_name, "--as", "keypoints"];
    let with = |more: &[&'static str]| [simulate.as_slice(), more].concat();
    is_refused(
        &with(&["--ticks", "0..99999"]),
        &out,
        &["--ticks", "0..600"],
    );
    is_refused(
        &with(&["--detector", "x.toml"]),
        &out,
        &["--detector", "keypoints"],
    );
    is_refused(&["demo", "--ticks", "0"], &out, &["--ticks"]);
    is_refused(
        &["demo", "--ticks", "9999999", "--out", out_name],
        &out,
        &["--ticks", "at most"],
    );
    fs::create_dir(&out).unwrap();
    fs::write(out.join("mine"), "x").unwrap();
    let finished = farfield(&simulate);
    assert_eq!(finished.code, 2);
    assert!(finished.stderr.contains("not empty"), "{}", finished.stderr);
}

#[test]
fn an_unknown_camera_of_a_scene_is_refused_with_the_nearest_name() {
    let dir = tempfile::tempdir().unwrap();
    let demo_out = dir.path().join("demo");
    assert_eq!(demo(&demo_out, &["--maps", "--ticks", "1"]).code, 0);
    let venue = demo_out.join("venue");
    for file in ["venue.toml", "calibration.toml"] {
        let text = fs::read_to_string(venue.join(file)).unwrap();
        fs::write(
            venue.join(file),
            text.replace("north-east-1", "north-east-9"),
        )
        .unwrap();
    }
    let out = dir.path().join("out");
    let (venue, out_name) = (venue.join("venue.toml"), out.to_str().unwrap());
    is_refused(
        &["run", venue.to_str().unwrap(), "--out", out_name],
        &out,
        &["court.toml", "north-east-9", "did you mean `north-east-1`"],
    );
}
