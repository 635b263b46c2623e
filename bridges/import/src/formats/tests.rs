//! Tests: written files read back the same; invalid files are refused with the place of the error, or
//! read; none panics.

use std::path::Path;

use farfield_proto::keypoints::COCO23;
use proptest::prelude::*;

use super::writers as write;
use super::{Format, ParseOptions, Parsed, Reading, parse};
use crate::keypoints::Model;
use crate::person::{CameraKey, Candidate, Frames, Person};

fn error_of(text: &str, name: &str) -> String {
    let parsed = parse(text.as_bytes(), Path::new(name), ParseOptions::default());
    parsed.unwrap_err().to_string()
}

/// Three frames of two people.
fn three_frames() -> Frames {
    let at = |x_px: f64| {
        [Some(Candidate {
            x_px,
            y_px: 7.5,
            score: 0.5,
        }); COCO23.len()]
    };
    (0..3)
        .map(|frame| (frame, vec![at(1.0), at(2.0)]))
        .collect()
}

#[test]
fn errors_contain_file_line_and_field() {
    for (text, name, expected) in [
        (
            "{\"people\":\n [{\"pose_keypoints_2d\": [1, \"x\"]}]}",
            "cam1_000001.json",
            &[
                "cam1_000001.json:2",
                "people[0].pose_keypoints_2d[1]",
                "\"x\"",
                "expected f64",
            ][..],
        ),
        (
            r#"{"people": [{"pose_keypoints_2d": [1, 2, 3, 4]}]}"#,
            "1.json",
            &[
                "people[0].pose_keypoints_2d",
                "found 4 numbers",
                "three per keypoint",
            ],
        ),
        (
            r#"{"people": [{"pose_keypoints_2d": [1, 2, 3]}]}"#,
            "1.json",
            &["found 1 keypoints", "BODY_25 (25)"],
        ),
        (r#"{"people": []}"#, "frame.json", &["no frame number"]),
        (r#"{"people": [}"#, "1.json", &["1.json:1", "not JSON"]),
        (
            r#"{"shapes": []}"#,
            "1.json",
            &["no known format", "openpose", "freemocap"],
        ),
        (
            "scorer,n,n\ncoords,x,y\nbodyparts,nose,nose\n0,1,2\n",
            "a.csv",
            &[
                "a.csv:2",
                "found `coords`, expected the heading `bodyparts`",
            ],
        ),
        (
            "scorer,n,n\nbodyparts,nose,nose\ncoords,x,z\n",
            "a.csv",
            &["a.csv:2", "found the column `z` of `nose`"],
        ),
        (
            "scorer,n,n,n\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood\n0,1,two,1\n",
            "a.csv",
            &["a.csv:4", "found `two`, expected a number"],
        ),
        (
            "scorer,n,n\nbodyparts,nose,nose\ncoords,x,y\n-9223372036854775808,1,2\n",
            "a.csv",
            &["a.csv:4", "found `-9223372036854775808`, expected a frame"],
        ),
        (
            "scorer,n,n\nbodyparts,nose,nose\ncoords,x,y\n0.5,1,2\n",
            "a.csv",
            &[
                "a.csv:4",
                "found `0.5`, expected a frame (a whole number) or the name",
            ],
        ),
        (
            "frame_idx,nose.x,nose.y\n0.5,1,2\n",
            "a.csv",
            &["a.csv:2", "found `0.5`, expected a whole number"],
        ),
        (
            "sync_index,port,point_id,img_loc_x,img_loc_y,board_loc_x\n1,0,0,1,2,0.05\n",
            "xy.csv",
            &["xy.csv:2", "calibration board"],
        ),
    ] {
        let error = error_of(text, name);
        for part in expected {
            assert!(error.contains(part), "{error}\nexpected: {part}");
        }
    }
}

#[test]
fn python_nan_is_undetected_and_huge_coordinates_are_refused() {
    let person = |x: &str| {
        let keypoints = format!("{x}, 5, 0.5, ").repeat(17);
        format!(
            r#"{{"people": [{{"pose_keypoints_2d": [{}]}}]}}"#,
            keypoints.trim_end_matches(", ")
        )
    };
    let parsed = parse(
        person("NaN").as_bytes(),
        Path::new("1.json"),
        ParseOptions::default(),
    );
    assert_eq!(parsed.unwrap().detections.n_people(), 0);
    assert!(error_of(&person("1e30"), "1.json").contains("expected pixels"));
}

#[test]
fn two_files_of_one_frame_are_refused() {
    let mut reading = Reading::new(ParseOptions::default());
    let text = write::openpose(&three_frames()[&0], Model::Body25);
    reading
        .read(text.as_bytes(), Path::new("cam1_000001.json"))
        .unwrap();
    let second = reading.read(text.as_bytes(), Path::new("cam2_000001.json"));
    let error = second.unwrap_err().to_string();
    assert!(
        error.contains("cam2_000001.json: found frame 1 twice"),
        "{error}"
    );
}

#[test]
fn two_takes_in_one_file_are_refused() {
    let image = |id: u32, name: &str| format!(r#"{{"id": {id}, "file_name": "{name}"}}"#);
    let parse_two = |first: &str, second: &str| {
        let text = format!(
            r#"{{"images": [{}, {}], "annotations": [], "categories": []}}"#,
            image(1, first),
            image(2, second)
        );
        parse(
            text.as_bytes(),
            Path::new("a.json"),
            ParseOptions::default(),
        )
        .map(|_| ())
    };
    let error = parse_two("take1/north/000007.jpg", "take2/north/000007.jpg").unwrap_err();
    assert_eq!(error.field.as_deref(), Some("images[1].file_name"));
    let message = error.to_string();
    for name in ["take1/north/000007.jpg", "take2/north/000007.jpg"] {
        assert!(message.contains(name), "{name}: {message}");
    }
    parse_two("take1/north/000007.jpg", "take1/south/000007.jpg").unwrap();
}

#[test]
fn manual_labels_have_image_names_and_no_likelihood() {
    let text =
        "scorer,,,me,me\nbodyparts,,,nose,nose\ncoords,,,x,y\nlabeled-data,video,img0012.png,3,4\n";
    let parsed = parse(text.as_bytes(), Path::new("a.csv"), ParseOptions::default()).unwrap();
    let frames = &parsed.detections.cameras[&CameraKey::OfFile];
    assert_eq!(
        frames[&12][0][0],
        Some(Candidate {
            x_px: 3.0,
            y_px: 4.0,
            score: 1.0
        })
    );
    assert!(parsed.notes.iter().any(|note| note.contains("score 1")));
}

#[test]
fn deeplabcut_frames_may_be_written_with_a_decimal_point() {
    let text = "scorer,n,n,n\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood\n\
                0.0,1,2,1\n1.0,3,4,1\n-2.0,5,6,1\n12,7,8,1\n";
    let parsed = parse(text.as_bytes(), Path::new("a.csv"), ParseOptions::default()).unwrap();
    let frames = &parsed.detections.cameras[&CameraKey::OfFile];
    let numbers: Vec<i64> = frames.keys().copied().collect();
    assert_eq!(numbers, [-2, 0, 1, 12]);
}

#[test]
fn other_categories_are_dropped_and_reported() {
    let text = r#"[{"image_id": 1, "category_id": 18, "keypoints": [1, 2, 3]}]"#;
    let parsed = parse(
        text.as_bytes(),
        Path::new("a.json"),
        ParseOptions::default(),
    )
    .unwrap();
    assert_eq!(parsed.detections.n_people(), 0);
    assert!(parsed.notes.iter().any(|note| note.contains("categor")));
}

/// One valid file of each format.
fn valid() -> Vec<Vec<u8>> {
    let frames = three_frames();
    vec![
        write::openpose(&frames[&0], Model::Body25).into_bytes(),
        write::alphapose(&frames).into_bytes(),
        write::coco_results(&frames).into_bytes(),
        write::coco_annotations(&frames, "cam1").into_bytes(),
        write::mmpose(&frames, Model::Coco17).into_bytes(),
        write::deeplabcut(&frames).into_bytes(),
        write::sleap(&frames).into_bytes(),
        write::caliscope(&[&frames]).into_bytes(),
        write::freemocap(&[&frames]),
    ]
}

fn parse_as_all(bytes: &[u8]) {
    let path = Path::new("cam1_000001.json");
    let formats = Format::ALL.into_iter().map(Some).chain([None]);
    for format in formats {
        for model in [None, Some(Model::Halpe26), Some(Model::BlazePose)] {
            let options = ParseOptions {
                format,
                model,
                model_hint: Some(Model::Body25B),
            };
            drop(parse(bytes, path, options));
        }
    }
}

#[test]
fn a_file_read_as_another_format_is_refused_or_read() {
    for bytes in valid() {
        parse_as_all(&bytes);
    }
}

proptest! {
    #[test]
    fn no_text_panics(text in "\\PC{0,200}") {
        parse_as_all(text.as_bytes());
    }

    #[test]
    fn no_combination_of_format_words_panics(
        words in proptest::collection::vec(
            proptest::sample::select(&[
                "{", "}", "[", "]", ":", ",", "\n", "\"people\"", "\"pose_keypoints_2d\"", "\"image_id\"", "\"keypoints\"",
                "\"instance_info\"", "\"frame_id\"", "\"instances\"", "\"images\"", "\"annotations\"", "1", "-1e300", "NaN",
                "\"7.jpg\"", "scorer", "bodyparts", "coords", "individuals", "x", "y", "nose", "sync_index", "cam_id",
                "point_id", "img_loc_x", "img_loc_y", "frame_idx", "nose.x", "null", "9223372036854775807",
                "-9223372036854775808", "scorer,n,n\nbodyparts,nose,nose\ncoords,x,y\n", ",",
            ][..]),
            0..60,
        ),
    ) {
        parse_as_all(words.concat().as_bytes());
    }

    #[test]
    fn no_damaged_file_panics(
        which in 0usize..9,
        cut in 0.0..1.0f64,
        damages in proptest::collection::vec((0.0..1.0f64, any::<u8>()), 0..6),
    ) {
        let mut bytes = valid().swap_remove(which);
        let length = bytes.len();
        for (at, byte) in damages {
            bytes[(at * length as f64) as usize] = byte;
        }
        bytes.truncate(length - (cut * cut * length as f64) as usize);
        parse_as_all(&bytes);
    }
}

/// Multiples of 1/1000: beyond fifteen digits `serde_json` does not guarantee the last bit, which
/// is 1e-12 pixels.
fn candidate() -> impl Strategy<Value = Candidate> {
    (-50_000i32..4_000_000, -50_000i32..4_000_000, 1i32..1000).prop_map(|(x, y, score)| Candidate {
        x_px: f64::from(x) / 1e3,
        y_px: f64::from(y) / 1e3,
        score: f64::from(score) / 1e3,
    })
}

/// A person with at least the nose detected.
fn person() -> impl Strategy<Value = Person> {
    let others = proptest::collection::vec(proptest::option::of(candidate()), COCO23.len() - 1);
    (candidate(), others).prop_map(|(nose, others)| {
        std::array::from_fn(|i| match i.checked_sub(1) {
            Some(i) => others[i],
            None => Some(nose),
        })
    })
}

/// Frames that contain people.
fn frames(people: std::ops::Range<usize>) -> impl Strategy<Value = Frames> {
    let people = proptest::collection::vec(person(), people);
    proptest::collection::btree_map(0i64..5000, people, 1..5)
}

/// The same frames with the score 1, for formats without scores.
fn certain(frames: &Frames) -> Frames {
    let mut frames = frames.clone();
    for it in frames.values_mut().flatten().flatten().flatten() {
        it.score = 1.0;
    }
    frames
}

/// Reads a file after recognising its format by content.
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
    fn openpose_round_trips_with_every_model(frames in frames(0..4), model in proptest::sample::select(&MODELS[..])) {
        let mut reading = Reading::new(ParseOptions { model: Some(model), ..ParseOptions::default() });
        for (frame, people) in &frames {
            let text = write::openpose(people, model);
            let path = format!("cam1_{frame:012}_keypoints.json");
            reading.read(text.as_bytes(), Path::new(&path)).unwrap();
        }
        let parsed = reading.finish().unwrap();
        let mut expected = write::known_to(model, frames);
        for people in expected.values_mut() {
            people.retain(|person| person.iter().any(Option::is_some));
        }
        prop_assert_eq!(only(&parsed), expected);
    }

    #[test]
    fn coco_and_alphapose_results_round_trip(frames in frames(1..4)) {
        let frames = write::known_to(Model::Coco17, frames);
        let text = write::coco_results(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.json", Format::CocoResults)), frames.clone());
        let text = write::alphapose(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.json", Format::AlphaPose)), frames.clone());
    }

    #[test]
    fn coco_annotations_round_trip(frames in frames(0..4)) {
        let frames = write::known_to(Model::Coco17, frames);
        let text = write::coco_annotations(&frames, "images/cam7");
        let parsed = read(text.as_bytes(), "a.json", Format::CocoAnnotations);
        let camera = CameraKey::Named("cam7".to_owned());
        prop_assert_eq!(&parsed.detections.cameras[&camera], &certain(&frames));
    }

    #[test]
    fn mmpose_predictions_round_trip(frames in frames(0..4), model in proptest::sample::select(&[Model::Coco17, Model::Halpe26][..])) {
        let text = write::mmpose(&frames, model);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.json", Format::MmPose)), write::known_to(model, frames));
    }

    #[test]
    fn deeplabcut_and_sleap_tables_round_trip(frames in frames(1..4)) {
        let text = write::deeplabcut(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.csv", Format::DeepLabCut)), frames.clone());
        let text = write::sleap(&frames);
        prop_assert_eq!(only(&read(text.as_bytes(), "a.csv", Format::Sleap)), frames.clone());
    }

    #[test]
    fn caliscope_table_of_two_cameras_round_trips(a in frames(1..3), b in frames(1..3)) {
        let parsed = read(write::caliscope(&[&a, &b]).as_bytes(), "xy_POSE.csv", Format::Caliscope);
        for (camera, frames) in [("cam_0", a), ("cam_1", b)] {
            let camera = CameraKey::Named(camera.to_owned());
            prop_assert_eq!(&parsed.detections.cameras[&camera], &certain(&write::known_to(Model::BlazePose, frames)));
        }
    }

    #[test]
    fn freemocap_array_of_two_cameras_round_trips(people in proptest::collection::vec((person(), person()), 1..4)) {
        let frames_of = |which: fn(&(Person, Person)) -> Person| -> Frames {
            people.iter().enumerate().map(|(frame, it)| (frame.cast_signed() as i64, vec![which(it)])).collect()
        };
        let (a, b) = (frames_of(|it| it.0), frames_of(|it| it.1));
        let parsed = read(&write::freemocap(&[&a, &b]), "2dData.npy", Format::FreeMoCap);
        for (camera, frames) in [a, b].iter().enumerate() {
            prop_assert_eq!(&parsed.detections.cameras[&CameraKey::Nth(camera)], &certain(&write::known_to(Model::BlazePose, frames.clone())));
        }
    }
}

#[test]
fn mmpose_lists_of_frames_and_of_instances_are_read() {
    let text =
        r#"[{"frame_id": 3, "instances": [{"keypoints": [[1, 2]], "keypoint_scores": [0.5]}]}]"#;
    let options = ParseOptions::default();
    let error = parse(text.as_bytes(), Path::new("a.json"), options).unwrap_err();
    assert_eq!(error.field.as_deref(), Some("[0].instances[0].keypoints"));
    assert!(error.to_string().contains("found 1 keypoints"), "{error}");
    let at: Vec<[f64; 2]> = (0..17).map(|i| [f64::from(i), 5.0]).collect();
    let scores = [0.5; 17];
    let text = serde_json::json!([{"keypoints": at, "keypoint_scores": scores}]).to_string();
    let parsed = read(text.as_bytes(), "frame_12.json", Format::MmPose);
    assert_eq!(only(&parsed)[&12].len(), 1);
}

#[test]
fn mmpose_keypoint_names_decide_the_mapping() {
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
