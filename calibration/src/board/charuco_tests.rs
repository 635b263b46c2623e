//! `ChArUco` boards of all prints in rendered pictures.

use calib_targets_charuco::resolve_dictionary;
use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Isometry3, Point3, Vector3};

use super::projection::Optics;
use super::*;
use crate::formats::LensModel;

const SIZE: [u32; 2] = [480, 270];
const FOCAL_PX: f64 = 420.0;
/// Largest error of corners in pictures with few rays per pixel; the next corner is 35 px away.
const MOST_OFF_PX: f64 = 0.5;
/// Rays per pixel along each side.
const RAYS: u32 = 3;

fn board(squares: [u32; 2]) -> Charuco {
    Charuco {
        squares,
        square_m: 0.04,
        marker_m: 0.03,
        dictionary: "DICT_4X4_50".to_owned(),
    }
}

fn optics() -> Optics {
    let intrinsics = Intrinsics {
        fx_px: FOCAL_PX,
        fy_px: FOCAL_PX,
        cx_px: 239.5,
        cy_px: 134.5,
    };
    Optics::new(&intrinsics, &LensModel::Rational(Distortion::default()))
}

/// Whether the board is white at a point, in squares from its upper left; `None` outside of it. A margin of half a square is
/// white.
fn is_white(board: &Charuco, print: Print, at: [f64; 2]) -> Option<bool> {
    let [columns, rows] = board.squares.map(f64::from);
    let [x, y] = at;
    if !(-0.5..columns + 0.5).contains(&x) || !(-0.5..rows + 0.5).contains(&y) {
        return None;
    }
    let is_inside = (0.0..columns).contains(&x) && (0.0..rows).contains(&y);
    let is_white = !is_inside || is_white_inside(board, print.is_legacy, at);
    Some(is_white != print.is_negative)
}

fn is_white_inside(board: &Charuco, is_legacy: bool, [x, y]: [f64; 2]) -> bool {
    let (column, row) = (x as u32, y as u32);
    let first = u32::from(!(is_legacy && board.squares[1].is_multiple_of(2)));
    let has_marker = |column: u32, row: u32| (column + row) % 2 == first;
    if !has_marker(column, row) {
        return false;
    }
    let before = (0..board.squares[0] * row + column)
        .filter(|i| has_marker(i % board.squares[0], i / board.squares[0]));
    let dictionary = resolve_dictionary(&board.dictionary).expect("a dictionary of OpenCV's");
    let code = dictionary.codes()[before.count()];
    // A marker is its bits with a black border of one bit.
    let side = dictionary.marker_size() as f64 + 2.0;
    let share = board.marker_m / board.square_m;
    let bit = [x, y].map(|v| ((v.fract() - 0.5) / share + 0.5) * side);
    let is_on_marker = bit.iter().all(|v| (0.0..side).contains(v));
    let is_border = bit.iter().any(|v| !(1.0..side - 1.0).contains(v));
    let [u, v] = bit.map(|v| v as usize);
    !is_on_marker || !is_border && (code >> ((v - 1) * dictionary.marker_size() + u - 1)) & 1 == 0
}

/// A picture of a board on grey.
fn drawn(board: &Charuco, print: Print, camera_from_board: &Isometry3<f64>) -> Vec<u8> {
    let board_from_camera = camera_from_board.inverse();
    let camera_m = board_from_camera * Point3::origin();
    let level = |x: f64, y: f64| {
        let ray = Vector3::new((x - 239.5) / FOCAL_PX, (y - 134.5) / FOCAL_PX, 1.0);
        let along = board_from_camera * ray;
        let at = camera_m + along * (-camera_m.z / along.z);
        let white = is_white(board, print, [at.x, at.y].map(|v| v / board.square_m));
        white.map_or(128.0, |white| if white { 230.0 } else { 25.0 })
    };
    let within = |i: u32| (f64::from(i) + 0.5) / f64::from(RAYS) - 0.5;
    let pixel = |x: u32, y: u32| {
        let rays = (0..RAYS * RAYS).map(|i| {
            let (across, down) = (within(i % RAYS), within(i / RAYS));
            level(f64::from(x) + across, f64::from(y) + down)
        });
        (rays.sum::<f64>() / f64::from(RAYS * RAYS)) as u8
    };
    let rows = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)));
    rows.map(|(x, y)| pixel(x, y)).collect()
}

/// The board in front of the camera, `shift_m` from its axis, tilted differently for each `i`.
fn pose(board: &Charuco, i: usize, shift_m: [f64; 2]) -> Isometry3<f64> {
    let turn = 2.4 * i as f64;
    let tilt = Vector3::new(libm::cos(turn), libm::sin(turn), 0.2) * 0.4;
    let place = Vector3::new(shift_m[0], shift_m[1], 0.47 + 0.02 * libm::cos(turn));
    let [across, down] = board.squares.map(|n| 0.5 * board.square_m * f64::from(n));
    Isometry3::new(place, tilt) * Isometry3::translation(-across, -down, 0.0)
}

fn detected(board: &Charuco, pixels: &[u8]) -> Result<BoardView, DetectError> {
    let picture = GrayPicture {
        width: SIZE[0],
        height: SIZE[1],
        pixels,
    };
    detect_charuco("", &picture, board)
}

/// The largest error of a corner, pixels.
fn off_px(view: &BoardView, camera_from_board: &Isometry3<f64>) -> f64 {
    let each = view.board_m.iter().zip(&view.pixels).map(|([x, y], px)| {
        let at = camera_from_board * Point3::new(*x, *y, 0.0);
        let drawn = optics().draw(&at.coords).expect("in front of the camera");
        libm::hypot(drawn.pixel.x - px[0], drawn.pixel.y - px[1])
    });
    each.fold(0.0, f64::max)
}

fn prints() -> [Print; 4] {
    [(false, false), (true, false), (false, true), (true, true)].map(|(is_negative, is_legacy)| {
        Print {
            is_negative,
            is_legacy,
        }
    })
}

/// Symptom: no corner of a board from before `OpenCV` 4.6 was found.
#[test]
fn a_board_is_detected_in_every_print() {
    for print in prints() {
        for squares in [[8, 6], [7, 6]] {
            let board = board(squares);
            let pose = pose(&board, 1, [0.0, 0.0]);
            let view = detected(&board, &drawn(&board, print, &pose)).expect("a whole board");
            assert_eq!(view.print, print, "{squares:?}");
            let full = (squares[0] - 1) * (squares[1] - 1);
            assert_eq!(view.pixels.len(), full as usize, "{print:?} {squares:?}");
            let off_px = off_px(&view, &pose);
            assert!(off_px < MOST_OFF_PX, "{print:?} {squares:?}: {off_px}");
        }
    }
}

/// Every other row of markers is the same in both layouts, shifted by one square.
#[test]
fn a_part_of_a_board_is_not_mistaken_for_the_other_layout() {
    let board = board([8, 6]);
    let mut found = 0;
    for print in prints() {
        for shift_m in [
            [0.2, 0.0],
            [-0.2, 0.02],
            [0.05, 0.17],
            [0.0, -0.18],
            [0.19, 0.1],
        ] {
            let pose = pose(&board, 2, shift_m);
            let Ok(view) = detected(&board, &drawn(&board, print, &pose)) else {
                continue;
            };
            found += 1;
            let off_px = off_px(&view, &pose);
            let count = view.pixels.len();
            assert_eq!(view.print, print, "{shift_m:?}: {count} corners");
            assert!(off_px < MOST_OFF_PX, "{print:?} {shift_m:?}: {off_px}");
        }
    }
    println!("{found} of 20 parts were found");
    assert!(found >= 14, "{found}");
}

#[test]
fn boards_with_an_odd_number_of_rows_have_the_current_layout() {
    let board = board([6, 5]);
    let print = Print {
        is_legacy: true,
        ..Print::default()
    };
    let pose = pose(&board, 1, [0.0, 0.0]);
    let view = detected(&board, &drawn(&board, print, &pose)).expect("a whole board");
    assert_eq!(view.print, Print::default());
    assert!(off_px(&view, &pose) < MOST_OFF_PX);
}

#[test]
fn the_print_of_a_board_is_reported() {
    let board = board([8, 6]);
    for (print, word) in
        prints()
            .into_iter()
            .zip(["", "white on black", "before 4.6", "before 4.6"])
    {
        let views = (0..6).map(|i| {
            let shift_m = [0.03 * libm::cos(i as f64), 0.0];
            let picture = drawn(&board, print, &pose(&board, i, shift_m));
            detected(&board, &picture).expect("a whole board")
        });
        let views: Vec<BoardView> = views.collect();
        let found = calibrate(SIZE, &views, Coefficients::Five).expect("six tilted boards");
        let focal_px = found.intrinsics.fx_px;
        assert!((focal_px / FOCAL_PX - 1.0).abs() < 0.01, "{focal_px}");
        let is_reported = found.remarks.iter().any(|it| it.contains("is printed"));
        assert_eq!(is_reported, !word.is_empty(), "{:?}", found.remarks);
        let has_word = found.remarks.iter().any(|it| it.contains(word));
        assert!(word.is_empty() || has_word, "{:?}", found.remarks);
    }
}

/// Symptom: the answer to a wrong description of the board was the advice to take other pictures.
#[test]
fn a_wrong_description_of_a_board_is_corrected() {
    let right = board([8, 6]);
    let pictures: Vec<Vec<u8>> = (0..3)
        .map(|i| drawn(&right, Print::default(), &pose(&right, i, [0.0, 0.0])))
        .collect();
    let mirrored: Vec<Vec<u8>> = pictures
        .iter()
        .map(|it| {
            let rows = it.chunks(SIZE[0] as usize);
            rows.flat_map(|row| row.iter().rev().copied()).collect()
        })
        .collect();
    let other = |pictures: &[Vec<u8>], given: &Charuco| {
        let count = pictures
            .iter()
            .filter(|it| detected(given, it).is_ok())
            .count();
        println!("{given:?}: found in {count}");
        let pictures = pictures.iter().map(|pixels| GrayPicture {
            width: SIZE[0],
            height: SIZE[1],
            pixels,
        });
        other_charuco(&pictures.collect::<Vec<_>>(), given)
    };
    for squares in [[7, 5], [6, 8], [5, 7]] {
        let given = Charuco {
            squares,
            ..right.clone()
        };
        assert_eq!(
            other(&pictures, &given),
            Some(OtherCharuco::Squares([8, 6])),
            "{squares:?}"
        );
    }
    let given = Charuco {
        dictionary: "DICT_5X5_50".to_owned(),
        ..right.clone()
    };
    let found = Some(OtherCharuco::Dictionary("DICT_4X4_1000".to_owned()));
    assert_eq!(other(&pictures, &given), found);
    let given = Charuco {
        marker_m: 0.018,
        ..right.clone()
    };
    let found = other(&pictures, &given);
    assert!(
        matches!(found, Some(OtherCharuco::Marker(m)) if (m - 0.03).abs() < 0.003),
        "{found:?}"
    );
    assert_eq!(other(&mirrored, &right), Some(OtherCharuco::Mirrored));
    let nothing = vec![vec![128; (SIZE[0] * SIZE[1]) as usize]];
    assert_eq!(other(&nothing, &right), None);
}
