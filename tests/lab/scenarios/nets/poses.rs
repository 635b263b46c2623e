//! The poses of some venues, to the bit.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Write as _, stdout};
use std::path::Path;
use std::sync::LazyLock;

use crate::data::checkout;
use crate::farfield::{farfield, run};

/// BLAKE3 of `poses.jsonl`, by what was run.
static HASHES: LazyLock<BTreeMap<String, String>> =
    LazyLock::new(|| toml::from_str(include_str!("poses.toml")).unwrap());

/// Holds the poses that the run in `out` left to those of `what` in the table.
pub(crate) fn hold_poses(what: &str, out: &Path) {
    let poses = fs::read(out.join("poses.jsonl")).unwrap();
    let hash = blake3::hash(&poses).to_hex().to_string();
    if super::is_shown() {
        let line = format!("NET {what} = \"{hash}\"\n");
        return stdout().write_all(line.as_bytes()).unwrap();
    }
    assert_eq!(
        HASHES.get(what),
        Some(&hash),
        "the poses of {what} are others"
    );
}

/// Runs the first seconds of a scene, as maps.
fn hold_scene(name: &str) {
    let folder = tempfile::tempdir().unwrap();
    let made = folder.path().join("venue");
    let scene = checkout().join(format!("sim/scenes/{name}.toml"));
    let (scene, venue) = (scene.to_str().unwrap(), made.to_str().unwrap());
    let simulated = farfield(&[
        "simulate", scene, "--as", "maps", "--ticks", "0..120", "--out", venue,
    ]);
    assert_eq!(simulated.code, 0, "{}", simulated.stderr);
    let out = folder.path().join("run");
    run(&made.join("venue.toml"), &out, &[]);
    hold_poses(name, &out);
}

#[test]
fn a_crossing_has_the_poses_of_the_net() {
    hold_scene("cross");
}

#[test]
fn a_hug_has_the_poses_of_the_net() {
    hold_scene("hug");
}

#[test]
fn futsal_has_the_poses_of_the_net() {
    hold_scene("futsal");
}

#[test]
fn the_sample_and_its_recording_replayed_have_the_poses_of_the_net() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    run(
        &checkout().join("examples/walk/venue.toml"),
        &out,
        &["--record"],
    );
    hold_poses("sample", &out);
    let (recording, again) = (out.join("recording.mcap"), folder.path().join("again"));
    let (recording, replayed) = (recording.to_str().unwrap(), again.to_str().unwrap());
    let finished = farfield(&["replay", recording, "--out", replayed]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    hold_poses("replay", &again);
}

#[test]
fn the_demo_from_maps_has_the_poses_of_the_net() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let finished = farfield(&[
        "demo",
        "--maps",
        "--ticks",
        "120",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    hold_poses("demo", &out);
}
