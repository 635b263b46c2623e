//! Mistakes that affect all cameras alike, or one camera for a part of the run.

use serde_json::{Value, json};

use super::{CAMERAS, MistakenSample};

#[test]
fn keypoints_exchanged_in_all_cameras_are_reported() {
    // COCO: 5 to 10 are shoulders, elbows and wrists, 11 to 16 hips, knees and ankles, left before right.
    type Exchange = fn(usize) -> usize;
    let cases: [(&str, Exchange); 7] = [
        ("sides_of_legs", |k| match k {
            11 | 13 | 15 => k + 1,
            12 | 14 | 16 => k - 1,
            _ => k,
        }),
        ("sides_of_arms", |k| match k {
            5 | 7 | 9 => k + 1,
            6 | 8 | 10 => k - 1,
            _ => k,
        }),
        ("elbows_and_wrists", |k| match k {
            7 | 8 => k + 2,
            9 | 10 => k - 2,
            _ => k,
        }),
        ("knees_and_ankles", |k| match k {
            13 | 14 => k + 2,
            15 | 16 => k - 2,
            _ => k,
        }),
        ("left_elbow_and_wrist", |k| match k {
            7 => 9,
            9 => 7,
            _ => k,
        }),
        ("right_knee_and_ankle", |k| match k {
            14 => 16,
            16 => 14,
            _ => k,
        }),
        ("hips_and_shoulders", |k| match k {
            5 | 6 => k + 6,
            11 | 12 => k - 6,
            _ => k,
        }),
    ];
    for (exchange, from) in cases {
        let sample = MistakenSample::new().change(&CAMERAS, from, |pixel| pixel);
        let disagreements = sample.disagreements();
        assert_eq!(disagreements.len(), 1, "{exchange}: {disagreements:?}");
        assert_eq!(
            disagreements[0]["cause"], "exchanged_keypoints",
            "{exchange}"
        );
        assert_eq!(disagreements[0]["exchange"], exchange);
        assert_eq!(disagreements[0]["cameras"], json!([]), "{exchange}");
    }
}

#[test]
fn the_keypoint_order_of_openpose_is_recognised() {
    // The first 17 of BODY_25; its neck and the middle of its hips are at a shoulder and a hip here.
    const BODY_25: [usize; 17] = [0, 6, 6, 8, 10, 5, 7, 9, 12, 12, 14, 16, 11, 13, 15, 2, 1];
    let sample = MistakenSample::new().change(&CAMERAS, |k| BODY_25[k], |pixel| pixel);
    sample.assert_printed(&["in the order of OpenPose's BODY_25", "farfield import"]);
}

/// Maps the true pixel of a keypoint to the written one.
type Written = fn([f64; 2]) -> [f64; 2];

#[test]
fn image_changes_of_all_cameras_are_reported() {
    // Images of the sample have 1920 x 1200 pixels.
    let cases: [(Written, Value); 7] = [
        (|[x, y]| [x / 2.0, y / 2.0], json!([2.0, 2.0])),
        (|[x, y]| [x / 3.0, y / 1.875], json!([3.0, 1.875])),
        (|[x, y]| [x - 240.0, y], json!([1.0, 1.0])),
        (|[x, y]| [x / 3.0, y / 3.0 + 120.0], json!([3.0, 3.0])),
        (|[x, y]| [x, 1199.0 - y], json!("from_below")),
        (|[x, y]| [1919.0 - x, y], json!("mirrored")),
        (|[x, y]| [y, x], json!("x_and_y_exchanged")),
    ];
    for (written, change) in cases {
        let sample = MistakenSample::new().change(&CAMERAS, |k| k, written);
        let disagreements = sample.disagreements();
        assert_eq!(disagreements.len(), 1, "{change}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "picture_of_all", "{change}");
        assert_eq!(disagreements[0]["cameras"], json!([]), "{change}");
        let reported = &disagreements[0]["change"];
        let Some(scale) = reported["resized"]["scale"].as_array() else {
            assert_eq!(reported, &change);
            continue;
        };
        for (scale, expected) in scale.iter().zip(change.as_array().unwrap()) {
            let ratio = scale.as_f64().unwrap() / expected.as_f64().unwrap();
            assert!((ratio - 1.0).abs() < 0.05, "{change}: {reported}");
        }
    }
}

#[test]
fn inverted_scores_are_reported_of_one_camera_and_of_all() {
    for (cameras, cameras_reported) in [
        (&CAMERAS[1..2], json!([CAMERAS[1]])),
        (&CAMERAS[..], json!([])),
    ] {
        let mut sample = MistakenSample::new();
        for camera in cameras {
            let lines = sample.lines.get_mut(camera).unwrap().iter_mut();
            let people = lines.flat_map(|line| line["persons"].as_array_mut().unwrap());
            let keypoints = people.flat_map(|it| it["keypoints"].as_array_mut().unwrap());
            for point in keypoints.filter_map(Value::as_array_mut) {
                point[2] = json!(1.0 - point[2].as_f64().unwrap());
            }
        }
        let disagreements = sample.disagreements();
        assert_eq!(
            disagreements.len(),
            1,
            "{cameras_reported}: {disagreements:?}"
        );
        assert_eq!(
            disagreements[0]["cause"], "low_scores",
            "{cameras_reported}: {disagreements:?}"
        );
        assert_eq!(disagreements[0]["cameras"], cameras_reported);
        let remedy = disagreements[0]["remedy"].as_str().unwrap();
        assert!(remedy.contains("is it 1 - score"), "{remedy}");
    }
}

/// Maps a tick to the line shown at that tick.
type ShownLine = fn(usize) -> usize;

#[test]
fn frames_lost_or_doubled_midway_are_reported_with_their_tick() {
    // The camera is five ticks early or late from tick 60 on, or late until then.
    let shown: [(&str, ShownLine, [f64; 2]); 3] = [
        ("lost", |t| if t < 60 { t } else { t + 5 }, [0.0, -5.0]),
        (
            "waited",
            |t| if t < 60 { t } else { (t - 5).max(60) },
            [0.0, 5.0],
        ),
        (
            "late at first",
            |t| if t < 60 { t.saturating_sub(4) } else { t },
            [4.0, 0.0],
        ),
    ];
    for (name, shown, late_ticks) in shown {
        let mut sample = MistakenSample::new();
        let lines = sample.lines.get_mut("north-west").unwrap();
        let before = lines.clone();
        for (tick, line) in lines.iter_mut().enumerate() {
            let from = shown(tick).min(before.len() - 1);
            line["persons"] = before[from]["persons"].clone();
        }
        let disagreements = sample.disagreements();
        assert_eq!(disagreements.len(), 1, "{name}: {disagreements:?}");
        assert_eq!(disagreements[0]["cause"], "late_in_part", "{name}");
        assert_eq!(disagreements[0]["cameras"], json!(["north-west"]), "{name}");
        let reported =
            ["before_ticks", "after_ticks"].map(|at| disagreements[0][at].as_f64().unwrap());
        for (reported, expected) in reported.iter().zip(late_ticks) {
            assert!((reported - expected).abs() < 0.5, "{name}: {reported}");
        }
        let since = disagreements[0]["since_tick"].as_i64().unwrap();
        assert!((since - 60).abs() <= 30, "{name}: {since}");
    }
}
