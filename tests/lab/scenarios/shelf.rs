//! The Shelf: five cameras, up to four people, real keypoint candidates (`OpenPose`, not HRNet), hand-made truth.

use std::path::Path;

use serde_json::Value;

use crate::data::recording;
use crate::farfield::{farfield, run};
use crate::nets::check_poses;

/// Mean-end PCP of actor 1 by triangulation of the candidates within 30 pixels of our keypoints, percent. The head is bent
/// in some frames, and head points follow the nose.
const TRIANGULATED_A1: f64 = 99.1;
/// Best result of other methods with these candidates on the 8 limbs, actors 1-3: 4D Association.
const BEST_PEER_BOTH_ENDS: f64 = 96.2;
/// Least mean error of other methods: Pose2Sim.
const BEST_PEER_MPJPE_MM: f64 = 51.0;

#[test]
fn the_shelf_runs_and_is_scored() {
    let Some(venue) = recording("the Shelf", "data/shelf/venue.toml") else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    run(&venue, &out, &[]);
    check_poses("shelf", &out);
    let truth = venue.with_file_name("truth.jsonl");
    let poses = out.join("poses.jsonl");
    for points in ["shelf14", "keypoints"] {
        let scored = farfield(&[
            "evaluate".as_ref(),
            poses.as_os_str(),
            truth.as_os_str(),
            "--truth".as_ref(),
            "partial".as_ref(),
            "--points".as_ref(),
            points.as_ref(),
        ]);
        assert_eq!(scored.code, 0, "{}", scored.stderr);
        println!(
            "Shelf, OpenPose candidates, --points {points}\n{}",
            scored.stdout
        );
    }
    let shelf14 = score(&poses, &truth, "shelf14");
    let mean_end = |actor: &str| number(&shelf14, &["actors", actor, "pcp_mean_end"]);
    assert!(mean_end("1") >= TRIANGULATED_A1, "{}", mean_end("1"));
    assert!(mean_end("2") >= 93.0, "{}", mean_end("2"));
    assert!(mean_end("3") >= 97.3, "{}", mean_end("3"));
    let mean = ["1", "2", "3"].map(mean_end).iter().sum::<f64>() / 3.0;
    assert!(mean >= 96.9, "{mean}");
    assert!(number(&shelf14, &["mean", "pcp_both_ends"]) >= 94.5);
    let keypoints = score(&poses, &truth, "keypoints");
    let mean_of_three = |figure: &str| {
        let of = |actor| number(&keypoints, &["actors", actor, figure]);
        ["1", "2", "3"].map(of).iter().sum::<f64>() / 3.0
    };
    let both_ends = mean_of_three("pcp_both_ends");
    assert!(both_ends >= BEST_PEER_BOTH_ENDS, "{both_ends}");
    let mpjpe_mm = mean_of_three("mpjpe_mm");
    assert!(mpjpe_mm <= BEST_PEER_MPJPE_MM, "{mpjpe_mm}");
    for actor in ["1", "2", "3", "4"] {
        assert!(number(&keypoints, &["actors", actor, "gaps"]) < 0.5);
    }
    assert!(number(&keypoints, &["identity", "switches"]) < 0.5);
}

/// Scores of the poses by `farfield evaluate --json`.
fn score(poses: &Path, truth: &Path, points: &str) -> Value {
    let finished = farfield(&[
        "evaluate".as_ref(),
        poses.as_os_str(),
        truth.as_os_str(),
        "--truth".as_ref(),
        "partial".as_ref(),
        "--points".as_ref(),
        points.as_ref(),
        "--json".as_ref(),
    ]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    serde_json::from_str(&finished.stdout).unwrap()
}

fn number(score: &Value, path: &[&str]) -> f64 {
    let entry = path.iter().fold(score, |value, key| &value[*key]);
    entry
        .as_f64()
        .unwrap_or_else(|| panic!("{path:?}: {entry}"))
}
