//! Files that are not as they should be: every one is refused with its place, or read; none panics.

use std::path::Path;

use proptest::prelude::*;

use super::writers as write;
use super::{Format, ParseOptions, Reading, parse};
use crate::keypoints::Model;
use crate::person::{CameraKey, Candidate, Frames};

fn said(text: &str, name: &str) -> String {
    let parsed = parse(text.as_bytes(), Path::new(name), ParseOptions::default());
    parsed.unwrap_err().to_string()
}

/// Three frames of two people.
fn frames() -> Frames {
    let at = |x_px: f64| {
        [Some(Candidate {
            x_px,
            y_px: 7.5,
            score: 0.5,
        }); 17]
    };
    (0..3)
        .map(|frame| (frame, vec![at(1.0), at(2.0)]))
        .collect()
}

#[test]
fn refusals_name_file_line_and_field() {
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
        let said = said(text, name);
        for part in expected {
            assert!(said.contains(part), "{said}\nexpected: {part}");
        }
    }
}

#[test]
fn pythons_nan_is_not_found_and_pixels_beyond_every_picture_are_refused() {
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
    assert!(said(&person("1e30"), "1.json").contains("expected pixels"));
}

#[test]
fn two_files_of_one_frame_are_two_cameras_and_refused() {
    let mut reading = Reading::new(ParseOptions::default());
    let text = write::openpose(&frames()[&0], Model::Body25);
    reading
        .read(text.as_bytes(), Path::new("cam1_000001.json"))
        .unwrap();
    let second = reading.read(text.as_bytes(), Path::new("cam2_000001.json"));
    let said = second.unwrap_err().to_string();
    assert!(
        said.contains("cam2_000001.json: found frame 1 twice"),
        "{said}"
    );
}

#[test]
fn two_takes_in_one_file_are_not_one_recording() {
    let image = |id: u32, name: &str| format!(r#"{{"id": {id}, "file_name": "{name}"}}"#);
    let of = |first: &str, second: &str| {
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
    let error = of("take1/north/000007.jpg", "take2/north/000007.jpg").unwrap_err();
    let said = error.to_string();
    for word in [
        "images[1].file_name",
        "take1/north/000007.jpg",
        "take2/north/000007.jpg",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
    of("take1/north/000007.jpg", "take1/south/000007.jpg").unwrap();
}

#[test]
fn labels_by_hand_have_names_of_pictures_and_no_likelihood() {
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
fn frames_of_deeplabcut_are_whole_numbers_also_with_a_point() {
    let text = "scorer,n,n,n\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood\n\
                0.0,1,2,1\n1.0,3,4,1\n-2.0,5,6,1\n12,7,8,1\n";
    let parsed = parse(text.as_bytes(), Path::new("a.csv"), ParseOptions::default()).unwrap();
    let frames = &parsed.detections.cameras[&CameraKey::OfFile];
    let numbers: Vec<i64> = frames.keys().copied().collect();
    assert_eq!(numbers, [-2, 0, 1, 12]);
}

#[test]
fn people_of_other_categories_are_left_out_and_said() {
    let text = r#"[{"image_id": 1, "category_id": 18, "keypoints": [1, 2, 3]}]"#;
    let parsed = parse(
        text.as_bytes(),
        Path::new("a.json"),
        ParseOptions::default(),
    )
    .unwrap();
    assert_eq!(parsed.detections.n_people(), 0);
    assert!(parsed.notes.iter().any(|note| note.contains("category")));
}

/// One valid file of each format.
fn valid() -> Vec<Vec<u8>> {
    let frames = frames();
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
fn a_file_taken_for_another_formats_is_refused_or_read() {
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
    fn no_words_of_these_formats_panic(
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
