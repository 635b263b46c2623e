//! Calibrates from rendered pictures of a `ChArUco` board, and writes the result to a file for comparison with other programs:
//! `tests/readers/boards.py` renders the pictures, runs this, and compares.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Instant;

use farfield_calibration::board::{
    BoardView, Charuco, Coefficients, GrayPicture, calibrate, detect_charuco,
};
use farfield_calibration::points::{self, PointCamera, PointRequest, Sighting, Timing};
use serde_json::json;

const CAMERAS: [&str; 4] = ["east", "middle", "north", "west"];
/// Squares along a row and a column.
const SQUARES: [u32; 2] = [8, 6];
const SQUARE_M: f64 = 0.08;
/// Corners of a row.
const INNER: usize = 7;
/// Corners of a board; each corner of each picture is its own moment.
const CORNERS: usize = 35;

/// The size of a camera's pictures, and the boards in them by number.
fn views(folder: &Path) -> ([u32; 2], BTreeMap<usize, BoardView>) {
    let board = Charuco {
        squares: SQUARES,
        square_m: SQUARE_M,
        marker_m: 0.06,
        dictionary: "DICT_4X4_50".to_owned(),
    };
    let mut size_px = [0, 0];
    let mut views = BTreeMap::new();
    for number in 0.. {
        let Ok(picture) = image::open(folder.join(format!("{number:03}.png"))) else {
            break;
        };
        let picture = picture.to_luma8();
        size_px = [picture.width(), picture.height()];
        let grey = GrayPicture {
            width: size_px[0],
            height: size_px[1],
            pixels: picture.as_raw(),
        };
        if let Ok(view) = detect_charuco(&number.to_string(), &grey, &board) {
            views.insert(number, view);
        }
    }
    (size_px, views)
}

/// Corners by number, row by row.
fn numbered(view: &BoardView) -> impl Iterator<Item = (usize, [f64; 2])> {
    let number = |[x, y]: &[f64; 2]| {
        let along = |at: &f64| (at / SQUARE_M).round() as usize - 1;
        along(y) * INNER + along(x)
    };
    let corners = view.board_m.iter().zip(&view.pixels);
    corners.map(move |(board, px)| (number(board), *px))
}

/// Every corner of every picture as a sight at its own moment.
fn sightings(views: &BTreeMap<usize, BoardView>) -> Vec<Sighting> {
    let mut all: Vec<(usize, [f64; 2])> = Vec::new();
    for (picture, view) in views {
        all.extend(numbered(view).map(|(number, px)| (picture * CORNERS + number, px)));
    }
    all.sort_by_key(|(moment, _)| *moment);
    let each = all.into_iter();
    each.map(|(moment, px)| Sighting {
        frame: moment as f64,
        px,
    })
    .collect()
}

/// `FARFIELD_BOARDS=DIR cargo test --release -p farfield-calibration --test side_by_side_boards -- --nocapture` writes
/// `DIR/ours.json`.
#[test]
#[expect(
    clippy::disallowed_methods,
    reason = "what is measured here is wall time, and nothing depends on it"
)]
fn rendered_boards_give_lenses_and_poses() {
    let Some(folder) = std::env::var_os("FARFIELD_BOARDS") else {
        println!("skipped: FARFIELD_BOARDS names the folder of the rendered pictures");
        return;
    };
    let folder = Path::new(&folder);
    let began = Instant::now();
    let (mut corners, mut rms_px, mut focal_px) = (BTreeMap::new(), Vec::new(), Vec::new());
    let mut cameras = Vec::new();
    for name in CAMERAS {
        let (size_px, views) = views(&folder.join(name));
        let all: Vec<BoardView> = views.values().cloned().collect();
        let lens = calibrate(size_px, &all, Coefficients::Five).expect("forty tilted boards");
        rms_px.push(lens.rms_px);
        focal_px.push(lens.intrinsics.fx_px);
        cameras.push(PointCamera {
            name: name.to_owned(),
            size_px,
            intrinsics: lens.intrinsics,
            lens: lens.lens,
            rate_hz: None,
            offset_s: None,
            sightings: sightings(&views),
        });
        let views = views.iter().map(|(picture, view)| {
            let numbered: Vec<(usize, [f64; 2])> = numbered(view).collect();
            (picture.to_string(), numbered)
        });
        corners.insert(name, views.collect::<BTreeMap<_, _>>());
    }
    let request = PointRequest::new(cameras, Timing::Synchronised);
    let found = points::calibrate(&request, &mut |_| ()).expect("four cameras that see one board");
    let seconds = began.elapsed().as_secs_f64();
    let poses = found.cameras.iter().map(|camera| {
        let state = &camera.state;
        let turn = state.camera_from_world.scaled_axis();
        let shift = -(state.camera_from_world * state.center_w);
        json!([[turn.x, turn.y, turn.z], [shift.x, shift.y, shift.z]])
    });
    let poses: Vec<_> = poses.collect();
    assert_eq!(poses.len(), CAMERAS.len());
    println!("{seconds:.1} s, {rms_px:.3?} px, focal lengths {focal_px:.2?} px");
    let document = json!({
        "seconds": seconds, "rms_px": rms_px, "focal_px": focal_px, "corners": corners, "poses": poses,
    });
    fs::write(folder.join("ours.json"), document.to_string()).expect("a folder to write to");
}
