//! A calibration from people, as a user makes one: three of them walk through the hall of the sample, and what a network saw of
//! them is a file for each camera.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::fs;

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_sim::embedded::{write_detector, write_network};
use image::RgbImage;
use nalgebra::{Point3, Vector3};
use serde_json::Value;

use super::seen_hall::{SeenHall, calibration};
use crate::data::onnx_runtime;
use crate::farfield::farfield;

/// How long people walk, seconds.
const WALK_S: f64 = 40.0;
/// Frames per second of the files.
const RATE_HZ: f64 = 10.0;
/// Statures, metres.
const PEOPLE_M: [f64; 3] = [1.68, 1.83, 1.75];

/// Where somebody is on the floor.
fn place_m(who: usize, time_s: f64) -> Vector3<f64> {
    let shift = 2.1 * who as f64;
    let x = 2.2 * (0.37 * time_s + shift).sin() + 0.5 * (1.1 * time_s + shift).sin();
    let y = 2.2 * (0.29 * time_s + 2.3 * shift).sin() + 0.5 * (0.9 * time_s).cos();
    Vector3::new(x, y, 0.0)
}

/// COCO's 17 keypoints of a walking body, world, metres; lengths are shares of the stature.
fn body_m(who: usize, time_s: f64) -> Vec<Vector3<f64>> {
    let stature_m = PEOPLE_M[who];
    let at = place_m(who, time_s);
    let ahead = (place_m(who, time_s + 0.05) - place_m(who, time_s - 0.05)).normalize();
    let left = Vector3::z().cross(&ahead);
    let up = |share: f64| at + Vector3::z() * (share * stature_m);
    let gait = TAU * 0.9 * time_s + who as f64;
    let sides = [(1.0, gait), (-1.0, gait + PI)];
    let both =
        |joint: &dyn Fn(f64, f64) -> Vector3<f64>| sides.map(|(side, phase)| joint(side, phase));
    let beside = |share: f64, aside_m: f64, swing_m: f64| {
        both(&move |side, phase| {
            up(share) + left * (side * aside_m) + ahead * (swing_m * phase.sin())
        })
    };
    let lifted = |share: f64, swing_m: f64, lift_m: f64| {
        both(&move |side, phase| {
            let lift = Vector3::z() * (lift_m * phase.cos().max(0.0));
            up(share) + left * (side * 0.08) + ahead * (swing_m * phase.sin()) + lift
        })
    };
    let mut joints = vec![up(0.93) + ahead * 0.1];
    for pair in [
        beside(0.945, 0.03, 0.0).map(|it| it + ahead * 0.08),
        beside(0.94, 0.075, 0.0),
        beside(0.818, 0.19, 0.0),
        beside(0.63, 0.23, -0.12),
        beside(0.49, 0.24, -0.22),
        beside(0.53, 0.085, 0.0),
        lifted(0.285, 0.15, 0.08),
        lifted(0.039, 0.3, 0.12),
    ] {
        joints.extend(pair);
    }
    joints
}

/// A share of the same wild number for the same place in the test.
fn jitter(seed: f64) -> f64 {
    let wild = 43758.5453 * (12.9898 * seed).sin();
    wild - wild.floor() - 0.5
}

/// What a network makes of what `camera` saw: a line a frame, people in changing order.
fn seen_at(rate_hz: f64, camera: &CameraModel, number: usize) -> String {
    let mut text = String::new();
    for frame in 0..(WALK_S * rate_hz) as u32 {
        let mut persons = Vec::new();
        for turn in 0..PEOPLE_M.len() {
            let who = (turn + frame as usize) % PEOPLE_M.len();
            let joints = body_m(who, f64::from(frame) / rate_hz)
                .into_iter()
                .enumerate();
            let keypoints = joints.map(|(index, at)| {
                let pixel = camera.project(Point::new(Point3::from(at)));
                let pixel = pixel.filter(|pixel| camera.sees(*pixel))?;
                let pixel = camera.distort(pixel)?;
                let seed = f64::from(frame) + 0.37 * index as f64 + 7.0 * (who + 5 * number) as f64;
                Some([
                    pixel.x() + 4.0 * jitter(seed),
                    pixel.y() + 4.0 * jitter(seed + 0.5),
                    0.9,
                ])
            });
            let keypoints: Vec<Option<[f64; 3]>> = keypoints.collect();
            if keypoints.iter().flatten().count() >= 8 {
                persons.push(serde_json::json!({ "keypoints": keypoints }));
            }
        }
        writeln!(
            text,
            "{}",
            serde_json::json!({ "tick": frame, "persons": persons })
        )
        .unwrap();
    }
    text
}

fn walked_hall() -> SeenHall {
    SeenHall::new("jsonl", |camera, number| seen_at(RATE_HZ, camera, number))
}

/// The first two cameras and their distance, metres.
fn distance(hall: &SeenHall) -> (String, f64) {
    let mut cameras = hall.truth.cameras.values();
    let (a, b) = (cameras.next().unwrap(), cameras.next().unwrap());
    let apart = a.center().coordinates_m() - b.center().coordinates_m();
    (format!("{},{}", a.name(), b.name()), apart.norm())
}

/// Up, floor and metres are the venue's; where it lies on the floor is not known.
fn assert_as_in_truth(found: &Calibration, truth: &Calibration) {
    let pinhole = |of: &Calibration, name: &str| of.cameras[name].center().coordinates_m().coords;
    for name in truth.cameras.keys() {
        let (here, there) = (pinhole(found, name), pinhole(truth, name));
        assert!((here.z - there.z).abs() < 0.1, "{name}: {here} {there}");
        for other in truth.cameras.keys() {
            let apart_m = (here - pinhole(found, other)).norm();
            let true_m = (there - pinhole(truth, other)).norm();
            println!(
                "{name} to {other}: {:.1} mm off",
                1000.0 * (apart_m - true_m)
            );
            assert!((apart_m - true_m).abs() < 0.03, "{name}, {other}");
        }
    }
}

#[test]
fn people_who_walk_through_the_hall_calibrate_its_cameras() {
    let walked = walked_hall();
    let (pair, distance_m) = distance(&walked);
    let known = format!("--distance={pair}={distance_m}");
    let done = walked.calibrate("people", &["--rate-hz", "10", &known, "--json"]);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let found = calibration(&walked.folder.path("found.toml"));
    assert_as_in_truth(&found, &walked.truth);
    let said: Value = serde_json::from_str(&done.stdout).unwrap();
    assert!(
        said["field"]["cells"].as_array().unwrap().len() > 50,
        "{said}"
    );
    assert_eq!(said["cameras"][0]["picture"].as_array().unwrap().len(), 4);
    let sheet = fs::read_to_string(walked.folder.path("found.html")).unwrap();
    for expected in [
        "It passes.",
        "<h2>The field</h2>",
        "What the pictures saw",
        "url(#stripes)",
    ] {
        assert!(sheet.contains(expected), "{expected}");
    }
    assert_eq!(sheet.matches("id=\"stripes\"").count(), 1);
}

#[test]
fn people_whose_size_nobody_knows_do_not_pass_and_a_rate_is_asked_for() {
    let walked = walked_hall();
    let done = walked.calibrate("people", &["--rate-hz", "10"]);
    assert_eq!(done.code, 1, "{}\n{}", done.stdout, done.stderr);
    assert!(
        done.stdout.contains("how long a metre is"),
        "{}",
        done.stdout
    );
    assert!(
        !walked.folder.path("found.toml").exists(),
        "it takes the place of none"
    );
    let done = walked.calibrate("people", &[]);
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(done.stderr.contains("--rate-hz"), "{}", done.stderr);
}

#[test]
fn a_recording_of_people_calibrates_its_cameras_anew_when_one_was_moved() {
    let rate_hz = 20.0;
    let walked = SeenHall::new("jsonl", |camera, number| seen_at(rate_hz, camera, number));
    let folder = &walked.folder;
    folder.replace("venue.toml", "rate_hz = 30.0", "rate_hz = 20.0");
    // In the calibration that was run with, the first camera stands half a metre beside where it is.
    let [before, after] = ["1.7763568394002505e-15", "0.5"];
    folder.replace("calibration.toml", before, after);
    let [venue, out] = [folder.path("venue.toml"), folder.path("run")];
    let [venue, out] = [venue.to_str().unwrap(), out.to_str().unwrap()];
    // Whatever it makes of cameras that do not agree.
    let ran = farfield(&["run", venue, "--out", out, "--record"]);
    println!("{}\n{}", ran.stdout, ran.stderr);
    let recording = folder.path("run/recording.mcap");
    let (pair, distance_m) = distance(&walked);
    let (known, found) = (
        format!("--distance={pair}={distance_m}"),
        folder.path("found.toml"),
    );
    let words = ["calibrate", "people", recording.to_str().unwrap(), &known];
    let more = ["--out", found.to_str().unwrap()];
    let done = farfield(&[&words[..], &more].concat());
    println!("{}", done.stdout);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    assert_as_in_truth(&calibration(&found), &walked.truth);

    let refused = farfield(&[&words[..], &["--rate-hz", "20"]].concat());
    assert_eq!(refused.code, 2, "{}", refused.stdout);
    let why = "is a recording, which knows its rate";
    assert!(refused.stderr.contains(why), "{}", refused.stderr);
}

/// Nobody makes pictures in which the small embedded networks see people for so long: what they saw in recordings of two empty
/// pictures gives way to the walk, as if they had seen that, and is taken up.
#[test]
fn people_whom_networks_saw_in_recordings_calibrate_the_cameras() {
    if !onnx_runtime("people in recordings, all the way to a calibration") {
        return;
    }
    let walked = walked_hall();
    let folder = &walked.folder;
    let networks = folder.path("networks");
    let network = networks.join(write_network(&networks).unwrap());
    let detector = networks.join(write_detector(&networks).unwrap());
    for camera in walked.truth.cameras.values() {
        let pictures = folder.path(&format!("recordings/{}", camera.name()));
        fs::create_dir_all(&pictures).unwrap();
        let [width, height] = camera.size_px();
        for number in 0..2 {
            let picture = RgbImage::new(width, height);
            picture
                .save(pictures.join(format!("{number}.png")))
                .unwrap();
        }
    }
    let (pair, distance_m) = distance(&walked);
    let known = format!("--distance={pair}={distance_m}");
    let [recordings, lens, seen, out] =
        ["recordings", "calibration.toml", "seen", "found.toml"].map(|name| folder.path(name));
    let paths = [&recordings, &lens, &network, &detector, &seen, &out];
    let [recordings, lens, network, detector, seen_in, out_to] =
        paths.map(|path| path.to_str().unwrap());
    let words = [
        ["calibrate", "people"],
        [recordings, &known],
        ["--lens", lens],
        ["--network", network],
        ["--detector", detector],
        ["--rate-hz", "10"],
        ["--looks-hz", "10"],
        ["--seen", seen_in],
        ["--out", out_to],
    ];
    let nobody = farfield(&words.concat());
    assert_eq!(nobody.code, 2, "{}\n{}", nobody.stdout, nobody.stderr);
    let why = "nobody was seen in any recording";
    assert!(nobody.stderr.contains(why), "{}", nobody.stderr);

    for camera in walked.truth.cameras.values() {
        let file = seen.join(format!("{}.jsonl", camera.name()));
        let text = fs::read_to_string(folder.path(&format!("{}.jsonl", camera.name()))).unwrap();
        let beside = file.with_extension("kept.json");
        let mut kept: Value = serde_json::from_slice(&fs::read(&beside).unwrap()).unwrap();
        kept["lines"] = blake3::hash(text.as_bytes()).to_hex()[..32].into();
        kept["bodies"] = text.lines().count().into();
        fs::write(&beside, kept.to_string()).unwrap();
        fs::write(&file, text).unwrap();
    }
    let done = farfield(&words.concat());
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let taken_up = done.stderr.matches("where they were found earlier");
    assert_eq!(taken_up.count(), walked.truth.cameras.len());
    assert_as_in_truth(&calibration(&out), &walked.truth);
}
