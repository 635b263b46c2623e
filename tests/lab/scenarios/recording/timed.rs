//! What the ticks of one's own recording cost: `farfield bench RECORDING`.

use serde_json::Value;

use super::{recorded, replay};
use crate::farfield::farfield;

#[test]
fn the_ticks_of_ones_own_recording_are_timed_in_rounds() {
    let dir = tempfile::tempdir().unwrap();
    let (file, _) = recorded(dir.path(), &["--ticks", "0..90"]);
    let timed = farfield(&["bench", file.to_str().unwrap(), "--threads", "2", "--json"]);
    assert_eq!(timed.code, 0, "{}", timed.stderr);
    let report: Value = serde_json::from_str(&timed.stdout).unwrap();
    assert_eq!(report["rate_hz"], 30.0);
    let [run] = &report["runs"].as_array().unwrap()[..] else {
        panic!("one number of threads: {report}");
    };
    assert_eq!(
        [&run["viewpoints"], &run["people"], &run["threads"]],
        [4, 2, 2]
    );
    // Sixty ticks after those that are left out, at least 300 in all.
    assert_eq!([&run["ticks"], &run["rounds"]], [300, 5]);
    // Whoever is found in a round is found in the next one, which begins anew.
    assert_eq!(run["tracked"], 2);
    let [median, typical, most] =
        ["p50_ms", "typical_p99_ms", "max_ms"].map(|name| run[name].as_f64().unwrap());
    assert!(0.0 < median && median <= most && typical <= most, "{run}");
}

#[test]
fn a_recording_that_ends_while_people_are_found_is_not_timed() {
    let dir = tempfile::tempdir().unwrap();
    let (file, _) = recorded(dir.path(), &["--ticks", "0..30"]);
    let timed = farfield(&["bench", file.to_str().unwrap()]);
    assert_eq!(timed.code, 2, "{}", timed.stderr);
    assert!(
        timed.stderr.contains("found at most 30 ticks"),
        "{}",
        timed.stderr
    );
    // The recording itself is whole.
    assert_eq!(replay(&file, &dir.path().join("again"), &[]).code, 0);
}
