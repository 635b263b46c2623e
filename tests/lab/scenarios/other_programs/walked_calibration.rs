//! Calibration from people by a user: three people walk through the room of the sample, and each camera has a file of
//! their keypoints.

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

use super::calibration::{SeenHall, calibration};
use crate::data::onnx_runtime;
use crate::farfield::farfield;

/// Duration of the walk, seconds.
const WALK_S: f64 = 40.0;
/// Frames per second of the files.
const RATE_HZ: f64 = 10.0;
/// Statures, metres.
const PEOPLE_M: [f64; 3] = [1.68, 1.83, 1.75];

/// Position of a person on the floor.
fn place_m(person: usize, time_s: f64) -> Vector3<f64> {
    let shift = 2.1 * person as f64;
    let x = 2.2 * (0.37 * time_s + shift).sin() + 0.5 * (1.1 * time_s + shift).sin();
    let y = 2.2 * (0.29 * time_s + 2.3 * shift).sin() + 0.5 * (0.9 * time_s).cos();
    Vector3::new(x, y, 0.0)
}

/// COCO's 17 keypoints of a walking body, world, metres; lengths are shares of the stature.
fn body_m(person: usize, time_s: f64) -> Vec<Vector3<f64>> {
    let stature_m = PEOPLE_M[person];
    let at = place_m(person, time_s);
    let ahead = (place_m(person, time_s + 0.05) - place_m(person, time_s - 0.05)).normalize();
    let left = Vector3::z().cross(&ahead);
    let up = |share: f64| at + Vector3::z() * (share * stature_m);
    let gait = TAU * 0.9 * time_s + person as f64;
    let sides = [(1.0, gait), (-1.0, gait + PI)];
    let both =
        |joint: &dyn Fn(f64, f64) -> Vector3<f64>| sides.map(|(side, phase)| joint(side, phase));
    let pair_at = |share: f64, aside_m: f64, swing_m: f64| {
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
        pair_at(0.945, 0.03, 0.0).map(|it| it + ahead * 0.08),
        pair_at(0.94, 0.075, 0.0),
        pair_at(0.818, 0.19, 0.0),
        pair_at(0.63, 0.23, -0.12),
        pair_at(0.49, 0.24, -0.22),
        pair_at(0.53, 0.085, 0.0),
        lifted(0.285, 0.15, 0.08),
        lifted(0.039, 0.3, 0.12),
    ] {
        joints.extend(pair);
    }
    joints
}

/// A reproducible pseudorandom number from -0.5 to 0.5.
fn jitter(seed: f64) -> f64 {
    let wild = 43758.5453 * (12.9898 * seed).sin();
    wild - wild.floor() - 0.5
}

/// Keypoints of a network for `camera`: one line per frame, people in changing order.
fn keypoints_at(rate_hz: f64, camera: &CameraModel, number: usize) -> String {
    let mut text = String::new();
    for frame in 0..(WALK_S * rate_hz) as u32 {
        let mut persons = Vec::new();
        for turn in 0..PEOPLE_M.len() {
            let person = (turn + frame as usize) % PEOPLE_M.len();
            let joints = body_m(person, f64::from(frame) / rate_hz)
                .into_iter()
                .enumerate();
            let keypoints = joints.map(|(index, at)| {
                let pixel = camera.project(Point::new(Point3::from(at)));
                let pixel = pixel.filter(|pixel| camera.sees(*pixel))?;
                let pixel = camera.distort(pixel)?;
                let seed =
                    f64::from(frame) + 0.37 * index as f64 + 7.0 * (person + 5 * number) as f64;
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
    SeenHall::new("jsonl", |camera, number| {
        keypoints_at(RATE_HZ, camera, number)
    })
}

/// The first two cameras and their distance, metres.
fn distance(hall: &SeenHall) -> (String, f64) {
    let mut cameras = hall.truth.cameras.values();
    let (a, b) = (cameras.next().unwrap(), cameras.next().unwrap());
    let apart = a.center().coordinates_m() - b.center().coordinates_m();
    (format!("{},{}", a.name(), b.name()), apart.norm())
}

/// Up, floor and scale equal the truth; the position on the floor is unknown.
fn assert_close_to_truth(found: &Calibration, truth: &Calibration) {
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
fn people_who_walk_through_the_room_calibrate_its_cameras() {
    let walked = walked_hall();
    let (pair, distance_m) = distance(&walked);
    let known = format!("--distance={pair}={distance_m}");
    let done = walked.calibrate("people", &["--rate-hz", "10", &known, "--json"]);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let found = calibration(&walked.folder.path("found.toml"));
    assert_close_to_truth(&found, &walked.truth);
    let report: Value = serde_json::from_str(&done.stdout).unwrap();
    assert!(
        report["field"]["cells"].as_array().unwrap().len() > 50,
        "{report}"
    );
    assert_eq!(report["cameras"][0]["picture"].as_array().unwrap().len(), 4);
    let sheet = fs::read_to_string(walked.folder.path("found.html")).unwrap();
    for expected in [
        "It passes.",
        "<h2>The field</h2>",
        "Coverage of the images",
        "url(#stripes)",
    ] {
        assert!(sheet.contains(expected), "{expected}");
    }
    assert_eq!(sheet.matches("id=\"stripes\"").count(), 1);
}

#[test]
fn people_without_a_known_length_or_a_rate_do_not_pass() {
    let walked = walked_hall();
    let done = walked.calibrate("people", &["--rate-hz", "10"]);
    assert_eq!(done.code, 1, "{}\n{}", done.stdout, done.stderr);
    assert!(
        done.stdout.contains("the length of a metre is unknown"),
        "{}",
        done.stdout
    );
    assert!(
        !walked.folder.path("found.toml").exists(),
        "a failed calibration replaces none"
    );
    let done = walked.calibrate("people", &[]);
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(done.stderr.contains("--rate-hz"), "{}", done.stderr);
}

#[test]
fn a_recording_recalibrates_cameras_after_one_was_moved() {
    let rate_hz = 20.0;
    let walked = SeenHall::new("jsonl", |camera, number| {
        keypoints_at(rate_hz, camera, number)
    });
    let folder = &walked.folder;
    folder.replace("venue.toml", "rate_hz = 30.0", "rate_hz = 20.0");
    // The calibration of the run has the first camera half a metre off.
    let [before, after] = ["1.7763568394002505e-15", "0.5"];
    folder.replace("calibration.toml", before, after);
    let [venue, out] = [folder.path("venue.toml"), folder.path("run")];
    let [venue, out] = [venue.to_str().unwrap(), out.to_str().unwrap()];
    // The result for cameras that disagree does not matter here.
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
    assert_close_to_truth(&calibration(&found), &walked.truth);

    let refused = farfield(&[&words[..], &["--rate-hz", "20"]].concat());
    assert_eq!(refused.code, 2, "{}", refused.stdout);
    let why = "is a recording, which contains its rate";
    assert!(refused.stderr.contains(why), "{}", refused.stderr);
}

/// The small embedded networks cannot see people in so long a recording. So the files that they wrote for two empty images
/// are replaced by the keypoints of the walk, and reused.
#[test]
fn keypoints_of_networks_calibrate_the_cameras() {
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
    let refused = farfield(&words.concat());
    assert_eq!(refused.code, 2, "{}\n{}", refused.stdout, refused.stderr);
    let why = "no person was detected in any recording";
    assert!(refused.stderr.contains(why), "{}", refused.stderr);

    for camera in walked.truth.cameras.values() {
        let file = seen.join(format!("{}.jsonl", camera.name()));
        let text = fs::read_to_string(folder.path(&format!("{}.jsonl", camera.name()))).unwrap();
        let path = file.with_extension("kept.json");
        let mut metadata: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        metadata["lines"] = blake3::hash(text.as_bytes()).to_hex()[..32].into();
        metadata["bodies"] = text.lines().count().into();
        fs::write(&path, metadata.to_string()).unwrap();
        fs::write(&file, text).unwrap();
    }
    let done = farfield(&words.concat());
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let taken_up = done.stderr.matches("from an earlier scan");
    assert_eq!(taken_up.count(), walked.truth.cameras.len());
    assert_close_to_truth(&calibration(&out), &walked.truth);
}
