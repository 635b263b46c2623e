//! The effect of a calibration on its users: errors of triangulated joints relative to those with the true cameras; and the
//! effect of thinning a long recording.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::simulated::{SIZE_PX, body, gauss};
use super::*;
use crate::alignment::Similarity;
use crate::geometry::{Sight, triangulate};
use crate::points::tests::simulated as ball;

/// Mean distance of triangulated joints from the true ones, metres: with the true cameras, and with the found ones after
/// similarity alignment, from the same noisy keypoints (25 mm on the body, 1 px).
fn mean_errors_m(field: &Field, truth: &[CameraState], found: &[CameraState]) -> (f64, f64) {
    let centers = |states: &[CameraState]| states.iter().map(|s| s.center_w).collect::<Vec<_>>();
    let similarity = Similarity::between(&centers(found), &centers(truth)).unwrap();
    let found: Vec<CameraState> = found
        .iter()
        .map(|state| similarity.apply_to_camera(state))
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut by_truth, mut by_found, mut count) = (0.0, 0.0, 0.0);
    for second in 0..60 {
        for person in 0..4 {
            for joint in body(field, &USUAL, person, f64::from(second) + 0.35) {
                let sights = sights(truth, &joint, &mut rng);
                let meet = |cameras: &[CameraState]| {
                    let each = sights.iter().map(|(index, px)| {
                        let state = &cameras[*index];
                        let bearing = state.bearing(*px, state.fold_radius()).unwrap();
                        (state.center_w, state.camera_from_world.inverse() * bearing)
                    });
                    triangulate(&each.collect::<Vec<Sight>>(), 1.0).map(|(at, _)| at)
                };
                let (Some(a), Some(b)) = (meet(truth), meet(&found)) else {
                    continue;
                };
                by_truth += (a - joint).norm();
                by_found += (b - joint).norm();
                count += 1.0;
            }
        }
    }
    (by_truth / count, by_found / count)
}

/// The noisy pixels of `joint` in the cameras that see it.
fn sights(
    cameras: &[CameraState],
    joint: &Vector3<f64>,
    rng: &mut ChaCha8Rng,
) -> Vec<(usize, [f64; 2])> {
    let mut sights = Vec::new();
    for (index, state) in cameras.iter().enumerate() {
        let depth_m = (state.camera_from_world * (joint - state.center_w)).z;
        let sigma_px = libm::hypot(0.025 * state.intrinsics.fx_px / depth_m.max(0.5), 1.0);
        let noise = [sigma_px * gauss(rng), sigma_px * gauss(rng)];
        let Some(px) = state.project(joint, state.fold_radius()) else {
            continue;
        };
        let px = [px.x + noise[0], px.y + noise[1]];
        let is_inside =
            (0..2).all(|axis| (0.0..f64::from(SIZE_PX[axis]) - 1.0).contains(&px[axis]));
        if is_inside {
            sights.push((index, px));
        }
    }
    sights
}

fn print_errors(what: &str, field: &Field, errors: (f64, f64)) -> f64 {
    let (by_truth, by_found) = errors;
    println!(
        "{:?} m, {what}: joints off by {:.2} mm with the true cameras, {:.2} mm with those found",
        field.size_m,
        1000.0 * by_truth,
        1000.0 * by_found
    );
    by_found - by_truth
}

/// The error of joints grows by half a millimetre at most with cameras calibrated from a ball.
#[test]
fn joints_have_nearly_the_same_error_with_cameras_from_a_ball() {
    let fields = [
        (SMALL, ball::SMALL),
        (HALL, ball::HALL),
        (PITCH, ball::PITCH),
    ];
    for (field, ball_field) in fields {
        let mut truth = ball::cameras(&ball_field);
        for state in &mut truth {
            state.period_s = 0.1;
        }
        let request = ball::request(&ball_field, &truth, &ball::USUAL, Timing::Synchronised);
        let found = crate::points::calibrate(&request, &mut |_| ()).unwrap();
        let worse_m = print_errors(
            "ball",
            &field,
            mean_errors_m(&field, &truth, &found_states(&found)),
        );
        assert!(worse_m < 0.0005, "{worse_m}");
    }
}

/// `FARFIELD_MEASURE=1 cargo test -p farfield-calibration --lib cameras_from_people -- --nocapture`
#[test]
fn joints_are_at_most_3_mm_worse_with_cameras_from_people() {
    if std::env::var_os("FARFIELD_MEASURE").is_none() {
        println!("skipped: takes minutes; FARFIELD_MEASURE=1 runs it");
        return;
    }
    for field in [SMALL, HALL, PITCH] {
        let walk = Walk {
            seconds: 120.0,
            held_share: 0.8,
            ..USUAL
        };
        let truth = cameras(&field);
        let found = quiet(&request(&field, &truth, &walk)).unwrap();
        let worse_m = print_errors(
            "people",
            &field,
            mean_errors_m(&field, &truth, &found_states(&found)),
        );
        assert!(worse_m < 0.003, "{worse_m}");
    }
}

/// `FARFIELD_MEASURE=1 cargo test -p farfield-calibration --lib thinned -- --nocapture`
#[test]
fn a_recording_thinned_to_a_quarter_gives_the_same_cameras() {
    if std::env::var_os("FARFIELD_MEASURE").is_none() {
        println!("skipped: takes minutes; FARFIELD_MEASURE=1 runs it");
        return;
    }
    let walk = Walk {
        // With few people nothing would be thinned.
        people: 12,
        seconds: 120.0,
        held_share: 0.8,
        ..USUAL
    };
    let truth = cameras(&SMALL);
    let all = request(&SMALL, &truth, &walk);
    let mut thinned = all.clone();
    for camera in &mut thinned.cameras {
        let mut thinning = Thinning::new(10.0, 0.0, Timing::Synchronised);
        thinning.coarsen(0.0, 0.0);
        thinning.coarsen(0.0, 0.0);
        camera.frames.retain(|it| thinning.keeps(it.frame));
    }
    let off = |request: &PeopleRequest| worst(&found_states(&quiet(request).unwrap()), &truth);
    let (whole, quarter) = (off(&all), off(&thinned));
    println!("worst camera, m and degrees: of all {whole:.5?}, of a quarter {quarter:.5?}");
    assert!(quarter.0 < whole.0 + 0.001 && quarter.1 < whole.1 + 0.01);
}
