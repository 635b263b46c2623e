//! The verdicts on cameras: for every planted mistake its cause, the cameras it names and its effect; right recordings
//! are silent.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::io::{Write as _, stdout};
use std::path::Path;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::{Value, json};

/// One row per run with a verdict; runs without one have none.
const TABLE: &str = include_str!("verdicts.jsonl");
/// By how much numbers of effects may differ: a share, or so much where they are small. What is named does not.
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
    /// Runs of the test of this thread so far.
    static RUNS: Cell<u32> = const { Cell::new(0) };
}

/// Holds the verdicts of the run in `out`, of the test of this thread, to its row of the table.
pub(crate) fn hold_verdicts(out: &Path) {
    let thread = std::thread::current();
    // With `--test-threads 1` no thread is named by its test.
    let Some(test) = thread.name().filter(|name| *name != "main") else {
        return;
    };
    let Ok(text) = fs::read_to_string(out.join("summary.json")) else {
        return;
    };
    let run = RUNS.replace(RUNS.get() + 1) + 1;
    let summary: Value = serde_json::from_str(&text).unwrap();
    let found = verdicts(&summary);
    if super::is_shown() {
        if found != json!([]) {
            let row = json!({ "test": test, "run": run, "verdicts": found });
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
        is_like(&found, &expected),
        "verdicts of run {run} of {test}:\n{found}\nexpected:\n{expected}"
    );
}

/// Cause, cameras and effect of each; sentences may change.
fn verdicts(summary: &Value) -> Value {
    let mut found = summary["agreement"]["disagreements"].clone();
    for verdict in found.as_array_mut().into_iter().flatten() {
        if let Some(verdict) = verdict.as_object_mut() {
            verdict.remove("found");
            verdict.remove("remedy");
        }
    }
    found
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
fn a_verdict_is_like_another_where_it_names_the_same_and_its_numbers_are_near() {
    let late =
        |ticks, camera: &str| json!([{ "cause": "late", "ticks": ticks, "cameras": [camera] }]);
    assert!(is_like(&late(5.0, "a"), &late(5.5, "a")));
    assert!(!is_like(&late(5.0, "a"), &late(9.0, "a")));
    assert!(!is_like(&late(5.0, "a"), &late(5.0, "b")));
    assert!(!is_like(&late(5.0, "a"), &json!([])));
}
