//! What the model reports: 40 angles with the names and signs of OpenSim's Rajagopal model.
//!
//! The root is reported as that model's ground-pelvis joint, in OpenSim's ground frame (y up) as the
//! `.trc` files use it: (x, y, z) of the ground = (y, z, x) of the world. So `pelvis_ty` is the
//! height, and a person who faces the world's +x has a `pelvis_rotation` of -90 degrees. Tilt, list
//! and rotation are intrinsic rotations about z, x, y; positive tilt leans back, positive list
//! leans to the right, positive rotation turns left.
//!
//! The trunk, the hips and the arms (against the scapula) turn in the same order. Positive are:
//! extension of the trunk, bending to the right, rotation to the left; flexion of the neck; elevation,
//! protraction and forward tilt of the scapula; flexion (forward), adduction (to the midline) and
//! internal rotation of arm and hip; flexion of elbow and knee; dorsiflexion, inversion and toe-in.

use nalgebra::{Matrix3, Vector3};

use super::dof::{DofGroup, N_JOINT_DOF, first_of};
use super::joint::Side;
use super::model::Pose;
use super::shoulder::SwingTwist;

/// Number of reported angles, the root's three translations among them.
pub const N_ANGLES: usize = 40;

/// The names of the reported angles, in the order of [`reported_angles`].
pub const ANGLE_NAMES: [&str; N_ANGLES] = [
    "pelvis_tilt",
    "pelvis_list",
    "pelvis_rotation",
    "pelvis_tx",
    "pelvis_ty",
    "pelvis_tz",
    "lumbar_extension",
    "lumbar_bending",
    "lumbar_rotation",
    "neck_flexion",
    "neck_bending",
    "neck_rotation",
    "scapula_elevation_r",
    "scapula_protraction_r",
    "scapula_tilt_r",
    "arm_flex_r",
    "arm_add_r",
    "arm_rot_r",
    "elbow_flex_r",
    "hip_flexion_r",
    "hip_adduction_r",
    "hip_rotation_r",
    "knee_angle_r",
    "ankle_angle_r",
    "subtalar_angle_r",
    "foot_rotation_r",
    "scapula_elevation_l",
    "scapula_protraction_l",
    "scapula_tilt_l",
    "arm_flex_l",
    "arm_add_l",
    "arm_rot_l",
    "elbow_flex_l",
    "hip_flexion_l",
    "hip_adduction_l",
    "hip_rotation_l",
    "knee_angle_l",
    "ankle_angle_l",
    "subtalar_angle_l",
    "foot_rotation_l",
];

/// First reported angle that is a joint's: angle `FIRST_JOINT_ANGLE + i` is DoF `i` of
/// [`Pose::dof`], except at the shoulders, where it is derived from the three DoF.
pub const FIRST_JOINT_ANGLE: usize = 6;

/// Whether a reported angle is a length in metres (the root's translations).
pub fn is_translation(angle: usize) -> bool {
    (3..FIRST_JOINT_ANGLE).contains(&angle)
}

/// The reported angles of a pose, radians (the translations metres), in the order of
/// [`ANGLE_NAMES`]. Angles that are a DoF are that number exactly, so bounds that hold for the pose
/// hold for the report.
pub fn reported_angles(pose: &Pose) -> [f64; N_ANGLES] {
    let mut angles = [0.0; N_ANGLES];
    angles[..3].copy_from_slice(&root_angles(pose));
    angles[3] = pose.root_m.y;
    angles[4] = pose.root_m.z;
    angles[5] = pose.root_m.x;
    angles[FIRST_JOINT_ANGLE..].copy_from_slice(&pose.dof);
    for side in Side::BOTH {
        let first = first_of(side, DofGroup::Shoulder);
        let arm = arm_angles(side, &pose.dof);
        angles[FIRST_JOINT_ANGLE + first..FIRST_JOINT_ANGLE + first + 3].copy_from_slice(&arm);
    }
    angles
}

/// Tilt, list, rotation of the pelvis in OpenSim's ground, radians.
fn root_angles(pose: &Pose) -> [f64; 3] {
    // Rows: ground axes in the world. Columns of `axes`: OpenSim's pelvis axes (forward, up, right).
    let world_from_pelvis = pose.root_rotation.to_rotation_matrix().into_inner();
    zxy(&(ground_from_world() * world_from_pelvis * body_from_opensim()))
}

/// Flexion, adduction, rotation of an arm against its scapula, radians.
fn arm_angles(side: Side, dof: &[f64; N_JOINT_DOF]) -> [f64; 3] {
    let first = first_of(side, DofGroup::Shoulder);
    let rotation = SwingTwist::for_side(side)
        .evaluate(&dof[first..first + 3])
        .rotation;
    let axes = body_from_opensim();
    let [flex, add, rot] = zxy(&(axes.transpose() * rotation * axes));
    [flex, side.mirror() * add, side.mirror() * rot]
}

/// OpenSim's ground from the world: (x, y, z) of the ground is (y, z, x) of the world.
pub fn ground_from_world() -> Matrix3<f64> {
    Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0)
}

/// Columns: OpenSim's axes (forward, up, right) in our link frames (forward, left, up).
pub fn body_from_opensim() -> Matrix3<f64> {
    Matrix3::from_columns(&[Vector3::x(), Vector3::z(), -Vector3::y()])
}

/// Angles of R = Rz(a) Rx(b) Ry(c): a and c within ±π, b within ±π/2.
fn zxy(r: &Matrix3<f64>) -> [f64; 3] {
    // The last row is (-cos b sin c, sin b, cos b cos c), the middle column (-cos b sin a, cos b cos a).
    let b = libm::asin(r[(2, 1)].clamp(-1.0, 1.0));
    [
        libm::atan2(-r[(0, 1)], r[(1, 1)]),
        b,
        libm::atan2(-r[(2, 0)], r[(2, 2)]),
    ]
}
