//! Disagreements that only people reveal: scale, floor height, lenses declared as fisheye.

use std::fmt::Write as _;
use std::fs;

use serde_json::{Value, json};

use super::{MistakenSample, warnings};
use crate::farfield::{command, finish};

/// The text of a calibration in a world scaled by `factor`.
fn scaled(text: &str, factor: f64) -> String {
    let lines = text.lines().map(|line| {
        let Some(numbers) = line.strip_prefix("translation = ") else {
            return format!("{line}\n");
        };
        let numbers: Vec<f64> = serde_json::from_str(numbers).unwrap();
        let numbers: Vec<f64> = numbers.iter().map(|m| m * factor).collect();
        format!("translation = {numbers:?}\n")
    });
    lines.collect()
}

#[test]
fn statures_reveal_a_scale_off_by_a_fifth() {
    for factor in [0.8, 1.2] {
        let sample = MistakenSample::new().replace("calibration.toml", |text| scaled(text, factor));
        let disagreements = sample.disagreements();
        assert_eq!(disagreements.len(), 1, "{factor}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "world_scale", "{factor}");
        assert_eq!(disagreements[0]["people"], 2, "{factor}");
        let remedy = disagreements[0]["remedy"].as_str().unwrap();
        let unless = if factor < 1.0 {
            "unless all of them are children"
        } else {
            "unless all of them are"
        };
        assert!(remedy.starts_with(unless), "{factor}: {remedy}");
    }
    // The venue states the expected statures: no warning.
    let expected = MistakenSample::new()
        .replace("calibration.toml", |text| scaled(text, 0.8))
        .replace("venue.toml", |text| {
            text.to_owned() + "\n[[subject]]\nname = \"Ida\"\nstature_m = 1.35\n"
        });
    assert_eq!(expected.disagreements(), [] as [Value; 0]);
}

#[test]
fn ankles_reveal_a_floor_off_by_13_centimetres() {
    for floor_m in [0.13, 0.2, -0.16, -0.2] {
        let sample = MistakenSample::new().replace("venue.toml", |text| {
            text.replace("2.4]", &format!("2.4]\nfloor_m = {floor_m}"))
        });
        let disagreements = sample.disagreements();
        assert_eq!(disagreements.len(), 1, "{floor_m}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "floor_height", "{floor_m}");
        let above_m = disagreements[0]["above_m"].as_f64().unwrap();
        assert!((above_m + floor_m).abs() < 0.06, "{floor_m}: {above_m}");
    }
}

#[test]
fn lenses_wrongly_declared_fisheye_are_reported() {
    let all = MistakenSample::new().replace("calibration.toml", |text| {
        text.replace("0.0, 0.0, 0.0]\nrotation", "0.0, 0.0]\nrotation")
            .replace("fisheye = false", "fisheye = true")
    });
    let disagreements = all.disagreements();
    assert_eq!(disagreements.len(), 1, "{disagreements:?}");
    assert_eq!(disagreements[0]["cause"], "lens_kind");
    assert_eq!(disagreements[0]["fisheye"], false);
    assert_eq!(disagreements[0]["cameras"].as_array().unwrap().len(), 4);
    let one = MistakenSample::new().replace("calibration.toml", |text| {
        let (first, others) = text.split_once("\n\n").unwrap();
        let first = first
            .replace("0.0, 0.0, 0.0]\nrotation", "0.0, 0.0]\nrotation")
            .replace("fisheye = false", "fisheye = true");
        format!("{first}\n\n{others}")
    });
    let disagreements = one.disagreements();
    assert_eq!(disagreements.len(), 1, "{disagreements:?}");
    assert_eq!(disagreements[0]["cause"], "lens_kind");
    assert_eq!(disagreements[0]["cameras"], json!(["north-east"]));
}

/// A `[[person]]` table: the first person of the sample at its first tick, moved 30 m away.
fn given_far_away(sample: &MistakenSample) -> String {
    let truth = fs::read_to_string(sample.path("truth.jsonl")).unwrap();
    let first: Value = serde_json::from_str(truth.lines().next().unwrap()).unwrap();
    let tick = first["tick"].as_i64().unwrap();
    let mut text = format!("\n[[person]]\ntick = {tick}\n[person.keypoints_m]\n");
    for (name, at) in first["keypoints"].as_object().unwrap() {
        let at: Vec<f64> = (0..3).map(|axis| at[axis].as_f64().unwrap()).collect();
        let at = [at[0] + 30.0, at[1], at[2]];
        writeln!(text, "{name} = {at:?}").unwrap();
    }
    text
}

#[test]
fn a_person_given_outside_the_field_is_refused() {
    let sample = MistakenSample::new();
    let given = given_far_away(&sample);
    let sample = sample.replace("venue.toml", |text| text.to_owned() + &given);
    sample.write();
    let mut run = command();
    run.arg("run").arg(sample.path("venue.toml"));
    let finished = finish(&run.arg("--out").arg(sample.path("out")).output().unwrap());
    assert_eq!(finished.code, 2, "{}", finished.stderr);
    for words in [
        "person[0].keypoints_m",
        "found a body around (30.",
        "inside the field",
    ] {
        assert!(finished.stderr.contains(words), "{}", finished.stderr);
    }
}

#[test]
fn parameters_far_from_their_defaults_warn_before_a_run() {
    let sample = MistakenSample::new();
    let finished = sample.run(&["--set", "ik.change_sigma_rad=100", "--ticks", "0..10"]);
    let line = "doubtful: a parameter is set far from the default: [tuning] ik.change_sigma_rad is 100.0 rad, the default 0.25;";
    assert!(finished.stderr.contains(line), "{}", finished.stderr);
    let sample = sample.replace("venue.toml", |text| {
        text.to_owned() + "\n[tuning]\nlattice.min_support = 1.0\n"
    });
    let mut check = command();
    check.arg("check").arg(sample.path("venue.toml"));
    let checked = finish(
        &check
            .arg("--out")
            .arg(sample.path("pictures"))
            .output()
            .unwrap(),
    );
    assert_eq!(checked.code, 0, "{}", checked.stdout);
    let line = "[tuning] lattice.min_support is 1.0, the default 0.08";
    assert!(checked.stdout.contains(line), "{}", checked.stdout);
    assert_eq!(warnings(&finished.stdout), [""; 0], "{}", finished.stdout);
}
