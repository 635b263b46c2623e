//! Scores computed by hand.

use std::fmt::Write as _;
use std::path::Path;

use super::lines::LinesRole;
use super::points::LIMB_POINTS;
use super::*;

/// A person as a line: 12 points on a grid of 0.4 m steps around `x_m`, each moved by `error_m` along y.
fn line(tick: i64, person: u32, x_m: f64, error_m: impl Fn(usize) -> f64) -> String {
    let mut joints = String::new();
    for (i, name) in LIMB_POINTS.iter().enumerate() {
        let (side, height) = ((i % 2) as f64 * 0.3, (i / 2) as f64 * 0.4);
        let comma = if i == 0 { "" } else { ", " };
        write!(
            joints,
            "{comma}\"{name}\": [{}, {}, {height}]",
            x_m + side,
            error_m(i)
        )
        .unwrap();
    }
    format!("{{\"tick\": {tick}, \"person\": {person}, \"joints\": {{{joints}}}}}\n")
}

fn exact(tick: i64, person: u32, x_m: f64) -> String {
    line(tick, person, x_m, |_| 0.0)
}

fn recording(text: &str, role: LinesRole) -> PoseLines {
    PoseLines::read(
        text.as_bytes(),
        Path::new("x.jsonl"),
        role,
        PointSet::Joints,
        None,
    )
    .unwrap()
}

fn scored(poses: &str, truth: &str) -> Scores {
    scored_against(TruthExtent::Whole, poses, truth)
}

fn scored_against(extent: TruthExtent, poses: &str, truth: &str) -> Scores {
    score(
        &recording(poses, LinesRole::Poses),
        &recording(truth, LinesRole::Truth),
        extent,
        Some(60.0),
    )
}

fn check(actual: f64, expected: f64) {
    assert!(
        (actual - expected).abs() < 1e-9,
        "{actual} is not {expected}"
    );
}

#[test]
fn perfect_poses_score_full_marks() {
    let truth: String = (0..4)
        .map(|t| exact(t, 1, 0.0) + &exact(t, 2, 3.0))
        .collect();
    let scores = scored(&truth, &truth);
    assert_eq!(scores.actors.len(), 2);
    let one = &scores.actors[&1];
    assert_eq!((one.frames, one.gaps, one.missing_points), (4, 0, 0));
    for percent in [
        one.success_150,
        one.pcp_both_ends,
        one.pcp_mean_end,
        one.pcp_midpoint,
        one.pck_50,
    ] {
        check(percent.unwrap(), 100.0);
    }
    check(one.mpjpe_mm.unwrap(), 0.0);
    check(one.jitter_m_s3.unwrap(), 0.0);
    let id = &scores.identity;
    assert_eq!((id.switches, id.fragmentations, id.false_births), (0, 0, 0));
    check(id.idf1, 100.0);
    check(id.mota, 100.0);
}

#[test]
fn errors_and_limbs_match_the_hand_calculation() {
    // Every limb is 0.4 m long (hip to knee and so on are one row apart): its half is 0.2 m.
    // Left elbow (2) off by 0.3, left wrist (4) off by 0.06, the other ten exact.
    let poses = line(7, 9, 0.0, |i| {
        [(2, 0.3), (4, 0.06)]
            .iter()
            .find(|e| e.0 == i)
            .map_or(0.0, |e| e.1)
    });
    let scores = scored(&poses, &exact(7, 1, 0.0));
    let one = &scores.actors[&1];
    check(one.mpjpe_mm.unwrap(), 1000.0 * 0.36 / 12.0);
    check(one.success_150.unwrap(), 100.0);
    check(one.pck_50.unwrap(), 100.0 * 10.0 / 12.0);
    check(one.pck_100.unwrap(), 100.0 * 11.0 / 12.0);
    // Upper arm: ends 0 and 0.3; lower arm: 0.3 and 0.06. Both ends fail in both; the means are 0.15
    // and 0.18, the midpoints off by 0.15 and 0.18: within 0.2.
    check(one.pcp_both_ends.unwrap(), 100.0 * 6.0 / 8.0);
    check(one.pcp_mean_end.unwrap(), 100.0);
    check(one.pcp_midpoint.unwrap(), 100.0);
}

#[test]
fn a_gap_counts_as_wrong_except_in_the_mpjpe() {
    let truth = exact(0, 1, 0.0) + &exact(1, 1, 0.0);
    let poses = line(0, 1, 0.0, |_| 0.04);
    let one = &scored(&poses, &truth).actors[&1];
    assert_eq!(one.gaps, 1);
    check(one.mpjpe_mm.unwrap(), 40.0);
    for percent in [
        one.success_150,
        one.pcp_both_ends,
        one.pcp_mean_end,
        one.pcp_midpoint,
        one.pck_100,
    ] {
        check(percent.unwrap(), 50.0);
    }
}

#[test]
fn an_outlier_counts_with_its_whole_error() {
    let truth: String = (0..4).map(|t| exact(t, 1, 0.0)).collect();
    let off_m = [0.04, 0.6, 0.6, 0.04];
    let poses = (0i64..)
        .zip(off_m)
        .map(|(t, off_m)| line(t, 7, 0.0, |_| off_m));
    let poses: String = poses.collect();
    let scores = scored(&poses, &truth);
    let one = &scores.actors[&1];
    assert_eq!((one.gaps, one.outliers), (2, 2));
    check(one.mpjpe_mm.unwrap(), 320.0);
    // The only third difference over four consecutive poses: 0.04 - 3 x 0.6 + 3 x 0.6 - 0.04 = 0.
    check(one.jitter_m_s3.unwrap(), 0.0);
    check(one.pck_50.unwrap(), 50.0);
    // For identity it is a gap and a false pose.
    check(scores.identity.mota, 0.0);
    let errors = &errors_over_time(
        &recording(&poses, LinesRole::Poses),
        &recording(&truth, LinesRole::Truth),
    )[&1];
    check(errors[1].1.unwrap(), 0.6);
}

#[test]
fn a_far_pose_of_another_person_or_of_none_is_no_outlier() {
    // Id 7 is matched to person 1, then to person 2, who arrives. Id 8 was never near a person.
    let truth = exact(0, 1, 0.0) + &exact(1, 1, 0.0) + &exact(1, 2, 3.0);
    let poses = exact(0, 7, 0.0) + &exact(1, 7, 3.0) + &exact(1, 8, 6.0);
    let scores = scored(&poses, &truth);
    assert_eq!((scores.actors[&1].gaps, scores.actors[&1].outliers), (1, 0));
    assert_eq!(scores.identity.false_births, 1);
}

#[test]
fn the_sigma_of_an_outlier_counts() {
    let state =
        "\"state\": \"tracked\", \"views\": 4, \"sigma_m\": {\"left_hip\": 0.01}, \"joints\"";
    let sure = |line: String| line.replace("\"joints\"", state);
    let truth: String = (0..2).map(|t| exact(t, 1, 0.0)).collect();
    let poses = sure(exact(0, 7, 0.0)) + &sure(line(1, 7, 0.0, |_| 0.6));
    let tracked = |extent| {
        let scores = scored_against(extent, &poses, &truth);
        scores.calibration.unwrap().all_rows().states["tracked"]
    };
    let whole = tracked(TruthExtent::Whole);
    assert_eq!(whole.n, 2);
    check(whole.inside_1, 100.0 * 5.0 / 6.0);
    // The pose may be of a person that the truth leaves out.
    assert_eq!(tracked(TruthExtent::Partial).n, 1);
}

#[test]
fn an_outlier_belongs_to_the_last_person_with_its_id() {
    // Id 7 is matched to one person for a tick, then to the other, and is then far from both.
    for [first, last] in [[1, 2], [2, 1]] {
        let truth: String = (0..3)
            .map(|t| exact(t, first, 0.0) + &exact(t, last, 3.0))
            .collect();
        let poses = exact(0, 7, 0.0) + &exact(1, 7, 3.0) + &exact(2, 7, 4.0);
        let actors = scored(&poses, &truth).actors;
        assert_eq!((actors[&first].outliers, actors[&last].outliers), (0, 1));
    }
}

#[test]
fn a_point_that_the_pose_lacks_is_wrong() {
    let poses = exact(0, 1, 0.0).replace("\"left_wrist\"", "\"somewhere\"");
    let one = &scored(&poses, &exact(0, 1, 0.0)).actors[&1];
    assert_eq!(one.missing_points, 1);
    check(one.pck_50.unwrap(), 100.0 * 11.0 / 12.0);
    check(one.pcp_both_ends.unwrap(), 100.0 * 7.0 / 8.0);
    check(one.mpjpe_mm.unwrap(), 0.0);
}

#[test]
fn a_share_of_nothing_is_absent() {
    let hip = |person: u32| {
        format!("{{\"tick\": 0, \"person\": {person}, \"joints\": {{\"left_hip\": [0, 0, 1]}}}}\n")
    };
    // A hip alone is a point but no limb; person 2 has no compared point.
    let truth = hip(1) + &hip(2).replace("left_hip", "nose");
    let scores = scored(&hip(7), &truth);
    let (one, two) = (&scores.actors[&1], &scores.actors[&2]);
    assert_eq!((one.pcp_both_ends, one.pcp_mean_end), (None, None));
    assert_eq!(one.pcp_midpoint, None);
    check(one.pck_50.unwrap(), 100.0);
    check(one.success_150.unwrap(), 100.0);
    assert_eq!(
        (two.pck_50, two.pck_100, two.success_150),
        (None, None, None)
    );
    // Absent shares are left out of the mean.
    check(scores.mean.pck_50.unwrap(), 100.0);
    assert_eq!(scores.mean.pcp_midpoint, None);
    let json = serde_json::to_value(&scores).unwrap();
    assert!(json["mean"]["pcp_midpoint"].is_null(), "{json}");
    let table = scores.to_string();
    assert!(
        table.contains("100.0      -      -      -  100.0"),
        "{table}"
    );
}

#[test]
fn bytes_that_are_no_text_are_refused() {
    let bytes = [exact(0, 1, 0.0).as_bytes(), b"\x89MCAP0\r\n"].concat();
    let (path, role) = (Path::new("poses.mcap"), LinesRole::Poses);
    let read = PoseLines::read(&bytes[..], path, role, PointSet::Joints, None);
    assert_eq!(
        read.unwrap_err().to_string(),
        "poses.mcap:2: found bytes that are no UTF-8, expected a line of JSON"
    );
}

#[test]
fn unknown_names_are_reported_for_their_file() {
    let truth = exact(0, 1, 0.0).replace("left_knee", "LKnee");
    let scores = scored(&exact(0, 1, 0.0), &truth);
    let json = serde_json::to_value(&scores).unwrap();
    assert_eq!(
        json["unknown_in_truth"],
        serde_json::json!(["joints.LKnee"])
    );
    assert!(json.get("unknown_in_poses").is_none(), "{json}");
}

#[test]
fn extra_keypoints_of_a_truth_do_not_matter_for_joints() {
    let keypoints =
        "{\"tick\": 0, \"keypoints\": {\"left_thumb\": [1, 2, 3], \"left_hip\": [1, 2, 3]}, ";
    let truth = exact(0, 1, 0.0).replace("{\"tick\": 0, ", keypoints);
    assert!(truth.contains("left_thumb"), "{truth}");
    let unknown = |points| {
        let (path, role) = (Path::new("truth.jsonl"), LinesRole::Truth);
        let read = PoseLines::read(truth.as_bytes(), path, role, points, None);
        read.unwrap().unknown().clone()
    };
    assert!(unknown(PointSet::Joints).is_empty());
    assert_eq!(
        unknown(PointSet::Keypoints).to_string(),
        "`keypoints.left_thumb`"
    );
}

#[test]
fn the_number_of_pairs_within_the_gate_precedes_distance() {
    // True people at 0 and 0.4; poses at 0.4 and 0.8. The nearest pair (0.4, 0.4) would leave two gaps.
    let truth = exact(0, 1, 0.0) + &exact(0, 2, 0.4);
    let poses = exact(0, 1, 0.4) + &exact(0, 2, 0.8);
    let scores = scored(&poses, &truth);
    check(scores.mean.gaps, 0.0);
    check(scores.mean.mpjpe_mm.unwrap(), 400.0);
}

#[test]
fn an_id_change_is_a_switch_and_costs_idf1() {
    // Id 1 for three ticks, then id 2 for one: MOTA = 1 - 1/4, IDTP = 3 of 4 true bodies and 4 poses.
    let truth: String = (0..4).map(|t| exact(t, 1, 0.0)).collect();
    let poses: String = (0..4)
        .map(|t| exact(t, if t < 3 { 1 } else { 2 }, 0.0))
        .collect();
    let id = scored(&poses, &truth).identity;
    assert_eq!((id.switches, id.fragmentations, id.false_births), (1, 0, 0));
    check(id.mota, 75.0);
    check(id.idf1, 75.0);
}

#[test]
fn a_swap_of_two_ids_is_two_switches() {
    let truth: String = (0..4)
        .map(|t| exact(t, 1, 0.0) + &exact(t, 2, 3.0))
        .collect();
    let poses: String = (0..4)
        .map(|t| {
            if t < 2 {
                exact(t, 1, 0.0) + &exact(t, 2, 3.0)
            } else {
                exact(t, 2, 0.0) + &exact(t, 1, 3.0)
            }
        })
        .collect();
    let id = scored(&poses, &truth).identity;
    assert_eq!(id.switches, 2);
    check(id.mota, 75.0);
    check(id.idf1, 50.0);
}

#[test]
fn clear_continues_a_pair_that_is_within_the_gate() {
    // The poses of two people 0.3 m apart cross for one tick: nearer to the other, still within the gate.
    let truth: String = (0..3)
        .map(|t| exact(t, 1, 0.0) + &exact(t, 2, 0.3))
        .collect();
    let crossed = exact(1, 1, 0.3) + &exact(1, 2, 0.0);
    let poses =
        exact(0, 1, 0.0) + &exact(0, 2, 0.3) + &crossed + &exact(2, 1, 0.0) + &exact(2, 2, 0.3);
    let scores = scored(&poses, &truth);
    assert_eq!(scores.identity.switches, 0);
    check(scores.identity.idf1, 100.0);
    // The accuracy matching has no memory: each pose goes to the nearest person.
    check(scores.mean.mpjpe_mm.unwrap(), 0.0);
}

#[test]
fn a_track_that_is_lost_and_found_is_a_fragmentation() {
    let truth: String = (0..5)
        .map(|t| exact(t, 1, 0.0) + &exact(t, 2, 3.0))
        .collect();
    let poses: String = (0..5)
        .map(|t| {
            if t == 2 {
                exact(t, 2, 3.0)
            } else {
                exact(t, 1, 0.0) + &exact(t, 2, 3.0)
            }
        })
        .collect();
    let scores = scored(&poses, &truth);
    let id = &scores.identity;
    assert_eq!((id.switches, id.fragmentations), (0, 1));
    check(id.mota, 90.0);
    check(id.idf1, 100.0 * 18.0 / 19.0);
    assert_eq!(scores.actors[&1].gaps, 1);
}

#[test]
fn an_id_that_is_mostly_unmatched_is_a_false_birth() {
    // Id 5 lives ten ticks far from any person; id 6 is matched in exactly half of its two ticks.
    let truth: String = (0..10).map(|t| exact(t, 1, 0.0)).collect();
    let mut poses: String = (0..10).map(|t| exact(t, 5, 9.0)).collect();
    poses += &(exact(3, 6, 0.0) + &exact(4, 6, 5.0));
    let id = scored(&poses, &truth).identity;
    assert_eq!(id.false_births, 1);
    check(id.mota, 100.0 * (1.0 - 11.0) / 10.0);
}

#[test]
fn extra_poses_count_with_a_whole_truth_only() {
    let poses: String = (0..6).map(|t| exact(t, 1, 0.0)).collect();
    let whole: String = (0..3).map(|t| exact(t, 1, 0.0)).collect();
    check(scored(&poses, &whole).identity.mota, 0.0);
    let partial: String = [0, 2, 4].map(|t| exact(t, 1, 0.0)).concat();
    let scores = scored_against(TruthExtent::Partial, &poses, &partial);
    check(scores.identity.mota, 100.0);
    assert_eq!(scores.actors[&1].frames, 3);
    // No two ticks of this truth are consecutive.
    assert_eq!(scores.actors[&1].jitter_m_s3, None);
    // Declared whole, the same truth has absent people, and reports the hole.
    let scores = scored(&poses, &partial);
    check(scores.identity.mota, 0.0);
    assert_eq!(scores.first_hole.unwrap().until, Tick(2));
}

#[test]
fn people_outside_a_partial_truth_do_not_count() {
    let both = |t| exact(t, 1, 0.0) + &exact(t, 2, 5.0);
    let poses: String = (0..4).map(both).collect();
    // Person 2 is always present; the truth has it at the first and the last tick.
    let partial = [both(0), exact(1, 1, 0.0), exact(2, 1, 0.0), both(3)].concat();
    let identity = scored_against(TruthExtent::Partial, &poses, &partial).identity;
    check(identity.mota, 100.0);
    check(identity.idf1, 100.0);
    // A second pose of a person in the truth is still wrong.
    let doubled = poses + &exact(3, 3, 0.1);
    let identity = scored_against(TruthExtent::Partial, &doubled, &partial).identity;
    check(identity.mota, 100.0 * 5.0 / 6.0);
    check(identity.idf1, 100.0 * 12.0 / 13.0);
}

#[test]
fn without_poses_all_is_gaps() {
    let scores = scored("", &exact(0, 1, 0.0));
    let one = &scores.actors[&1];
    assert_eq!((one.gaps, one.mpjpe_mm), (1, None));
    check(one.pcp_midpoint.unwrap(), 0.0);
    check(scores.identity.mota, 0.0);
    check(scores.identity.idf1, 0.0);
}

#[test]
fn the_mean_is_over_actors_and_on_shelf_over_the_first_three() {
    let truth = "{\"tick\": 0, \"person\": 3, \"joints\": {\"left_hip\": [0, 0, 1]}}\n\
                 {\"tick\": 0, \"person\": 4, \"joints\": {\"left_hip\": [5, 0, 1]}}\n";
    let poses = "{\"tick\": 0, \"person\": 1, \"keypoints\": {\"left_hip\": [0, 0, 1.02]}}\n\
                 {\"tick\": 0, \"person\": 2, \"keypoints\": {\"left_hip\": [5, 0, 1.04]}}\n";
    let mean_mm = |points| {
        let read = |text: &str, role| {
            PoseLines::read(text.as_bytes(), Path::new("x"), role, points, None).unwrap()
        };
        let scores = score(
            &read(poses, LinesRole::Poses),
            &read(truth, LinesRole::Truth),
            TruthExtent::Whole,
            None,
        );
        scores.mean.mpjpe_mm.unwrap()
    };
    check(mean_mm(PointSet::Keypoints), 30.0);
    check(mean_mm(PointSet::Shelf14), 20.0);
}

#[test]
fn the_json_has_the_documented_fields() {
    let value = serde_json::to_value(scored(&exact(0, 1, 0.0), &exact(0, 1, 0.0))).unwrap();
    for field in [
        "frames",
        "success_150",
        "mpjpe_mm",
        "pcp_both_ends",
        "pcp_mean_end",
        "pcp_midpoint",
        "pck_50",
        "pck_100",
        "gaps",
        "outliers",
        "jitter_m_s3",
        "foot_slide_mm_s",
    ] {
        assert!(value["actors"]["1"].get(field).is_some(), "{field}");
        assert!(value["mean"].get(field).is_some(), "{field}");
    }
    for field in ["switches", "fragmentations", "false_births", "idf1", "mota"] {
        assert!(value["identity"].get(field).is_some(), "{field}");
    }
    assert_eq!(value["points"], "joints");
    assert_eq!(value["truth"], "whole");
}

#[test]
fn the_table_reports_what_it_leaves_out() {
    let truth = exact(0, 1, 0.0) + &exact(2, 1, 0.0);
    let text = |extent| {
        let truth = recording(&truth, LinesRole::Truth);
        score(&recording("", LinesRole::Poses), &truth, extent, None).to_string()
    };
    let partial = text(TruthExtent::Partial);
    assert!(partial.contains("false births not counted"), "{partial}");
    assert!(partial.contains("jitter and foot slide"), "{partial}");
    let whole = text(TruthExtent::Whole);
    assert!(whole.contains("person 1 at ticks 0 and 2"), "{whole}");
}
