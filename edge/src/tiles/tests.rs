//! Properties of every plan, for any camera and field.

use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Transform;
use farfield_proto::model_card::Letterbox;
use farfield_proto::venue::Field;
use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

use super::plan::MAX_SCALE;
use super::standing::standing;
use super::*;
use crate::inference::{DetectorInput, DetectorWindow};

const INPUT: DetectorInput = DetectorInput {
    size_px: [416, 256],
    letterbox: Letterbox::TopLeft,
};
/// Tolerance for the promised heights: pixels are computed in `f64`.
const ROUNDING_PX: f64 = 1e-6;

/// A level camera at `eye_m` that looks at `at_m` (world, metres).
fn camera(eye_m: [f64; 3], at_m: [f64; 3], focal_px: f64, k1: f64) -> CameraModel {
    camera_of(eye_m, at_m, focal_px, k1, [1920, 1200])
}

/// The same with pictures of `size_px`.
fn camera_of(
    eye_m: [f64; 3],
    at_m: [f64; 3],
    focal_px: f64,
    k1: f64,
    size_px: [u32; 2],
) -> CameraModel {
    let (eye, at) = (Vector3::from(eye_m), Vector3::from(at_m));
    let forward = (at - eye).normalize();
    // If the camera looks straight down, the picture's upper edge is north.
    let up = if forward.z < -0.999 {
        Vector3::y()
    } else {
        Vector3::z()
    };
    let right = forward.cross(&up).normalize();
    let down = forward.cross(&right);
    let axes = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let rotation = Rotation3::from_matrix(&axes);
    let motion = Isometry3::from_parts((-(rotation * eye)).into(), rotation.into());
    let intrinsics = Intrinsics {
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: f64::from(size_px[0]) / 2.0 - 0.5,
        cy_px: f64::from(size_px[1]) / 2.0 - 0.5,
    };
    let lens = Distortion {
        k1,
        ..Distortion::default()
    };
    CameraModel::new("c", size_px, intrinsics, lens, Transform::new(motion)).unwrap()
}

/// The strongest valid barrel distortion, -k1: 0.1, or the limit at the picture's corner, because a
/// lens must not fold inside its picture.
///
/// ```text
///   r (1 + k1 r^2) is largest at r^2 = -1 / (3 k1), where it is 2 r / 3:   -k1 < 4 / (27 c^2),   c: the corner
/// ```
fn most_bent(focal_px: f64) -> f64 {
    let corner = 960.0_f64.hypot(600.0) / focal_px;
    f64::min(0.1, 0.99 * 4.0 / (27.0 * corner * corner))
}

#[test]
fn the_strongest_generated_lens_is_valid() {
    for focal_px in [900.0, 901.0, 930.0, 1000.0, 6000.0] {
        let bent = |k1| camera([0.0, -9.0, 3.0], [0.0, 0.0, 1.0], focal_px, k1);
        bent(-most_bent(focal_px));
    }
}

fn field(half_m: [f64; 2]) -> Field {
    Field {
        min_m: [-half_m[0], -half_m[1], -0.3],
        max_m: [half_m[0], half_m[1], 2.6],
        floor_m: 0.0,
    }
}

/// Whether one of `windows` shows a person, complete in the picture, large enough.
fn is_served(windows: &[DetectorWindow], around_px: [f64; 4], long_px: f64) -> bool {
    windows.iter().any(|window| {
        let scale = window.scale(INPUT.size_px);
        let tall_enough =
            long_px * scale >= TALL_ENOUGH_PX - ROUNDING_PX || scale >= MAX_SCALE - 1e-9;
        tall_enough && window.holds(around_px, 0.0, [1920, 1200])
    })
}

fn cell_count(plans: &[TilePlan]) -> i64 {
    i64::try_from(plans[0].cells.len()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn every_person_is_complete_and_tall_enough_in_some_window(
        half_m in prop::array::uniform2(4.0f64..55.0),
        bearing in 0.0..std::f64::consts::TAU,
        away in 0.0f64..2.0,
        height_m in 1.2f64..14.0,
        focal_px in 900.0f64..6000.0,
        bend in 0.0f64..=1.0,
        look_at in prop::array::uniform2(-0.8f64..0.8),
        limit in 2usize..30,
        places in prop::collection::vec(prop::array::uniform2(-1.0f64..1.0), 60),
    ) {
        let eye_m = [away * half_m[0] * bearing.cos(), away * half_m[1] * bearing.sin(), height_m];
        let at_m = [look_at[0] * half_m[0], look_at[1] * half_m[1], 0.5];
        let camera = camera(eye_m, at_m, focal_px, -bend * most_bent(focal_px));
        let field = field(half_m);
        let plans = plan(&[&camera], &field, INPUT, limit);
        prop_assert!(plans[0].most_windows() <= 1 + limit || cell_count(&plans) == 256);
        // Over one round of the cells: a person in a cell is covered by its pass.
        let windows: Vec<DetectorWindow> = (0..cell_count(&plans))
            .flat_map(|pass| plans[0].windows(pass).collect::<Vec<_>>())
            .collect();
        for [u, v] in places {
            let feet_m = [u * half_m[0], v * half_m[1], 0.0];
            let Some(person) = standing(&camera, feet_m) else { continue };
            let [l, t, r, b] = person.around_px;
            let is_whole = l > 0.0 && t > 0.0 && r < 1920.0 && b < 1200.0;
            if is_whole {
                prop_assert!(
                    is_served(&windows, person.around_px, person.long_px),
                    "no window shows {person:?}"
                );
            }
        }
    }
}

#[test]
fn a_room_with_large_people_needs_no_tiles() {
    let camera = camera([5.0, 0.0, 2.5], [0.0, 0.0, 1.0], 1200.0, -0.08);
    let plans = plan(&[&camera], &field([2.5, 2.5]), INPUT, 4);
    assert_eq!(plans[0].most_windows(), 1);
    assert_eq!(cell_count(&plans), 1);
}

#[test]
fn distant_people_get_tiles_at_their_places() {
    let camera = camera([0.0, -60.0, 6.0], [0.0, 40.0, 1.0], 2600.0, -0.05);
    let plans = plan(&[&camera], &field([20.0, 40.0]), INPUT, 100);
    let tiles = &plans[0].cells[0];
    assert!(tiles.len() > 3, "{}", tiles.len());
    let inside = |w: &DetectorWindow| w.min_px.iter().all(|&m| m >= 0.0);
    assert!(tiles.iter().all(inside));
    let ends = tiles.iter().map(DetectorWindow::max_px);
    assert!(
        ends.clone()
            .all(|[right, bottom]| right <= 1920.0 + 1e-9 && bottom <= 1200.0 + 1e-9)
    );
    // No person in the lower part of the picture is far away.
    let lowest = tiles.iter().filter(|w| w.scale(INPUT.size_px) > 0.9);
    assert!(lowest.clone().count() > 0);
    assert!(lowest.clone().all(|w| w.min_px[1] < 800.0));
}

#[test]
fn all_cameras_use_the_cells_of_the_most_demanding_one() {
    let near = camera([5.0, 0.0, 2.5], [0.0, 0.0, 1.0], 1200.0, -0.08);
    let far = camera([0.0, -60.0, 6.0], [0.0, 40.0, 1.0], 2600.0, -0.05);
    let plans = plan(&[&near, &far], &field([20.0, 40.0]), INPUT, 4);
    assert!(cell_count(&plans) > 1);
    assert_eq!(plans[0].cells.len(), plans[1].cells.len());
    assert!(plans.iter().all(|p| p.most_windows() <= 5));
    let turn = cell_count(&plans);
    let windows = |pass| plans[1].windows(pass).collect::<Vec<_>>();
    assert_eq!(windows(3), windows(3 + turn));
    assert_eq!(windows(-1), windows(turn - 1));
}

#[test]
fn the_same_venue_gives_the_same_plan() {
    let camera = camera([0.0, -60.0, 6.0], [0.0, 40.0, 1.0], 2600.0, -0.05);
    let make = || plan(&[&camera], &field([20.0, 40.0]), INPUT, 4);
    assert_eq!(make(), make());
}

#[test]
fn an_input_too_small_for_a_person_gets_no_tiles() {
    let camera = camera([0.0, -60.0, 6.0], [0.0, 40.0, 1.0], 2600.0, -0.05);
    for side_px in [1, 32, 127] {
        let input = DetectorInput {
            size_px: [side_px; 2],
            ..INPUT
        };
        let plans = plan(&[&camera], &field([20.0, 40.0]), input, 8);
        assert_eq!(plans[0].windows(3).count(), 1, "{side_px}");
        assert_eq!(plans[0].most_windows(), 1);
    }
}

#[test]
fn no_pass_has_more_than_256_tiles() {
    // 8K pictures full of people as small as tiles are made for, in few of the cells.
    let camera = camera_of(
        [0.0, -200.0, 60.0],
        [0.0, 0.0, 0.0],
        6000.0,
        0.0,
        [7680, 4320],
    );
    let input = DetectorInput {
        size_px: [128, 128],
        ..INPUT
    };
    for limit in [1, 256, 10_000] {
        let plans = plan(&[&camera], &field([8000.0, 8000.0]), input, limit);
        assert_eq!(plans[0].most_windows(), 257, "{limit}");
    }
}

#[test]
fn under_a_ceiling_camera_the_width_of_shoulders_counts() {
    let over = |focal_px| camera([0.0, 0.0, 6.0], [0.0, 0.0, 0.0], focal_px, 0.0);
    // Under a long lens the shoulders alone are as large as an upright person must be.
    let near = plan(&[&over(2700.0)], &field([1.5, 1.0]), INPUT, 8);
    assert_eq!(near[0].most_windows(), 1);
    // Under a wide lens they are not, but no person is so small that full resolution is needed.
    let wide = plan(&[&over(1200.0)], &field([4.0, 3.0]), INPUT, 64);
    let finest = wide[0].cells[0].iter().map(|w| w.scale(INPUT.size_px));
    assert!(finest.fold(0.0, f64::max) < 0.7);
    let below = standing(&over(1200.0), [0.0; 3]).unwrap();
    let [l, t, r, b] = below.around_px;
    assert!((below.long_px - 0.25 * 1.7 * 1200.0 / 4.3).abs() < 1e-6);
    assert!((r - l) > below.long_px && (b - t) > below.long_px);
}

#[test]
fn pictures_no_larger_than_the_input_need_no_tiles() {
    let [eye_m, at_m] = [[0.0, -60.0, 6.0], [0.0, 40.0, 1.0]];
    for size_px in [[16, 16], [416, 256], [300, 200]] {
        let camera = camera_of(eye_m, at_m, 20.0, 0.0, size_px);
        let plans = plan(&[&camera], &field([20.0, 40.0]), INPUT, 8);
        assert_eq!(plans[0].most_windows(), 1, "{size_px:?}");
    }
}
