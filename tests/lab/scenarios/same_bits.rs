//! The same input gives the same bytes: in every run, on any processor, with any number of threads.

use std::fs;
use std::path::{Path, PathBuf};

use crate::data::{checkout, recording};
use crate::farfield::{command, farfield, finish, run};

fn check_two_runs(venue: &std::path::Path, more: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let (first, second) = (dir.path().join("first"), dir.path().join("second"));
    run(venue, &first, more);
    run(venue, &second, more);
    let bytes = |out: &std::path::Path| std::fs::read(out.join("poses.jsonl")).unwrap();
    assert!(!bytes(&first).is_empty());
    assert!(
        bytes(&first) == bytes(&second),
        "poses.jsonl differs between two lock-step runs"
    );
    let summary = |out: &std::path::Path| {
        let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
        let mut value: serde_json::Value = serde_json::from_str(&text).unwrap();
        value
            .as_object_mut()
            .unwrap()
            .remove("timing")
            .expect("a summary has its timing");
        value
    };
    assert_eq!(
        summary(&first),
        summary(&second),
        "only `timing` may differ"
    );
    println!(
        "lockstep {}: {} bytes of poses.jsonl, equal in two runs",
        venue.display(),
        bytes(&first).len()
    );
}

#[test]
fn two_lockstep_runs_of_the_sample_are_byte_identical() {
    check_two_runs(&checkout().join("examples/walk/venue.toml"), &[]);
}

#[test]
fn two_lockstep_runs_of_the_shelf_are_byte_identical() {
    let Some(venue) = recording("lockstep on the Shelf", "data/shelf/venue.toml") else {
        return;
    };
    check_two_runs(&venue, &["--ticks", "300..400"]);
}

struct RecordedScene {
    name: &'static str,
    ticks: u32,
}

/// Makes the C library choose functions for a processor without fused multiply-add.
const WITHOUT_FMA: (&str, &str) = ("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX2,-FMA");
/// Two people who dance, for enough ticks that a difference in the last bit of a function of the C library has shown in a
/// published pose.
const COUPLE: RecordedScene = RecordedScene {
    name: "hug",
    ticks: 300,
};
/// Five people: from four on, decisions between people run on several threads.
const FIVE: RecordedScene = RecordedScene {
    name: "five",
    ticks: 90,
};

/// Runs and records a scene in maps; returns the recording and the folder of the run.
fn record(dir: &Path, scene: &RecordedScene) -> (PathBuf, PathBuf) {
    let (venue, out) = (dir.join("venue"), dir.join("run"));
    let path = checkout().join(format!("sim/scenes/{}.toml", scene.name));
    let ticks = format!("0..{}", scene.ticks);
    let made = farfield(&[
        "simulate".as_ref(),
        path.as_os_str(),
        "--as".as_ref(),
        "maps".as_ref(),
        "--ticks".as_ref(),
        ticks.as_ref(),
        "--out".as_ref(),
        venue.as_os_str(),
    ]);
    assert_eq!(made.code, 0, "{}\n{}", made.stdout, made.stderr);
    run(&venue.join("venue.toml"), &out, &["--record"]);
    (out.join("recording.mcap"), out)
}

/// Replays a recording of a scene with each setting: every tick has the published bits.
fn check_replays(scene: &RecordedScene, settings: &[(&str, &str)]) {
    let dir = tempfile::tempdir().unwrap();
    let (recording, out) = record(dir.path(), scene);
    let poses = |out: &Path| fs::read(out.join("poses.jsonl")).unwrap();
    for (index, (name, value)) in settings.iter().enumerate() {
        let again = dir.path().join(format!("again-{index}"));
        let mut replay = command();
        replay.arg("replay").arg(&recording).arg("--json");
        let output = replay.arg("--out").arg(&again).env(name, value).output();
        let finished = finish(&output.unwrap());
        assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
        let report: serde_json::Value = serde_json::from_str(&finished.stdout).unwrap();
        let counts = ["same_ticks", "different_ticks"].map(|count| &report["replay"][count]);
        let (scene, ticks) = (scene.name, scene.ticks);
        assert_eq!(counts, [ticks, 0], "{scene}: with {name}={value}");
        assert!(
            poses(&again) == poses(&out),
            "{scene}: poses.jsonl differs with {name}={value}"
        );
    }
}

#[test]
fn a_replay_has_the_same_bits_without_fma_and_on_any_number_of_threads() {
    let [one, two, eight] = ["1", "2", "8"].map(|n| ("RAYON_NUM_THREADS", n));
    check_replays(&COUPLE, &[WITHOUT_FMA, one, eight]);
    check_replays(&FIVE, &[one, two, eight]);
}
