//! Tests: which calibration of a folder is used, and how the others are reported.

use std::fs;
use std::path::Path;

use farfield_calibration::formats::{self, Format, ImportOptions, TextFile};
use tempfile::TempDir;

use super::tests::{TWO_CAMERAS, frames, pose2sim, remarks_text, request, write};
use super::{ImportRequest, import};

/// Pose of the second camera in [`TWO_CAMERAS`].
const PLACE: &str = "rotation = [1.5707963267948966, 0.0, 0.0]\ntranslation = [0.0, 1.5, 4.0]";

/// [`TWO_CAMERAS`] with the second camera moved sideways by 0.3 m.
fn moved() -> String {
    assert!(TWO_CAMERAS.contains(PLACE));
    TWO_CAMERAS.replace(PLACE, &PLACE.replace("[0.0, 1.5", "[0.3, 1.5"))
}

/// A Pose2Sim project with these files in `calibration`.
fn project(calibrations: &[(&str, &str)]) -> TempDir {
    let frames = frames(0..20);
    let folder = pose2sim(&[("cam01", &frames), ("cam02", &frames)], TWO_CAMERAS);
    fs::remove_file(folder.path().join("calibration/Calib_board.toml")).unwrap();
    for (name, text) in calibrations {
        write(
            &folder.path().join("calibration").join(name),
            text.as_bytes(),
        );
    }
    folder
}

fn refused(folder: &Path) -> String {
    import(&request(folder)).unwrap_err().to_string()
}

#[test]
fn differing_calibrations_are_listed_until_the_user_chooses() {
    let moved = moved();
    let folder = project(&[
        ("Calib_qualisys.toml", TWO_CAMERAS),
        ("Calib_scene.toml", &moved),
    ]);
    let refusal = refused(folder.path());
    for words in [
        "Calib_qualisys.toml (20",
        "Calib_scene.toml (20",
        "UTC, 2 cameras, farfield)",
        "it places camera int_cam02_img 0.300 m away",
        "--calibration FILE",
    ] {
        assert!(refusal.contains(words), "{refusal}");
    }
    let scene = folder.path().join("calibration/Calib_scene.toml");
    let chosen = ImportRequest {
        calibration: vec![scene.clone()],
        ..request(folder.path())
    };
    let report = import(&chosen).unwrap();
    assert_eq!(report.calibration, [scene]);
    let text = remarks_text(&report);
    assert!(
        text.contains("found and not taken: ") && text.contains("Calib_qualisys.toml"),
        "{text}"
    );
    assert!(
        !text.contains("not taken: calibration/Calib_scene"),
        "{text}"
    );
}

#[test]
fn calibrations_are_recognised_by_content_not_by_name() {
    let folder = project(&[("Calib_scene.toml", TWO_CAMERAS)]);
    let report = import(&request(folder.path())).unwrap();
    assert!(report.calibration[0].ends_with("calibration/Calib_scene.toml"));
    assert!(!remarks_text(&report).contains("not taken"));
    let folder = project(&[("venue.toml.bak", TWO_CAMERAS)]);
    assert_eq!(import(&request(folder.path())).unwrap().cameras.len(), 2);
}

#[test]
fn of_two_equal_calibrations_one_is_used_and_the_other_reported() {
    let text = TextFile {
        path: "a.toml".into(),
        text: TWO_CAMERAS.to_owned(),
    };
    let cameras = formats::import(&[text], &ImportOptions::default())
        .unwrap()
        .cameras;
    let qualisys = formats::export(&cameras, Format::Qualisys);
    let qualisys = qualisys.unwrap().remove(0).text;
    let folder = project(&[
        ("Calib.toml", TWO_CAMERAS),
        ("a_hall.qca.txt", &qualisys),
        ("cut.toml", &TWO_CAMERAS[..TWO_CAMERAS.len() / 2]),
    ]);
    let report = import(&request(folder.path())).unwrap();
    assert!(
        report.calibration[0].ends_with("Calib.toml"),
        "{:?}",
        report.calibration
    );
    let text = remarks_text(&report);
    for words in [
        "a_hall.qca.txt",
        "qualisys): it has the same content",
        "cut.toml:",
    ] {
        assert!(text.contains(words), "{text}");
    }
}

#[test]
fn files_above_the_folder_are_suggested_but_not_used() {
    let session = tempfile::tempdir().unwrap();
    let at = |name: &str| session.path().join(name);
    write(&at("calibration/Calib_old.toml"), moved().as_bytes());
    write(
        &at("Config.toml"),
        b"[project]\nframe_rate = 50\n[pose]\npose_model = 'BODY_25B'\n",
    );
    let other = project(&[]);
    fs::rename(other.path(), at("trial")).unwrap();
    let refusal = refused(&at("trial"));
    for words in [
        "no calibration is in",
        "Calib_old.toml (20",
        "`--calibration FILE`",
        "qualisys, theia",
    ] {
        assert!(refusal.contains(words), "{refusal}");
    }
    assert!(!at("trial/farfield").exists());
    fs::remove_file(at("trial/Config.toml")).unwrap();
    let chosen = ImportRequest {
        calibration: vec![at("calibration/Calib_old.toml")],
        ..request(&at("trial"))
    };
    let refusal = import(&chosen).unwrap_err().to_string();
    assert!(
        refusal.contains("`--rate 50` `--keypoints BODY_25B`"),
        "{refusal}"
    );
    let chosen = ImportRequest {
        rate_hz: Some(50.0),
        ..chosen
    };
    assert_eq!(import(&chosen).unwrap().cameras.len(), 2);
}

#[test]
fn binary_calibration_files_are_refused_with_their_kind() {
    let folder = project(&[]);
    let pickle = folder.path().join("calibration/rig.pickle");
    write(&pickle, b"\x80\x04\x95\x7f\x02\0\0\0}\x94(\x8c\x06matrix");
    assert!(refused(folder.path()).contains("no calibration is in"));
    let chosen = ImportRequest {
        calibration: vec![pickle],
        ..request(folder.path())
    };
    let refusal = import(&chosen).unwrap_err().to_string();
    for words in [
        "rig.pickle: is a Python pickle",
        "pickle.load(open(\"rig.pickle\"",
        "opencv-json, qualisys",
    ] {
        assert!(refusal.contains(words), "{refusal}");
    }
}
