//! Laws of the search, on maps drawn around the projections of a known truth.

use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::{Point, Transform};
use farfield_proto::grid::CellGrid;
use farfield_proto::id::{CameraIndex, PersonId, ViewpointIndex};
use farfield_proto::message::PersonPatch;
use farfield_proto::patch::{EncodedMaps, Maps};
use farfield_proto::tick::Tick;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector2};
use proptest::prelude::*;

use super::*;

const SIZE_PX: [u32; 2] = [1920, 1200];
const SIGMA_CELLS: f64 = 2.0;
const LEFT_WRIST: usize = 9;
const HIPS: std::ops::Range<usize> = 11..13;
const LEFT_ANKLE: usize = 15;
const RIGHT_ANKLE: usize = 16;
/// With perfect maps the error comes from 8 bit, the fit of a quadratic to a Gaussian, and the rest
/// of the pull of the prediction: about a tenth of a cell, which is 30 to 45 mm here.
const EXACT_M: f64 = 0.004;
/// The same for any prediction and cameras: of 4,000 random cases the worst was 5.0 mm, and one in
/// 170 was above 4.
const EXACT_ANYWHERE_M: f64 = 0.006;

/// 17 keypoints of a standing person at the origin, COCO order, metres.
fn standing() -> Vec<Vector3<f64>> {
    let side = |y: f64, x: f64, z: f64| [Vector3::new(x, y, z), Vector3::new(x, -y, z)];
    let mut points = vec![Vector3::new(0.1, 0.0, 1.62)];
    for [left, right] in [
        side(0.03, 0.08, 1.65),
        side(0.08, 0.0, 1.64),
        side(0.19, 0.0, 1.43),
        side(0.26, -0.02, 1.12),
        side(0.28, 0.1, 0.86),
        side(0.10, 0.0, 0.92),
        side(0.11, 0.04, 0.50),
        side(0.12, -0.02, 0.09),
    ] {
        points.extend([left, right]);
    }
    points
}

/// A camera at `eye_m` that looks at the person's middle.
fn camera_at(eye_m: Vector3<f64>) -> CameraModel {
    let forward = (Vector3::new(0.0, 0.0, 0.9) - eye_m).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
        right.transpose(),
        forward.cross(&right).transpose(),
        forward.transpose(),
    ]));
    let intrinsics = Intrinsics {
        fx_px: 1400.0,
        fy_px: 1400.0,
        cx_px: 959.5,
        cy_px: 599.5,
    };
    let isometry = Isometry3::from_parts(
        (-(rotation * eye_m)).into(),
        UnitQuaternion::from_rotation_matrix(&rotation),
    );
    CameraModel::new(
        "test",
        SIZE_PX,
        intrinsics,
        Distortion::default(),
        Transform::new(isometry),
    )
    .unwrap()
}

/// Cameras on a circle of 8 m, 2.5 m high, at these bearings (degrees).
fn ring(bearings_deg: &[f64]) -> Vec<CameraModel> {
    let eye = |deg: &f64| {
        Vector3::new(
            8.0 * deg.to_radians().cos(),
            8.0 * deg.to_radians().sin(),
            2.5,
        )
    };
    bearings_deg.iter().map(|deg| camera_at(eye(deg))).collect()
}

/// Four viewpoints, as in a venue.
fn four() -> Vec<CameraModel> {
    ring(&[10.0, 95.0, 200.0, 290.0])
}

fn pixel(model: &CameraModel, p: Vector3<f64>) -> Vector2<f64> {
    model
        .project(Point::new(Point3::from(p)))
        .unwrap()
        .vector_px()
}

/// Maps of 48 x 64 cells over the person, still empty.
fn empty_view(model: &CameraModel, index: u16, points: &[Vector3<f64>]) -> View {
    let px: Vec<_> = points.iter().map(|&p| pixel(model, p)).collect();
    let least = px
        .iter()
        .fold(Vector2::repeat(f64::INFINITY), |a, b| a.inf(b));
    let most = px
        .iter()
        .fold(Vector2::repeat(f64::NEG_INFINITY), |a, b| a.sup(b));
    let step = 1.4 * (most.y - least.y) / 64.0;
    let origin = (least + most) * 0.5 - Vector2::new(23.5, 31.5) * step;
    view_on_grid(
        model,
        index,
        [origin.x as f32, origin.y as f32],
        step as f32,
        points.len(),
    )
}

fn view_on_grid(
    model: &CameraModel,
    index: u16,
    origin_px: [f32; 2],
    step: f32,
    keypoints: usize,
) -> View {
    let patch = PersonPatch {
        person: PersonId(1),
        camera: CameraIndex(index),
        box_tick: Tick(0),
        capture_offset_us: 0,
        crops: vec![CellGrid {
            origin_px,
            step_px: [step, 0.0],
            width: 48,
            height: 64,
        }],
        crop_of_keypoint: vec![0; keypoints],
        maps: EncodedMaps {
            width: 48,
            height: 64,
            keypoints: keypoints as u8,
            bytes: Vec::new(),
        },
    };
    View::from_maps(
        Maps::new(48, 64, keypoints),
        &patch,
        ViewpointIndex(index),
        model,
    )
    .unwrap()
}

/// Draws a peak of `height` at the projection of `p`, keeping the larger value.
fn draw(view: &mut View, keypoint: usize, p: Vector3<f64>, height: f64) {
    let h = view.cell_from_world(keypoint) * p.push(1.0);
    let center = Vector2::new(h.x, h.y) / h.z;
    view.draw_for_test(keypoint, |x, y| {
        height * (-0.5 * (Vector2::new(x, y) - center).norm_squared() / SIGMA_CELLS.powi(2)).exp()
    });
}

/// Views with perfect maps of `truth`.
fn perfect(models: &[CameraModel], truth: &[Vector3<f64>]) -> Vec<View> {
    let view = |(i, model): (usize, &CameraModel)| {
        let mut view = empty_view(model, i as u16, truth);
        for (k, &p) in truth.iter().enumerate() {
            draw(&mut view, k, p, 0.9);
        }
        view
    };
    models.iter().enumerate().map(view).collect()
}

fn search(views: &mut [View], predicted_m: &[Vector3<f64>]) -> Vec<KeypointEstimate> {
    for view in views.iter_mut() {
        expect(view, predicted_m);
    }
    search_as_predicted(views, predicted_m)
}

fn expect(view: &mut View, predicted_m: &[Vector3<f64>]) {
    for (keypoint, &position_m) in predicted_m.iter().enumerate() {
        view.expect(keypoint, position_m);
    }
}

fn search_as_predicted(views: &mut [View], predicted_m: &[Vector3<f64>]) -> Vec<KeypointEstimate> {
    let mut estimates = Vec::new();
    let mut search = LatticeSearch::new(&KeypointSet::coco17());
    search.search(
        views,
        predicted_m,
        &LatticeParameters::default(),
        &mut estimates,
    );
    estimates
}

fn shifted(points: &[Vector3<f64>], by: [f64; 3]) -> Vec<Vector3<f64>> {
    points.iter().map(|p| p + Vector3::from(by)).collect()
}

fn errors_m(estimates: &[KeypointEstimate], truth: &[Vector3<f64>]) -> Vec<f64> {
    estimates
        .iter()
        .zip(truth)
        .map(|(e, t)| (e.position_m - t).norm())
        .collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn perfect_maps_give_the_truth_anywhere_in_the_lattice(
        off in prop::array::uniform3(-0.11f64..0.11), first in 0.0f64..360.0,
    ) {
        let truth = standing();
        let mut views = perfect(&ring(&[first, first + 85.0, first + 190.0, first + 280.0]), &truth);
        let estimates = search(&mut views, &shifted(&truth, off));
        let worst = largest(&errors_m(&estimates, &truth));
        prop_assert!(worst < EXACT_ANYWHERE_M, "{worst}");
        prop_assert!(estimates.iter().all(|e| e.views == 4 && e.weight > 0.8 && e.ray.is_none()));
    }

    #[test]
    fn the_answer_is_not_quantised(shift in 0.0f64..0.02) {
        // A prediction that moves by less than a step must not move the answer with it.
        let truth = standing();
        let mut views = perfect(&four(), &truth);
        let a = search(&mut views, &shifted(&truth, [0.05, 0.0, 0.0]));
        let b = search(&mut views, &shifted(&truth, [0.05 + shift, shift, -shift]));
        let apart = a.iter().zip(&b).map(|(a, b)| (a.position_m - b.position_m).norm());
        prop_assert!(apart.fold(0.0, f64::max) < EXACT_M);
    }

    #[test]
    fn any_drawing_gives_finite_numbers(
        seed in prop::collection::vec(any::<u8>(), 97), off in prop::array::uniform3(-30.0f64..30.0),
    ) {
        let truth = standing();
        let mut views = perfect(&four(), &truth);
        for view in &mut views {
            for k in 0..17 {
                view.draw_for_test(k, |x, y| f64::from(seed[(x * 7.0 + y * 3.0) as usize % seed.len()]) / 255.0);
            }
        }
        let predicted = shifted(&truth, off);
        for (e, p) in search(&mut views, &predicted).iter().zip(&predicted) {
            prop_assert!(e.position_m.iter().all(|v| v.is_finite()));
            prop_assert!((0.0..=1.0).contains(&e.weight) && (0.0..=1.0).contains(&e.support));
            prop_assert!((e.position_m - p).norm() < 0.6);
        }
    }
}

#[test]
fn a_higher_wrong_peak_in_one_view_does_not_pull() {
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    draw(
        &mut views[1],
        LEFT_WRIST,
        truth[LEFT_WRIST] + Vector3::new(0.0, 0.0, 0.25),
        1.0,
    );
    let estimates = search(&mut views, &shifted(&truth, [0.03, -0.02, 0.04]));
    assert!(errors_m(&estimates, &truth)[LEFT_WRIST] < EXACT_M);
}

#[test]
fn a_wrong_peak_in_one_view_pulls_less_than_a_fifth() {
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    views[2].draw_for_test(LEFT_WRIST, |_, _| -1.0);
    draw(
        &mut views[2],
        LEFT_WRIST,
        truth[LEFT_WRIST] + Vector3::new(0.0, 0.0, 0.2),
        0.9,
    );
    let estimates = search(&mut views, &shifted(&truth, [0.0, 0.0, 0.03]));
    assert!(errors_m(&estimates, &truth)[LEFT_WRIST] < 0.04);
    assert_eq!(estimates[LEFT_WRIST].views, 3);
}

#[test]
fn a_second_peak_saves_a_limb_that_two_views_misplace() {
    // Two views show the mirrored ankle more clearly than the right one; the other two do not.
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    for view in &mut views[..2] {
        view.draw_for_test(LEFT_ANKLE, |_, _| -1.0);
        draw(view, LEFT_ANKLE, truth[LEFT_ANKLE], 0.4);
        draw(view, LEFT_ANKLE, truth[RIGHT_ANKLE], 0.9);
    }
    let estimates = search(&mut views, &shifted(&truth, [0.02, -0.05, 0.0]));
    // The ankles are 240 mm apart; in the second view their peaks run into each other.
    assert!(errors_m(&estimates, &truth)[LEFT_ANKLE] < 0.03);
}

#[test]
fn two_ankles_do_not_both_take_one_peak() {
    // Every view shows the right ankle best for both sides, the left one faintly.
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    for view in &mut views {
        view.draw_for_test(LEFT_ANKLE, |_, _| -1.0);
        draw(view, LEFT_ANKLE, truth[LEFT_ANKLE], 0.2);
        draw(view, LEFT_ANKLE, truth[RIGHT_ANKLE], 0.95);
    }
    let estimates = search(&mut views, &truth);
    let errors = errors_m(&estimates, &truth);
    assert!(
        errors[LEFT_ANKLE] < 0.02 && errors[RIGHT_ANKLE] < EXACT_M,
        "{errors:?}"
    );
}

#[test]
fn an_ankle_with_only_its_twins_peak_is_predicted() {
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    for view in &mut views {
        view.draw_for_test(LEFT_ANKLE, |_, _| -1.0);
        draw(view, LEFT_ANKLE, truth[RIGHT_ANKLE], 0.9);
    }
    let estimates = search(&mut views, &truth);
    assert!(estimates[LEFT_ANKLE].weight <= 0.0);
    assert!(errors_m(&estimates, &truth)[LEFT_ANKLE] < 1e-12);
    assert!(estimates[RIGHT_ANKLE].weight > 0.8);
}

#[test]
fn folded_hands_may_share_a_place() {
    let mut truth = standing();
    truth[LEFT_WRIST] = Vector3::new(0.3, 0.02, 1.1);
    truth[LEFT_WRIST + 1] = Vector3::new(0.3, -0.02, 1.1);
    let mut views = perfect(&four(), &truth);
    let estimates = search(&mut views, &shifted(&truth, [0.02, 0.0, 0.0]));
    assert!(estimates[LEFT_WRIST].weight > 0.8 && estimates[LEFT_WRIST + 1].weight > 0.8);
}

#[test]
fn an_unsupported_keypoint_is_its_prediction_with_weight_zero() {
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    for view in &mut views {
        view.draw_for_test(LEFT_WRIST, |_, _| -1.0);
    }
    let predicted = shifted(&truth, [0.05, 0.0, 0.0]);
    let wrist = &search(&mut views, &predicted)[LEFT_WRIST];
    assert!((wrist.position_m - predicted[LEFT_WRIST]).norm() < 1e-12);
    assert!(wrist.weight <= 0.0 && wrist.views == 0);
}

#[test]
fn without_views_or_predictions_there_is_no_evidence() {
    let truth = standing();
    let none = search(&mut [], &truth);
    assert!(none.iter().all(|e| e.weight <= 0.0) && none.len() == 17);
    let mut views = perfect(&four(), &truth);
    // The views have no expected places.
    assert!(
        search_as_predicted(&mut views, &truth)
            .iter()
            .all(|e| e.weight <= 0.0)
    );
    assert_eq!(search_as_predicted(&mut views, &[]).len(), 17);
}

#[test]
fn a_single_view_moves_a_keypoint_only_across_its_ray() {
    let truth = standing();
    let mut views = perfect(&ring(&[30.0]), &truth);
    let predicted = shifted(&truth, [0.04, -0.05, 0.03]);
    for (e, (t, p)) in search(&mut views, &predicted)
        .iter()
        .zip(truth.iter().zip(&predicted))
    {
        let ray = e.ray.unwrap();
        let along = |v: Vector3<f64>| v.dot(&ray);
        let missed = e.position_m - t;
        assert!((missed - ray.as_ref() * along(missed)).norm() < EXACT_M);
        assert!(
            along(e.position_m - p).abs() < 0.01,
            "{}",
            along(e.position_m - p)
        );
    }
}

#[test]
fn a_person_half_outside_a_view_is_found_in_the_others() {
    let truth = standing();
    let models = four();
    let mut views = perfect(&models, &truth);
    // The crop of the first view ends at the hips: what lies below is not there, and not zero.
    let grid = *views[0].grid(0);
    let hip = pixel(&models[0], truth[11]);
    let origin = [grid.origin_px[0], hip.y as f32 - 60.0 * grid.step_px[0]];
    views[0] = view_on_grid(&models[0], 0, origin, grid.step_px[0], 17);
    for (k, &p) in truth.iter().enumerate() {
        draw(&mut views[0], k, p, 0.9);
    }
    let estimates = search(&mut views, &shifted(&truth, [0.04, 0.02, -0.03]));
    assert!(
        largest(&errors_m(&estimates, &truth)) < 0.006,
        "{:?}",
        errors_m(&estimates, &truth)
    );
    assert_eq!(estimates[LEFT_ANKLE].views, 3);
    assert!(
        estimates[LEFT_ANKLE].weight > 0.8,
        "an absent view is no vote against"
    );
}

#[test]
fn each_view_is_searched_at_its_own_capture_instant() {
    // 8 m/s, and the second view looked 5 ms early: 40 mm.
    let truth = standing();
    let early = shifted(&truth, [-0.04, 0.0, 0.0]);
    let models = four();
    let mut views = perfect(&models, &truth);
    views[1] = perfect(&models[1..2], &early).remove(0);
    let predicted = shifted(&truth, [0.02, 0.0, 0.01]);
    for view in &mut views {
        expect(view, &predicted);
    }
    expect(&mut views[1], &shifted(&early, [0.02, 0.0, 0.01]));
    let estimates = search_as_predicted(&mut views, &predicted);
    assert!(largest(&errors_m(&estimates, &truth)) < EXACT_M);
}

#[test]
fn two_close_viewpoints_have_one_vote() {
    // They agree on a wrong wrist; two views from elsewhere see the right one a little less
    // clearly.
    let truth = standing();
    let mut views = perfect(&ring(&[10.0, 11.0, 120.0, 240.0]), &truth);
    let wrong = truth[LEFT_WRIST] + Vector3::new(0.0, 0.0, 0.2);
    for (i, view) in views.iter_mut().enumerate() {
        view.draw_for_test(LEFT_WRIST, |_, _| -1.0);
        if i < 2 {
            draw(view, LEFT_WRIST, wrong, 0.9);
        } else {
            draw(view, LEFT_WRIST, truth[LEFT_WRIST], 0.7);
        }
    }
    let wrist = &search(&mut views, &shifted(&truth, [0.0, 0.0, 0.1]))[LEFT_WRIST];
    assert!((wrist.position_m - truth[LEFT_WRIST]).norm() < 0.02);
    assert_eq!(wrist.views, 2);
}

#[test]
fn two_opposite_viewpoints_are_one_witness_between_them() {
    // At the height of the hips their rays are one line: they fix a keypoint across it, but not
    // along it.
    let truth = standing();
    let opposite = ring(&[20.0, 200.0]);
    let level = |model: &CameraModel| {
        let eye_m = model.center().coordinates_m().coords;
        camera_at(Vector3::new(eye_m.x, eye_m.y, 0.9))
    };
    let models: Vec<_> = opposite.iter().map(level).collect();
    let mut views = perfect(&models, &truth);
    for hip in &search(&mut views, &shifted(&truth, [0.03, 0.02, 0.0]))[HIPS] {
        assert_eq!(hip.views, 1);
        assert!(hip.ray.is_some());
    }
    // A third view from the side gives a second line, and a place.
    let mut views = perfect(&[models, ring(&[110.0])].concat(), &truth);
    for hip in &search(&mut views, &shifted(&truth, [0.03, 0.02, 0.0]))[HIPS] {
        assert_eq!(hip.views, 2);
        assert!(hip.ray.is_none());
    }
}

#[test]
fn a_blind_viewpoint_takes_no_share_of_its_neighbour() {
    // The views at 10 and 11 degrees would count as one. But of them only the first, and the one at
    // 120 degrees, see the wrist: two witnesses.
    let truth = standing();
    let mut views = perfect(&ring(&[10.0, 11.0, 120.0, 121.0]), &truth);
    for i in [1, 3] {
        views[i].draw_for_test(LEFT_WRIST, |_, _| -1.0);
    }
    let wrist = &search(&mut views, &truth)[LEFT_WRIST];
    assert_eq!(wrist.views, 2);
    assert!(wrist.ray.is_none());
}

#[test]
fn occlusion_lowers_weight_and_vote_of_a_view() {
    let truth = standing();
    let mut views = perfect(&four(), &truth);
    let free = search(&mut views, &truth)[LEFT_WRIST].weight;
    for view in &mut views {
        view.occlusion[LEFT_WRIST] = 0.3;
    }
    let occluded = search(&mut views, &truth)[LEFT_WRIST].weight;
    assert!((occluded / free - 0.3).abs() < 1e-9);
}

/// Twelve views all round; those from `blocked` on show nothing of these keypoints.
fn twelve(truth: &[Vector3<f64>], blocked: usize, keypoints: &[usize]) -> Vec<View> {
    let bearings: Vec<f64> = (0..12).map(|i| 10.0 + 85.0 * f64::from(i)).collect();
    let mut views = perfect(&ring(&bearings), truth);
    for view in &mut views[blocked..] {
        for &keypoint in keypoints {
            view.draw_for_test(keypoint, |_, _| -1.0);
        }
    }
    views
}

#[test]
fn ten_hidden_views_do_not_weaken_two_that_see() {
    let truth = standing();
    let everything: Vec<usize> = (0..truth.len()).collect();
    let mut views = twelve(&truth, 2, &everything);
    let near = shifted(&truth, [0.05, 0.0, 0.03]);
    for (estimate, truth) in search(&mut views, &near).iter().zip(&truth) {
        assert!(estimate.weight > 0.8 && estimate.views == 2, "{estimate:?}");
        assert!((estimate.position_m - truth).norm() < 0.02);
    }
}

#[test]
fn silent_views_of_a_visible_person_count_against_a_wrist() {
    let truth = standing();
    let mut views = twelve(&truth, 2, &[LEFT_WRIST]);
    let wrist = &search(&mut views, &truth)[LEFT_WRIST];
    assert!(wrist.support < 0.3, "{wrist:?}");
}
