//! Tests of the places of a view's cells, and of which have data.

use farfield_proto::camera::{Distortion, Intrinsics};
use farfield_proto::frames::{Pixel, Transform, Undistorted};
use farfield_proto::id::PersonId;
use farfield_proto::patch::{CompressionLevel, EncodedMaps, Encoder};
use farfield_proto::tick::Tick;
use nalgebra::Isometry3;
use proptest::prelude::*;

use super::*;

const WIDTH: u16 = 12;
const HEIGHT: u16 = 16;

/// A camera of 200 x 100 pixels at the world's origin, looking along +z.
fn model() -> CameraModel {
    let intrinsics = Intrinsics {
        fx_px: 100.0,
        fy_px: 100.0,
        cx_px: 99.5,
        cy_px: 49.5,
    };
    CameraModel::new(
        "test",
        [200, 100],
        intrinsics,
        Distortion::default(),
        Transform::new(Isometry3::identity()),
    )
    .unwrap()
}

fn patch(origin_px: [f32; 2], step_px: [f32; 2]) -> PersonPatch {
    PersonPatch {
        person: PersonId(1),
        camera: CameraIndex(3),
        box_tick: Tick(0),
        capture_offset_us: -2500,
        crops: vec![CellGrid {
            origin_px,
            step_px,
            width: WIDTH,
            height: HEIGHT,
        }],
        crop_of_keypoint: vec![0; 2],
        maps: EncodedMaps {
            width: WIDTH,
            height: HEIGHT,
            keypoints: 2,
            bytes: Vec::new(),
        },
    }
}

fn maps() -> Maps {
    let mut maps = Maps::new(usize::from(WIDTH), usize::from(HEIGHT), 2);
    for (i, cell) in maps.cells_mut(1).iter_mut().enumerate() {
        *cell = (i % 12 * 10 + i / 12 * 4) as u8;
    }
    maps
}

fn view(patch: &PersonPatch) -> Result<View, EvidenceError> {
    View::from_maps(maps(), patch, ViewpointIndex(2), &model())
}

/// The map at a pixel, 0 to 1; `None` without data.
fn sample(view: &View, keypoint: usize, pixel: Pixel<Undistorted>) -> Option<f64> {
    let cell = view.grid(0).cell(pixel);
    view.knows(keypoint, cell)
        .then(|| view.map(keypoint).bilinear(cell))
}

proptest! {
    #[test]
    fn between_cells_a_plane_is_read_as_a_plane(x in 0.0f64..11.0, y in 0.0f64..15.0, angle in -3.0f32..3.0) {
        let patch = patch([100.0, 50.0], [1.5 * angle.cos(), 1.5 * angle.sin()]);
        let view = view(&patch).unwrap();
        let pixel = patch.crops[0].pixel(x, y);
        let value = sample(&view, 1, pixel).unwrap();
        // Grids are sent in single precision.
        prop_assert!((value * 255.0 - (x * 10.0 + y * 4.0)).abs() < 0.01);
    }

    #[test]
    fn a_notch_does_not_depend_on_the_written_part(
        peak in prop::array::uniform2(0.0f64..16.0), at in prop::array::uniform2(-3.0f64..19.0),
        depth in 0.1f64..1.0, level in 0usize..3,
    ) {
        let mut drawn = Maps::new(WIDTH.into(), HEIGHT.into(), 2);
        for (i, cell) in drawn.cells_mut(1).iter_mut().enumerate() {
            let r2 = ((i % 12) as f64 - peak[0]).powi(2) + ((i / 12) as f64 - peak[1]).powi(2);
            *cell = (230.0 * (-0.5 * r2).exp()) as u8;
        }
        let encoded = Encoder::new().encode(&drawn, CompressionLevel::all().nth(level).unwrap());
        let mut decoded = Maps::default();
        Decoder::new().decode(&encoded, &mut decoded).unwrap();
        let mut whole = decoded.clone();
        whole.cells_mut(1);
        let notch = Notch { at: Vector2::from(at), height: 0.9, stays: None, depth };
        let [decoded, whole] = [decoded, whole].map(|maps| {
            let patch = patch([100.0, 50.0], [1.0, 0.0]);
            let mut view = View::from_maps(maps, &patch, ViewpointIndex(2), &model()).unwrap();
            view.carve(1, &notch);
            view.cells_for_test(1)
        });
        prop_assert_eq!(decoded, whole);
    }

    #[test]
    fn world_to_cells_is_projection_and_then_the_grid(
        p in prop::array::uniform3(-1.0f64..1.0), angle in -3.0f32..3.0,
    ) {
        let p_m = Vector3::new(p[0], p[1], p[2] + 3.0);
        let patch = patch([80.0, 40.0], [0.7 * angle.cos(), 0.7 * angle.sin()]);
        let h = view(&patch).unwrap().cell_from_world(0) * p_m.push(1.0);
        let pixel = Pixel::new(p_m.x / p_m.z * 100.0 + 99.5, p_m.y / p_m.z * 100.0 + 49.5);
        prop_assert!((Vector2::new(h.x, h.y) / h.z - patch.crops[0].cell(pixel)).norm() < 1e-9);
        prop_assert!((h.z - p_m.z).abs() < 1e-12);
    }

    #[test]
    fn cells_that_the_camera_does_not_see_are_unknown(
        origin in prop::array::uniform2(-60.0f32..220.0), angle in -3.0f32..3.0, step in 0.5f32..8.0,
    ) {
        let patch = patch(origin, [step * angle.cos(), step * angle.sin()]);
        let (view, model) = (view(&patch).unwrap(), model());
        for i in 0..usize::from(WIDTH) * usize::from(HEIGHT) {
            let (x, y) = ((i % 12) as f64, (i / 12) as f64);
            let known = view.knows(0, Vector2::new(x, y));
            // A corner of the image between tested cells is not noticed: a tolerance of one test
            // step.
            let near_image = (-4..=4).any(|dx| (-4..=4).any(|dy| {
                model.sees(patch.crops[0].pixel(x + f64::from(dx), y + f64::from(dy)))
            }));
            prop_assert!(!known || near_image);
        }
    }
}

#[test]
fn outside_the_crop_a_view_has_no_data_and_not_zero() {
    let patch = patch([100.0, 50.0], [1.0, 0.0]);
    let view = view(&patch).unwrap();
    assert_eq!(sample(&view, 0, Pixel::new(100.0, 50.0)), Some(0.0));
    assert_eq!(sample(&view, 0, Pixel::new(99.4, 50.0)), None);
    assert_eq!(sample(&view, 0, Pixel::new(100.0, 65.6)), None);
    assert_eq!(
        sample(&view, 2, Pixel::new(100.0, 50.0)),
        None,
        "no such keypoint"
    );
}

#[test]
fn outside_the_image_maps_repeat_their_last_value_without_data() {
    // Columns 6 to 11 lie right of the image's edge at 199.5.
    let patch = patch([194.0, 20.0], [1.0, 0.0]);
    let view = view(&patch).unwrap();
    assert!(sample(&view, 1, Pixel::new(196.0, 25.0)).is_some());
    assert_eq!(sample(&view, 1, Pixel::new(203.0, 25.0)), None);
    let row = &view.cells_for_test(1)[5 * 12..6 * 12];
    let last_known = (0..12)
        .rev()
        .find(|&x| view.knows(1, Vector2::new(f64::from(x), 5.0)))
        .unwrap() as usize;
    assert!(
        row[last_known..]
            .iter()
            .all(|&cell| cell == row[last_known]),
        "{row:?}"
    );
}

#[test]
fn a_fill_replaces_all_data_of_the_last_tick() {
    let view = view(&patch([100.0, 50.0], [1.0, 0.0])).unwrap();
    assert_eq!(
        (view.viewpoint, view.camera, view.n_keypoints()),
        (ViewpointIndex(2), CameraIndex(3), 2)
    );
    assert!((view.capture_offset_s + 0.0025).abs() < 1e-12);
    assert!((0..2).all(|keypoint| view.expected(keypoint).is_none()));
    assert!(view.occlusion.iter().all(|&w| w >= 1.0) && view.occlusion.len() == 2);
}

#[test]
fn grids_and_crops_that_do_not_fit_are_refused() {
    let mut wrong = patch([100.0, 50.0], [1.0, 0.0]);
    wrong.crops[0].width = 13;
    assert_eq!(
        view(&wrong).unwrap_err(),
        EvidenceError::Grid {
            crop: 0,
            width: 12,
            height: 16
        }
    );
    let mut wrong = patch([f32::NAN, 50.0], [1.0, 0.0]);
    assert!(matches!(view(&wrong), Err(EvidenceError::Grid { .. })));
    wrong = patch([100.0, 50.0], [1.0, 0.0]);
    wrong.crop_of_keypoint = vec![0, 1];
    assert_eq!(
        view(&wrong).unwrap_err(),
        EvidenceError::NoCrop { keypoint: 1 }
    );
    wrong.crop_of_keypoint = vec![0];
    assert_eq!(
        view(&wrong).unwrap_err(),
        EvidenceError::NoCrop { keypoint: 1 }
    );
}
