//! Boards and marks seen by known cameras.

use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Isometry3, Point3, Vector3};

use super::projection::Optics;
use super::*;
use crate::formats::LensModel;

pub(super) const SIZE: [u32; 2] = [1920, 1200];

pub(super) fn intrinsics(focal: f64) -> Intrinsics {
    Intrinsics {
        fx_px: focal,
        fy_px: focal * 1.002,
        cx_px: 970.0,
        cy_px: 590.0,
    }
}

pub(super) fn pinhole() -> LensModel {
    LensModel::Rational(Distortion {
        k1: -0.12,
        k2: 0.06,
        p1: 0.001,
        p2: -0.0005,
        k3: 0.01,
        ..Distortion::default()
    })
}

/// Deterministic noise of standard deviation `sigma` px: a sum of twelve uniform numbers is nearly normal.
struct Noise(u64);

impl Noise {
    fn next(&mut self, sigma: f64) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        }
        sigma * sum
    }
}

/// `count` pictures of a board of 9 x 6 corners, tilted by `tilt_rad`, distributed over the picture.
pub(super) fn views(optics: &Optics, count: usize, tilt_rad: f64, sigma_px: f64) -> Vec<BoardView> {
    let mut noise = Noise(7);
    (0..count)
        .map(|i| {
            let turn = i as f64 * 2.4;
            let tilt = Vector3::new(
                libm::cos(turn),
                libm::sin(turn),
                0.3 * libm::cos(1.7 * turn),
            ) * tilt_rad;
            let away = 1.0 + 0.3 * libm::sin(0.9 * turn);
            let focal = optics.intrinsics().fx_px / 1400.0;
            let place = Vector3::new(
                0.42 * libm::cos(1.3 * turn),
                0.22 * libm::sin(1.3 * turn),
                away * focal.max(0.3),
            );
            let pose = Isometry3::new(place, tilt);
            let mut view = BoardView {
                name: format!("{i:02}"),
                board_m: Vec::new(),
                pixels: Vec::new(),
                print: Print::default(),
            };
            for (u, v) in (0..9).flat_map(|u| (0..6).map(move |v| (u, v))) {
                let board = [0.05 * f64::from(u) - 0.2, 0.05 * f64::from(v) - 0.125];
                let p = pose * Point3::new(board[0], board[1], 0.0);
                let Some(drawn) = optics.draw(&p.coords) else {
                    continue;
                };
                let px = drawn.pixel;
                let inside = (0.0..f64::from(SIZE[0])).contains(&px.x)
                    && (0.0..f64::from(SIZE[1])).contains(&px.y);
                if inside {
                    view.board_m.push(board);
                    view.pixels
                        .push([px.x + noise.next(sigma_px), px.y + noise.next(sigma_px)]);
                }
            }
            view
        })
        .collect()
}

#[test]
fn boards_without_noise_give_the_true_pinhole() {
    let truth = Optics::new(&intrinsics(1400.0), &pinhole());
    let found =
        calibrate(SIZE, &views(&truth, 15, 0.5, 0.0), Coefficients::Five).expect("good pictures");
    assert!(found.rms_px < 1e-6, "{}", found.rms_px);
    let k = found.intrinsics;
    let expected = intrinsics(1400.0);
    for (a, b) in [
        (k.fx_px, expected.fx_px),
        (k.fy_px, expected.fy_px),
        (k.cx_px, expected.cx_px),
        (k.cy_px, expected.cy_px),
    ] {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
    for (a, b) in found
        .lens
        .coefficients()
        .iter()
        .zip(pinhole().coefficients())
    {
        assert!((a - b).abs() < 1e-5, "{:?}", found.lens);
    }
}

#[test]
fn boards_without_noise_give_the_true_fisheye() {
    let lens = LensModel::KannalaBrandt([-0.02, 0.005, -0.002, 0.0003]);
    let truth = Optics::new(&intrinsics(600.0), &lens);
    let found = calibrate(SIZE, &views(&truth, 15, 0.5, 0.0), Coefficients::Fisheye)
        .expect("good pictures");
    assert!(found.rms_px < 1e-5, "{}", found.rms_px);
    assert!(
        (found.intrinsics.fx_px - 600.0).abs() < 1e-3,
        "{:?}",
        found.intrinsics
    );
    for (a, b) in found.lens.coefficients().iter().zip(lens.coefficients()) {
        assert!((a - b).abs() < 1e-4, "{:?}", found.lens);
    }
}

/// Each parameter is within 4 of its standard deviations, and these match the noise.
#[test]
fn the_covariance_matches_the_errors_of_the_parameters() {
    let truth = Optics::new(&intrinsics(1400.0), &pinhole());
    let found =
        calibrate(SIZE, &views(&truth, 20, 0.5, 0.2), Coefficients::Five).expect("good pictures");
    assert!(
        (found.rms_px - 0.2 * std::f64::consts::SQRT_2).abs() < 0.02,
        "{}",
        found.rms_px
    );
    let k = found.intrinsics;
    let values = [k.fx_px, k.fy_px, k.cx_px, k.cy_px]
        .into_iter()
        .chain(found.lens.coefficients());
    for ((value, expected), sigma) in values.zip(truth.values).zip(found.sigmas()) {
        assert!(
            (value - expected).abs() < 4.0 * sigma,
            "{value} {expected} {sigma}"
        );
    }
    assert!(
        (0.05..5.0).contains(&found.sigmas()[0]),
        "{:?}",
        found.sigmas()
    );
}

#[test]
fn a_picture_with_wrong_corners_is_reported() {
    let truth = Optics::new(&intrinsics(1400.0), &pinhole());
    let mut views = views(&truth, 15, 0.5, 0.1);
    for (i, pixel) in views[4].pixels.iter_mut().enumerate() {
        pixel[0] += if i % 2 == 0 { 1.5 } else { -1.5 };
    }
    let found = calibrate(SIZE, &views, Coefficients::Five).expect("one bad picture of 15");
    let hurting: Vec<&str> = found
        .pictures
        .iter()
        .filter(|p| p.hurts)
        .map(|p| p.name.as_str())
        .collect();
    assert_eq!(hurting, ["04"]);
}

#[test]
fn parallel_boards_determine_no_focal_length() {
    let truth = Optics::new(&intrinsics(1400.0), &pinhole());
    let error =
        calibrate(SIZE, &views(&truth, 12, 0.0, 0.2), Coefficients::Five).expect_err("no tilt");
    let is_expected = matches!(
        error,
        BoardError::Parallel | BoardError::FocalLength { .. } | BoardError::Coefficient { .. }
    );
    assert!(is_expected, "{error}");
}

#[test]
fn few_pictures_do_not_determine_eight_coefficients() {
    let truth = Optics::new(&intrinsics(1700.0), &LensModel::ideal());
    let mut views = views(&truth, 6, 0.4, 0.25);
    for view in &mut views {
        // 4 x 7 corners of the 9 x 6, in the middle of the picture.
        let keep = |p: &[f64; 2]| p[0] < 0.125 && p[1] < 0.06;
        let kept: Vec<bool> = view.board_m.iter().map(keep).collect();
        let mut flags = kept.iter();
        view.board_m.retain(|_| *flags.next().unwrap_or(&false));
        let mut flags = kept.iter();
        view.pixels.retain(|_| *flags.next().unwrap_or(&false));
    }
    let error = calibrate(SIZE, &views, Coefficients::Eight).expect_err("eight on six pictures");
    let is_expected = matches!(
        error,
        BoardError::Coefficient { .. } | BoardError::Folds(_) | BoardError::FocalLength { .. }
    );
    assert!(is_expected, "{error}");
}

#[test]
fn two_pictures_are_too_few_and_the_others_have_reasons() {
    let truth = Optics::new(&intrinsics(1400.0), &pinhole());
    let mut views = views(&truth, 3, 0.5, 0.0);
    views[1].board_m.truncate(5);
    views[1].pixels.truncate(5);
    let error = calibrate(SIZE, &views, Coefficients::Five).expect_err("two");
    let BoardError::TooFewPictures { found, left_out } = &error else {
        panic!("{error}")
    };
    assert_eq!((*found, left_out[0].0.as_str()), (2, "01"));
    assert!(error.to_string().contains("`01`: 5 corners"), "{error}");
}

/// The marks of the Pose2Sim demo: two rows on the floor, one point of each 5 cm above it.
fn marks() -> Vec<[f64; 3]> {
    let across = [(0.3, 0.0), (0.0, 0.0), (0.0, 0.05), (-0.3, 0.0)];
    [-2.0, 0.0]
        .iter()
        .flat_map(|x| across.iter().map(move |(y, z)| [*x, *y, *z]))
        .collect()
}

fn camera_at(center: [f64; 3]) -> Isometry3<f64> {
    let eye = Point3::from(Vector3::from(center));
    let view = Isometry3::look_at_rh(&eye, &Point3::new(-1.0, 0.0, 0.3), &Vector3::z());
    Isometry3::rotation(Vector3::x() * std::f64::consts::PI) * view
}

fn seen(
    pose: &Isometry3<f64>,
    lens: &LensModel,
    points: &[[f64; 3]],
    sigma_px: f64,
) -> Vec<[f64; 2]> {
    let optics = Optics::new(&intrinsics(1400.0), lens);
    let mut noise = Noise(11);
    let draw = |p: &[f64; 3]| {
        optics
            .draw(&(pose * Point3::from(*p)).coords)
            .expect("in front")
            .pixel
    };
    points
        .iter()
        .map(|p| {
            let px = draw(p);
            [px.x + noise.next(sigma_px), px.y + noise.next(sigma_px)]
        })
        .collect()
}

#[test]
fn known_marks_give_the_pose_of_the_camera() {
    for center in [
        [1.46, -1.91, 1.9],
        [2.58, 0.71, 1.69],
        [-3.2, 2.2, 2.1],
        [-3.76, -1.4, 1.88],
    ] {
        let truth = camera_at(center);
        for (sigma, within_m) in [(0.0, 1e-6), (0.5, 0.05)] {
            let pixels = seen(&truth, &pinhole(), &marks(), sigma);
            let found = pose_from_points(&intrinsics(1400.0), &pinhole(), &marks(), &pixels)
                .expect("eight marks");
            let off = (found.center_m().coords - Vector3::from(center)).norm();
            assert!(off < within_m, "{center:?} {sigma}: {off} {found:?}");
            assert!(
                off < 4.0 * found.center_sigma_m(sigma) + 1e-6,
                "{off} {}",
                found.center_sigma_m(sigma)
            );
            assert!(
                !found.is_ambiguous && !found.is_under_points,
                "{:?}",
                found.other
            );
        }
    }
}

#[test]
fn points_in_space_give_a_pose() {
    let points = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.2],
        [0.0, 1.0, 1.5],
        [-1.0, 0.3, 0.8],
        [-2.0, -0.7, 0.1],
        [0.4, 0.8, 1.1],
    ];
    let truth = camera_at([3.0, 3.0, 2.0]);
    for count in [4, 5, 6] {
        let points = &points[..count];
        let pixels = seen(&truth, &LensModel::ideal(), points, 0.0);
        let found = pose_from_points(&intrinsics(1400.0), &LensModel::ideal(), points, &pixels)
            .expect("points");
        let fits = |pose: &Isometry3<f64>| {
            (pose.to_homogeneous() - truth.to_homogeneous()).abs().max() < 1e-6
        };
        assert!(fits(&found.camera_from_world), "{count}: {found:?}");
    }
}

#[test]
fn marks_with_sides_swapped_fit_from_below_and_are_reported() {
    let truth = camera_at([3.0, 0.5, 2.0]);
    let flat: Vec<[f64; 3]> = marks().iter().filter(|p| p[2] == 0.0).copied().collect();
    let pixels = seen(&truth, &pinhole(), &flat, 0.0);
    let swapped: Vec<[f64; 3]> = flat.iter().map(|[x, y, z]| [*x, -y, *z]).collect();
    let found = pose_from_points(&intrinsics(1400.0), &pinhole(), &swapped, &pixels)
        .expect("a mirrored fit");
    assert!(
        found.rms_px < 1e-6 && found.is_under_points,
        "{} {:?}",
        found.rms_px,
        found.center_m()
    );
}

/// A small board far away: the ambiguity of Schweighofer and Pinz.
#[test]
fn a_small_flat_set_far_away_is_ambiguous() {
    let points = [
        [0.0, 0.0, 0.0],
        [0.1, 0.0, 0.0],
        [0.1, 0.1, 0.0],
        [0.0, 0.1, 0.0],
    ];
    let truth = Isometry3::new(Vector3::new(0.0, 0.0, 8.0), Vector3::new(0.5, 0.2, 0.0));
    let pixels = seen(&truth, &pinhole(), &points, 0.3);
    let found =
        pose_from_points(&intrinsics(1400.0), &pinhole(), &points, &pixels).expect("four corners");
    assert!(found.is_ambiguous, "{found:?}");
}

#[test]
fn points_on_a_line_are_refused() {
    let points = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [3.0, 0.0, 0.0],
    ];
    let pixels = [[0.0, 0.0], [100.0, 0.0], [200.0, 0.0], [300.0, 0.0]];
    let error =
        pose_from_points(&intrinsics(1400.0), &pinhole(), &points, &pixels).expect_err("a line");
    assert_eq!(error, PoseError::OnALine);
}

/// A rendered board of `columns` x `rows` squares with side `side` px and a white rim, slightly rotated and antialiased.
fn drawn_board(columns: u32, rows: u32, side: f64, turn: f64) -> (u32, u32, Vec<u8>) {
    let (width, height) = (640u32, 480u32);
    let (c, s) = (libm::cos(turn), libm::sin(turn));
    let mut pixels = Vec::new();
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let mut sum = 0.0;
        for (dy, dx) in (0..4).flat_map(|dy| (0..4).map(move |dx| (dy, dx))) {
            let px = f64::from(x) + (f64::from(dx) - 1.5) / 4.0 - 320.0;
            let py = f64::from(y) + (f64::from(dy) - 1.5) / 4.0 - 240.0;
            let u = ((c * px + s * py) / side + 0.5 * f64::from(columns)).floor();
            let v = ((-s * px + c * py) / side + 0.5 * f64::from(rows)).floor();
            let inside = u >= 0.0 && v >= 0.0 && u < f64::from(columns) && v < f64::from(rows);
            let black = inside && (u as u32 + v as u32).is_multiple_of(2);
            sum += if black { 30.0 } else { 220.0 };
        }
        pixels.push((sum / 16.0) as u8);
    }
    (width, height, pixels)
}

#[test]
fn a_rendered_chessboard_is_detected_to_a_tenth_of_a_pixel() {
    let (width, height, pixels) = drawn_board(8, 5, 40.0, 0.2);
    let picture = GrayPicture {
        width,
        height,
        pixels: &pixels,
    };
    let board = Chessboard {
        corners: [4, 7],
        square_m: 0.06,
    };
    let found = detect_chessboard("drawn", &picture, &board).expect("a board");
    assert_eq!(found.pixels.len(), 28);
    let (c, s) = (libm::cos(0.2), libm::sin(0.2));
    for [x, y] in &found.pixels {
        let u = (c * (x - 320.0) + s * (y - 240.0)) / 40.0;
        let v = (-s * (x - 320.0) + c * (y - 240.0)) / 40.0;
        // Corners are at integers along the eight squares, at halves along the five.
        let off = [u - u.round(), v - 0.5 - (v - 0.5).round()].map(|d| (40.0 * d).abs());
        assert!(off[0] < 0.1 && off[1] < 0.1, "{off:?}");
    }
    let small = Chessboard {
        corners: [4, 4],
        square_m: 0.06,
    };
    let error = detect_chessboard("drawn", &picture, &small).expect_err("another board");
    assert!(matches!(error, DetectError::OtherBoard { .. }), "{error}");
}

#[test]
fn an_empty_picture_has_no_board_and_missing_bytes_are_refused() {
    let pixels = vec![128; 640 * 480];
    let board = Chessboard {
        corners: [4, 7],
        square_m: 0.06,
    };
    let picture = GrayPicture {
        width: 640,
        height: 480,
        pixels: &pixels,
    };
    assert_eq!(
        detect_chessboard("grey", &picture, &board),
        Err(DetectError::NotFound)
    );
    let short = GrayPicture {
        width: 641,
        ..picture
    };
    let error = detect_chessboard("short", &short, &board).expect_err("bytes");
    assert_eq!(error.to_string(), "found 307200 bytes, expected 641 x 480");
}
