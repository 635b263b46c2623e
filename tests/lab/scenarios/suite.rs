//! `lab suite`: scenes in one process, scored, with the clips of the project.

use crate::farfield::farfield;

/// Runs a suite for two seconds of its scenes and returns standard output.
fn suite(words: &[&str]) -> String {
    let mut args = vec!["suite"];
    args.extend(words);
    args.extend(["--seconds", "2"]);
    let run = farfield(&args);
    assert_eq!(run.code, 0, "{}", run.stderr);
    run.stdout
}

#[test]
fn a_scene_gives_a_table_of_our_method_and_of_triangulation() {
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
    // 36 errors that last for seconds: 68 % within one sigma may be 24 % more or less.
    let calibration = &scene["with_range_of_motion"]["calibration"];
    let inside = calibration["states"]["tracked"]["inside_1"]
        .as_f64()
        .unwrap();
    assert!((44.0..92.0).contains(&inside), "{inside} %");
    assert_eq!(calibration["fifths"].as_array().unwrap().len(), 5);
    let all = calibration["all_joints"]["states"]["tracked"]["n"].as_u64();
    assert!(all > calibration["states"]["tracked"]["n"].as_u64());
    let baseline = &scene["baseline"];
    assert!(baseline["cutoff_hz"].as_f64().unwrap() >= 4.0);
    assert!(baseline["scores"]["mean"]["mpjpe_mm"].as_f64().unwrap() > 5.0);
    assert_eq!(json["behind_limits"], serde_json::json!([]));
}

#[test]
fn a_mirror_adds_no_person_and_lost_people_keep_their_ids() {
    let run = farfield(&["suite", "mirror", "lost", "--seconds", "4", "--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let json: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    for scene in json["scenes"].as_array().unwrap() {
        let scores = &scene["with_range_of_motion"];
        assert_eq!(scores["identity"]["false_births"], 0, "{scores}");
        assert_eq!(scores["identity"]["switches"], 0, "{scores}");
        assert_eq!(scores["lives"]["never_born"], 0, "{scores}");
        let initiated_s = scores["lives"]["time_to_birth_worst_s"].as_f64().unwrap();
        assert!(initiated_s <= 1.0, "initiated after {initiated_s} s");
    }
    // The first loss in the scene ends within four seconds.
    let recoveries = json["scenes"][1]["recoveries"].as_array().unwrap();
    assert_eq!(recoveries.len(), 1);
    assert_eq!(recoveries[0]["same_id"], true, "{recoveries:?}");
    let back_s = recoveries[0]["seconds"].as_f64().unwrap();
    assert!(back_s <= 0.5, "below 50 mm after {back_s} s");
}

#[test]
fn a_suite_without_a_runnable_scene_does_not_pass() {
    let run = farfield(&["suite", "mirror", "--pixels", "--check"]);
    assert_eq!(run.code, 2, "{}", run.stdout);
    assert!(run.stderr.contains("own mirror"), "{}", run.stderr);
}

#[test]
fn an_unknown_suite_is_wrong_usage() {
    let run = farfield(&["suite", "papr"]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("papr"), "{}", run.stderr);
}
