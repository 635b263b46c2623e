//! Five cameras, up to four people, real keypoint candidates (`OpenPose`, not HRNet), hand-made truth.

use crate::data::recording;
use crate::farfield::{farfield, run};

#[test]
fn the_shelf_runs_and_is_scored() {
    let Some(venue) = recording("the Shelf", "data/shelf/venue.toml") else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    run(&venue, &out, &[]);
    let truth = venue.with_file_name("truth.jsonl");
    let poses = out.join("poses.jsonl");
    for points in ["shelf14", "keypoints"] {
        let scored = farfield(&[
            "evaluate".as_ref(),
            poses.as_os_str(),
            truth.as_os_str(),
            "--points".as_ref(),
            points.as_ref(),
        ]);
        assert_eq!(scored.code, 0, "{}", scored.stderr);
        println!(
            "Shelf, OpenPose candidates, --points {points}\n{}",
            scored.stdout
        );
    }
    let json = farfield(&[
        "evaluate".as_ref(),
        poses.as_os_str(),
        truth.as_os_str(),
        "--points".as_ref(),
        "shelf14".as_ref(),
        "--json".as_ref(),
    ]);
    let score: serde_json::Value = serde_json::from_str(&json.stdout).unwrap();
    for actor in ["1", "2", "3"] {
        for pcp in ["pcp_both_ends", "pcp_mean_end", "pcp_midpoint"] {
            let value = score["actors"][actor][pcp].as_f64().unwrap();
            assert!(
                value > 50.0,
                "actor {actor} {pcp}: {value}: the loop has lost the person"
            );
        }
    }
}
