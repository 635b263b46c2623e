//! Tests: folders in which a camera could silently be lost or confused with another.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use farfield_calibration::formats::RemarkKind;
use tempfile::TempDir;

use super::tests::{TWO_CAMERAS, frames, people_of, pose2sim, remarks_text, request, write};
use super::{ImportRequest, import};
use crate::formats::{Format, writers as files_of};
use crate::keypoints::Model;
use crate::person::Frames;

/// A calibration with cameras of these names, in this order.
fn calibration(names: &[String]) -> String {
    let table = &TWO_CAMERAS[TWO_CAMERAS.find("size").unwrap()..TWO_CAMERAS.rfind('[').unwrap()];
    let table = &table[..table.find("[int_cam02_img]").unwrap_or(table.len())];
    names.iter().fold(String::new(), |mut text, name| {
        write!(text, "[{name}]\nname = \"{name}\"\n{table}\n").unwrap();
        text
    })
}

/// Twenty frames that differ between cameras.
fn frames_of_camera(place: usize) -> Frames {
    let mut frames = frames(0..20);
    for seen in frames.values_mut().flatten().flatten().flatten() {
        seen.x_px += 10.0 * place as f64;
    }
    frames
}

/// A folder with these files and the calibration of two cameras.
fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("Calib.toml"), TWO_CAMERAS.as_bytes());
    for (name, text) in files {
        write(&folder.path().join(name), text.as_bytes());
    }
    folder
}

fn at_50_hz(folder: &Path) -> ImportRequest {
    ImportRequest {
        rate_hz: Some(50.0),
        ..request(folder)
    }
}

fn refused(request: &ImportRequest) -> String {
    import(request).unwrap_err().to_string()
}

#[test]
fn cameras_without_matching_names_are_paired_by_number() {
    let all: Vec<Frames> = (0..12).map(frames_of_camera).collect();
    let eyes: Vec<String> = (0..12).map(|i| format!("eye_{i}")).collect();
    let cameras: Vec<(&str, &Frames)> = eyes.iter().map(String::as_str).zip(&all).collect();
    let lenses: Vec<String> = (0..12).map(|i| format!("lens_{i}")).collect();
    let folder = pose2sim(&cameras, &calibration(&lenses));
    let report = import(&request(folder.path())).unwrap();
    assert!(remarks_text(&report).contains("in order"));
    for (place, camera) in report.cameras.iter().enumerate() {
        assert_eq!(camera.name, lenses[place]);
        assert_eq!(people_of(&camera.keypoints), all[place], "{}", camera.name);
    }
}

#[test]
fn cameras_keep_the_order_of_the_calibration_file() {
    let names = ["north", "east"].map(str::to_owned);
    let (a, b) = (frames_of_camera(0), frames_of_camera(1));
    let folder = pose2sim(&[("video_1", &a), ("video_2", &b)], &calibration(&names));
    let report = import(&request(folder.path())).unwrap();
    assert_eq!(report.cameras[0].name, "north");
    assert_eq!(people_of(&report.cameras[0].keypoints), a);
    assert_eq!(people_of(&report.cameras[1].keypoints), b);
}

#[test]
fn a_truncated_file_of_a_camera_is_reported() {
    let whole = files_of::coco_results(&frames(0..20));
    let cut = &whole[..whole.len() / 2];
    let all_json = folder(&[("cam01.json", &whole), ("cam02.json", cut)]);
    let error = refused(&at_50_hz(all_json.path()));
    assert!(
        error.contains("cam02.json:1") && error.contains("not JSON"),
        "{error}"
    );
    // If the others are not JSON, its name is enough.
    let table = files_of::deeplabcut(&frames(0..20));
    let named = folder(&[("cam01.csv", &table), ("cam02.json", cut)]);
    assert!(refused(&at_50_hz(named.path())).contains("cam02.json:1"));
    let other = folder(&[("cam01.csv", &table), ("settings.json", "{")]);
    let report = import(&at_50_hz(other.path())).unwrap();
    let text = remarks_text(&report);
    assert!(
        text.contains("doubtful") && text.contains("settings.json"),
        "{text}"
    );
}

#[test]
fn the_first_recognised_file_decides_the_format_of_frames() {
    let people = frames(0..1).remove(&0).unwrap();
    let picture = serde_json::json!([{
        "keypoints": people[0].iter().flatten().map(|it| [it.x_px, it.y_px]).collect::<Vec<_>>(),
        "keypoint_scores": vec![0.75; people[0].len()],
    }])
    .to_string();
    let folder = folder(&[
        ("cam01/000.json", "[]"),
        ("cam01/001.json", &picture),
        ("cam02/000.json", &picture),
        ("cam02/001.json", "[]"),
    ]);
    let report = import(&at_50_hz(folder.path())).unwrap();
    assert_eq!((report.format, report.cameras.len()), ("mmpose", 2));
    assert_eq!(report.cameras[0].frames, 2);
    let found = people_of(&report.cameras[0].keypoints);
    assert!(found[&0].is_empty() && found[&1] == people);
    // The same if the user assigns the camera.
    let requested = ImportRequest {
        cameras: vec![("int_cam01_img".to_owned(), folder.path().join("cam01"))],
        out: Some(folder.path().join("other")),
        ..at_50_hz(folder.path())
    };
    assert_eq!(import(&requested).unwrap().cameras[0].frames, 2);
}

#[test]
fn settings_among_the_frames_are_skipped_and_reported() {
    let (a, b) = (frames(0..20), frames(0..20));
    let folder = pose2sim(&[("cam01", &a), ("cam02", &b)], TWO_CAMERAS);
    for name in ["a.json", "z.json"] {
        write(
            &folder.path().join("pose/cam01_json").join(name),
            b"{\"fps\": 50}",
        );
    }
    let report = import(&request(folder.path())).unwrap();
    assert_eq!(people_of(&report.cameras[0].keypoints), a);
    let text = remarks_text(&report);
    assert!(
        text.contains("a.json: no keypoints") && text.contains("z.json"),
        "{text}"
    );
    // An invalid file with a frame number is not skipped.
    let broken = folder.path().join("pose/cam01_json/cam01_000003.json");
    fs::write(broken, b"{\"fps\": 50}").unwrap();
    let again = ImportRequest {
        out: Some(folder.path().join("again")),
        ..request(folder.path())
    };
    assert!(refused(&again).contains("cam01_000003.json"));
}

/// A Pose2Sim folder with keypoints of both cameras, of which only the first is synchronised.
fn half_synchronised(names: [&str; 2]) -> TempDir {
    let both = frames(0..20);
    let folder = pose2sim(&names.map(|name| (name, &both)), TWO_CAMERAS);
    for (frame, people) in &both {
        let file = format!("pose-sync/{0}_json/{0}_{frame:06}.json", names[0]);
        let text = files_of::openpose(people, Model::Halpe26);
        write(&folder.path().join(file), text.as_bytes());
    }
    folder
}

#[test]
fn unsynchronised_cameras_are_left_out_with_the_reason() {
    let folder = half_synchronised(["cam01", "cam02"]);
    let report = import(&request(folder.path())).unwrap();
    assert_eq!(report.cameras.len(), 1);
    assert!(report.cameras[0].source.contains("pose-sync"));
    let remarks = report.remarks.iter();
    let of_it: Vec<_> = remarks
        .filter(|it| it.camera.as_deref() == Some("int_cam02_img"))
        .collect();
    let [only] = of_it.as_slice() else {
        panic!("{of_it:?}")
    };
    assert_eq!(only.kind, RemarkKind::Doubtful);
    assert!(only.text.contains("pose/cam02_json"), "{}", only.text);
}

#[test]
fn unsynchronised_cameras_are_listed_if_names_do_not_match() {
    let folder = half_synchronised(["east", "west"]);
    for file in ["settings.json", "cam02.json"] {
        write(&folder.path().join("pose").join(file), b"{}");
    }
    let error = refused(&request(folder.path()));
    assert!(error.contains("east_json is of no camera"), "{error}");
    assert!(
        error.contains("`pose-sync` lacks") && error.contains("west_json, which `pose` has"),
        "{error}"
    );
    assert!(
        error.contains("cam02.json") && !error.contains("settings.json"),
        "{error}"
    );
}

#[test]
fn arrays_with_missing_cameras_need_explicit_assignment() {
    let (a, b) = (frames_of_camera(0), frames_of_camera(1));
    let folder = folder(&[]);
    let array = folder.path().join("mediapipe_2dData.npy");
    write(&array, &files_of::freemocap(&[&b]));
    let error = refused(&at_50_hz(folder.path()));
    assert!(
        error.contains("1 cameras") && error.contains("--camera NAME=FILE"),
        "{error}"
    );
    let assigned = |name: &str| (name.to_owned(), array.clone());
    let requested = ImportRequest {
        cameras: vec![assigned("int_cam02_img")],
        ..at_50_hz(folder.path())
    };
    assert_eq!(import(&requested).unwrap().cameras[0].name, "int_cam02_img");
    // Two of three, in the given order.
    write(&array, &files_of::freemocap(&[&b, &a]));
    let requested = ImportRequest {
        cameras: vec![assigned("int_cam02_img"), assigned("int_cam01_img")],
        out: Some(folder.path().join("second")),
        ..at_50_hz(folder.path())
    };
    let report = import(&requested).unwrap();
    let first_x_px =
        |place: usize| people_of(&report.cameras[place].keypoints)[&0][0][0].map(|it| it.x_px);
    assert_eq!((first_x_px(0), first_x_px(1)), (Some(100.0), Some(110.0)));
    let one = ImportRequest {
        cameras: vec![assigned("int_cam02_img")],
        out: Some(folder.path().join("third")),
        ..at_50_hz(folder.path())
    };
    assert!(refused(&one).contains("found 2 cameras"));
}

#[test]
fn file_name_identifies_the_camera_if_the_image_folder_does_not() {
    let (a, b) = (frames_of_camera(0), frames_of_camera(1));
    // The calibration lists the cameras in the opposite order.
    let names = ["west", "east"].map(str::to_owned);
    let folder = folder(&[
        ("east.json", &files_of::coco_annotations(&a, "images")),
        ("west.json", &files_of::coco_annotations(&b, "images")),
    ]);
    write(
        &folder.path().join("Calib.toml"),
        calibration(&names).as_bytes(),
    );
    let report = import(&at_50_hz(folder.path())).unwrap();
    assert!(report.cameras[0].name == "west" && report.cameras[0].source.contains("west.json"));
    assert!(report.cameras[1].source.contains("east.json"));
}

#[test]
fn ambiguous_camera_names_are_not_paired_by_order() {
    let (a, b) = (frames(0..20), frames(0..20));
    // Each name contains the names of both cameras.
    let names = ["left", "rear"].map(str::to_owned);
    let folder = pose2sim(
        &[("left_rear_1", &a), ("left_rear_2", &b)],
        &calibration(&names),
    );
    let error = refused(&request(folder.path()));
    assert!(error.contains("may be of several"), "{error}");
}

#[test]
fn a_requested_model_applies_to_points_without_names() {
    let table = files_of::caliscope(&[&frames(0..20)]);
    let folder = folder(&[("xy_POSE.csv", &table)]);
    let at = folder.path().join("xy_POSE.csv");
    let requested = ImportRequest {
        cameras: vec![("int_cam01_img".to_owned(), at)],
        model: Some(Model::Halpe26),
        format: Some(Format::Caliscope),
        ..at_50_hz(folder.path())
    };
    assert_eq!(import(&requested).unwrap().model, "HALPE_26");
}
