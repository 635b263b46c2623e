//! One pose of the export skeleton, and its conversion from and to the 40 reported angles.
//!
//! The rotations of pelvis and arms are reported as angles in OpenSim's axes (forward, up, right):
//! flexion about z, then adduction about x, then rotation about y. All other angles are degrees of
//! freedom of the body.

use farfield_fusion::body::skeleton::angles::{
    FIRST_JOINT_ANGLE, body_from_opensim, ground_from_world,
};
use farfield_fusion::body::skeleton::dof::{DofGroup, N_JOINT_DOF, first_of};
use farfield_fusion::body::skeleton::shoulder_coordinates;
use farfield_fusion::body::skeleton::{Joint, Kinematics, N_JOINTS, Proportions, Skeleton};
use farfield_fusion::body::skeleton::{N_ANGLES, Pose, Side, reported_angles};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::bones::{Bone, N_BONES};
use super::rig::{Offsets, RestPose, Rig};

/// Position of the hips and rotation of every bone, in our world (metres, z up).
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// The hips in the world, metres.
    pub root_m: Vector3<f64>,
    /// Rotation of each bone relative to its parent (hips: the world) and to rest, in body axes, by
    /// [`Bone::index`].
    pub rotations: [UnitQuaternion<f64>; N_BONES],
}

/// A body with link rotations from `angles`, at their pelvis position. Its joints are those of an
/// average body.
pub fn links_of(angles: &Angles) -> Kinematics {
    let mut body = Kinematics::default();
    // Rotations do not depend on lengths.
    Skeleton::new(&Proportions::from_stature(1.75)).forward(&pose_of(angles), &mut body);
    body
}

impl Motion {
    /// The motion of a body with the link rotations of `body`.
    pub fn of_links(body: &Kinematics, rest: RestPose) -> Self {
        let world_from_bone =
            Bone::ALL.map(|bone| body.rotation(bone.link()) * rest.of_bone(bone).transpose());
        let rotations = Bone::ALL.map(|bone| {
            let own = world_from_bone[bone.index()];
            match bone.parent() {
                _ if bone.is_static() => UnitQuaternion::identity(),
                None => quaternion(&own),
                Some(parent) => quaternion(&world_from_bone[parent.index()].tr_mul(&own)),
            }
        });
        Self {
            root_m: body.joint_m(Joint::Pelvis),
            rotations,
        }
    }

    /// Rotation of every bone in the world, relative to rest.
    pub fn world_from_bones(&self) -> [Matrix3<f64>; N_BONES] {
        let mut world = [Matrix3::identity(); N_BONES];
        for bone in Bone::ALL {
            let own = self.rotations[bone.index()]
                .to_rotation_matrix()
                .into_inner();
            world[bone.index()] = bone
                .parent()
                .map_or(own, |parent| world[parent.index()] * own);
        }
        world
    }

    /// Start of every bone in the world, metres: forward kinematics as in a reader of the file.
    pub fn heads_m(&self, rig: &Rig) -> [Vector3<f64>; N_BONES] {
        let world = self.world_from_bones();
        let mut heads_m = [self.root_m; N_BONES];
        for bone in Bone::ALL {
            if let Some(parent) = bone.parent() {
                heads_m[bone.index()] =
                    heads_m[parent.index()] + world[parent.index()] * rig.offset_m[bone.index()];
            }
        }
        heads_m
    }

    /// The link rotations of this motion, at its hips: the inverse of [`Self::of_links`]. All
    /// joints except the pelvis are zero.
    pub fn links(&self, rest: RestPose) -> Kinematics {
        let mut body = Kinematics::default();
        let world = self.world_from_bones();
        for bone in Bone::ALL {
            if !bone.is_static() {
                body.rotations[bone.link() as usize] = world[bone.index()] * rest.of_bone(bone);
            }
        }
        body.joints_m[Joint::Pelvis.index()] = self.root_m;
        body
    }

    /// The joints in the world, metres, of a body with these offsets.
    pub fn joints_m(&self, rest: RestPose, offsets: &Offsets) -> [Vector3<f64>; N_JOINTS] {
        offsets.joints_m(&self.links(rest))
    }

    /// Root and arms as reported angles; the other angles are copied from `others`.
    pub fn angles(&self, rest: RestPose, others: &Angles) -> Angles {
        let mut pose = pose_of(others);
        pose.root_m = self.root_m;
        pose.root_rotation = self.rotations[Bone::Hips.index()];
        for (side, bone) in [
            (Side::Right, Bone::RightUpperArm),
            (Side::Left, Bone::LeftUpperArm),
        ] {
            let against_scapula = self.rotations[bone.index()]
                .to_rotation_matrix()
                .into_inner()
                * rest.of_bone(bone);
            let first = first_of(side, DofGroup::Shoulder);
            pose.dof[first..first + 3]
                .copy_from_slice(&shoulder_coordinates(side, &against_scapula));
        }
        let mut angles = angles_of(&pose);
        // Angles that are degrees of freedom stay unchanged.
        for (i, angle) in angles.iter_mut().enumerate().skip(FIRST_JOINT_ANGLE) {
            let is_arm = Side::BOTH.into_iter().any(|side| {
                let first = FIRST_JOINT_ANGLE + first_of(side, DofGroup::Shoulder);
                (first..first + 3).contains(&i)
            });
            if !is_arm {
                *angle = others[i];
            }
        }
        angles
    }
}

fn quaternion(rotation: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation))
}

/// The reported angles of one pose, in the order of `ANGLE_NAMES`: radians, metres for the root's
/// translations.
pub type Angles = [f64; N_ANGLES];

/// Rz(a) Rx(b) Ry(c), radians.
pub fn zxy_rotation([a, b, c]: [f64; 3]) -> Matrix3<f64> {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let rotation =
        about(Vector3::z_axis(), a) * about(Vector3::x_axis(), b) * about(Vector3::y_axis(), c);
    rotation.into_inner()
}

/// Angles of R = Rz(a) Rx(b) Ry(c), radians: a and c within ±π, b within ±π/2. At the pole b =
/// ±π/2, only a ± c is defined, and c is 0.
pub fn zxy(r: &Matrix3<f64>) -> [f64; 3] {
    /// Cosine of b below which a and c cannot be separated.
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

/// The body's pose with these angles; the inverse of [`angles_of`].
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

/// The reported angles of a pose.
pub fn angles_of(pose: &Pose) -> Angles {
    reported_angles(pose)
}
