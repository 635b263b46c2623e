//! Stored results of runs: verdicts and poses. They show whether a refactoring changes results.
//!
//! A commit that improves a row changes nothing else. `FARFIELD_NETS=show` prints rows and hashes instead of comparing them.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::io::{Write as _, stdout};
use std::path::Path;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::{Value, json};

use crate::data::checkout;
use crate::farfield::{farfield, run};

/// Whether to print the results, for an update of the tables.
fn is_shown() -> bool {
    std::env::var_os("FARFIELD_NETS").is_some_and(|it| it == "show")
}

/// BLAKE3 of `poses.jsonl` by name of the run.
static HASHES: LazyLock<BTreeMap<String, String>> =
    LazyLock::new(|| toml::from_str(include_str!("poses.toml")).unwrap());

/// Compares the poses in `out` with the table entry `what`.
pub(crate) fn check_poses(what: &str, out: &Path) {
    let poses = fs::read(out.join("poses.jsonl")).unwrap();
    let hash = blake3::hash(&poses).to_hex().to_string();
    if is_shown() {
        let line = format!("NET {what} = \"{hash}\"\n");
        return stdout().write_all(line.as_bytes()).unwrap();
    }
    assert_eq!(
        HASHES.get(what),
        Some(&hash),
        "the poses of {what} have changed"
    );
}

/// Runs the first seconds of a scene as maps, and compares its poses.
fn check_scene(name: &str) {
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
    check_poses(name, &out);
}

#[test]
fn a_crossing_has_the_poses_of_the_net() {
    check_scene("cross");
}

#[test]
fn a_hug_has_the_poses_of_the_net() {
    check_scene("hug");
}

#[test]
fn futsal_has_the_poses_of_the_net() {
    check_scene("futsal");
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
    check_poses("sample", &out);
    let (recording, again) = (out.join("recording.mcap"), folder.path().join("again"));
    let (recording, replayed) = (recording.to_str().unwrap(), again.to_str().unwrap());
    let finished = farfield(&["replay", recording, "--out", replayed]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    check_poses("replay", &again);
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
    check_poses("demo", &out);
}

/// One row per run that has a verdict.
const TABLE: &str = include_str!("verdicts.jsonl");
/// Accepted difference of effects: relative, plus an absolute one. Names must be equal.
const SHARE: f64 = 0.25;
const LEAST: f64 = 0.02;

#[derive(Deserialize)]
struct Row {
    test: String,
    run: u32,
    verdicts: Value,
}

static ROWS: LazyLock<BTreeMap<(String, u32), Value>> = LazyLock::new(|| {
    let row = |line| -> Row { serde_json::from_str(line).unwrap() };
    let rows = TABLE.lines().map(row);
    rows.map(|row| ((row.test, row.run), row.verdicts))
        .collect()
});

thread_local! {
    static RUNS: Cell<u32> = const { Cell::new(0) };
}

/// Compares the verdicts of a run with its row of the table. The keys of a row are the test and the number of the run in it.
pub(crate) fn check_verdicts(out: &Path) {
    let thread = std::thread::current();
    // With `--test-threads 1` threads have no name of a test.
    let Some(test) = thread.name().filter(|name| *name != "main") else {
        return;
    };
    let Ok(text) = fs::read_to_string(out.join("summary.json")) else {
        return;
    };
    let run = RUNS.replace(RUNS.get() + 1) + 1;
    let summary: Value = serde_json::from_str(&text).unwrap();
    let actual = verdicts(&summary);
    if is_shown() {
        if actual != json!([]) {
            let row = json!({ "test": test, "run": run, "verdicts": actual });
            stdout()
                .write_all(format!("NET {row}\n").as_bytes())
                .unwrap();
        }
        return;
    }
    let expected = ROWS
        .get(&(test.to_owned(), run))
        .cloned()
        .unwrap_or(json!([]));
    assert!(
        is_like(&actual, &expected),
        "verdicts of run {run} of {test}:\n{actual}\nexpected:\n{expected}"
    );
}

/// Cause, cameras and effect of each verdict, without the sentences.
fn verdicts(summary: &Value) -> Value {
    let mut rows = summary["agreement"]["disagreements"].clone();
    for verdict in rows.as_array_mut().into_iter().flatten() {
        if let Some(verdict) = verdict.as_object_mut() {
            verdict.remove("found");
            verdict.remove("remedy");
        }
    }
    rows
}

fn is_like(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            (a - b).abs() <= LEAST + SHARE * a.abs().max(b.abs())
        }
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_like(a, b))
        }
        (Value::Object(a), Value::Object(b)) => {
            let same = |(name, a)| b.get(name).is_some_and(|b| is_like(a, b));
            a.len() == b.len() && a.iter().all(same)
        }
        _ => a == b,
    }
}

#[test]
fn verdicts_compare_names_exactly_and_numbers_with_a_tolerance() {
    let late =
        |ticks, camera: &str| json!([{ "cause": "late", "ticks": ticks, "cameras": [camera] }]);
    assert!(is_like(&late(5.0, "a"), &late(5.5, "a")));
    assert!(!is_like(&late(5.0, "a"), &late(9.0, "a")));
    assert!(!is_like(&late(5.0, "a"), &late(5.0, "b")));
    assert!(!is_like(&late(5.0, "a"), &json!([])));
}
