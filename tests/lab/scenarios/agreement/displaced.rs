//! Cameras that were moved or turned slightly after their calibration, and a calibration whose z is not up.

use std::fmt::Write as _;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;

use super::{CAMERAS, MistakenSample};

/// The text of a calibration after `change(name, camera_from_world)` of each camera.
fn replaced(text: &str, change: impl Fn(&str, Isometry3<f64>) -> Isometry3<f64>) -> String {
    let numbers = |text: &str| -> Vector3<f64> {
        let numbers: Vec<f64> = serde_json::from_str(text).unwrap();
        Vector3::from_row_slice(&numbers)
    };
    let (mut camera, mut rotation) = (String::new(), Vector3::zeros());
    let mut all = String::new();
    for line in text.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|it| it.strip_suffix(']')) {
            name.clone_into(&mut camera);
        }
        if let Some(text) = line.strip_prefix("rotation = ") {
            rotation = numbers(text);
        } else if let Some(text) = line.strip_prefix("translation = ") {
            let before = Isometry3::from_parts(
                Translation3::from(numbers(text)),
                UnitQuaternion::from_scaled_axis(rotation),
            );
            let after = change(&camera, before);
            let rotation: [f64; 3] = after.rotation.scaled_axis().into();
            let translation: [f64; 3] = after.translation.vector.into();
            writeln!(
                all,
                "rotation = {rotation:?}\ntranslation = {translation:?}"
            )
            .unwrap();
        } else {
            writeln!(all, "{line}").unwrap();
        }
    }
    all
}

/// Disagreements of a run of the sample with a changed calibration.
fn disagreements(change: impl Fn(&str, Isometry3<f64>) -> Isometry3<f64>) -> Vec<Value> {
    let sample = MistakenSample::new().replace("calibration.toml", |text| replaced(text, &change));
    sample.run(&[]);
    let summary = std::fs::read_to_string(sample.path("out/summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&summary).unwrap();
    let disagreements = summary["agreement"]["disagreements"].as_array().unwrap();
    disagreements.clone()
}

/// The disagreement of a run in which one camera was displaced after its calibration: by `moved_m` (world) and
/// `turned_deg` (about its own axes).
fn disagreement_of(camera: &str, moved_m: [f64; 3], turned_deg: [f64; 3]) -> Value {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turned_deg.map(f64::to_radians)));
    let disagreements = disagreements(|name, camera_from_world| {
        if name == camera {
            turn * camera_from_world * Translation3::from(-Vector3::from(moved_m))
        } else {
            camera_from_world
        }
    });
    println!("{camera}, {moved_m:?} m, {turned_deg:?} degrees: {disagreements:?}");
    assert_eq!(disagreements.len(), 1, "{disagreements:?}");
    assert_eq!(disagreements[0]["cameras"], serde_json::json!([camera]));
    disagreements[0].clone()
}

#[test]
fn a_camera_moved_by_a_decimetre_is_reported_with_its_distance() {
    for (camera, moved_m) in CAMERAS.into_iter().zip([
        [0.1, 0.0, 0.0],
        [0.0, 0.1, 0.0],
        [0.0, 0.0, 0.08],
        [-0.07, 0.07, 0.0],
    ]) {
        let disagreement = disagreement_of(camera, moved_m, [0.0; 3]);
        assert_eq!(disagreement["cause"], "moved", "{camera}: {disagreement}");
        let (found_m, true_m) = (
            disagreement["distance_m"].as_f64().unwrap(),
            Vector3::from(moved_m).norm(),
        );
        assert!((found_m - true_m).abs() < 0.04, "{camera}: {disagreement}");
        assert!(
            disagreement["found"]
                .as_str()
                .unwrap()
                .contains("been moved by 0.")
        );
    }
}

#[test]
fn the_remedy_for_small_displacements_is_calibration_in_place() {
    for (camera, moved_m, turned_deg) in [
        ("north-east", [0.05, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ("north-west", [0.04, -0.05, 0.03], [0.5, 1.0, 0.4]),
        ("south-west", [0.0, 0.0, 0.0], [0.0, 0.0, 3.0]),
        ("south-east", [0.0, 0.0, 0.0], [0.0, 1.5, 0.0]),
    ] {
        let disagreement = disagreement_of(camera, moved_m, turned_deg);
        let remedy = disagreement["remedy"].as_str().unwrap();
        assert_eq!(
            remedy, "calibrate its position and direction again",
            "{disagreement}"
        );
    }
}

#[test]
fn a_tilted_world_is_reported_to_a_degree() {
    for axis in [Vector3::x(), -Vector3::y()] {
        let tilt = UnitQuaternion::from_scaled_axis(5.0_f64.to_radians() * axis);
        let disagreements =
            disagreements(|_, camera_from_world| camera_from_world * tilt.inverse());
        assert_eq!(disagreements.len(), 1, "{disagreements:?}");
        assert_eq!(
            disagreements[0]["cause"], "world_tilted",
            "{disagreements:?}"
        );
        let degrees = disagreements[0]["degrees"].as_f64().unwrap();
        assert!((degrees - 5.0).abs() < 1.0, "{degrees}");
    }
}
