//! `farfield calibrate ball` finds a filmed ball in recordings of a user.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::Command;

use image::{Rgb, RgbImage};

use crate::data::print_skipped;
use crate::farfield::{FinishedCommand, farfield};

/// Frames of a recording.
const FRAMES: u32 = 50;
/// Size of an image, pixels.
const SIZE_PX: [u32; 2] = [320, 240];
/// Radius of the ball, pixels.
const RADIUS_PX: f64 = 11.0;
/// A lens without distortion of a camera without a pose.
const LENS: &str = "[hall]\nname = \"hall\"\nsize = [320, 240]\n\
    matrix = [[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]]\n\
    distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n\
    rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n";

/// Centre of the ball in a frame, pixels.
fn centre_px(frame: u32) -> [f64; 2] {
    let turn = 0.1 * f64::from(frame);
    [160.0 + 100.0 * turn.cos(), 120.0 + 70.0 * turn.sin()]
}

/// An orange ball in front of grey boards.
fn picture(frame: u32) -> RgbImage {
    let [x_px, y_px] = centre_px(frame);
    RgbImage::from_fn(SIZE_PX[0], SIZE_PX[1], |column, row| {
        let distance_px = (f64::from(column) - x_px).hypot(f64::from(row) - y_px);
        let ball = (RADIUS_PX + 0.5 - distance_px).clamp(0.0, 1.0);
        let dark = (column / 40 + row / 30) % 2 == 0;
        let board = if dark { 90.0 } else { 120.0 };
        Rgb([240.0, 120.0, 20.0].map(|level| (ball * level + (1.0 - ball) * board).round() as u8))
    })
}

/// Writes numbered images to `folder`.
fn write_pictures(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    for frame in 0..FRAMES {
        let path = folder.join(format!("{frame:06}.png"));
        picture(frame).save(path).unwrap();
    }
}

/// Runs the command on `recordings` of `folder`.
fn calibrate_ball(folder: &Path, more: &[&str]) -> FinishedCommand {
    let lenses = LENS.to_owned() + &LENS.replace("hall", "stage");
    fs::write(folder.join("lens.toml"), lenses).unwrap();
    let path = |name: &str| folder.join(name).display().to_string();
    let [recordings, lens, out] = ["recordings", "lens.toml", "seen"].map(path);
    let words = [
        "calibrate",
        "ball",
        &recordings,
        "--lens",
        &lens,
        "--out",
        &out,
    ];
    farfield(&[&words, more].concat())
}

/// Distances of the detected from the true centres, sorted, pixels.
fn errors_px(seen: &Path) -> Vec<f64> {
    let text = fs::read_to_string(seen).unwrap();
    // The first line names the columns, and the last has metadata.
    let lines = text.lines();
    let lines = lines.filter(|line| line.starts_with(|it: char| it.is_ascii_digit()));
    let lines = lines.map(|line| {
        let numbers: Vec<f64> = line.split(' ').map(|it| it.parse().unwrap()).collect();
        let [x_px, y_px] = centre_px(numbers[0] as u32);
        (numbers[1] - x_px).hypot(numbers[2] - y_px)
    });
    let mut errors_px: Vec<f64> = lines.collect();
    errors_px.sort_by(f64::total_cmp);
    errors_px
}

#[test]
fn a_ball_in_numbered_images_is_found_within_a_pixel() {
    let folder = tempfile::tempdir().unwrap();
    write_pictures(&folder.path().join("recordings/hall"));
    let done = calibrate_ball(folder.path(), &[]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let errors_px = errors_px(&folder.path().join("seen/hall.txt"));
    assert!(errors_px.len() as u32 >= FRAMES * 9 / 10, "{}", done.stdout);
    let median_px = errors_px[errors_px.len() / 2];
    assert!(median_px < 0.2, "{median_px} px at the median");
    assert!(errors_px.last().is_some_and(|worst_px| *worst_px < 1.0));
}

#[test]
fn a_ball_in_a_video_is_found_in_the_right_frames() {
    let folder = tempfile::tempdir().unwrap();
    let recordings = folder.path().join("recordings");
    write_pictures(&folder.path().join("pictures"));
    fs::create_dir_all(&recordings).unwrap();
    let made = Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error", "-framerate", "50", "-i"])
        .arg(folder.path().join("pictures/%06d.png"))
        .args(["-pix_fmt", "yuv420p", "-crf", "12", "-preset", "ultrafast"])
        .arg(recordings.join("hall.mp4"))
        .output();
    match made {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            print_skipped("a ball in a video: no ffmpeg");
            return;
        }
        made => {
            let made = made.unwrap();
            let message = String::from_utf8_lossy(&made.stderr);
            assert!(made.status.success(), "{message}");
        }
    }
    let done = calibrate_ball(folder.path(), &[]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let errors_px = errors_px(&folder.path().join("seen/hall.txt"));
    assert!(errors_px.len() as u32 >= FRAMES * 9 / 10, "{}", done.stdout);
    // The ball moves 8 to 10 px per frame, so that a wrong frame would show.
    let median_px = errors_px[errors_px.len() / 2];
    assert!(median_px < 0.5, "{median_px} px at the median");
}

#[test]
fn a_camera_without_a_ball_has_no_file_of_an_earlier_run() {
    let folder = tempfile::tempdir().unwrap();
    write_pictures(&folder.path().join("recordings/hall"));
    let stage = folder.path().join("recordings/stage");
    fs::create_dir_all(&stage).unwrap();
    let empty = RgbImage::from_pixel(SIZE_PX[0], SIZE_PX[1], Rgb([90, 90, 90]));
    for frame in 0..10 {
        empty.save(stage.join(format!("{frame:06}.png"))).unwrap();
    }
    fs::create_dir_all(folder.path().join("seen")).unwrap();
    fs::write(folder.path().join("seen/stage.txt"), "frame x y\n").unwrap();
    let done = calibrate_ball(folder.path(), &["--replace"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let message = "camera stage: not found in 10 frames";
    assert!(done.stdout.contains(message), "{}", done.stdout);
    assert!(folder.path().join("seen/hall.txt").exists());
    assert!(!folder.path().join("seen/stage.txt").exists());
}

#[test]
fn recordings_without_a_ball_are_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let hall = folder.path().join("recordings/hall");
    fs::create_dir_all(&hall).unwrap();
    for frame in 0..10 {
        let empty = RgbImage::from_pixel(SIZE_PX[0], SIZE_PX[1], Rgb([90, 90, 90]));
        empty.save(hall.join(format!("{frame:06}.png"))).unwrap();
    }
    let refused = calibrate_ball(folder.path(), &[]);
    assert_eq!(refused.code, 2, "{}", refused.stdout);
    for words in [
        "camera hall: found nothing round, saturated and moving in the first 10 frames",
        "found no moving ball in any recording",
    ] {
        assert!(refused.stderr.contains(words), "{}", refused.stderr);
    }
    assert!(!folder.path().join("seen/hall.txt").exists());
}
