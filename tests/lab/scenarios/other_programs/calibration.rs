//! A calibration, as a user makes one: from a light that was carried through the hall of the sample, from pictures of a
//! board, from another program's file.

use std::fs;
use std::path::Path;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use nalgebra::Point3;
use serde_json::Value;

use super::seen_hall::{SeenHall, calibration};
use crate::data::{SampleFolder, recording};
use crate::farfield::farfield;

/// Frames in which the light is carried.
const FRAMES: u32 = 600;

/// Where the light is, world, metres: all over the field, from knee to as high as an arm reaches.
fn light_m(frame: u32) -> Point3<f64> {
    let t = 0.05 * f64::from(frame);
    Point3::new(
        3.0 * (0.37 * t).sin(),
        3.0 * (0.23 * t + 1.0).sin(),
        1.2 + 0.9 * (0.71 * t + 0.4).sin(),
    )
}

/// A third of a pixel here, a third there; the same every time.
fn jitter_px(frame: u32, camera: usize) -> [f64; 2] {
    let seed = f64::from(frame) + 1000.0 * camera as f64;
    [12.9898, 78.233].map(|by| {
        let wild = 43758.5453 * (by * seed).sin();
        0.7 * (wild - wild.floor() - 0.5)
    })
}

/// What `camera` sees of the light: one line a frame.
fn seen_by(camera: &CameraModel, number: usize) -> String {
    let mut text = "frame x y\n".to_owned();
    for frame in 0..FRAMES {
        let pixel = camera.project(Point::new(light_m(frame)));
        let pixel = pixel.filter(|pixel| camera.sees(*pixel));
        if let Some(pixel) = pixel.and_then(|pixel| camera.distort(pixel)) {
            let [dx, dy] = jitter_px(frame, number);
            let line = format!("{frame} {:.3} {:.3}\n", pixel.x() + dx, pixel.y() + dy);
            text.push_str(&line);
        }
    }
    text
}

fn carried_light() -> SeenHall {
    SeenHall::new("txt", seen_by)
}

/// Where three of the cameras stand, as a user who has measured it says.
fn places(hall: &SeenHall) -> Vec<String> {
    let known = hall.truth.cameras.values().take(3);
    known
        .map(|camera| {
            let at_m = camera.center().coordinates_m();
            format!("--at={}={},{},{}", camera.name(), at_m.x, at_m.y, at_m.z)
        })
        .collect()
}

#[test]
fn a_light_that_was_carried_through_the_hall_calibrates_its_cameras() {
    let light = carried_light();
    let places = places(&light);
    let places: Vec<&str> = places.iter().map(String::as_str).collect();
    let done = light.calibrate("points", &places);
    println!("{}", done.stdout);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let found = calibration(&light.folder.path("found.toml"));
    for (name, camera) in &light.truth.cameras {
        let at_m = found.cameras[name].center().coordinates_m();
        let apart_m = (at_m - camera.center().coordinates_m()).norm();
        println!("{name}: {:.1} mm from the truth", 1000.0 * apart_m);
        assert!(apart_m < 0.005, "{name}: {apart_m} m");
    }
    let sheet = fs::read_to_string(light.folder.path("found.html")).unwrap();
    assert!(
        sheet.contains("It passes.") && sheet.contains("<svg"),
        "{sheet}"
    );

    let again = light.calibrate("points", &places);
    assert_eq!(again.code, 2, "{}", again.stdout);
    assert!(again.stderr.contains("--replace"), "{}", again.stderr);
}

#[test]
fn a_calibration_without_a_length_is_written_and_does_not_pass() {
    let light = carried_light();
    let done = light.calibrate("points", &["--json"]);
    assert_eq!(done.code, 1, "{}\n{}", done.stdout, done.stderr);
    // One document, whatever happens.
    let said: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(said["passes"], false);
    assert_eq!(said["exit_code"], 1);
    assert!(said["findings"].to_string().contains("metre"), "{said}");
    let sheet = fs::read_to_string(light.folder.path("found.failed.html")).unwrap();
    assert!(sheet.contains("It does not pass."), "{sheet}");
    assert!(light.folder.path("found.failed.toml").is_file());
    assert!(
        !light.folder.path("found.toml").exists(),
        "it takes the place of none"
    );
}

#[test]
fn what_cannot_be_calibrated_is_refused_by_name() {
    let light = carried_light();
    let refused = |more: &[&str], told: &str| {
        let done = light.calibrate("points", more);
        assert_eq!(done.code, 2, "{told}\n{}\n{}", done.stdout, done.stderr);
        assert!(done.stderr.contains(told), "{told}: {}", done.stderr);
        println!("{}", done.stderr.lines().last().unwrap());
    };
    refused(&["--at", "norht=0,0,3"], "unknown camera `norht`");
    refused(&["--distance", "north-east=3"], "A,B=METRES");
    refused(&["--clocks", "given"], "rate_hz");
    refused(&["--rate-hz", "50"], "--clocks given, or unknown");
    let broken = light.folder.path("north-east.txt");
    fs::write(&broken, "frame x y\n0 1.0 2.0\n1 1.0\n").unwrap();
    refused(&[], "north-east.txt:3");
}

#[test]
fn another_programs_calibration_comes_in_and_goes_out_again() {
    let sample = SampleFolder::new();
    let ours = sample.path("calibration.toml");
    let convert = |from: &Path, to: &str, out: &Path| {
        let words = [
            "calibrate",
            "convert",
            from.to_str().unwrap(),
            "--to",
            to,
            "--out",
        ];
        let done = farfield(&[&words[..], &[out.to_str().unwrap()]].concat());
        assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
        println!("{}", done.stdout);
    };
    let (there, back) = (sample.path("there"), sample.path("back"));
    convert(&ours, "qualisys", &there);
    convert(&there.join("calibration.qca.txt"), "farfield", &back);
    let (first, second) = (
        calibration(&ours),
        calibration(&back.join("calibration.toml")),
    );
    assert_eq!(first.cameras.len(), second.cameras.len());
    for (name, camera) in &first.cameras {
        let same = &second.cameras[name];
        let apart_m = (camera.center().coordinates_m() - same.center().coordinates_m()).norm();
        assert!(apart_m < 1e-6, "{}: {apart_m} m", camera.name());
    }
}

#[test]
fn pictures_of_a_chessboard_tell_a_lens() {
    let needed = "data/pose2sim/single/intrinsics/int_cam01_img";
    let Some(pictures) = recording("pictures of a chessboard", needed) else {
        return;
    };
    let out = tempfile::tempdir().unwrap();
    let words = [
        "calibrate",
        "board",
        pictures.to_str().unwrap(),
        "--chessboard",
        "4x7",
    ];
    let more = ["--square-mm", "60", "--camera", "cam01", "--out"];
    let done = farfield(&[&words[..], &more, &[out.path().to_str().unwrap()]].concat());
    println!("{}", done.stdout);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    assert!(out.path().join("cam01.yml").is_file() || out.path().join("cam01.yaml").is_file());
    let eight = [
        &words[..],
        &more,
        &[
            out.path().to_str().unwrap(),
            "--coefficients",
            "8",
            "--replace",
        ],
    ];
    let done = farfield(&eight.concat());
    assert_eq!(
        done.code, 2,
        "eight coefficients of seven pictures: {}",
        done.stdout
    );
    assert!(
        done.stderr.contains("do not carry 8 coefficients"),
        "{}",
        done.stderr
    );
}
