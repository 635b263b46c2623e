//! One person's body: the constant offsets of its joints, its pose, and the sites of keypoints.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use farfield_proto::keypoints::KeypointSet;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use thiserror::Error;

use super::dof::{DofGroup, LINKS, N_DOF, N_JOINT_DOF, N_ROOT_DOF, first_of, scapula_turns};
use super::joint::{Joint, N_JOINTS, Side};
use super::shoulder::{SwingTwist, turn_about, wrap, wrapped};

/// Distance of a small toe's tip behind the tip of the foot, metres.
const SMALL_TOE_BEHIND_M: f64 = 0.04;
/// Its distance to the outside, metres.
const SMALL_TOE_OUTSIDE_M: f64 = 0.05;

/// A configuration of the body. Any value is legal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// The pelvis in the world, metres.
    pub root_m: Vector3<f64>,
    /// World from pelvis (x forward, y left, z up).
    pub root_rotation: UnitQuaternion<f64>,
    /// The DoF of the joints, radians, in the order of [`super::dof`].
    pub dof: [f64; N_JOINT_DOF],
}

impl Pose {
    /// Upright with hanging arms (the neutral pose), at `root_m` in the world and
    /// turned by `root_rotation` (identity: facing the world's +x).
    pub fn neutral(root_m: Vector3<f64>, root_rotation: UnitQuaternion<f64>) -> Self {
        let mut dof = [0.0; N_JOINT_DOF];
        for side in Side::BOTH {
            let first = first_of(side, DofGroup::Shoulder);
            let hanging = SwingTwist::for_side(side).coordinates_of(&Matrix3::identity());
            dof[first..first + 3].copy_from_slice(&hanging);
        }
        Self {
            root_m,
            root_rotation,
            dof,
        }
    }

    /// The same directions of all limbs with elbows that bend forwards: an elbow bent backwards
    /// equals one of an upper arm turned by half a turn about itself.
    #[must_use]
    pub fn with_elbows_forward(mut self) -> Self {
        for side in Side::BOTH {
            let elbow = first_of(side, DofGroup::Elbow);
            let twist = first_of(side, DofGroup::Shoulder) + 2;
            if self.dof[elbow] < 0.0 {
                self.dof[elbow] = -self.dof[elbow];
                self.dof[twist] = wrap(self.dof[twist] + PI);
            }
        }
        self
    }

    /// The pose after a small motion: translation in the world (metres), rotation vector in the
    /// pelvis' own frame, then the joints (radians). The inverse of [`Self::step_to`].
    #[must_use]
    pub fn moved(&self, step: &[f64; N_DOF]) -> Self {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[3], step[4], step[5]));
        let mut moved = *self;
        moved.root_m += Vector3::new(step[0], step[1], step[2]);
        moved.root_rotation = self.root_rotation * turn;
        moved.root_rotation.renormalize();
        for (q, d) in moved.dof.iter_mut().zip(&step[N_ROOT_DOF..]) {
            *q += d;
        }
        moved
    }

    /// The motion from here to `other`, as in [`Self::moved`].
    pub fn step_to(&self, other: &Self) -> [f64; N_DOF] {
        let mut step = [0.0; N_DOF];
        step[..3].copy_from_slice((other.root_m - self.root_m).as_slice());
        let turn = (self.root_rotation.inverse() * other.root_rotation).scaled_axis();
        step[3..N_ROOT_DOF].copy_from_slice(turn.as_slice());
        for (d, (to, from)) in step[N_ROOT_DOF..]
            .iter_mut()
            .zip(other.dof.iter().zip(&self.dof))
        {
            *d = to - from;
        }
        step
    }

    /// The same configuration with every angle, and the swing of the shoulders, within ±π.
    #[must_use]
    pub fn wrapped(mut self) -> Self {
        let before = self.dof;
        for q in &mut self.dof {
            *q = wrap(*q);
        }
        for side in Side::BOTH {
            let first = first_of(side, DofGroup::Shoulder);
            let q = [before[first], before[first + 1], before[first + 2]];
            self.dof[first..first + 3].copy_from_slice(&wrapped(q));
        }
        self
    }

    /// Angle between an upper arm and the trunk's downward direction, radians, 0 to π.
    pub fn arm_elevation_rad(&self, side: Side) -> f64 {
        let (scapula, shoulder) = (
            first_of(side, DofGroup::Scapula),
            first_of(side, DofGroup::Shoulder),
        );
        let mut trunk_from_scapula = Matrix3::identity();
        for (turn, q) in scapula_turns(side).iter().zip(&self.dof[scapula..]) {
            turn_about(&mut trunk_from_scapula, turn.axis, turn.sign * q);
        }
        let arm = SwingTwist::for_side(side).direction(self.dof[shoulder], self.dof[shoulder + 1]);
        libm::acos((-(trunk_from_scapula * arm).z).clamp(-1.0, 1.0))
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.root_m
            .iter()
            .chain(self.root_rotation.coords.iter())
            .chain(&self.dof)
            .all(|v| v.is_finite())
    }
}

/// Shoulder coordinates (raising swing, inward swing, twist; radians) of a rotation, scapula from
/// upper arm.
pub fn shoulder_coordinates(side: Side, scapula_from_upper_arm: &Matrix3<f64>) -> [f64; 3] {
    SwingTwist::for_side(side).coordinates_of(scapula_from_upper_arm)
}

/// The constant part of one person: the place of each joint in its link.
#[derive(Debug, Clone)]
pub struct Skeleton {
    proportions: Proportions,
    /// From the link's origin, in the link's frame, metres; indexed by joint.
    pub(crate) offset_m: [Vector3<f64>; N_JOINTS],
    pub(crate) shoulders: [SwingTwist; 2],
}

impl Skeleton {
    /// The body of these proportions (see [`Proportions::checked`]).
    pub fn new(proportions: &Proportions) -> Self {
        let from_parent = Joint::ALL.map(|joint| from_parent_m(proportions, joint));
        let offset_m = Joint::ALL.map(|joint| {
            let origin = LINKS[joint.link() as usize].origin;
            let mut offset = Vector3::zeros();
            let mut at = joint;
            while at != origin {
                offset += from_parent[at.index()];
                match at.parent() {
                    Some(parent) => at = parent,
                    None => break,
                }
            }
            offset
        });
        Self {
            proportions: *proportions,
            offset_m,
            shoulders: Side::BOTH.map(|side| *SwingTwist::for_side(side)),
        }
    }

    /// Its lengths.
    pub fn proportions(&self) -> &Proportions {
        &self.proportions
    }
}

/// Offset of a joint from its parent joint in the neutral pose, metres.
fn from_parent_m(p: &Proportions, joint: Joint) -> Vector3<f64> {
    let left = match joint.name() {
        name if name.starts_with("left_") => 1.0,
        name if name.starts_with("right_") => -1.0,
        _ => 0.0,
    };
    match joint {
        Joint::Pelvis => Vector3::zeros(),
        Joint::Spine => Vector3::new(0.0, 0.0, p.lumbar_m),
        Joint::Neck => Vector3::new(0.0, 0.0, p.trunk_m),
        Joint::Head => Vector3::new(0.0, 0.0, p.head_m),
        Joint::Nose => Vector3::new(p.nose_forward_m, 0.0, 0.0),
        Joint::LeftEye | Joint::RightEye => {
            Vector3::new(p.eye_forward_m, left * p.eye_side_m, p.eye_up_m)
        }
        Joint::LeftEar | Joint::RightEar => Vector3::new(0.0, left * p.ear_side_m, 0.0),
        Joint::LeftScapula | Joint::RightScapula => {
            Vector3::new(0.0, left * p.scapula_side_m, p.scapula_up_m)
        }
        Joint::LeftShoulder | Joint::RightShoulder => Vector3::new(0.0, left * p.clavicle_m, 0.0),
        Joint::LeftElbow | Joint::RightElbow => Vector3::new(0.0, 0.0, -p.upper_arm_m),
        Joint::LeftWrist | Joint::RightWrist => Vector3::new(0.0, 0.0, -p.forearm_m),
        Joint::LeftHand | Joint::RightHand => Vector3::new(0.0, 0.0, -p.forearm_m - p.hand_m),
        Joint::LeftHip | Joint::RightHip => Vector3::new(0.0, left * p.hip_side_m, 0.0),
        Joint::LeftKnee | Joint::RightKnee => Vector3::new(0.0, 0.0, -p.thigh_m),
        Joint::LeftAnkle | Joint::RightAnkle => Vector3::new(0.0, 0.0, -p.shank_m),
        Joint::LeftHeel | Joint::RightHeel => Vector3::new(-p.heel_back_m, 0.0, -p.foot_height_m),
        Joint::LeftToe | Joint::RightToe => Vector3::new(p.toe_forward_m, 0.0, -p.foot_height_m),
    }
}

/// The place of a keypoint on the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// The joint that it belongs to.
    pub joint: Joint,
    /// Offset from the joint, metres, in the frame of the link in which the joint is fixed
    /// ([`Joint::link`]: the pelvis for a hip, the thigh for a knee, the head for the nose).
    pub offset_m: Vector3<f64>,
}

impl Site {
    /// On the joint itself.
    pub fn at(joint: Joint) -> Self {
        Self {
            joint,
            offset_m: Vector3::zeros(),
        }
    }
}

/// The sites of a network's keypoints, in the order of its maps.
///
/// A keypoint with the name of a joint sits on it. Other names that networks with feet use are
/// mapped to the nearest joint, and an unknown name has no site. `offsets_m` (from the network's
/// card) are added, by keypoint name.
pub fn sites_of(
    keypoints: &KeypointSet,
    offsets_m: &BTreeMap<String, [f64; 3]>,
) -> Vec<Option<Site>> {
    let offset_of = |name: &String| {
        offsets_m
            .get(name)
            .copied()
            .map_or(Vector3::zeros(), Vector3::from)
    };
    keypoints
        .names()
        .iter()
        .map(|name| {
            let site = site_named(name)?;
            Some(Site {
                offset_m: site.offset_m + offset_of(name),
                ..site
            })
        })
        .collect()
}

fn site_named(name: &str) -> Option<Site> {
    let small_toe = |outside_m: f64| Vector3::new(-SMALL_TOE_BEHIND_M, outside_m, 0.0);
    let (joint, offset_m) = match name {
        "hip" | "mid_hip" | "root" => (Joint::Pelvis, Vector3::zeros()),
        "left_big_toe" => (Joint::LeftToe, Vector3::zeros()),
        "right_big_toe" => (Joint::RightToe, Vector3::zeros()),
        "left_small_toe" => (Joint::LeftToe, small_toe(SMALL_TOE_OUTSIDE_M)),
        "right_small_toe" => (Joint::RightToe, small_toe(-SMALL_TOE_OUTSIDE_M)),
        name => (Joint::from_name(name)?, Vector3::zeros()),
    };
    Some(Site { joint, offset_m })
}

/// A body cannot have this length.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("length `{name}` is {found_m} m, expected a finite number above 0")]
pub struct ProportionsError {
    /// The field.
    pub name: &'static str,
    /// What it holds, metres.
    pub found_m: f64,
}

macro_rules! proportions {
    ($($(#[$doc:meta])* $field:ident = $ratio:literal,)*) => {
        /// Named lengths in metres, measured in the neutral pose (upright, arms hanging) from a
        /// joint to its parent.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Proportions {
            $($(#[$doc])* pub $field: f64,)*
        }

        impl Proportions {
            /// The average body of that stature (metres): shares of the stature, after Drillis
            /// and Contini where these have them.
            pub fn from_stature(stature_m: f64) -> Self {
                Self { $($field: $ratio * stature_m,)* }
            }

            /// The body of these lengths (metres), in the order of the fields; `None` of another number of them.
            pub fn from_lengths(lengths_m: &[f64]) -> Option<Self> {
                let mut left = lengths_m.iter().copied();
                let proportions = Self { $($field: left.next()?,)* };
                left.next().is_none().then_some(proportions)
            }

            /// Every length with its name, in the order of the fields.
            pub fn lengths_m(&self) -> impl Iterator<Item = (&'static str, f64)> {
                [$((stringify!($field), self.$field)),*].into_iter()
            }
        }
    };
}

proportions! {
    /// Pelvis above the floor when standing.
    pelvis_height_m = 0.53,
    /// Pelvis to spine, up.
    lumbar_m = 0.07,
    /// Spine to neck, up.
    trunk_m = 0.22,
    /// Neck to head, up.
    head_m = 0.10,
    /// Head to nose, forward.
    nose_forward_m = 0.06,
    /// Head to eye, forward.
    eye_forward_m = 0.05,
    /// Head to eye, up.
    eye_up_m = 0.015,
    /// Head to eye, to its side.
    eye_side_m = 0.019,
    /// Head to ear, to its side.
    ear_side_m = 0.042,
    /// Spine to scapula (sternoclavicular joint), up.
    scapula_up_m = 0.20,
    /// Spine to scapula, to its side.
    scapula_side_m = 0.02,
    /// Scapula to shoulder, to its side.
    clavicle_m = 0.09,
    /// Shoulder to elbow, down.
    upper_arm_m = 0.172,
    /// Elbow to wrist, down.
    forearm_m = 0.157,
    /// Wrist to hand, beyond the wrist.
    hand_m = 0.05,
    /// Pelvis to hip, to its side.
    hip_side_m = 0.05,
    /// Hip to knee, down.
    thigh_m = 0.245,
    /// Knee to ankle, down.
    shank_m = 0.246,
    /// Ankle to heel and toe, down.
    foot_height_m = 0.035,
    /// Ankle to heel, back.
    heel_back_m = 0.03,
    /// Ankle to toe, forward.
    toe_forward_m = 0.12,
}

impl Proportions {
    /// The same body, if every length is possible.
    ///
    /// # Errors
    /// The first length that is not a finite number above 0.
    pub fn checked(self) -> Result<Self, ProportionsError> {
        match self.lengths_m().find(|(_, m)| !(m.is_finite() && *m > 0.0)) {
            None => Ok(self),
            Some((name, found_m)) => Err(ProportionsError { name, found_m }),
        }
    }
}

#[cfg(test)]
mod proportions_tests {
    use super::*;

    #[test]
    fn a_body_is_its_lengths() {
        let body = Proportions::from_stature(1.68);
        let mut lengths_m: Vec<f64> = body.lengths_m().map(|(_, m)| m).collect();
        assert_eq!(Proportions::from_lengths(&lengths_m), Some(body));
        lengths_m.push(1.0);
        assert_eq!(Proportions::from_lengths(&lengths_m), None);
        assert_eq!(Proportions::from_lengths(&lengths_m[..5]), None);
    }

    #[test]
    fn an_impossible_length_is_refused_by_name() {
        assert!(Proportions::from_stature(1.75).checked().is_ok());
        for bad in [0.0, -0.1, f64::NAN, f64::INFINITY] {
            let body = Proportions {
                thigh_m: bad,
                ..Proportions::from_stature(1.75)
            };
            assert_eq!(body.checked().unwrap_err().name, "thigh_m");
        }
    }
}
