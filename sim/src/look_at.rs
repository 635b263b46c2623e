//! The pose of a camera that points at a target.

use farfield_proto::frames::{Camera, Transform, World};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The pose of an upright camera at `eye` whose optical axis goes through `target`.
pub fn look_at(eye: Vector3<f64>, target: Vector3<f64>) -> Transform<Camera, World> {
    let forward = (target - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rows = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    Transform::new(Isometry3::from_parts(
        Translation3::from(-(rotation * eye)),
        rotation,
    ))
}
