//! From recordings of boards and of a ball to a calibration that passes, in one command.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use image::{GrayImage, Luma};
use nalgebra::{Isometry3, Point3, Vector3};

use super::all_stages::{CAMERAS_M, SIZE_PX, names, record};
use super::calibration::calibration;
use crate::farfield::{FinishedCommand, command, finish};

/// Focal length and principal point of all cameras, as of those that filmed the ball.
const FOCAL_PX: f64 = 300.0;
const MIDDLE_PX: [f64; 2] = [159.5, 119.5];
/// Squares along a row and a column, and their side, metres.
const SQUARES: [f64; 2] = [5.0, 8.0];
const SQUARE_M: f64 = 0.06;
/// Images of a board.
const PICTURES: u32 = 14;

/// Camera from board in one image.
fn board(picture: u32) -> Isometry3<f64> {
    let turn = 2.4 * f64::from(picture);
    let tilt = Vector3::new(turn.cos(), turn.sin(), 0.3 * (1.7 * turn).cos()) * 0.55;
    let away_m = 0.62 + 0.1 * (0.9 * turn).sin();
    let aside_m = 0.2 * away_m;
    let middle = Vector3::new(
        aside_m * (1.3 * turn).cos(),
        0.6 * aside_m * (1.3 * turn).sin(),
        away_m,
    );
    Isometry3::new(middle, tilt)
}

/// Brightness of the board along the ray through a pixel, 0 to 255.
fn level(camera_from_board: &Isometry3<f64>, [x_px, y_px]: [f64; 2]) -> f64 {
    let ray = Vector3::new(
        (x_px - MIDDLE_PX[0]) / FOCAL_PX,
        (y_px - MIDDLE_PX[1]) / FOCAL_PX,
        1.0,
    );
    let board_from_camera = camera_from_board.inverse();
    let from = board_from_camera * Point3::origin();
    let along = board_from_camera * ray;
    let at = from - along * (from.z / along.z);
    let square = [0, 1].map(|axis| at[axis] / SQUARE_M + SQUARES[axis] / 2.0);
    if (0..2).any(|axis| !(-0.7..SQUARES[axis] + 0.7).contains(&square[axis])) {
        return 110.0;
    }
    let is_on = (0..2).all(|axis| (0.0..SQUARES[axis]).contains(&square[axis]));
    let number = square[0].floor() + square[1].floor();
    if is_on && number.rem_euclid(2.0) < 0.5 {
        30.0
    } else {
        225.0
    }
}

/// All images, rendered once: each takes a million rays.
fn pictures() -> &'static [GrayImage] {
    static DRAWN: OnceLock<Vec<GrayImage>> = OnceLock::new();
    DRAWN.get_or_init(|| (0..PICTURES).map(picture).collect())
}

fn picture(number: u32) -> GrayImage {
    let camera_from_board = board(number);
    GrayImage::from_fn(SIZE_PX[0], SIZE_PX[1], |column, row| {
        let part = |i: u32| (f64::from(i) + 0.5) / 4.0 - 0.5;
        let parts = (0..16).map(|i| {
            let px = [
                f64::from(column) + part(i % 4),
                f64::from(row) + part(i / 4),
            ];
            level(&camera_from_board, px)
        });
        Luma([(parts.sum::<f64>() / 16.0).round() as u8])
    })
}

/// Writes a folder of images for each camera.
fn film_boards(boards: &Path) {
    for (name, _) in CAMERAS_M {
        let folder = boards.join(name);
        fs::create_dir_all(&folder).unwrap();
        for (number, picture) in pictures().iter().enumerate() {
            let path = folder.join(format!("{number:02}.png"));
            picture.save(path).unwrap();
        }
    }
}

/// Runs `farfield calibrate all recordings` in `folder`.
fn calibrate_all(folder: &Path, more: &[&str]) -> FinishedCommand {
    let mut command = command();
    command.current_dir(folder);
    command.args(["calibrate", "all", "recordings", "--colour", "#f07814"]);
    for (name, [x, y, z]) in CAMERAS_M {
        command.arg(format!("--at={name}={x},{y},{z}"));
    }
    command.args(more);
    finish(&command.output().unwrap())
}

const BOARDS: [&str; 6] = [
    "--boards",
    "boards",
    "--chessboard",
    "4x7",
    "--square-mm",
    "60",
];

#[test]
fn boards_and_a_ball_become_a_calibration_that_passes_in_one_command() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    record(&folder.join("recordings"));
    film_boards(&folder.join("boards"));
    let done = calibrate_all(folder, &BOARDS);
    println!("{}\n{}", done.stdout, done.stderr);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let found = calibration(&folder.join("calibration.toml"));
    for (name, at_m) in CAMERAS_M {
        let camera = &found.cameras[name];
        let apart_m = (camera.center().coordinates_m().coords - Vector3::from(at_m)).norm();
        let focal_px = camera.intrinsics().fx_px;
        println!("{name}: {:.1} mm, {focal_px:.2} px", 1000.0 * apart_m);
        assert!(apart_m < 0.03, "{name}: {apart_m} m");
        assert!((focal_px - FOCAL_PX).abs() < 2.0, "{name}: {focal_px} px");
    }
    assert_eq!(
        names(&folder.join("lenses")),
        ["east.yml", "north.yml", "west.yml"]
    );

    // Existing lenses and sightings are reused, and the rest is computed from them with the same result.
    let first = fs::read(folder.join("calibration.toml")).unwrap();
    for name in ["calibration.toml", "calibration.html", "lenses/north.yml"] {
        fs::remove_file(folder.join(name)).unwrap();
    }
    let again = calibrate_all(folder, &BOARDS);
    assert_eq!(again.code, 0, "{}\n{}", again.stdout, again.stderr);
    assert_eq!(fs::read(folder.join("calibration.toml")).unwrap(), first);
    let count = |words: &str| again.stderr.matches(words).count();
    assert_eq!(count("its lens in "), 2, "{}", again.stderr);
    assert_eq!(count("camera north: its lens"), 0, "{}", again.stderr);
    assert_eq!(count(".txt from an earlier scan"), 3, "{}", again.stderr);
}

#[test]
fn wrong_boards_are_refused_before_images_are_read() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    film_boards(&folder.join("recordings"));
    for name in ["east", "north"] {
        fs::create_dir_all(folder.join("boards").join(name)).unwrap();
        let path = folder.join("boards").join(name).join("0.png");
        pictures()[0].save(path).unwrap();
    }
    let cases: [(&[&str], &str); 7] = [
        (
            &[],
            "set it with --lens, or give images of a board with --boards",
        ),
        (&BOARDS, "boards: found no boards of camera `west`"),
        (
            &BOARDS[2..],
            "a board is described, but there are no images of it",
        ),
        (&BOARDS[..2], "expected --chessboard AxB"),
        (&BOARDS[..4], "expected --square-mm"),
        (
            &[
                "--boards",
                "nowhere",
                "--chessboard",
                "4x7",
                "--square-mm",
                "60",
            ],
            "nowhere",
        ),
        (
            &[
                "--boards",
                "boards",
                "--chessboard",
                "4x7",
                "--square-mm",
                "0",
            ],
            "squares of 0 m",
        ),
    ];
    for (more, words) in cases {
        let refused = calibrate_all(folder, more);
        assert_eq!(refused.code, 2, "{more:?}: {}", refused.stderr);
        assert!(
            refused.stderr.contains(words),
            "{more:?}: {}",
            refused.stderr
        );
        assert_eq!(names(folder), ["boards", "recordings"], "{more:?}");
    }
}

#[test]
fn recordings_of_another_size_than_boards_are_refused_first() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    film_boards(&folder.join("recordings"));
    film_boards(&folder.join("boards"));
    let small = GrayImage::new(SIZE_PX[0] / 2, SIZE_PX[1] / 2);
    small.save(folder.join("boards/north/00.png")).unwrap();
    let refused = calibrate_all(folder, &BOARDS);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    for words in ["camera `north`", "00.png is 160x120", "320x240"] {
        assert!(refused.stderr.contains(words), "{}", refused.stderr);
    }
    assert_eq!(names(folder), ["boards", "recordings"]);
}

#[test]
fn a_board_of_another_size_than_stated_does_not_pass() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    film_boards(&folder.join("boards"));
    for (size, message) in [
        ("5x9", "at most 4 x 7 inner corners were found"),
        ("4x8", "at most 4 x 7 inner corners were found"),
        ("3x6", "at most 4 x 7 inner corners were found"),
        ("4x6", "at most 4 x 7 inner corners were found"),
    ] {
        let mut command = command();
        command.current_dir(folder);
        command.args(["calibrate", "board", "boards/east", "--camera", "east"]);
        command.args(["--square-mm", "60", "--chessboard", size]);
        let refused = finish(&command.output().unwrap());
        assert_eq!(refused.code, 2, "{size}: {}", refused.stdout);
        assert!(
            refused.stderr.contains(message),
            "{size}: {}",
            refused.stderr
        );
        assert_eq!(names(folder), ["boards"], "{size}");
    }
}
