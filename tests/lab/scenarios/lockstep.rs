//! The same recording gives the same bytes, run after run.

use crate::data::{checkout, recording};
use crate::farfield::run;

fn two_runs_are_equal(venue: &std::path::Path, more: &[&str]) {
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
    two_runs_are_equal(&checkout().join("examples/walk/venue.toml"), &[]);
}

#[test]
fn two_lockstep_runs_of_the_shelf_are_byte_identical() {
    let Some(venue) = recording("lockstep on the Shelf", "data/shelf/venue.toml") else {
        return;
    };
    two_runs_are_equal(&venue, &["--ticks", "300..400"]);
}
