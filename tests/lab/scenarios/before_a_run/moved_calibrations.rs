//! Valid calibrations with a distant origin or of rotated images: the advice of a check is followed and works.

use std::fs;

use farfield_calibration::formats::{Format, ImportOptions, TextFile, export, import};
use nalgebra::Vector3;

use crate::data::SampleFolder;
use crate::farfield::{poses, run};

/// Origin of the sample in surveyed coordinates (UTM), metres.
const SURVEYED_M: [f64; 3] = [500_000.0, 5_000_000.0, 120.0];
/// At 50 km from the origin poses still work, in coarse steps.
const FAR_M: [f64; 3] = [30_000.0, 40_000.0, 0.0];

/// The sample without a field, with the origin of its calibration moved by `at_m`.
fn sample_at(at_m: [f64; 3]) -> SampleFolder {
    let folder = SampleFolder::new();
    let field = "[field]\nmin_m = [-4.0, -4.0, -0.3]\nmax_m = [4.0, 4.0, 2.4]\n";
    folder.replace("venue.toml", field, "");
    let path = folder.path("calibration.toml");
    let text = fs::read_to_string(&path).unwrap();
    let file = TextFile { path, text };
    let mut cameras = import(std::slice::from_ref(&file), &ImportOptions::default())
        .unwrap()
        .cameras;
    for pose in cameras
        .iter_mut()
        .filter_map(|it| it.camera_from_world.as_mut())
    {
        pose.translation.vector -= pose.rotation * Vector3::from(at_m);
    }
    let text = export(&cameras, Format::Farfield).unwrap().remove(0).text;
    fs::write(&file.path, text).unwrap();
    folder
}

/// Positions of the pelvis by tick and person, metres.
fn hips(folder: &SampleFolder, out: &str) -> Vec<[f64; 3]> {
    let poses = poses(&folder.path(out));
    let number = |pose: &serde_json::Value, i: usize| pose["joints"]["pelvis"][i].as_f64().unwrap();
    poses
        .iter()
        .map(|pose| [0, 1, 2].map(|i| number(pose, i)))
        .collect()
}

/// The word after `option` in the output.
fn advised(printed: &str, option: &str) -> String {
    let rest = printed
        .split(option)
        .nth(1)
        .unwrap_or_else(|| panic!("{option}: {printed}"));
    rest.split_whitespace().next().unwrap().to_owned()
}

#[test]
fn surveyed_coordinates_are_refused_with_a_usable_origin() {
    let folder = sample_at(SURVEYED_M);
    let refused = folder.farfield(&["check", "venue.toml"]);
    assert_eq!(refused.code, 1, "{}", refused.stdout);
    let printed = &refused.stdout;
    assert!(
        printed.contains("about (500000, 5000000, 120) m"),
        "{printed}"
    );
    assert!(!printed.contains("calibrate again"), "{printed}");
    let origin = advised(printed, "--origin ");
    assert_eq!(origin, "500000,5000000,120");

    for (origin, out) in [(origin.as_str(), "stated"), ("auto", "found")] {
        let words = [
            "calibrate",
            "convert",
            "calibration.toml",
            "--origin",
            origin,
            "--out",
            out,
        ];
        let converted = folder.farfield(&words);
        assert_eq!(converted.code, 0, "{}", converted.stderr);
        let stdout = &converted.stdout;
        assert!(stdout.contains("moved to (500000, 5000000, "), "{stdout}");
        let text = fs::read_to_string(folder.path(out).join("calibration.toml")).unwrap();
        assert!(text.contains("origin_m = [500000.0, 5000000.0, "), "{text}");
    }
    folder.replace(
        "venue.toml",
        "\"calibration.toml\"",
        "\"stated/calibration.toml\"",
    );
    let checked = folder.farfield(&["check", "venue.toml"]);
    assert_eq!(checked.code, 0, "{}", checked.stdout);
    run(&folder.path("venue.toml"), &folder.path("surveyed"), &[]);
    let near = sample_at([0.0; 3]);
    run(&near.path("venue.toml"), &near.path("by_hand"), &[]);
    let (surveyed, by_hand) = (hips(&folder, "surveyed"), hips(&near, "by_hand"));
    assert_eq!((surveyed.len(), by_hand.len()), (240, 240));
    let apart = |(a, b): (&[f64; 3], &[f64; 3])| (Vector3::from(*a) - Vector3::from(*b)).norm();
    let apart_m = surveyed.iter().zip(&by_hand).map(apart).fold(0.0, f64::max);
    assert!(apart_m < 2e-3, "{apart_m} m");
}

#[test]
fn coarse_steps_far_from_the_origin_are_reported() {
    let checked = sample_at(FAR_M).farfield(&["check", "venue.toml"]);
    let words = "the cameras stand 50 km from the origin: poses come in steps of 3.9 mm there";
    assert!(checked.stdout.contains(words), "{}", checked.stdout);
    assert_eq!(advised(&checked.stdout, "--origin "), "30000,40000,0");
}

/// Turns a calibration of the folder by `--turn` and makes the venue use the result in `out`.
fn turn(folder: &SampleFolder, calibration: &str, turn: &str, out: &str) {
    let turn = format!("--turn={turn}");
    let done = folder.farfield(&["calibrate", "convert", calibration, &turn, "--out", out]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let before = format!("calibration = \"{calibration}\"");
    folder.replace(
        "venue.toml",
        &before,
        &format!("calibration = \"{out}/calibration.toml\""),
    );
}

#[test]
fn a_camera_on_its_side_is_turned_by_following_the_advice() {
    for (turned_deg, filter, advice) in [
        ("90", "transpose=2", "north-east=-90"),
        ("-90", "transpose=1", "north-east=90"),
        ("180", "hflip,vflip", "north-east=180"),
    ] {
        let folder = SampleFolder::new();
        turn(
            &folder,
            "calibration.toml",
            &format!("north-east={turned_deg}"),
            "turned",
        );
        let printed = folder.farfield(&["check", "venue.toml"]).stdout;
        assert!(
            printed.contains("nothing has to be turned: its keypoints"),
            "{printed}"
        );
        assert!(!printed.contains("-vf "), "{printed}");
        // The advice for a video applies to its images; the video file need not exist.
        let keypoints = "{ kind = \"keypoints\", path = \"north-east.jsonl\" }";
        folder.replace(
            "venue.toml",
            keypoints,
            "{ kind = \"video\", path = \"north-east.mp4\" }",
        );
        folder.replace(
            "venue.toml",
            "rate_hz = 30.0\n",
            "rate_hz = 30.0\nnetwork = \"card.toml\"\n",
        );
        let printed = folder.farfield(&["check", "venue.toml"]).stdout;
        assert_eq!(advised(&printed, "--turn "), advice, "{printed}");
        assert!(printed.contains(&format!("-vf {filter} ")), "{printed}");
        turn(&folder, "turned/calibration.toml", advice, "upright");
        let printed = folder.farfield(&["check", "venue.toml"]).stdout;
        assert!(!printed.contains("its picture is"), "{printed}");
    }
}
