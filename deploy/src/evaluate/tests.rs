//! Tests of scores, refusals and warnings.

use super::*;

const LINE: &str = "{\"tick\": 5, \"person\": 1, \"joints\": {\"left_hip\": [0, 0, 1]}}\n";

#[derive(clap::Parser)]
struct EvaluateLine {
    #[command(flatten)]
    args: EvaluateArgs,
}

fn parsed(words: &[&str]) -> Result<EvaluateArgs, clap::Error> {
    let words = [&["evaluate"], words].concat();
    <EvaluateLine as clap::Parser>::try_parse_from(words).map(|line| line.args)
}

fn folder_with(truth: &str) -> (tempfile::TempDir, EvaluateArgs) {
    let folder = tempfile::tempdir().unwrap();
    let (poses, true_path) = (
        folder.path().join("poses.jsonl"),
        folder.path().join("truth.jsonl"),
    );
    fs::write(&poses, LINE).unwrap();
    fs::write(&true_path, truth).unwrap();
    let args = parsed(&[poses.to_str().unwrap(), true_path.to_str().unwrap()]).unwrap();
    (folder, args)
}

#[test]
fn poses_and_a_truth_are_needed() {
    assert!(parsed(&[]).is_err());
    assert!(parsed(&["poses.jsonl"]).is_err());
    let args = parsed(&["poses.jsonl", "truth.jsonl", "--json"]).unwrap();
    assert_eq!(args.truth, Path::new("truth.jsonl"));
    assert!(args.json);
    assert_eq!(args.extent, TruthExtent::Whole);
    let partial = parsed(&["poses.jsonl", "truth.jsonl", "--truth", "partial"]).unwrap();
    assert_eq!(partial.extent, TruthExtent::Partial);
    let refused = parsed(&["p", "t", "--truth", "half"]).unwrap_err();
    assert_eq!(refused.kind(), clap::error::ErrorKind::ValueValidation);
}

#[test]
fn other_poses_are_compared_row_by_row() {
    let (folder, mut args) = folder_with(LINE);
    let other = folder.path().join("other.jsonl");
    fs::write(&other, LINE.replace("[0, 0, 1]", "[0, 0, 1.1]")).unwrap();
    args.beside = Some(other);
    let (evaluation, plot) = scores_of(&args).unwrap();
    let table = evaluation.table();
    assert!(
        table.contains("POSES") && table.contains("100.0"),
        "{table}"
    );
    let json = serde_json::to_value(&evaluation).unwrap();
    assert_eq!(json["actors"]["1"]["frames"], 1);
    assert_eq!(json["beside"]["actors"]["1"]["frames"], 1);
    assert!(plot.starts_with("<svg"));
}

fn refused(args: &EvaluateArgs) -> String {
    format!("{:#}", scores_of(args).err().unwrap())
}

#[test]
fn a_truth_without_anything_to_compare_is_refused() {
    let (_folder, mut args) = folder_with("");
    assert!(refused(&args).ends_with("truth.jsonl: no line, expected one per tick and person"));
    fs::write(&args.truth, LINE.replace("left_hip", "spine")).unwrap();
    assert!(refused(&args).contains("none of the compared points"));
    fs::write(&args.truth, LINE).unwrap();
    args.ticks = Some(Tick(0)..Tick(5));
    assert!(refused(&args).ends_with("no person in ticks 0..5"));
}

#[test]
fn unknown_names_are_reported_with_scores_and_refusals() {
    let both = LINE.replace("}}", ", \"hip_l\": [0, 0, 1]}}");
    let (_folder, args) = folder_with(&both);
    let (evaluation, _) = scores_of(&args).unwrap();
    let json = serde_json::to_value(&evaluation).unwrap();
    assert_eq!(json["unknown_in_truth"][0], "joints.hip_l");
    let truth = read(&args.truth, LinesRole::Truth, &args).unwrap();
    let warning = unknown_names(&truth, &args.truth).unwrap();
    assert!(warning.contains("`joints.hip_l`"), "{warning}");
    let alone = LINE.replace("left_hip", "hip_l");
    fs::write(&args.truth, &alone).unwrap();
    assert!(refused(&args).contains("`joints.hip_l`"));
    fs::write(&args.truth, LINE).unwrap();
    fs::write(&args.poses, alone).unwrap();
    assert!(refused(&args).contains("`joints.hip_l`"));
}

#[test]
fn a_recording_is_refused_with_a_remedy() {
    let (folder, mut args) = folder_with(LINE);
    args.poses = folder.path().join("hall.mcap");
    // The magic bytes, a header of 16 bytes, its profile, and bytes that are not text.
    let head = [
        &b"\x89MCAP0\r\n\x01"[..],
        &16u64.to_le_bytes(),
        &8u32.to_le_bytes(),
        b"farfield\xff\xff\xff\xff",
    ]
    .concat();
    fs::write(&args.poses, head).unwrap();
    let error = refused(&args);
    assert!(error.contains("hall.mcap: "), "{error}");
    assert!(error.contains("`farfield replay "), "{error}");
    args.truth.clone_from(&args.poses);
    assert!(refused(&args).contains("truth.jsonl"));
}

/// A person who moves to and fro: 60 ticks of some joints; one metre has `scale` units.
fn swaying(late: i64, scale: f64) -> String {
    let line = |tick: i64| {
        let t = (tick - late) as f64;
        let (x_m, y_m) = (
            0.6 * scale * (0.1 * t).sin(),
            0.4 * scale * (0.17 * t).cos(),
        );
        let joints = ["hip", "knee", "shoulder"].iter().enumerate();
        let joints = joints.flat_map(|(i, joint)| {
            let z_m = scale * (0.5 + 0.4 * i as f64);
            [("left", 0.1), ("right", -0.1)].map(|(side, aside)| {
                let x_m = x_m + aside * scale;
                format!("\"{side}_{joint}\": [{x_m}, {y_m}, {z_m}]")
            })
        });
        let joints = joints.collect::<Vec<String>>().join(", ");
        format!("{{\"tick\": {tick}, \"person\": 1, \"joints\": {{{joints}}}}}\n")
    };
    (0..60).map(line).collect()
}

#[test]
fn a_truth_with_an_offset_or_other_unit_is_reported() {
    let (_folder, args) = folder_with(&swaying(5, 1.0));
    fs::write(&args.poses, swaying(0, 1.0)).unwrap();
    let (evaluation, _) = scores_of(&args).unwrap();
    let json = serde_json::to_value(&evaluation).unwrap();
    assert_eq!(json["doubts"][0]["cause"], "other_ticks");
    let found = json["doubts"][0]["found"].as_str().unwrap();
    assert!(found.contains("5 ticks later"), "{found}");
    fs::write(&args.truth, swaying(0, 1000.0)).unwrap();
    let error = refused(&args);
    assert!(error.contains("millimetres"), "{error}");
    fs::write(&args.truth, swaying(0, 1.0)).unwrap();
    let (evaluation, _) = scores_of(&args).unwrap();
    let json = serde_json::to_value(&evaluation).unwrap();
    assert!(json.get("doubts").is_none(), "{json}");
}

#[test]
fn poses_of_another_run_are_refused() {
    let (_folder, args) = folder_with(&LINE.replace("\"tick\": 5", "\"tick\": 50"));
    let error = refused(&args);
    assert!(error.contains("ticks 5 to 5"), "{error}");
    assert!(error.contains("truth.jsonl: no tick in common"), "{error}");
}

#[test]
fn swapped_or_equal_inputs_are_reported() {
    let (_folder, mut args) = folder_with(LINE);
    assert_eq!(input_warning(&args), None);
    let of_run = LINE.replace(
        "\"person\": 1",
        "\"person\": 1, \"state\": \"tracked\", \"views\": 4",
    );
    fs::write(&args.truth, of_run).unwrap();
    assert!(
        input_warning(&args)
            .unwrap()
            .contains("expected POSES, then TRUTH")
    );
    args.truth.clone_from(&args.poses);
    assert!(input_warning(&args).unwrap().contains("against itself"));
}

#[test]
fn a_missing_file_is_named() {
    let (folder, args) = folder_with(LINE);
    fs::remove_file(&args.poses).unwrap();
    assert!(refused(&args).contains(&folder.path().join("poses.jsonl").display().to_string()));
}

#[test]
fn the_rate_comes_from_the_caller_then_the_summary_then_the_venue() {
    let (folder, mut args) = folder_with(LINE);
    assert_eq!(rate_hz(&args), None);
    fs::write(folder.path().join("venue.toml"), "rate_hz = 25").unwrap();
    assert_eq!(rate_hz(&args), Some(25.0));
    fs::write(folder.path().join("summary.json"), "{\"rate_hz\": 60.0}").unwrap();
    assert_eq!(rate_hz(&args), Some(60.0));
    args.rate_hz = Some(50.0);
    assert_eq!(rate_hz(&args), Some(50.0));
    args.rate_hz = Some(0.0);
    assert!(evaluate(&args).is_err());
}
