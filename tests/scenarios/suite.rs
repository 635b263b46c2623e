//! `farfield evaluate --suite`: scenes in one process, scored, on clips that the project carries.

use crate::farfield::farfield;

/// Runs a suite for two seconds of its scenes and returns standard output.
fn suite(words: &[&str]) -> String {
    let mut args = vec!["evaluate", "--suite"];
    args.extend(words);
    args.extend(["--seconds", "2"]);
    let run = farfield(&args);
    assert_eq!(run.code, 0, "{}", run.stderr);
    run.stdout
}

#[test]
fn a_scene_of_the_own_clips_gives_a_table_of_ours_and_of_triangulation() {
    let dir = tempfile::tempdir().unwrap();
    let plots = dir.path().join("plots");
    let table = suite(&["one", "facing", "--plot", plots.to_str().unwrap()]);
    println!("{table}");
    for expected in [
        "[own one] 1 people",
        "[own facing] 2 people",
        "with RoM",
        "without",
        "DLT+BW",
        "MPJPE",
        "PCK100",
        "identity: switches 0",
    ] {
        assert!(table.contains(expected), "{expected} is not in\n{table}");
    }
    let svg = std::fs::read_to_string(plots.join("own-facing.svg")).unwrap();
    assert!(svg.contains("actor 1") && svg.contains("actor 2"));
}

#[test]
fn the_json_of_a_suite_has_the_figures_of_every_scene() {
    let json: serde_json::Value = serde_json::from_str(&suite(&["one", "--json"])).unwrap();
    let scene = &json["scenes"][0];
    assert_eq!(scene["scene"], "own one");
    for method in ["with_range_of_motion", "without_range_of_motion"] {
        assert_eq!(scene[method]["actors"]["1"]["gaps"], 0, "{method}");
        let mpjpe_mm = scene[method]["mean"]["mpjpe_mm"].as_f64().unwrap();
        assert!((5.0..45.0).contains(&mpjpe_mm), "{method}: {mpjpe_mm} mm");
    }
    let baseline = &scene["baseline"];
    assert!(baseline["cutoff_hz"].as_f64().unwrap() >= 4.0);
    assert!(baseline["scores"]["mean"]["mpjpe_mm"].as_f64().unwrap() > 5.0);
    assert_eq!(json["behind_limits"], serde_json::json!([]));
}

#[test]
fn an_unknown_suite_is_wrong_usage() {
    let run = farfield(&["evaluate", "--suite", "papr"]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("papr"), "{}", run.stderr);
}
