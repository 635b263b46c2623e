//! Random cameras around a person.

use std::f64::consts::TAU;

use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Transform;
use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

/// A random position (world, metres) `distance_m` from `middle`, up to `highest_m` above the floor.
pub(crate) fn eye_around(
    middle: Vector3<f64>,
    distance_m: f64,
    highest_m: f64,
    rng: &mut ChaCha8Rng,
) -> Vector3<f64> {
    let height_m = rng.random_range(0.8..highest_m);
    let bearing = rng.random_range(0.0..TAU);
    let ground_m = distance_m.powi(2) - (height_m - middle.z).powi(2);
    let ground_m = ground_m.max(1.0).sqrt();
    Vector3::new(
        middle.x + ground_m * bearing.cos(),
        middle.y + ground_m * bearing.sin(),
        height_m,
    )
}

/// Camera axes from world axes: the person is anywhere in the image of a wide lens, and cameras are slightly tilted.
pub(crate) fn looking(eye: Vector3<f64>, at: Vector3<f64>, rng: &mut ChaCha8Rng) -> Matrix3<f64> {
    let forward = (at - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let towards = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let turn = Rotation3::from_euler_angles(
        rng.random_range(-0.3..0.3),
        rng.random_range(-0.5..0.5),
        0.0,
    );
    let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(-0.06..0.06));
    roll.matrix() * turn.matrix() * towards
}

/// A camera without distortion at `eye` (world, metres).
pub(crate) fn camera(
    focal_px: f64,
    principal_px: [f64; 2],
    size_px: [u32; 2],
    axes: Matrix3<f64>,
    eye: Vector3<f64>,
) -> Option<CameraModel> {
    let intrinsics = Intrinsics {
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: principal_px[0],
        cy_px: principal_px[1],
    };
    let rotation = Rotation3::from_matrix(&axes);
    let motion = Isometry3::from_parts((-(rotation * eye)).into(), rotation.into());
    CameraModel::new(
        "crop",
        size_px,
        intrinsics,
        Distortion::default(),
        Transform::new(motion),
    )
    .ok()
}

/// A random number, uniform in its logarithm.
pub(crate) fn log_uniform(range: std::ops::Range<f64>, rng: &mut ChaCha8Rng) -> f64 {
    rng.random_range(range.start.ln()..range.end.ln()).exp()
}
