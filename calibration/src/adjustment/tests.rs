//! Properties of the adjustment on small problems with known solutions.

use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::alignment::{Similarity, rms};

const INTRINSICS: Intrinsics = Intrinsics {
    fx_px: 1400.0,
    fy_px: 1390.0,
    cx_px: 960.0,
    cy_px: 600.0,
};

fn looking_at_middle(angle: f64) -> CameraState {
    let center = Vector3::new(6.0 * libm::cos(angle), 6.0 * libm::sin(angle), 2.5);
    let forward = -center.normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rows =
        nalgebra::Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(rows);
    CameraState {
        camera_from_world: UnitQuaternion::from_rotation_matrix(&rotation),
        center_w: center,
        period_s: 0.02,
        ..CameraState::at_origin(
            INTRINSICS,
            Distortion {
                k1: -0.1,
                k2: 0.02,
                p1: 0.001,
                p2: -0.002,
                ..Distortion::default()
            },
        )
    }
}

fn path_at(time_s: f64) -> Vector3<f64> {
    Vector3::new(
        1.5 * libm::sin(1.3 * time_s),
        1.2 * libm::cos(0.9 * time_s),
        0.4 * libm::sin(2.1 * time_s),
    )
}

/// Four cameras and 120 points, with noise of `noise_px`.
fn scene(noise_px: f64, seed: u64) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let cameras: Vec<CameraState> = (0..4)
        .map(|i| looking_at_middle(1.4 * f64::from(i)))
        .collect();
    let points: Vec<_> = (0..120).map(|i| path_at(0.1 * f64::from(i))).collect();
    let mut observations = Vec::new();
    for (camera, state) in cameras.iter().enumerate() {
        for (point, p) in points.iter().enumerate() {
            let px = state.project(p, 10.0).unwrap();
            let noise = [rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)];
            let scale = noise_px * 3f64.sqrt();
            observations.push(Observation {
                camera,
                point,
                frame: 5.0 * point as f64,
                px: [px.x + scale * noise[0], px.y + scale * noise[1]],
                sigma_px: 1.0,
                velocity: [0.0; 2],
            });
        }
    }
    let free = Free::none().with(Block::Pose);
    Problem {
        cameras: cameras
            .iter()
            .map(|s| AdjustedCamera::new(*s, free))
            .collect(),
        path: Path::Points(points),
        observations,
        loss: Loss::Squared,
    }
}

fn disturb(problem: &mut Problem) {
    for (i, camera) in problem.cameras.iter_mut().enumerate() {
        let mut step = [0.0; PARAMETERS];
        for (k, s) in step.iter_mut().take(6).enumerate() {
            *s = 0.03 * libm::sin((i * 6 + k) as f64);
        }
        camera.state = camera.state.moved(&step);
    }
    for (i, node) in problem.path.nodes_mut().iter_mut().enumerate() {
        *node += Vector3::new(libm::sin(i as f64), libm::cos(i as f64), 0.3) * 0.1;
    }
}

/// Distances between cameras relative to the first one; independent of the gauge.
fn shape(problem: &Problem) -> Vec<f64> {
    let centers: Vec<_> = problem.cameras.iter().map(|c| c.state.center_w).collect();
    let unit = (centers[0] - centers[1]).norm();
    (0..centers.len())
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .map(|(i, j)| (centers[i] - centers[j]).norm() / unit)
        .collect()
}

#[test]
fn disturbed_cameras_and_points_converge_to_the_truth() {
    let mut problem = scene(0.0, 0);
    let truth = shape(&problem);
    disturb(&mut problem);
    let outcome = adjust(&mut problem, Limits::default());
    assert!(outcome.cost[1] < 1e-9, "{outcome:?}");
    for (found, expected) in shape(&problem).iter().zip(truth) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn a_free_lens_converges_to_the_truth() {
    let mut problem = scene(0.0, 0);
    disturb(&mut problem);
    for camera in &mut problem.cameras {
        camera.free = camera.free.with(Block::Focal).with(Block::FirstRadial);
        camera.state.intrinsics.fx_px *= 1.02;
        camera.state.intrinsics.fy_px *= 1.02;
        camera.state.distortion[0] += 0.02;
    }
    let outcome = adjust(&mut problem, Limits::default());
    assert!(outcome.cost[1] < 1e-6, "{outcome:?}");
    let focal = problem.cameras[2].state.intrinsics.fx_px;
    assert!((focal - 1400.0).abs() < 1e-2, "{focal}");
}

#[test]
fn a_robust_loss_ignores_outliers() {
    let mut problem = scene(0.0, 0);
    let truth = shape(&problem);
    for (i, observation) in problem.observations.iter_mut().enumerate() {
        if i % 10 == 3 {
            observation.px[0] += 80.0;
        }
    }
    problem.loss = Loss::Cauchy(1.0);
    disturb(&mut problem);
    adjust(&mut problem, Limits::default());
    for (found, expected) in shape(&problem).iter().zip(truth) {
        assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    }
}

#[test]
fn unknown_clocks_converge_along_a_curve() {
    let mut problem = scene(0.0, 0);
    let mut spline = Spline::over(-0.5, 12.5, 0.1, 1e-9);
    for (k, control) in spline.controls.iter_mut().enumerate() {
        *control = path_at(-0.5 + 0.1 * (k as f64 - 1.0));
    }
    problem.path = Path::Curve(spline);
    for (i, camera) in problem.cameras.iter_mut().enumerate().skip(1) {
        camera.state.pivot_s = 0.04 * (i as f64 - 2.0);
        camera.state.pivot_frame = 0.0;
        camera.state.period_s *= 1.002;
        camera.free = camera.free.with(Block::TimeOffset).with(Block::Rate);
    }
    adjust(&mut problem, Limits::default());
    for camera in &problem.cameras {
        assert!(
            camera.state.pivot_s.abs() < 1e-3,
            "{}",
            camera.state.pivot_s
        );
        assert!((camera.state.period_s - 0.02).abs() < 2e-6);
    }
}

#[test]
fn the_covariance_matches_the_scatter_of_many_trials() {
    const TRIALS: u64 = 40;
    let truth: Vec<_> = scene(0.0, 0)
        .cameras
        .iter()
        .map(|c| c.state.center_w)
        .collect();
    let (mut predicted, mut scattered) = (0.0, 0.0);
    for seed in 0..TRIALS {
        let mut problem = scene(0.5, seed);
        problem
            .observations
            .iter_mut()
            .for_each(|it| it.sigma_px = 0.5);
        adjust(&mut problem, Limits::default());
        let known = covariance(&problem).unwrap();
        assert!(known.degenerate.is_empty(), "{:?}", known.degenerate);
        let found: Vec<_> = problem.cameras.iter().map(|c| c.state.center_w).collect();
        let similarity = Similarity::between(&found, &truth).unwrap();
        scattered += rms(&similarity, &found, &truth).powi(2);
        let variances = known.cameras.iter().flatten().map(|c| c.position.powi(2));
        predicted += variances.sum::<f64>() / truth.len() as f64;
    }
    // A variance from 40 trials with five free parameters each is accurate to a tenth.
    let ratio = scattered / predicted;
    assert!((0.7..1.4).contains(&ratio), "{ratio}");
}

#[test]
fn cameras_without_common_points_are_degenerate() {
    let mut problem = scene(0.1, 0);
    problem
        .observations
        .retain(|it| (it.camera < 2) == (it.point < 60));
    adjust(&mut problem, Limits::default());
    let known = covariance(&problem).unwrap();
    assert_eq!(known.degenerate.len(), 7, "{:?}", known.degenerate);
}

fn any_state() -> impl Strategy<Value = CameraState> {
    (
        0.0f64..6.0,
        prop::array::uniform8(-0.05f64..0.05),
        prop::bool::ANY,
    )
        .prop_map(|(angle, c, is_fisheye)| {
            let mut state = looking_at_middle(angle);
            if is_fisheye {
                // Wide angle: 65 degrees off the axis in the corners.
                (state.intrinsics.fx_px, state.intrinsics.fy_px) = (1000.0, 990.0);
                let [k1, k2, k3, k4, ..] = c.map(|c| 0.3 * c);
                state.distortion = [k1, k2, k3, k4, 0.0, 0.0, 0.0, 0.0];
                state.is_fisheye = true;
                return state;
            }
            state.distortion = c;
            state.distortion[2] *= 0.1;
            state.distortion[3] *= 0.1;
            state
        })
}

proptest! {
    #[test]
    fn a_bearing_projects_to_its_pixel(state in any_state(), x in 0.0f64..1920.0, y in 0.0f64..1200.0) {
        let fold = state.fold_radius();
        let bearing = state.bearing([x, y], fold).unwrap();
        let back = state.camera_from_world.inverse() * bearing * 3.0 + state.center_w;
        let px = state.project(&back, fold).unwrap();
        prop_assert!((px.x - x).abs() < 1e-8 && (px.y - y).abs() < 1e-8);
    }

    #[test]
    fn derivatives_match_finite_differences(state in any_state(), x in -1.0f64..1.0, y in -1.0f64..1.0, z in -0.5f64..0.5) {
        const STEP: f64 = 1e-6;
        let point = Vector3::new(x, y, z);
        let analytic = state.project_with_derivatives(&point, 10.0).unwrap();
        let close = |a: f64, b: f64| (a - b).abs() < 2e-3 + 1e-5 * b.abs();
        for axis in 0..3 {
            let h = Vector3::ith(axis, STEP);
            let slope = (state.project(&(point + h), 10.0).unwrap() - state.project(&(point - h), 10.0).unwrap()) / (2.0 * STEP);
            for i in 0..2 {
                prop_assert!(close(analytic.by_point[(i, axis)], slope[i]));
            }
        }
        for parameter in 0..17 {
            let mut step = [0.0; PARAMETERS];
            step[parameter] = STEP;
            let ahead = state.moved(&step).project(&point, 10.0).unwrap();
            step[parameter] = -STEP;
            let back = state.moved(&step).project(&point, 10.0).unwrap();
            let slope = (ahead - back) / (2.0 * STEP);
            for i in 0..2 {
                prop_assert!(close(analytic.by_camera[(i, parameter)], slope[i]), "{parameter} {} {}", analytic.by_camera[(i, parameter)], slope[i]);
            }
        }
    }
}
