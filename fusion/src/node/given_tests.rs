//! Whom a run refuses to be given.

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Transform;
use nalgebra::Isometry3;

use super::*;

const CARD: &str = r#"kind = "heatmap"
file = "net.onnx"
input = { name = "image", layout = "nchw", width = 192, height = 256, channels = "rgb" }
normalize = { scale = 0.004, mean = [0.485, 0.456, 0.406], std = [0.229, 0.224, 0.225] }
output = { name = "heatmaps", width = 48, height = 64, keypoints = [KEYPOINTS] }
cell_to_input = { scale = 4.0, offset = 0.0 }
box_margin = 1.25
"#;

const SHOULDERS: &str = "left_shoulder = [0.1, 0.2, 1.4], right_shoulder = [-0.2, 0.2, 1.4]";
const HIPS: &str = "left_hip = [0.05, 0.2, 0.95], right_hip = [-0.15, 0.2, 0.95]";

fn path() -> &'static Path {
    Path::new("hall.toml")
}

/// A venue whose second given person has `keypoints_m` at tick 30; the first is whole, at tick 20.
fn venue(keypoints_m: &str) -> Venue {
    let text = format!(
        r#"name = "hall"
rate_hz = 20
calibration = "calibration.toml"
network = "net.toml"
[[viewpoint]]
name = "south"
[[viewpoint.camera]]
name = "south"
source = {{ kind = "keypoints", path = "south.jsonl" }}
[[person]]
tick = 20
keypoints_m = {{ {SHOULDERS}, {HIPS}, nose = [-0.05, 0.3, 1.65] }}
[[person]]
tick = 30
keypoints_m = {{ {keypoints_m} }}
"#
    );
    let intrinsics = Intrinsics {
        fx_px: 900.0,
        fy_px: 900.0,
        cx_px: 640.0,
        cy_px: 360.0,
    };
    let place = Transform::new(Isometry3::identity());
    let camera = CameraModel::new(
        "south",
        [1280, 720],
        intrinsics,
        Distortion::default(),
        place,
    );
    let calibration = Calibration {
        cameras: [("south".to_owned(), camera.unwrap())].into(),
        hash: "0123456789abcdef".to_owned(),
        rotation_lengths_rad: std::collections::BTreeMap::new(),
    };
    Venue::parse(&text, path(), calibration).unwrap()
}

fn card(more: &[&str]) -> HeatmapCard {
    let names = COCO17.iter().chain(more).map(|name| format!("{name:?}"));
    let names: Vec<String> = names.collect();
    HeatmapCard::parse(
        &CARD.replace("KEYPOINTS", &names.join(", ")),
        Path::new("net.toml"),
    )
    .unwrap()
}

fn check(keypoints_m: &str, card: &HeatmapCard, expected: &str) {
    let refused = check_given_keypoints(&venue(keypoints_m), path(), Some(card)).unwrap_err();
    assert_eq!(refused.to_string(), format!("hall.toml: {expected}"));
}

#[test]
fn a_keypoint_that_the_network_does_not_know_is_answered_with_the_nearest() {
    let misspelt = format!("{SHOULDERS}, {HIPS}, nsoe = [0, 0, 1.6]");
    check(
        &misspelt,
        &card(&[]),
        "`person[1].keypoints_m.nsoe`: unknown keypoint of the network `nsoe`, did you mean `nose`?",
    );
    let with_heel = venue(&format!("{SHOULDERS}, {HIPS}, left_heel = [0, 0.2, 0.05]"));
    check_given_keypoints(&with_heel, path(), Some(&card(&["left_heel"]))).unwrap();
    assert!(check_given_keypoints(&with_heel, path(), Some(&card(&[]))).is_err());
    assert!(check_given_keypoints(&with_heel, path(), None).is_err());
}

#[test]
fn keypoints_that_no_body_can_be_fitted_to_are_refused() {
    // Symptom to prevent: five names that the network knows, one of them no joint of the skeleton;
    // the person was missing from the results without a word.
    let on_no_joint = format!("{SHOULDERS}, {HIPS}, racket = [0, 0, 1]");
    check(
        &on_no_joint,
        &card(&["racket"]),
        "`person[1].keypoints_m`: no body can be fitted to them: 4 keypoints are known, 5 are needed",
    );
}

#[test]
fn a_person_outside_the_ticks_of_the_run_is_refused() {
    let venue = venue(&format!("{SHOULDERS}, {HIPS}, nose = [0, 0, 1.6]"));
    check_given_ticks(&venue, path(), &(Tick(20)..Tick(31))).unwrap();
    let refused = check_given_ticks(&venue, path(), &(Tick(20)..Tick(30))).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "hall.toml: `person[1].tick`: found 30, which is outside the ticks of the run, 20..30"
    );
}
