//! From the 40 reported angles to a pose of the body, and back.
//!
//! The rotations of pelvis and arms are reported as angles in OpenSim's axes (forward, up, right): flexion about z,
//! then adduction about x, then rotation about y. All other angles are degrees of freedom of the body themselves.

use farfield_fusion::body::skeleton::angles::{
    FIRST_JOINT_ANGLE, body_from_opensim, ground_from_world,
};
use farfield_fusion::body::skeleton::dof::{DofGroup, N_JOINT_DOF, first_of};
use farfield_fusion::body::skeleton::shoulder_coordinates;
use farfield_fusion::body::skeleton::{N_ANGLES, Pose, Side, reported_angles};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The reported angles of one pose, in the order of `ANGLE_NAMES`: radians, the root's translations metres.
pub type Angles = [f64; N_ANGLES];

/// Rz(a) Rx(b) Ry(c), radians.
pub fn zxy_rotation([a, b, c]: [f64; 3]) -> Matrix3<f64> {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let rotation =
        about(Vector3::z_axis(), a) * about(Vector3::x_axis(), b) * about(Vector3::y_axis(), c);
    rotation.into_inner()
}

/// Angles of R = Rz(a) Rx(b) Ry(c), radians: a and c within ±π, b within ±π/2. At the pole b = ±π/2, where only a ± c is
/// known, c is 0.
pub fn zxy(r: &Matrix3<f64>) -> [f64; 3] {
    /// Cosine of b below which a and c are not told apart.
    const POLE: f64 = 1e-9;
    let cos_b = libm::hypot(r[(2, 0)], r[(2, 2)]);
    let b = libm::atan2(r[(2, 1)], cos_b);
    if cos_b < POLE {
        return [libm::atan2(r[(1, 0)], r[(0, 0)]), b, 0.0];
    }
    [
        libm::atan2(-r[(0, 1)], r[(1, 1)]),
        b,
        libm::atan2(-r[(2, 0)], r[(2, 2)]),
    ]
}

/// The pose of the body that these angles report; the inverse of [`angles_of`].
pub fn pose_of(angles: &Angles) -> Pose {
    let axes = body_from_opensim();
    let root = ground_from_world().transpose()
        * zxy_rotation([angles[0], angles[1], angles[2]])
        * axes.transpose();
    let mut dof = [0.0; N_JOINT_DOF];
    dof.copy_from_slice(&angles[FIRST_JOINT_ANGLE..]);
    for side in Side::BOTH {
        let first = first_of(side, DofGroup::Shoulder);
        let m = side.mirror();
        let arm = zxy_rotation([dof[first], m * dof[first + 1], m * dof[first + 2]]);
        let coordinates = shoulder_coordinates(side, &(axes * arm * axes.transpose()));
        dof[first..first + 3].copy_from_slice(&coordinates);
    }
    Pose {
        root_m: Vector3::new(angles[5], angles[3], angles[4]),
        root_rotation: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
            root,
        )),
        dof,
    }
}

/// What is reported of a pose.
pub fn angles_of(pose: &Pose) -> Angles {
    reported_angles(pose)
}
