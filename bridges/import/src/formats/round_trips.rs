//! What small writers write of our 17 keypoints comes back the same.

use std::path::Path;

use proptest::prelude::*;

use super::writers as write;
use super::{Format, ParseOptions, Parsed, Reading, parse};
use crate::keypoints::Model;
use crate::person::{CameraKey, Candidate, Frames, Person};

/// Thousandths: of numbers with more than fifteen digits `serde_json` reads the last bit as it comes, which is 1e-12 of a
/// pixel.
fn candidate() -> impl Strategy<Value = Candidate> {
    (-50_000i32..4_000_000, -50_000i32..4_000_000, 1i32..1000).prop_map(|(x, y, score)| Candidate {
        x_px: f64::from(x) / 1e3,
        y_px: f64::from(y) / 1e3,
        score: f64::from(score) / 1e3,
    })
}

/// Somebody of whom at least the nose was found.
fn person() -> impl Strategy<Value = Person> {
    let others = proptest::collection::vec(proptest::option::of(candidate()), 16);
    (candidate(), others).prop_map(|(nose, others)| {
        std::array::from_fn(|i| match i.checked_sub(1) {
            Some(i) => others[i],
            None => Some(nose),
        })
    })
}

/// Frames in which somebody is.
fn frames(people: std::ops::Range<usize>) -> impl Strategy<Value = Frames> {
    let people = proptest::collection::vec(person(), people);
    proptest::collection::btree_map(0i64..5000, people, 1..5)
}

/// With the scores of formats that have none.
fn certain(frames: &Frames) -> Frames {
    let mut frames = frames.clone();
    for it in frames.values_mut().flatten().flatten().flatten() {
        it.score = 1.0;
    }
    frames
}

/// Recognised by its content, and read.
fn read(bytes: &[u8], name: &str, format: Format) -> Parsed {
    let parsed = parse(bytes, Path::new(name), ParseOptions::default()).unwrap();
    assert_eq!(parsed.format, format);
    parsed
}

/// The frames of the only camera.
fn only(parsed: &Parsed) -> Frames {
    assert_eq!(parsed.detections.cameras.len(), 1);
    parsed.detections.cameras[&CameraKey::OfFile].clone()
}

const MODELS: [Model; 12] = [
    Model::Body25,
    Model::Body25B,
    Model::Body135,
    Model::Coco18,
    Model::Mpii15,
    Model::Coco17,
    Model::Coco23,
    Model::Coco133,
    Model::Halpe26,
    Model::Halpe68,
    Model::Halpe136,
    Model::BlazePose,
];

proptest! {
    #[test]
    fn openpose_of_every_model(frames in frames(0..4), model in proptest::sample::select(&MODELS[..])) {
        let mut reading = Reading::new(ParseOptions { model: Some(model), ..ParseOptions::default() });
        for (frame, people) in &frames {
            let text = write::openpose(people, model);
            let path = format!("cam1_{frame:012}_keypoints.json");
            reading.read(text.as_bytes(), Path::new(&path)).unwrap();
        }
        let parsed = reading.finish().unwrap();
        let mut expected = frames;
        for person in expected.values_mut().flatten() {
            for (keypoint, place) in person.iter_mut().zip(model.mapping().places) {
                if place.is_none() {
                    *keypoint = None;
                }
            }
        }
        for people in expected.values_mut() {
            people.retain(|person| person.iter().any(Option::is_some));
        }
        prop_assert_eq!(only(&parsed), expected);
    }

    #[test]
    fn cocos_and_alphaposes_results(frames in frames(1..4)) {
        let text = write::coco_results(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.json", Format::CocoResults)), frames.clone());
        let text = write::alphapose(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.json", Format::AlphaPose)), frames.clone());
    }

    #[test]
    fn cocos_annotations(frames in frames(0..4)) {
        let text = write::coco_annotations(&frames, "images/cam7");
        let parsed = read(text.as_bytes(), "a.json", Format::CocoAnnotations);
        let camera = CameraKey::Named("cam7".to_owned());
        prop_assert_eq!(&parsed.detections.cameras[&camera], &certain(&frames));
    }

    #[test]
    fn mmposes_predictions(frames in frames(0..4), model in proptest::sample::select(&[Model::Coco17, Model::Halpe26][..])) {
        let text = write::mmpose(&frames, model);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.json", Format::MmPose)), frames.clone());
    }

    #[test]
    fn deeplabcuts_and_sleaps_tables(frames in frames(1..4)) {
        let text = write::deeplabcut(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.csv", Format::DeepLabCut)), frames.clone());
        let text = write::sleap(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.csv", Format::Sleap)), frames.clone());
    }

    #[test]
    fn caliscopes_table_of_two_cameras(a in frames(1..3), b in frames(1..3)) {
        let parsed = read(write::caliscope(&[&a, &b]).as_bytes(), "xy_POSE.csv", Format::Caliscope);
        for (camera, frames) in [("cam_0", a), ("cam_1", b)] {
            let camera = CameraKey::Named(camera.to_owned());
            prop_assert_eq!(&parsed.detections.cameras[&camera], &certain(&frames));
        }
    }

    #[test]
    fn freemocaps_array_of_two_cameras(people in proptest::collection::vec((person(), person()), 1..4)) {
        let of = |which: fn(&(Person, Person)) -> Person| -> Frames {
            people.iter().enumerate().map(|(frame, it)| (frame.cast_signed() as i64, vec![which(it)])).collect()
        };
        let (a, b) = (of(|it| it.0), of(|it| it.1));
        let parsed = read(&write::freemocap(&[&a, &b]), "2dData.npy", Format::FreeMoCap);
        for (camera, frames) in [a, b].iter().enumerate() {
            prop_assert_eq!(&parsed.detections.cameras[&CameraKey::Nth(camera)], &certain(frames));
        }
    }
}

#[test]
fn mmposes_other_files_are_read_too() {
    let text =
        r#"[{"frame_id": 3, "instances": [{"keypoints": [[1, 2]], "keypoint_scores": [0.5]}]}]"#;
    let options = ParseOptions::default();
    let said = parse(text.as_bytes(), Path::new("a.json"), options)
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("[0].instances[0].keypoints") && said.contains("found 1 keypoints"),
        "{said}"
    );
    let at: Vec<[f64; 2]> = (0..17).map(|i| [f64::from(i), 5.0]).collect();
    let scores = [0.5; 17];
    let text = serde_json::json!([{"keypoints": at, "keypoint_scores": scores}]).to_string();
    let parsed = read(text.as_bytes(), "frame_12.json", Format::MmPose);
    assert_eq!(only(&parsed)[&12].len(), 1);
}

#[test]
fn mmposes_names_of_keypoints_decide() {
    let text = serde_json::json!({
        "meta_info": {"keypoint_id2name": {"0": "right_wrist", "1": "nose"}},
        "instance_info": [{"frame_id": 1, "instances": [{"keypoints": [[1, 2], [3, 4]], "keypoint_scores": [0.5, 0.25]}]}],
    });
    let parsed = read(text.to_string().as_bytes(), "a.json", Format::MmPose);
    let person = only(&parsed)[&1][0];
    assert_eq!(
        person[0],
        Some(Candidate {
            x_px: 3.0,
            y_px: 4.0,
            score: 0.25
        })
    );
    assert_eq!(
        person[10],
        Some(Candidate {
            x_px: 1.0,
            y_px: 2.0,
            score: 0.5
        })
    );
}
