//! The truth of a person at one moment: its joints, and the keypoint sites that a network
//! estimates.
//!
//! The joints are those of the clip's own skeleton (see [`crate::motion`]). The sites of the 17
//! keypoints are the joints of the same name. With the fault `definition`, hips and knees differ:
//! the network's definition has a constant offset in the pelvis (hips) or the thigh (knees).

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use farfield_proto::keypoints::COCO17;
use nalgebra::{Matrix3, Rotation3, UnitVector3, Vector3};
use rand::RngExt as _;

use super::{Purpose, draws};

/// Number of keypoints.
pub const N_SITES: usize = COCO17.len();

/// The joint that carries each of [`COCO17`]'s keypoints.
pub const SITE_JOINTS: [Joint; N_SITES] = [
    Joint::Nose,
    Joint::LeftEye,
    Joint::RightEye,
    Joint::LeftEar,
    Joint::RightEar,
    Joint::LeftShoulder,
    Joint::RightShoulder,
    Joint::LeftElbow,
    Joint::RightElbow,
    Joint::LeftWrist,
    Joint::RightWrist,
    Joint::LeftHip,
    Joint::RightHip,
    Joint::LeftKnee,
    Joint::RightKnee,
    Joint::LeftAnkle,
    Joint::RightAnkle,
];

/// Indices in [`SITE_JOINTS`], in COCO's order.
const LEFT_HIP: usize = 11;
const RIGHT_HIP: usize = 12;
const LEFT_KNEE: usize = 13;
const RIGHT_KNEE: usize = 14;

/// One person at one moment, world, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct PersonTruth {
    /// The 29 anatomical centres, indexed by [`Joint`].
    pub joints_m: Joints,
    /// The sites of the keypoints, in COCO's order.
    pub sites_m: [Vector3<f64>; N_SITES],
}

impl PersonTruth {
    /// The position of one joint.
    pub fn joint_m(&self, joint: Joint) -> Vector3<f64> {
        self.joints_m[joint.index()]
    }

    pub(super) fn new(joints_m: &Joints, definition: &DefinitionOffsets, length_m: f64) -> Self {
        let mut sites_m = SITE_JOINTS.map(|joint| joints_m[joint.index()]);
        if length_m > 0.0 {
            definition.shift(joints_m, length_m, &mut sites_m);
        }
        Self {
            joints_m: *joints_m,
            sites_m,
        }
    }
}

/// The directions of a person's hip and knee offsets: left and right hip in the axes of the pelvis,
/// left and right knee in those of their thighs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DefinitionOffsets([UnitVector3<f64>; 4]);

impl DefinitionOffsets {
    /// Draws the directions of `person`: uniform on the sphere, independent of each other.
    pub(super) fn draw(seed: u64, person: usize) -> Self {
        let mut rng = draws(seed, Purpose::Definition, person);
        Self(std::array::from_fn(|_| {
            let z: f64 = rng.random_range(-1.0..1.0);
            let (sin, cos) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
            let across = (1.0 - z * z).sqrt();
            UnitVector3::new_normalize(Vector3::new(across * cos, across * sin, z))
        }))
    }

    fn shift(&self, joints_m: &Joints, length_m: f64, sites_m: &mut [Vector3<f64>; N_SITES]) {
        let at = |joint: Joint| joints_m[joint.index()];
        let pelvis = pelvis_axes(joints_m);
        let thigh = |hip: Joint, knee: Joint| {
            // The thigh's axes are the pelvis's, swung the shortest way: continuous as long as no
            // thigh points straight up along the trunk.
            let down = -(pelvis * Vector3::z());
            let swing = Rotation3::rotation_between(&down, &(at(knee) - at(hip)));
            swing.unwrap_or_else(Rotation3::identity) * pelvis
        };
        let axes = [
            (LEFT_HIP, pelvis),
            (RIGHT_HIP, pelvis),
            (LEFT_KNEE, thigh(Joint::LeftHip, Joint::LeftKnee)),
            (RIGHT_KNEE, thigh(Joint::RightHip, Joint::RightKnee)),
        ];
        for ((site, axes), direction) in axes.into_iter().zip(&self.0) {
            sites_m[site] += axes * direction.into_inner() * length_m;
        }
    }
}

/// Axes of the pelvis in the world: x forward, y to the left hip, z towards the spine.
fn pelvis_axes(joints_m: &Joints) -> Rotation3<f64> {
    let at = |joint: Joint| joints_m[joint.index()];
    let left = at(Joint::LeftHip) - at(Joint::RightHip);
    let up = at(Joint::Spine) - at(Joint::Pelvis);
    let forward = left.cross(&up);
    let (Some(x), Some(y)) = (forward.try_normalize(1e-9), left.try_normalize(1e-9)) else {
        return Rotation3::identity();
    };
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]))
}

#[cfg(test)]
mod tests {
    use farfield_fusion::body::skeleton::{Kinematics, Pose, Proportions, Skeleton};
    use nalgebra::UnitQuaternion;

    use super::*;

    const LENGTH_M: f64 = 0.03;

    fn joints_m(turn: UnitQuaternion<f64>, hip_rad: f64) -> Joints {
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let mut pose = Pose::neutral(Vector3::new(1.0, -2.0, 0.9), turn);
        for dof in [9, 23] {
            pose.dof[dof] += hip_rad;
        }
        let mut kinematics = Kinematics::default();
        skeleton.forward(&pose, &mut kinematics);
        Joint::ALL.map(|joint| kinematics.joint_m(joint))
    }

    #[test]
    fn sites_are_named_like_their_joints() {
        for (joint, name) in SITE_JOINTS.into_iter().zip(COCO17) {
            assert_eq!(joint.name(), name);
        }
    }

    #[test]
    fn hip_and_knee_offsets_are_constant_in_the_body() {
        let offsets = DefinitionOffsets::draw(7, 3);
        let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.5);
        let upright = joints_m(UnitQuaternion::identity(), 0.0);
        let turned = joints_m(turn, 0.0);
        let (a, b) = (
            PersonTruth::new(&upright, &offsets, LENGTH_M),
            PersonTruth::new(&turned, &offsets, LENGTH_M),
        );
        for site in 0..N_SITES {
            let off_a = a.sites_m[site] - a.joint_m(SITE_JOINTS[site]);
            let off_b = b.sites_m[site] - b.joint_m(SITE_JOINTS[site]);
            let expected_m = if (LEFT_HIP..=RIGHT_KNEE).contains(&site) {
                LENGTH_M
            } else {
                0.0
            };
            assert!((off_a.norm() - expected_m).abs() < 1e-9);
            assert!((turn * off_a - off_b).norm() < 1e-9, "{}", COCO17[site]);
        }
    }

    #[test]
    fn without_the_fault_sites_are_joints() {
        let joints = joints_m(UnitQuaternion::identity(), 0.3);
        let truth = PersonTruth::new(&joints, &DefinitionOffsets::draw(7, 0), 0.0);
        assert_eq!(
            truth.sites_m,
            SITE_JOINTS.map(|joint| joints[joint.index()])
        );
    }
}
