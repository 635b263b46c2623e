//! A real man on a treadmill: four real cameras, a real network, no truth. The reference is plain weighted triangulation
//! (DLT) of the peaks of the same maps.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use farfield_lab::in_process::InProcess;
use farfield_lab::leave_one_out::{ViewsRun, median};
use farfield_proto::patch::CompressionLevel;
use serde_json::Value;

use crate::data::{cases, onnx_runtime, recording};
use crate::farfield::{poses, run};
use crate::outputs::check_poses_against_model;

const SCENARIO: &str = "the treadmill";

/// The id of the man on the treadmill, the only person in all four viewpoints. A bystander is visible in cam01 and
/// cam02 and is tracked too.
fn man(lines: &[Value]) -> u64 {
    let mut seen_by_all: Vec<u64> = lines
        .iter()
        .filter(|p| p["views"] == 4)
        .map(|p| p["person"].as_u64().unwrap())
        .collect();
    seen_by_all.sort_unstable();
    seen_by_all.dedup();
    assert_eq!(seen_by_all.len(), 1, "one man, one id: {seen_by_all:?}");
    seen_by_all[0]
}

fn ticks_of(lines: &[Value], person: u64) -> Vec<i64> {
    lines
        .iter()
        .filter(|p| p["person"] == person)
        .map(|p| p["tick"].as_i64().unwrap())
        .collect()
}

#[test]
fn the_man_has_one_id_at_every_tick_and_his_skeleton_sits_on_him() {
    let Some(venue) = recording(SCENARIO, "data/pose2sim/single/venue.toml") else {
        return;
    };
    if !onnx_runtime(SCENARIO) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let finished = run(&venue, &out, &["--overlay"]);
    let lines = poses(&out);
    let man = man(&lines);
    let ticks = ticks_of(&lines, man);
    assert!(ticks[0] <= 2, "first pose at tick {}", ticks[0]);
    assert_eq!(
        ticks,
        (ticks[0]..100).collect::<Vec<_>>(),
        "a pose at every tick to the end"
    );
    check_poses_against_model(&lines);
    let flagged = lines
        .iter()
        .filter(|p| {
            p["unobserved"]
                .as_array()
                .unwrap()
                .iter()
                .any(|n| n == "ankle_angle_l")
        })
        .count();
    assert_eq!(
        flagged,
        lines.len(),
        "17 keypoints do not determine the ankles"
    );
    for camera in ["cam01", "cam02", "cam03", "cam04"] {
        assert!(out.join(format!("overlay_{camera}_50.png")).exists());
    }
    let summary = std::fs::read_to_string(out.join("summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&summary).unwrap();
    let disagreements = summary["agreement"]["disagreements"].as_array();
    assert_eq!(disagreements, Some(&Vec::new()), "the cameras are right");
    println!(
        "treadmill: id {man} at ticks {}..100\n{}",
        ticks[0],
        finished.stdout.trim()
    );
}

/// Writes the venue of the recording to `folder`, without the viewpoints `left_out` and with the tables of `added`.
fn changed_venue(venue: &Path, folder: &Path, left_out: &[&str], added: &str) -> PathBuf {
    let root = venue.parent().unwrap().canonicalize().unwrap();
    let absolute = |path: &toml::Value| {
        let path = root.join(path.as_str().unwrap()).canonicalize().unwrap();
        toml::Value::from(path.to_str().unwrap())
    };
    let mut table: toml::Table = std::fs::read_to_string(venue).unwrap().parse().unwrap();
    for field in ["calibration", "network", "detector"] {
        table[field] = absolute(&table[field]);
    }
    let viewpoints = table["viewpoint"].as_array_mut().unwrap();
    viewpoints.retain(|viewpoint| !left_out.contains(&viewpoint["name"].as_str().unwrap()));
    for viewpoint in viewpoints {
        let source = &mut viewpoint["camera"][0]["source"];
        source["path"] = absolute(&source["path"]);
    }
    table.extend(added.parse::<toml::Table>().unwrap());
    let path = folder.join("venue.toml");
    std::fs::write(&path, table.to_string()).unwrap();
    path
}

/// Checks that `lines` contain one person only, from within half a second to the end.
fn check_only_the_man(lines: &[Value]) {
    let mut ids: Vec<u64> = lines
        .iter()
        .map(|p| p["person"].as_u64().unwrap())
        .collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(
        ids.len(),
        1,
        "another person is confirmed, or the man twice: {ids:?}"
    );
    let ticks = ticks_of(lines, ids[0]);
    assert!(
        ticks[0] < 30,
        "confirmed half a second late or more: tick {}",
        ticks[0]
    );
    let to_the_end: Vec<i64> = (ticks[0]..100).collect();
    assert_eq!(ticks, to_the_end, "a pose at every tick to the end");
}

/// The bystander is visible in cam01 and cam02. Without cam02 she is visible in one camera only: a ray without a position.
#[test]
fn a_bystander_in_one_camera_is_not_confirmed() {
    let Some(venue) = recording(SCENARIO, "data/pose2sim/single/venue.toml") else {
        return;
    };
    if !onnx_runtime(SCENARIO) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let venue = changed_venue(&venue, dir.path(), &["cam02"], "");
    let out = dir.path().join("out");
    run(&venue, &out, &[]);
    check_only_the_man(&poses(&out));
}

/// With all four cameras the bystander has a position, behind cam03. A field around the treadmill excludes her.
#[test]
fn a_bystander_outside_the_field_is_not_confirmed() {
    let Some(venue) = recording(SCENARIO, "data/pose2sim/single/venue.toml") else {
        return;
    };
    if !onnx_runtime(SCENARIO) {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let field = "[field]\nmin_m = [-2.5, -1.8, -0.3]\nmax_m = [0.6, 1.5, 2.8]\n";
    let venue = changed_venue(&venue, dir.path(), &[], field);
    let out = dir.path().join("out");
    run(&venue, &out, &[]);
    check_only_the_man(&poses(&out));
}

/// The run with all four views, made once.
fn run_of_all_views(venue: &Path) -> &'static ViewsRun {
    static RUN: OnceLock<ViewsRun> = OnceLock::new();
    RUN.get_or_init(|| ViewsRun::make(InProcess::open(venue).unwrap(), None).unwrap())
}

/// Distances of our keypoints and of triangulated ones to the peaks of `view`, at the same ticks and keypoints, pixels.
fn distances_px(run: &ViewsRun, view: usize) -> (Vec<f64>, Vec<f64>) {
    let man = run.most_seen().unwrap();
    let residuals = run.residuals(view, |_, person| person == man);
    let both = residuals
        .iter()
        .filter_map(|r| Some((r.ours_px, r.triangulated_px?)));
    both.unzip()
}

#[test]
fn the_skeleton_predicts_a_withheld_view_better_than_triangulation_does() {
    let Some(venue) = recording(SCENARIO, "data/pose2sim/single/venue.toml") else {
        return;
    };
    if !onnx_runtime(SCENARIO) {
        return;
    }
    let (mut ours_all, mut dlt_all) = (Vec::new(), Vec::new());
    // The first two have the least and the largest distances of the four.
    for withheld in cases("a withheld view of the treadmill", [1, 2, 0, 3], 2) {
        let run = ViewsRun::without(&venue, withheld, None, CompressionLevel::LOSSLESS).unwrap();
        let (ours, dlt) = distances_px(&run, run.withheld_view());
        println!(
            "treadmill, view {withheld} withheld, {} keypoints: ours {:.2} px, DLT {:.2} px (medians)",
            ours.len(),
            median(&ours),
            median(&dlt)
        );
        ours_all.extend(ours);
        dlt_all.extend(dlt);
    }
    println!(
        "treadmill, these views: ours {:.2} px, DLT {:.2} px",
        median(&ours_all),
        median(&dlt_all)
    );
    let (mut ours_in, mut dlt_in) = (Vec::new(), Vec::new());
    for view in 0..4 {
        let (ours, dlt) = distances_px(run_of_all_views(&venue), view);
        ours_in.extend(ours);
        dlt_in.extend(dlt);
    }
    let ratio = median(&ours_in) / median(&dlt_in);
    println!(
        "treadmill, in sample: ours {:.2} px, DLT {:.2} px, ratio {ratio:.2}",
        median(&ours_in),
        median(&dlt_in)
    );
    assert!(
        median(&ours_all) <= median(&dlt_all),
        "a withheld view is predicted worse than by triangulation"
    );
    assert!(ratio <= 1.6, "the skeleton does not follow the views");
}

#[test]
fn wrists_and_ankles_move_with_less_than_half_the_jerk_of_triangulation() {
    let Some(venue) = recording(SCENARIO, "data/pose2sim/single/venue.toml") else {
        return;
    };
    if !onnx_runtime(SCENARIO) {
        return;
    }
    let recording = run_of_all_views(&venue);
    let man = recording.most_seen().unwrap();
    let names = ["left_wrist", "right_wrist", "left_ankle", "right_ankle"];
    let (ours, dlt) = recording.jerk_m_s3(man, &names);
    println!(
        "treadmill, mean jerk of wrists and ankles: ours {ours:.0} m/s3, DLT {dlt:.0} m/s3, ratio {:.2}",
        ours / dlt
    );
    assert!(ours < 0.5 * dlt);
}
