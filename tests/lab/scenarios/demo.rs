//! `farfield demo` and `farfield simulate` as a newcomer meets them: nothing beside the program.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::data::{checkout, onnx_runtime};
use crate::farfield::{FinishedCommand, command, farfield, finish, poses, run};

/// The four players, the files of a run, and nothing unfinished.
fn holds_the_files_of_a_run(out: &Path) {
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

/// All four are there from the first tick to the last, each with one id, and close to the truth.
fn four_players_are_followed(out: &Path, truth: &Path, worst_mm: f64) {
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
fn the_demo_without_pixels_follows_four_players_and_says_how_well() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let said = demo(&out, &["--maps", "--ticks", "45"]);
    assert_eq!(said.code, 0, "{}\n{}", said.stdout, said.stderr);
    holds_the_files_of_a_run(&out);
    four_players_are_followed(&out, &out.join("truth.jsonl"), 40.0);
    for words in [
        "4 simulated people and a ball",
        "   1.0 of 1.5 s   4 of 4 people tracked",
        "MPJPE",
        "identity: switches 0",
        "skeletons over the pictures: ",
    ] {
        assert!(said.stdout.contains(words), "{words:?} in\n{}", said.stdout);
    }
    // Nobody asked for it: of the middle tick.
    assert!(out.join("overlay_north-east-1_22.png").is_file());
    // The venue that the demo made is one like any other, and the same run gives the same bytes.
    let again = dir.path().join("again");
    run(&out.join("venue/venue.toml"), &again, &[]);
    let bytes = |out: &Path| fs::read(out.join("poses.jsonl")).unwrap();
    assert!(bytes(&out) == bytes(&again), "poses.jsonl differs");
}

#[test]
fn a_demo_without_an_end_leaves_whole_files_at_ctrl_c() {
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
    holds_the_files_of_a_run(&out);
    let ticks = |file: &str| {
        let text = fs::read_to_string(out.join(file)).unwrap();
        let last: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        last["tick"].as_i64().unwrap()
    };
    assert_eq!(ticks("poses.jsonl"), ticks("truth.jsonl"));
}

#[test]
fn the_demo_with_pixels_reads_its_pictures_with_the_network_it_carries() {
    if !onnx_runtime("the demo with pixels") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let said = demo(&out, &["--ticks", "18", "--overlay", "3"]);
    assert_eq!(said.code, 0, "{}\n{}", said.stdout, said.stderr);
    holds_the_files_of_a_run(&out);
    // Who is found starts with what a small network saw in one picture per viewpoint.
    four_players_are_followed(&out, &out.join("truth.jsonl"), 250.0);
    let given = dir.path().join("given");
    let told = demo(&given, &["--ticks", "18", "--given"]);
    assert_eq!(told.code, 0, "{}\n{}", told.stdout, told.stderr);
    four_players_are_followed(&given, &given.join("truth.jsonl"), 90.0);
    assert!(out.join("overlay_north-east-1_3.png").is_file());
    assert!(said.stdout.contains("inference by "), "{}", said.stdout);
}

#[test]
fn a_simulated_recording_of_keypoints_runs_like_any_other() {
    let dir = tempfile::tempdir().unwrap();
    let (venue, out) = (dir.path().join("venue"), dir.path().join("out"));
    let scene = checkout().join("sim/scenes/court.toml");
    let said = farfield(&[
        "simulate".as_ref(),
        scene.as_os_str(),
        "--out".as_ref(),
        venue.as_os_str(),
        "--as".as_ref(),
        "keypoints".as_ref(),
        "--ticks".as_ref(),
        "30..75".as_ref(),
    ]);
    assert_eq!(said.code, 0, "{}", said.stderr);
    assert!(
        said.stdout.contains("outside the clinical range of motion"),
        "{}",
        said.stdout
    );
    run(&venue.join("venue.toml"), &out, &[]);
    four_players_are_followed(&out, &venue.join("truth.jsonl"), 40.0);
}

#[test]
fn a_simulated_recording_of_pictures_is_of_the_calibrations_size_and_length() {
    let dir = tempfile::tempdir().unwrap();
    let venue = dir.path().join("venue");
    let scene = small_scene(dir.path());
    let said = farfield(&[
        "simulate".as_ref(),
        scene.as_os_str(),
        "--out".as_ref(),
        venue.as_os_str(),
        "--as".as_ref(),
        "images".as_ref(),
        "--ticks".as_ref(),
        "2..5".as_ref(),
    ]);
    assert_eq!(said.code, 0, "{}", said.stderr);
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

/// The court, with pictures so small that they cost nothing.
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

/// Runs `farfield` with `args`, and checks that it is refused with a message that names all of
/// `named`, and that nothing is left at `out`.
fn is_refused(args: &[&str], out: &Path, named: &[&str]) {
    let said = farfield(args);
    assert_eq!(said.code, 2, "{}\n{}", said.stdout, said.stderr);
    for word in named {
        assert!(said.stderr.contains(word), "{word:?} in: {}", said.stderr);
    }
    assert!(!said.stderr.contains("panicked"), "{}", said.stderr);
    assert!(!out.exists(), "something was written");
    println!("refused: {}", said.stderr.trim());
}

#[test]
fn a_wrong_scene_is_refused_by_file_and_field_before_anything_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let scene = small_scene(dir.path());
    let text = fs::read_to_string(&scene).unwrap();
    let (scene, out) = (scene.to_str().unwrap(), dir.path().join("new/out"));
    let out_name = out.to_str().unwrap();
    for (from, to, named) in [
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
            &named,
        );
        is_refused(
            &["demo", "--scene", scene, "--out", out_name, "--maps"],
            &out,
            &named,
        );
    }
}

#[test]
fn what_cannot_be_recorded_is_refused() {
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
    let said = farfield(&simulate);
    assert_eq!(said.code, 2);
    assert!(said.stderr.contains("not empty"), "{}", said.stderr);
}

#[test]
fn a_camera_that_the_scene_does_not_have_is_refused_with_the_nearest() {
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
