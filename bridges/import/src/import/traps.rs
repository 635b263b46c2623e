//! Folders in which a camera could be lost, or taken for another, without a word.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use farfield_calibration::formats::RemarkKind;
use tempfile::TempDir;

use super::tests::{TWO_CAMERAS, frames, people_of, pose2sim, request, said, write};
use super::{ImportRequest, import};
use crate::formats::{Format, writers as files_of};
use crate::keypoints::Model;
use crate::person::Frames;

/// A calibration of cameras of these names, in this order.
fn calibration(names: &[String]) -> String {
    let table = &TWO_CAMERAS[TWO_CAMERAS.find("size").unwrap()..TWO_CAMERAS.rfind('[').unwrap()];
    let table = &table[..table.find("[int_cam02_img]").unwrap_or(table.len())];
    names.iter().fold(String::new(), |mut text, name| {
        write!(text, "[{name}]\nname = \"{name}\"\n{table}\n").unwrap();
        text
    })
}

/// Twenty frames that differ from camera to camera.
fn of_camera(place: usize) -> Frames {
    let mut frames = frames(0..20);
    for seen in frames.values_mut().flatten().flatten().flatten() {
        seen.x_px += 10.0 * place as f64;
    }
    frames
}

/// A folder of these files beside the calibration of two cameras.
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
fn twelve_cameras_without_a_name_in_common_are_paired_by_number_not_by_alphabet() {
    let all: Vec<Frames> = (0..12).map(of_camera).collect();
    let eyes: Vec<String> = (0..12).map(|i| format!("eye_{i}")).collect();
    let cameras: Vec<(&str, &Frames)> = eyes.iter().map(String::as_str).zip(&all).collect();
    let lenses: Vec<String> = (0..12).map(|i| format!("lens_{i}")).collect();
    let folder = pose2sim(&cameras, &calibration(&lenses));
    let report = import(&request(folder.path())).unwrap();
    assert!(said(&report).contains("in their order"));
    for (place, camera) in report.cameras.iter().enumerate() {
        assert_eq!(camera.name, lenses[place]);
        assert_eq!(people_of(&camera.keypoints), all[place], "{}", camera.name);
    }
}

#[test]
fn cameras_of_a_calibration_keep_the_order_of_its_file() {
    let names = ["north", "east"].map(str::to_owned);
    let (a, b) = (of_camera(0), of_camera(1));
    let folder = pose2sim(&[("video_1", &a), ("video_2", &b)], &calibration(&names));
    let report = import(&request(folder.path())).unwrap();
    assert_eq!(report.cameras[0].name, "north");
    assert_eq!(people_of(&report.cameras[0].keypoints), a);
    assert_eq!(people_of(&report.cameras[1].keypoints), b);
}

#[test]
fn a_camera_whose_file_was_cut_off_is_not_left_out_in_silence() {
    let whole = files_of::coco_results(&frames(0..20));
    let cut = &whole[..whole.len() / 2];
    let beside = folder(&[("cam01.json", &whole), ("cam02.json", cut)]);
    let said = refused(&at_50_hz(beside.path()));
    assert!(
        said.contains("cam02.json:1") && said.contains("not JSON"),
        "{said}"
    );
    // Its name alone says it, where the others are no JSON.
    let table = files_of::deeplabcut(&frames(0..20));
    let named = folder(&[("cam01.csv", &table), ("cam02.json", cut)]);
    assert!(refused(&at_50_hz(named.path())).contains("cam02.json:1"));
    let other = folder(&[("cam01.csv", &table), ("settings.json", "{")]);
    let report = import(&at_50_hz(other.path())).unwrap();
    let said = super::tests::said(&report);
    assert!(
        said.contains("doubtful") && said.contains("settings.json"),
        "{said}"
    );
}

#[test]
fn frames_are_told_by_the_first_file_that_tells_them() {
    let people = frames(0..1).remove(&0).unwrap();
    let picture = serde_json::json!([{
        "keypoints": people[0].iter().flatten().map(|it| [it.x_px, it.y_px]).collect::<Vec<_>>(),
        "keypoint_scores": vec![0.75; 17],
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
    // The same where somebody says whose they are.
    let asked = ImportRequest {
        cameras: vec![("int_cam01_img".to_owned(), folder.path().join("cam01"))],
        out: Some(folder.path().join("other")),
        ..at_50_hz(folder.path())
    };
    assert_eq!(import(&asked).unwrap().cameras[0].frames, 2);
}

#[test]
fn settings_beside_the_frames_are_left_out_and_said() {
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
    let said = said(&report);
    assert!(
        said.contains("a.json: no keypoints") && said.contains("z.json"),
        "{said}"
    );
    // A frame that is none is no such file.
    let broken = folder.path().join("pose/cam01_json/cam01_000003.json");
    fs::write(broken, b"{\"fps\": 50}").unwrap();
    let again = ImportRequest {
        out: Some(folder.path().join("again")),
        ..request(folder.path())
    };
    assert!(refused(&again).contains("cam01_000003.json"));
}

/// A folder of Pose2Sim with keypoints of both cameras, of which it has synchronised the first alone.
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
fn a_camera_that_pose2sim_did_not_synchronise_is_left_out_with_the_true_reason() {
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
    for words in [
        "pose/cam02_json are not synchronised",
        "`pose-sync` has none of it",
        "synchronise all cameras again, or move `pose-sync` away",
    ] {
        assert!(only.text.contains(words), "{}", only.text);
    }
}

#[test]
fn cameras_that_are_not_synchronised_are_named_where_the_others_fit_no_camera() {
    let folder = half_synchronised(["east", "west"]);
    for file in ["settings.json", "cam02.json"] {
        write(&folder.path().join("pose").join(file), b"{}");
    }
    let said = refused(&request(folder.path()));
    assert!(said.contains("east_json is of no camera"), "{said}");
    assert!(
        said.contains("`pose-sync` lacks") && said.contains("west_json, which `pose` has"),
        "{said}"
    );
    assert!(
        said.contains("cam02.json") && !said.contains("settings.json"),
        "{said}"
    );
}

#[test]
fn arrays_of_fewer_cameras_than_the_calibration_has_are_refused_until_somebody_says_whose() {
    let (a, b) = (of_camera(0), of_camera(1));
    let folder = folder(&[]);
    let array = folder.path().join("mediapipe_2dData.npy");
    write(&array, &files_of::freemocap(&[&b]));
    let said = refused(&at_50_hz(folder.path()));
    assert!(
        said.contains("1 cameras") && said.contains("--camera NAME=FILE"),
        "{said}"
    );
    let of = |name: &str| (name.to_owned(), array.clone());
    let asked = ImportRequest {
        cameras: vec![of("int_cam02_img")],
        ..at_50_hz(folder.path())
    };
    assert_eq!(import(&asked).unwrap().cameras[0].name, "int_cam02_img");
    // Two of three, in the order that was said.
    write(&array, &files_of::freemocap(&[&b, &a]));
    let asked = ImportRequest {
        cameras: vec![of("int_cam02_img"), of("int_cam01_img")],
        out: Some(folder.path().join("second")),
        ..at_50_hz(folder.path())
    };
    let report = import(&asked).unwrap();
    let first_x_px =
        |place: usize| people_of(&report.cameras[place].keypoints)[&0][0][0].map(|it| it.x_px);
    assert_eq!((first_x_px(0), first_x_px(1)), (Some(100.0), Some(110.0)));
    let one = ImportRequest {
        cameras: vec![of("int_cam02_img")],
        out: Some(folder.path().join("third")),
        ..at_50_hz(folder.path())
    };
    assert!(refused(&one).contains("found 2 cameras"));
}

#[test]
fn a_files_name_says_its_camera_where_its_pictures_lie_in_a_folder_that_does_not() {
    let (a, b) = (of_camera(0), of_camera(1));
    // The calibration has the cameras the other way round.
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
fn keypoints_that_may_be_of_several_cameras_are_not_paired_by_order() {
    let (a, b) = (frames(0..20), frames(0..20));
    // Each name has both cameras' in it.
    let names = ["left", "rear"].map(str::to_owned);
    let folder = pose2sim(
        &[("left_rear_1", &a), ("left_rear_2", &b)],
        &calibration(&names),
    );
    let said = refused(&request(folder.path()));
    assert!(said.contains("may be of several"), "{said}");
}

#[test]
fn a_model_that_was_asked_for_is_taken_for_points_without_names() {
    let table = files_of::caliscope(&[&frames(0..20)]);
    let folder = folder(&[("xy_POSE.csv", &table)]);
    let at = folder.path().join("xy_POSE.csv");
    let asked = ImportRequest {
        cameras: vec![("int_cam01_img".to_owned(), at)],
        model: Some(Model::Halpe26),
        format: Some(Format::Caliscope),
        ..at_50_hz(folder.path())
    };
    assert_eq!(import(&asked).unwrap().model, "HALPE_26");
}
