//! One person's skeleton at rest.

use std::str::FromStr;

use farfield_fusion::body::skeleton::{Joint, Kinematics, N_JOINTS, Proportions, Skeleton};
use nalgebra::{Matrix3, Vector3};

use super::bones::{Bone, N_BONES, Raised};

/// Position of the ball of the foot between ankle and tip, as a share of the way forward.
const BALL: f64 = 0.7;
/// Distance of the top of the head from its centre, in lengths from neck to head: 0.07 of 0.10
/// statures.
const HEAD_TOP: f64 = 0.7;

/// Position of the arms at rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RestPose {
    /// Level, to the sides.
    #[default]
    TPose,
    /// Halfway down.
    APose,
}

impl RestPose {
    /// Every rest pose with its name on the command line.
    pub const ALL: [(&'static str, Self); 2] = [("t-pose", Self::TPose), ("a-pose", Self::APose)];

    /// Angle of the arms from hanging, radians.
    const fn raised_rad(self) -> f64 {
        match self {
            Self::TPose => std::f64::consts::FRAC_PI_2,
            Self::APose => std::f64::consts::FRAC_PI_4,
        }
    }

    /// `R_rest`: rotation of a bone's link from the neutral pose, with hanging arms, to the rest
    /// pose.
    pub(crate) fn of_bone(self, bone: Bone) -> Matrix3<f64> {
        let sign = match bone.raised_side() {
            None => return Matrix3::identity(),
            // About the forward axis: -z turns to +y, the left.
            Some(Raised::Left) => 1.0,
            Some(Raised::Right) => -1.0,
        };
        let (sin, cos) = match self {
            // Exactly level, unlike sine and cosine of a quarter turn.
            Self::TPose => (sign, 0.0),
            Self::APose => {
                let (sin, cos) = libm::sincos(self.raised_rad());
                (sign * sin, cos)
            }
        };
        Matrix3::new(1.0, 0.0, 0.0, 0.0, cos, -sin, 0.0, sin, cos)
    }
}

impl FromStr for RestPose {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        crate::options::named(name, &Self::ALL)
    }
}

/// Offset of each joint from its parent joint, in the frame of the link that holds it (x forward, y
/// left, z up in the neutral pose), metres, by [`Joint::index`]. The pelvis' own is zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Offsets(pub [Vector3<f64>; N_JOINTS]);

impl Offsets {
    /// The offsets of a body with these proportions.
    pub fn from_proportions(proportions: &Proportions) -> Self {
        let pose = farfield_fusion::body::skeleton::Pose::neutral(
            Vector3::zeros(),
            nalgebra::UnitQuaternion::identity(),
        );
        let mut body = Kinematics::default();
        Skeleton::new(proportions).forward(&pose, &mut body);
        Self::measured(&body.joints_m, &body)
    }

    /// The offsets of joints in the world (metres), with the link rotations of `body`.
    pub fn measured(joints_m: &[Vector3<f64>; N_JOINTS], body: &Kinematics) -> Self {
        Self(Joint::ALL.map(|joint| match joint.parent() {
            None => Vector3::zeros(),
            Some(parent) => {
                let apart_m = joints_m[joint.index()] - joints_m[parent.index()];
                body.rotation(joint.link()).tr_mul(&apart_m)
            }
        }))
    }

    /// The offset of one joint.
    pub fn of_joint(&self, joint: Joint) -> Vector3<f64> {
        self.0[joint.index()]
    }

    /// The joints in the world, metres, of a body with these offsets and the pelvis and links of
    /// `body`.
    pub fn joints_m(&self, body: &Kinematics) -> [Vector3<f64>; N_JOINTS] {
        let mut joints_m = [body.joint_m(Joint::Pelvis); N_JOINTS];
        for joint in Joint::ALL {
            if let Some(parent) = joint.parent() {
                let apart_m = body.rotation(joint.link()) * self.of_joint(joint);
                joints_m[joint.index()] = joints_m[parent.index()] + apart_m;
            }
        }
        joints_m
    }

    /// Height of the pelvis above the soles when standing upright, metres.
    pub fn pelvis_height_m(&self) -> f64 {
        let chain = [
            Joint::LeftHip,
            Joint::LeftKnee,
            Joint::LeftAnkle,
            Joint::LeftToe,
        ];
        -chain
            .iter()
            .map(|&joint| self.of_joint(joint).z)
            .sum::<f64>()
    }
}

/// A skeleton at rest in body axes (x forward, y left, z up), metres; the hips are its origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// Position of its arms.
    pub rest: RestPose,
    /// Start of each bone relative to its parent's start, by [`Bone::index`]. Zero for the hips.
    pub offset_m: [Vector3<f64>; N_BONES],
    /// End of each bone without children, relative to its start.
    pub tip_m: [Option<Vector3<f64>>; N_BONES],
}

impl Rig {
    /// The skeleton of a body with these offsets.
    pub fn new(offsets: &Offsets, rest: RestPose) -> Self {
        let mut offset_m = [Vector3::zeros(); N_BONES];
        let mut tip_m = [None; N_BONES];
        for bone in Bone::ALL {
            let i = bone.index();
            // The start of a bone is fixed in its parent and rotates with the parent's rest
            // rotation.
            let parent = bone.parent().unwrap_or(bone);
            let at_rest = rest.of_bone(parent);
            let from_parent = offsets.of_joint(bone.joint());
            offset_m[i] = match bone {
                Bone::Hips => Vector3::zeros(),
                Bone::LeftToes | Bone::RightToes => ball_m(&from_parent),
                _ => at_rest * from_parent,
            };
            tip_m[i] = match bone {
                Bone::Head => Some(Vector3::z() * (HEAD_TOP * from_parent.norm())),
                Bone::LeftHand => Some(hand_m(offsets, rest, bone, Joint::LeftHand)),
                Bone::RightHand => Some(hand_m(offsets, rest, bone, Joint::RightHand)),
                Bone::LeftToes | Bone::RightToes => Some(from_parent - ball_m(&from_parent)),
                _ => None,
            };
        }
        Self {
            rest,
            offset_m,
            tip_m,
        }
    }

    /// Start of each bone at rest, relative to the hips, metres.
    pub fn rest_heads_m(&self) -> [Vector3<f64>; N_BONES] {
        let mut heads_m = [Vector3::zeros(); N_BONES];
        for bone in Bone::ALL {
            if let Some(parent) = bone.parent() {
                heads_m[bone.index()] = heads_m[parent.index()] + self.offset_m[bone.index()];
            }
        }
        heads_m
    }
}

/// The ball of the foot relative to the ankle, for a tip of the foot at `tip_m`: on the sole.
fn ball_m(tip_m: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(BALL * tip_m.x, BALL * tip_m.y, tip_m.z)
}

/// The knuckles relative to the wrist; both are given relative to the elbow.
fn hand_m(offsets: &Offsets, rest: RestPose, bone: Bone, hand: Joint) -> Vector3<f64> {
    rest.of_bone(bone) * (offsets.of_joint(hand) - offsets.of_joint(bone.joint()))
}
