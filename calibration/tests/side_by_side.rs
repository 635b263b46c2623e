//! The adjustment of 28 cameras to 3,000 points, written to a file that other programs can solve too:
//! `tests/readers/adjustment.py` does.

use std::fs;
use std::path::Path as FilePath;
use std::time::Instant;

use farfield_calibration::adjustment::{
    AdjustedCamera, Block, CameraState, Free, Limits, Loss, Observation, Path, Problem, adjust,
};
use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

const CAMERAS: u32 = 28;
const POINTS: u32 = 3000;
const SIZE_PX: [f64; 2] = [1920.0, 1200.0];
const NOISE_PX: f64 = 0.3;

/// One of the cameras around a field of 16 x 24 m.
fn camera(number: u32) -> CameraState {
    let angle = std::f64::consts::TAU * f64::from(number) / f64::from(CAMERAS);
    let height_m = 4.0 + libm::sin(5.0 * f64::from(number));
    let center = Vector3::new(11.0 * libm::cos(angle), 15.0 * libm::sin(angle), height_m);
    let forward = (Vector3::new(0.0, 0.0, 0.8) - center).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rows = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let rotation = Rotation3::from_matrix_unchecked(rows);
    let intrinsics = Intrinsics {
        fx_px: 1200.0,
        fy_px: 1200.0,
        cx_px: 960.0,
        cy_px: 600.0,
    };
    let lens = Distortion {
        k1: -0.08,
        k2: 0.02,
        ..Distortion::default()
    };
    CameraState {
        camera_from_world: UnitQuaternion::from_rotation_matrix(&rotation),
        center_w: center,
        ..CameraState::at_origin(intrinsics, lens)
    }
}

/// Noisy sights of points in the field, with a start that is off by a centimetre and a few tenths of a degree.
fn problem() -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut within = |most: f64| rng.random_range(-most..most);
    let mut points: Vec<Vector3<f64>> = (0..POINTS)
        .map(|_| Vector3::new(within(8.0), within(12.0), 1.2 + within(1.2)))
        .collect();
    let states: Vec<CameraState> = (0..CAMERAS).map(camera).collect();
    let mut observations = Vec::new();
    for (camera, state) in states.iter().enumerate() {
        for (point, at) in points.iter().enumerate() {
            let Some(px) = state.project(at, state.fold_radius()) else {
                continue;
            };
            if (0..2).all(|axis| (0.0..SIZE_PX[axis]).contains(&px[axis])) {
                let scale = NOISE_PX * 3f64.sqrt();
                observations.push(Observation {
                    camera,
                    point,
                    frame: point as f64,
                    px: [px.x + scale * within(1.0), px.y + scale * within(1.0)],
                    sigma_px: NOISE_PX,
                    velocity: [0.0; 2],
                });
            }
        }
    }
    let cameras = states.iter().map(|state| {
        let turn = Vector3::from_fn(|_, _| within(0.003));
        let moved = CameraState {
            camera_from_world: UnitQuaternion::from_scaled_axis(turn) * state.camera_from_world,
            center_w: state.center_w + Vector3::from_fn(|_, _| within(0.01)),
            ..*state
        };
        AdjustedCamera::new(moved, Free::none().with(Block::Pose).with(Block::Focal))
    });
    let cameras = cameras.collect();
    for point in &mut points {
        *point += Vector3::from_fn(|_, _| within(0.01));
    }
    Problem {
        cameras,
        path: Path::Points(points),
        observations,
        loss: Loss::Squared,
    }
}

/// The result of `work`, and its seconds.
#[expect(
    clippy::disallowed_methods,
    reason = "what is measured here is wall time, and nothing depends on it"
)]
fn seconds<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let began = Instant::now();
    let done = work();
    (done, began.elapsed().as_secs_f64())
}

/// `FARFIELD_SIDE_BY_SIDE=DIR cargo test --release -p farfield-calibration --test side_by_side -- --nocapture` writes
/// `DIR/problem.json`.
#[test]
fn the_adjustment_of_28_cameras_ends_in_a_minimum() {
    let Some(folder) = std::env::var_os("FARFIELD_SIDE_BY_SIDE") else {
        println!("skipped: FARFIELD_SIDE_BY_SIDE names the folder that the problem is written to");
        return;
    };
    let mut problem = problem();
    let written = json(&problem);
    let (start, count) = (problem.cost(), problem.observations.len());
    let limits = Limits {
        steps: 100,
        decrease: 1e-12,
    };
    let (outcome, seconds) = seconds(|| adjust(&mut problem, limits));
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let most = status.lines().find(|line| line.starts_with("VmHWM"));
    println!(
        "{CAMERAS} cameras, {POINTS} points, {count} sights: cost {start:.6e} -> {:.12e} in {} steps, {seconds:.2} s, {}",
        outcome.cost[1],
        outcome.steps,
        most.unwrap_or("memory not known")
    );
    let mut written = written;
    written["cost"] = json!(outcome.cost[1]);
    fs::write(
        FilePath::new(&folder).join("problem.json"),
        written.to_string(),
    )
    .unwrap();
    assert!(outcome.converged && outcome.cost[1] < start);
    // The expected sum of 2 n squared residuals over their variance is 2 n less the number of unknowns.
    let freedom = 2.0 * count as f64 - 7.0 * f64::from(CAMERAS) - 3.0 * f64::from(POINTS) + 7.0;
    let ratio = 2.0 * outcome.cost[1] / freedom;
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

/// Rotation vectors from world to camera, centres, and one factor on the focal length.
fn json(problem: &Problem) -> serde_json::Value {
    let cameras = problem.cameras.iter().map(|it| {
        let state = &it.state;
        let turn = state.camera_from_world.scaled_axis();
        let center = state.center_w;
        json!([turn.x, turn.y, turn.z, center.x, center.y, center.z, 1.0])
    });
    let observations = problem.observations.iter();
    let observations = observations.map(|it| json!([it.camera, it.point, it.px[0], it.px[1]]));
    let points = problem
        .path
        .nodes()
        .iter()
        .map(|at| json!([at.x, at.y, at.z]));
    json!({
        "focal_px": 1200.0, "middle_px": [960.0, 600.0], "k1": -0.08, "k2": 0.02, "sigma_px": NOISE_PX,
        "cameras": cameras.collect::<Vec<_>>(),
        "points": points.collect::<Vec<_>>(),
        "observations": observations.collect::<Vec<_>>(),
    })
}
