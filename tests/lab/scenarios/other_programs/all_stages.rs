//! From recordings of a ball to a calibration in one go, and in two, after somebody stopped the first.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use farfield_node::clock;
use image::{Rgb, RgbImage};
use nalgebra::Vector3;

use crate::farfield::{FinishedCommand, command, finish};

/// Frames in which the ball is carried.
const FRAMES: u32 = 150;
/// Frames of the camera that was stopped last: looking through them takes much longer.
const LATE_FRAMES: u32 = 900;
/// Size of a picture and focal length, pixels; radius of the ball, metres.
const SIZE_PX: [u32; 2] = [320, 240];
const FOCAL_PX: f64 = 300.0;
const RADIUS_M: f64 = 0.12;
/// Where the cameras stand, metres; they look at the same place.
const CAMERAS_M: [(&str, [f64; 3]); 3] = [
    ("east", [4.0, 0.5, 2.0]),
    ("north", [-1.5, 4.2, 2.4]),
    ("west", [-3.0, -2.8, 1.8]),
];

/// Where the ball is, metres; after the last frame it lies still.
fn ball_m(frame: u32) -> Vector3<f64> {
    let t = 0.07 * f64::from(frame.min(FRAMES));
    Vector3::new(
        0.9 * (1.1 * t).sin(),
        0.8 * (0.83 * t + 1.0).sin(),
        1.0 + 0.6 * (0.61 * t + 0.4).sin(),
    )
}

/// Where a camera draws the ball, and its radius there, pixels.
fn drawn_px(camera_m: [f64; 3], frame: u32) -> ([f64; 2], f64) {
    let centre = Vector3::from(camera_m);
    let ahead = (Vector3::new(0.0, 0.0, 1.0) - centre).normalize();
    let right = ahead.cross(&Vector3::z()).normalize();
    let down = ahead.cross(&right);
    let to = ball_m(frame) - centre;
    let depth_m = to.dot(&ahead);
    let at = |axis: &Vector3<f64>, middle: f64| FOCAL_PX * to.dot(axis) / depth_m + middle;
    let px = [at(&right, 159.5), at(&down, 119.5)];
    (px, FOCAL_PX * RADIUS_M / depth_m)
}

/// Numbered pictures of each camera.
fn record(recordings: &Path) {
    for (name, camera_m) in CAMERAS_M {
        let folder = recordings.join(name);
        fs::create_dir_all(&folder).unwrap();
        let frames = if name == "west" { LATE_FRAMES } else { FRAMES };
        for frame in 0..frames {
            let ([x_px, y_px], radius_px) = drawn_px(camera_m, frame);
            let picture = RgbImage::from_fn(SIZE_PX[0], SIZE_PX[1], |column, row| {
                let apart_px = (f64::from(column) - x_px).hypot(f64::from(row) - y_px);
                let ball = (radius_px + 0.5 - apart_px).clamp(0.0, 1.0);
                let level = |ball_level: f64| (ball * ball_level + (1.0 - ball) * 100.0) as u8;
                Rgb([level(240.0), level(120.0), level(20.0)])
            });
            picture
                .save(folder.join(format!("{frame:06}.png")))
                .unwrap();
        }
    }
}

/// The lenses of all cameras.
fn write_lenses(path: &Path) {
    let each = CAMERAS_M.map(|(name, _)| {
        format!(
            "[{name}]\nname = \"{name}\"\nsize = [320, 240]\n\
             matrix = [[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]]\n\
             distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n\
             rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n"
        )
    });
    fs::write(path, each.concat()).unwrap();
}

/// `farfield calibrate all` on the recordings, in `folder`.
fn calibrate_all(folder: &Path, recordings: &Path, more: &[&str]) -> Command {
    let mut command = command();
    command.args(["calibrate", "all"]).arg(recordings);
    command.args([
        "--lens",
        "lenses.toml",
        "--colour",
        "#f07814",
        "--out",
        "found.toml",
    ]);
    for (name, [x, y, z]) in CAMERAS_M {
        command.arg(format!("--at={name}={x},{y},{z}"));
    }
    command.args(more).current_dir(folder);
    command
}

/// A folder to work in.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_lenses(&folder.path().join("lenses.toml"));
    folder
}

/// The calibration, whether it passes or not, and what each camera saw.
fn results(folder: &Path, done: &FinishedCommand) -> Vec<Vec<u8>> {
    assert!(done.code <= 1, "{}\n{}", done.stdout, done.stderr);
    let found = ["found.failed.toml", "found.toml"][usize::from(done.code == 0)];
    let seen = CAMERAS_M.map(|(name, _)| format!("seen/{name}.txt"));
    let files = seen.iter().map(String::as_str).chain([found]);
    files
        .map(|name| fs::read(folder.join(name)).unwrap())
        .collect()
}

#[test]
fn who_is_stopped_after_a_look_goes_on_from_there_and_ends_with_the_same_bytes() {
    let recorded = tempfile::tempdir().unwrap();
    let recordings = recorded.path().join("recordings");
    record(&recordings);
    let at_once = workplace();
    let whole = calibrate_all(at_once.path(), &recordings, &[]).output();
    let whole = finish(&whole.unwrap());
    println!("{}\n{}", whole.stdout, whole.stderr);
    let expected = results(at_once.path(), &whole);

    let stopped = workplace();
    let mut running = calibrate_all(stopped.path(), &recordings, &[]);
    let running = running.stdout(Stdio::null()).stderr(Stdio::null());
    let mut running = running.spawn().unwrap();
    let (east, west) = (
        stopped.path().join("seen/east.txt"),
        stopped.path().join("seen/west.txt"),
    );
    let until = clock::now() + Duration::from_mins(5);
    while !east.exists() && clock::now() < until {
        sleep(Duration::from_millis(5));
    }
    let interrupt = Command::new("kill")
        .args(["-INT", &running.id().to_string()])
        .status();
    assert!(interrupt.unwrap().success());
    running.wait().unwrap();
    assert!(east.exists() && !west.exists(), "stopped too late");
    assert!(!stopped.path().join("found.toml").exists());
    let left: Vec<_> = CAMERAS_M
        .iter()
        .filter(|(name, _)| stopped.path().join(format!("seen/{name}.txt")).exists())
        .collect();

    let again = finish(
        &calibrate_all(stopped.path(), &recordings, &[])
            .output()
            .unwrap(),
    );
    assert_eq!(results(stopped.path(), &again), expected);
    // What was found is not looked for again, and all else is.
    let taken_up = again.stderr.matches("where it was found earlier").count();
    assert_eq!(taken_up, left.len(), "{}", again.stderr);
    assert!(
        again.stderr.contains("camera east: taken from"),
        "{}",
        again.stderr
    );

    // With another option what is there is of no use, and stands in the way until somebody says so.
    fs::remove_file(stopped.path().join("found.toml")).ok();
    let other = ["--diameter-px", "6,300"];
    let refused = calibrate_all(stopped.path(), &recordings, &other).output();
    let refused = finish(&refused.unwrap());
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("--replace"), "{}", refused.stderr);
}
