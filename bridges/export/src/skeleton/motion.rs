//! One pose of the export skeleton.

use farfield_fusion::body::skeleton::{Joint, Kinematics, N_JOINTS, Proportions, Skeleton};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::angles::{Angles, angles_of, pose_of};
use super::bones::{Bone, N_BONES};
use super::rig::{Offsets, RestPose, Rig};

/// Where the hips are and how every bone is turned, in our world (metres, z up).
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// The hips in the world, metres.
    pub root_m: Vector3<f64>,
    /// Each bone against its parent (the hips against the world) and against rest, in body axes; indexed by
    /// [`Bone::index`].
    pub rotations: [UnitQuaternion<f64>; N_BONES],
}

/// A body whose links are turned as `angles` say, at the pelvis that they say. Its joints are those of an average body.
pub fn links_of(angles: &Angles) -> Kinematics {
    let mut body = Kinematics::default();
    // Rotations do not depend on lengths.
    Skeleton::new(&Proportions::from_stature(1.75)).forward(&pose_of(angles), &mut body);
    body
}

impl Motion {
    /// The motion of a body whose links are turned as in `body`.
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

    /// How every bone is turned in the world against rest.
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

    /// Where every bone begins in the world, metres: forward kinematics as a reader of the file does it.
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

    /// The body's links as this motion turns them, at its hips: the inverse of [`Self::of_links`]. Joints are zero but for
    /// the pelvis.
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

    /// Root and arms as reported angles; the other angles are those of `others`.
    pub fn angles(&self, rest: RestPose, others: &Angles) -> Angles {
        use farfield_fusion::body::skeleton::Side;
        use farfield_fusion::body::skeleton::angles::FIRST_JOINT_ANGLE;
        use farfield_fusion::body::skeleton::dof::{DofGroup, first_of};
        use farfield_fusion::body::skeleton::shoulder_coordinates;

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
        // Numbers that are degrees of freedom come back as they were.
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
