//! Tests: imports of small folders made here, and of a real recording written in other programs'
//! formats.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use farfield_calibration::formats::Remark;
use farfield_proto::calibration::Calibration;
use farfield_proto::keypoints::COCO23;
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::Venue;
use serde_json::Value;
use tempfile::TempDir;

use super::{ImportRequest, Settings, import, key_chunk};
use crate::error::ImportError;
use crate::formats::{Format, writers as write};
use crate::keypoints::Model;
use crate::person::{Candidate, Frames, Person};
use crate::report::Report;

/// Two cameras in our format.
pub(super) const TWO_CAMERAS: &str = r#"
[int_cam01_img]
name = "int_cam01_img"
size = [640, 480]
matrix = [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [1.2091995761561452, 1.2091995761561452, -1.2091995761561452]
translation = [0.0, 1.5, 4.0]
[int_cam02_img]
name = "int_cam02_img"
size = [640, 480]
matrix = [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [1.5707963267948966, 0.0, 0.0]
translation = [0.0, 1.5, 4.0]
"#;

/// A person who stands in an image of 640 x 480, `x_px` from its left edge.
fn standing(x_px: f64) -> Person {
    std::array::from_fn(|i| {
        Some(Candidate {
            x_px: x_px + i as f64,
            y_px: 60.0 + 18.0 * i as f64,
            score: 0.75,
        })
    })
}

pub(super) fn frames(range: std::ops::Range<i64>) -> Frames {
    range
        .map(|frame| (frame, vec![standing(100.0 + frame as f64)]))
        .collect()
}

pub(super) fn write(path: &Path, bytes: &[u8]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// A folder as Pose2Sim writes it.
pub(super) fn pose2sim(cameras: &[(&str, &Frames)], calibration: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write(
        &at("Config.toml"),
        b"[project]\nframe_rate = 50\n[pose]\npose_model = 'Body_with_feet'\n",
    );
    write(&at("calibration/Calib_board.toml"), calibration.as_bytes());
    for (camera, frames) in cameras {
        for (frame, people) in *frames {
            let text = write::openpose(people, Model::Halpe26);
            write(
                &at(&format!("pose/{camera}_json/{camera}_{frame:06}.json")),
                text.as_bytes(),
            );
        }
    }
    folder
}

pub(super) fn request(folder: &Path) -> ImportRequest {
    ImportRequest {
        folder: folder.to_owned(),
        ..ImportRequest::default()
    }
}

/// The people of one of our keypoint files, by tick.
pub(super) fn people_of(path: &Path) -> Frames {
    let text = fs::read_to_string(path).unwrap();
    let mut frames = Frames::new();
    for line in text.lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        let people = line["persons"].as_array().unwrap().iter().map(|person| {
            let points = person["keypoints"].as_array().unwrap();
            assert!(points.len() <= COCO23.len());
            std::array::from_fn(|i| {
                let number = |k: usize| points[i][k].as_f64().unwrap();
                (i < points.len() && !points[i].is_null()).then(|| Candidate {
                    x_px: number(0),
                    y_px: number(1),
                    score: number(2),
                })
            })
        });
        frames.insert(line["tick"].as_i64().unwrap(), people.collect());
    }
    frames
}

/// Reads the imported venue with its calibration.
fn venue(report: &Report) -> Venue {
    let text = fs::read_to_string(&report.venue).unwrap();
    let calibration = report.venue.with_file_name("calibration.toml");
    let calibration =
        Calibration::parse(&fs::read_to_string(&calibration).unwrap(), &calibration).unwrap();
    Venue::parse(&text, &report.venue, calibration).unwrap()
}

pub(super) fn remarks_text(report: &Report) -> String {
    let text = |it: &Remark| format!("{} {it:?}", it.kind.name());
    let texts: Vec<String> = report.remarks.iter().map(text).collect();
    texts.join("\n")
}

#[test]
fn a_pose2sim_folder_needs_no_option() {
    let (a, b) = (frames(0..20), frames(0..20));
    let folder = pose2sim(&[("cam01", &a), ("cam02", &b)], TWO_CAMERAS);
    let report = import(&request(folder.path())).unwrap();
    assert_eq!(
        (report.format, report.model.as_str()),
        ("openpose", "HALPE_26")
    );
    assert_eq!(report.frames, 20);
    assert_eq!(report.left_out, ["head", "mid hip", "neck"]);
    let venue = venue(&report);
    assert_eq!(venue.keypoints.names(), COCO23);
    assert_eq!(venue.cameras.len(), 2);
    assert!((venue.rate_hz - 50.0).abs() < 1e-12);
    assert_eq!(
        people_of(&folder.path().join("farfield/keypoints/int_cam01_img.jsonl")),
        a
    );
    assert_eq!(
        people_of(&folder.path().join("farfield/keypoints/int_cam02_img.jsonl")),
        b
    );
    // An existing output folder is not overwritten, and it is not read as a recording.
    let again = import(&request(folder.path())).unwrap_err().to_string();
    assert!(again.contains("is there already"), "{again}");
}

#[test]
fn cameras_are_aligned_by_frame_number() {
    let (a, mut b) = (frames(10..30), frames(12..30));
    b.remove(&20);
    let folder = pose2sim(&[("cam01", &a), ("cam02", &b)], TWO_CAMERAS);
    let report = import(&request(folder.path())).unwrap();
    assert_eq!((report.first_frame, report.frames), (10, 20));
    assert_eq!(report.cameras[1].missing_frames, 3);
    let text = remarks_text(&report);
    assert!(
        text.contains("the first frame is 10") && text.contains("from 12 to 29"),
        "{text}"
    );
    let found = people_of(&report.cameras[1].keypoints);
    assert_eq!(found.len(), 20);
    assert!(found[&10].is_empty() && found[&20].is_empty() && found[&12] == b[&12]);
}

#[test]
fn a_missing_frame_rate_is_refused_and_nothing_is_left_behind() {
    let folder = pose2sim(
        &[("cam01", &frames(0..20)), ("cam02", &frames(0..20))],
        TWO_CAMERAS,
    );
    fs::remove_file(folder.path().join("Config.toml")).unwrap();
    let refused = import(&request(folder.path())).unwrap_err().to_string();
    assert!(refused.contains("--rate HZ"), "{refused}");
    assert!(!folder.path().join("farfield").exists());
    let requested = ImportRequest {
        rate_hz: Some(60.0),
        ..request(folder.path())
    };
    assert!((import(&requested).unwrap().rate_hz - 60.0).abs() < 1e-12);
}

#[test]
fn keypoints_of_no_camera_need_explicit_assignment() {
    let folder = pose2sim(
        &[("cam01", &frames(0..20)), ("west", &frames(0..20))],
        TWO_CAMERAS,
    );
    let refused = import(&request(folder.path())).unwrap_err().to_string();
    assert!(refused.contains("west_json is of no camera"), "{refused}");
    let at = |name: &str| folder.path().join(format!("pose/{name}_json"));
    let requested = ImportRequest {
        cameras: vec![
            ("int_cam02_img".to_owned(), at("west")),
            ("int_cam01_img".to_owned(), at("cam01")),
        ],
        ..request(folder.path())
    };
    assert!(
        import(&requested).unwrap().cameras[1]
            .source
            .ends_with("west_json")
    );
    let unknown = ImportRequest {
        cameras: vec![("int_cam03_img".to_owned(), at("west"))],
        out: Some(folder.path().join("other")),
        ..request(folder.path())
    };
    let refused = import(&unknown).unwrap_err().to_string();
    assert!(
        refused.contains("int_cam03_img") && refused.contains("int_cam01_img"),
        "{refused}"
    );
}

#[test]
fn cameras_without_matching_names_are_assigned_in_order_with_a_warning() {
    let folder = pose2sim(
        &[("east", &frames(0..20)), ("west", &frames(0..20))],
        TWO_CAMERAS,
    );
    let report = import(&request(folder.path())).unwrap();
    assert!(report.cameras[0].source.ends_with("east_json"));
    assert!(remarks_text(&report).contains("in order, as Pose2Sim does"));
}

#[test]
fn a_broken_file_among_many_is_reported() {
    let folder = pose2sim(
        &[("cam01", &frames(0..20)), ("cam02", &frames(0..20))],
        TWO_CAMERAS,
    );
    let broken = folder.path().join("pose/cam02_json/cam02_000007.json");
    fs::write(&broken, "{\"people\":\n[{\"pose_keypoints_2d\": [1, 2]}]}").unwrap();
    let refused = import(&request(folder.path())).unwrap_err();
    assert!(matches!(refused, ImportError::File(_)));
    let refused = refused.to_string();
    assert!(
        refused.contains("cam02_000007.json") && refused.contains("people[0]"),
        "{refused}"
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
}

#[test]
fn a_requested_format_reports_why_a_file_is_invalid() {
    let folder = pose2sim(&[], TWO_CAMERAS);
    write(&folder.path().join("cam01.csv"), b"frame,nose.x\n1,2\n");
    let refused = import(&request(folder.path())).unwrap_err().to_string();
    assert!(refused.contains("found no 2D keypoints"), "{refused}");
    let requested = ImportRequest {
        format: Some(Format::Sleap),
        ..request(folder.path())
    };
    let refused = import(&requested).unwrap_err().to_string();
    assert!(
        refused.contains("cam01.csv:1") && refused.contains("frame_idx"),
        "{refused}"
    );
}

#[test]
fn caliscope_and_freemocap_folders_are_read_with_their_calibrations() {
    let (a, b) = (frames(0..20), frames(0..20));
    let cameras = farfield_calibration::formats::import(
        &[farfield_calibration::formats::TextFile {
            path: "a.toml".into(),
            text: TWO_CAMERAS.to_owned(),
        }],
        &farfield_calibration::formats::ImportOptions::default(),
    )
    .unwrap()
    .cameras;
    let text = |format| {
        let files = farfield_calibration::formats::export(&cameras, format).unwrap();
        files.into_iter().next().unwrap().text
    };
    let rate = Some(30.0);
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let caliscope = text(farfield_calibration::formats::Format::Caliscope);
    write(&at("camera_array.toml"), caliscope.as_bytes());
    write(
        &at("recordings/walk/POSE/xy_POSE.csv"),
        write::caliscope(&[&a, &b]).as_bytes(),
    );
    let walk = ImportRequest {
        rate_hz: rate,
        calibration: vec![at("camera_array.toml")],
        ..request(&at("recordings/walk/POSE"))
    };
    let report = import(&walk).unwrap();
    assert_eq!(
        (report.format, report.calibration_format),
        ("caliscope", "caliscope")
    );
    assert_eq!(venue(&report).cameras.len(), 2);
    assert!(
        remarks_text(&report).contains("no scores"),
        "{}",
        remarks_text(&report)
    );

    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let freemocap = text(farfield_calibration::formats::Format::FreeMoCap);
    write(&at("take_camera_calibration.toml"), freemocap.as_bytes());
    let array =
        "output_data/raw_data/mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy";
    write(&at(array), &write::freemocap(&[&a, &b]));
    let report = import(&ImportRequest {
        rate_hz: rate,
        ..request(folder.path())
    })
    .unwrap();
    assert_eq!(report.format, "freemocap");
    assert_eq!(venue(&report).cameras.len(), 2);
    assert!(remarks_text(&report).contains("in the order of the calibration"));
    let pixels = |frames: &Frames| -> Vec<(f64, f64)> {
        let points = frames.values().flatten().flatten().flatten();
        points.map(|it| (it.x_px, it.y_px)).collect()
    };
    let expected = write::known_to(Model::BlazePose, a);
    assert_eq!(
        pixels(&people_of(&report.cameras[0].keypoints)),
        pixels(&expected)
    );
}

/// The folder of the Shelf recording; `None` with a message if it is absent.
fn shelf() -> Option<PathBuf> {
    let default_root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let root = env::var_os("FARFIELD_DATA").map_or(default_root, PathBuf::from);
    let folder = root.join("data/shelf");
    if folder.join("cam0.jsonl").is_file() {
        return Some(folder);
    }
    eprintln!(
        "skipped: {} is not there (FARFIELD_DATA names its root)",
        folder.display()
    );
    None
}

/// What a run reads from a keypoint file: people with at least one keypoint, and scores clamped to
/// 1. `OpenPose` exceeds 1 at three keypoints of this recording.
fn people_found(path: &Path) -> Frames {
    let mut frames = people_of(path);
    for people in frames.values_mut() {
        people.retain(|person| person.iter().any(Option::is_some));
        for found in people.iter_mut().flatten().flatten() {
            found.score = found.score.min(1.0);
        }
    }
    frames
}

#[test]
fn shelf_imported_from_three_formats_equals_the_reference() {
    let Some(shelf) = shelf() else { return };
    let by_hand: BTreeMap<String, Frames> = (0..5)
        .map(|i| {
            (
                format!("cam{i}"),
                people_found(&shelf.join(format!("cam{i}.jsonl"))),
            )
        })
        .collect();
    let same = |format: &str, fill: &dyn Fn(&Path, &str, &Frames)| {
        let folder = tempfile::tempdir().unwrap();
        fs::copy(
            shelf.join("calibration.toml"),
            folder.path().join("Calib.toml"),
        )
        .unwrap();
        for (camera, frames) in &by_hand {
            fill(folder.path(), camera, frames);
        }
        let requested = ImportRequest {
            rate_hz: Some(20.0),
            ..request(folder.path())
        };
        let report = import(&requested).unwrap();
        println!("{format}: {report:#?}");
        assert_eq!(report.format, format);
        assert_eq!((report.first_frame, report.frames), (300, 301));
        for camera in &report.cameras {
            assert_eq!(
                people_of(&camera.keypoints),
                by_hand[&camera.name],
                "{}",
                camera.name
            );
        }
        let venue = venue(&report);
        let text = fs::read_to_string(shelf.join("calibration.toml")).unwrap();
        let ours = Calibration::parse(&text, Path::new("calibration.toml")).unwrap();
        for camera in &venue.cameras {
            let (a, b) = (&camera.model, &ours.cameras[camera.model.name()]);
            let apart_m = (a.center().coordinates_m() - b.center().coordinates_m()).norm();
            assert!(apart_m < 1e-9, "{apart_m} m");
        }
    };
    same("openpose", &|folder, camera, frames| {
        for (frame, people) in frames {
            let text = write::openpose(people, Model::Body25);
            let name = format!("pose/{camera}_json/{camera}_{frame:012}_keypoints.json");
            write(&folder.join(name), text.as_bytes());
        }
    });
    same("coco-results", &|folder, camera, frames| {
        write(
            &folder.join(format!("{camera}.json")),
            write::coco_results(frames).as_bytes(),
        );
    });
    same("alphapose", &|folder, camera, frames| {
        let name = format!("{camera}/alphapose-results.json");
        write(&folder.join(name), write::alphapose(frames).as_bytes());
    });
}

fn parse_settings(text: &str) -> Result<Settings, FileError> {
    Settings::parse(text, Path::new("Config.toml"))
}

#[test]
fn rate_and_model_are_read_and_auto_is_ignored() {
    let settings =
        parse_settings("[project]\nframe_rate = 60\n[pose]\npose_model = 'Body_with_feet'\n");
    let expected = Settings {
        rate_hz: Some(60.0),
        model: Some(Model::Halpe26),
    };
    assert_eq!(settings, Ok(expected));
    let settings = parse_settings("[project]\nframe_rate = 'auto'\n");
    assert_eq!(settings, Ok(Settings::default()));
}

#[test]
fn an_invalid_rate_is_refused_with_its_line() {
    let message = parse_settings("[project]\nframe_rate = -3\n")
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("Config.toml:2") && message.contains("frame_rate"),
        "{message}"
    );
}

#[test]
fn names_become_valid_key_chunks() {
    for (name, chunk) in [
        ("cam 1/é", "cam-1--"),
        ("", "venue"),
        ("..", "venue"),
        ("a.b", "a.b"),
    ] {
        assert_eq!(key_chunk(name), chunk);
    }
}
