//! Compares chessboards of the Pose2Sim demo with Qualisys' calibration of the same cameras. Skipped without the recordings.

use std::path::PathBuf;

use farfield_calibration::board::{
    BoardError, BoardView, Charuco, Chessboard, Coefficients, GrayPicture, calibrate,
    detect_charuco, detect_chessboard,
};
use farfield_calibration::formats::{ImportOptions, TextFile, import};

/// A chessboard of 5 x 8 squares of 60 mm.
const BOARD: Chessboard = Chessboard {
    corners: [4, 7],
    square_m: 0.06,
};

/// The folder of the demo: below `$FARFIELD_DATA`, else below `../shared` next to the checkout.
fn demo() -> Option<PathBuf> {
    let default = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let root = std::env::var_os("FARFIELD_DATA").map_or(default, PathBuf::from);
    let folder = root.join("data/pose2sim/single");
    if !folder.exists() {
        println!(
            "skipped: {} is not there (FARFIELD_DATA names its folder)",
            folder.display()
        );
        return None;
    }
    Some(folder)
}

/// The boards in the pictures of a camera, and the size of the pictures.
fn views(folder: &std::path::Path, camera: &str) -> ([u32; 2], Vec<BoardView>) {
    let mut size = [0, 0];
    let mut found = Vec::new();
    for i in 1..=7 {
        let name = format!("{camera}_{i:02}_int.jpg");
        let path = folder
            .join(format!("intrinsics/int_{camera}_img"))
            .join(&name);
        let picture = image::open(&path)
            .expect("a picture of the demo")
            .to_luma8();
        size = [picture.width(), picture.height()];
        let gray = GrayPicture {
            width: size[0],
            height: size[1],
            pixels: picture.as_raw(),
        };
        match detect_chessboard(&name, &gray, &BOARD) {
            Ok(view) => found.push(view),
            Err(error) => println!("{name}: {error}"),
        }
    }
    (size, found)
}

#[test]
fn chessboards_give_the_focal_lengths_of_qualisys() {
    let Some(folder) = demo() else { return };
    let path = folder.join("Calib.qca.txt");
    let text = std::fs::read_to_string(&path).expect("Qualisys' file");
    let theirs = import(&[TextFile { path, text }], &ImportOptions::default())
        .expect("Qualisys' calibration");
    let mut full = 0;
    for their in &theirs.cameras {
        let (size, views) = views(&folder, &their.name);
        full += views.iter().filter(|view| view.pixels.len() == 28).count();
        let found = calibrate(size, &views, Coefficients::Five).expect("seven tilted boards");
        let (a, b) = (found.intrinsics, their.intrinsics);
        let sigmas = found.sigmas();
        println!(
            "{}: {size:?}, rms {:.3} px, f {:.1} +- {:.1} (Qualisys {:.1}), c {:.1} {:.1} (Qualisys {:.1} {:.1}), {:?}, covers {:.2} to {:.2}",
            their.name,
            found.rms_px,
            a.fx_px,
            sigmas[0],
            b.fx_px,
            a.cx_px,
            a.cy_px,
            b.cx_px,
            b.cy_px,
            found.lens,
            found.coverage.cells,
            found.coverage.radius
        );
        println!(
            "    corner {:.1} px; {:?}",
            found.corner_sigma_px, found.remarks
        );
        // The boards of the demo stay in the middle.
        assert!(
            found
                .remarks
                .iter()
                .any(|text| text.contains("board in the corners")),
            "{:?}",
            found.remarks
        );
        for picture in &found.pictures {
            println!(
                "    {} {} corners {:.3} px{}",
                picture.name,
                picture.corners,
                picture.rms_px,
                if picture.hurts { " hurts" } else { "" }
            );
        }
        assert!(found.rms_px < 0.35, "{}: {}", their.name, found.rms_px);
        // Two calibrations of one lens agree within 1.5 %, or four standard deviations.
        assert!(
            (a.fx_px - b.fx_px).abs() < f64::max(0.015 * b.fx_px, 4.0 * sigmas[0]),
            "{}: {a:?} {b:?}",
            their.name
        );
        // OpenCV returns coefficients from 290 to 1080 here.
        let error =
            calibrate(size, &views, Coefficients::Eight).expect_err("eight on seven pictures");
        assert!(
            matches!(error, BoardError::Coefficient { asked: 8, .. }),
            "{error}"
        );
        println!("    {error}");
    }
    println!("{full} of 28 boards complete");
    assert!(full >= 20, "{full} of 28 boards");
}

#[test]
fn two_pictures_are_refused() {
    let Some(folder) = demo() else { return };
    let (size, views) = views(&folder, "cam03");
    let error = calibrate(size, &views[..2], Coefficients::Five).expect_err("two pictures");
    assert!(
        matches!(error, BoardError::TooFewPictures { .. }),
        "{error}"
    );
}

/// A board of 5 x 7 squares that OpenCV 5.0.0 drew (`cv2.aruco.CharucoBoard((5, 7), 0.04, 0.03, DICT_4X4_50)`), seen at an
/// angle and slightly blurred; the warp gives the true corners.
#[test]
fn corners_of_an_opencv_charuco_board_have_the_right_numbers() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/charuco_opencv.png");
    let picture = image::open(&path)
        .expect("a picture of the repository")
        .to_luma8();
    let gray = GrayPicture {
        width: picture.width(),
        height: picture.height(),
        pixels: picture.as_raw(),
    };
    let board = Charuco {
        squares: [5, 7],
        square_m: 0.04,
        marker_m: 0.03,
        dictionary: "DICT_4X4_50".to_owned(),
    };
    let found = detect_charuco("drawn", &gray, &board).expect("a board");
    assert!(found.pixels.len() >= 20, "{} of 24", found.pixels.len());
    let mut worst = 0.0_f64;
    for ([x, y], pixel) in found.board_m.iter().zip(&found.pixels) {
        let at = |row: [f64; 3]| row[0] * x + row[1] * y + row[2];
        let depth = at(WARP[2]);
        let expected = [at(WARP[0]) / depth, at(WARP[1]) / depth];
        worst = worst.max((pixel[0] - expected[0]).hypot(pixel[1] - expected[1]));
    }
    println!("{} of 24 corners, worst {worst:.3} px", found.pixels.len());
    assert!(worst < 0.25, "{worst} px");
    let other = Charuco {
        dictionary: "DICT_9X9_1".to_owned(),
        ..board
    };
    let error = detect_charuco("drawn", &gray, &other).expect_err("no such dictionary");
    assert!(error.to_string().contains("DICT_9X9_1"), "{error}");
}

/// Caliscope prints its boards like this with `inverted = true`.
#[test]
fn inverted_charuco_boards_are_detected_as_others() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/charuco_opencv.png");
    let mut picture = image::open(&path)
        .expect("a picture of the repository")
        .to_luma8();
    let board = Charuco {
        squares: [5, 7],
        square_m: 0.04,
        marker_m: 0.03,
        dictionary: "DICT_4X4_50".to_owned(),
    };
    let found = |picture: &image::GrayImage| {
        let gray = GrayPicture {
            width: picture.width(),
            height: picture.height(),
            pixels: picture.as_raw(),
        };
        detect_charuco("drawn", &gray, &board).expect("a board")
    };
    let as_drawn = found(&picture);
    image::imageops::invert(&mut picture);
    let inverted = found(&picture);
    assert_eq!(inverted.board_m, as_drawn.board_m);
    for (a, b) in inverted.pixels.iter().zip(&as_drawn.pixels) {
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.05, "{a:?} {b:?}");
    }
}

/// From board metres to pixels, as the picture was drawn.
const WARP: [[f64; 3]; 3] = [
    [1_306.305_16, -114.067_664, 69.754_042],
    [110.930_015, 1_053.041_302, 39.762_914],
    [0.011_635_47, -0.548_084_64, 1.0],
];
