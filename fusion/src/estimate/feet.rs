//! Standing feet keep their place.
//!
//! The keypoints of most networks end at the ankles. So heels and toes come from priors and turn
//! with the shank, while a real foot stays flat on the floor. And the ankle of a standing foot
//! trembles with the network's errors. A foot counts as standing while its ankle is low, slow and
//! below an upright shank. Ankle, heel and toe then have the place where they were put down as
//! targets of the second inverse kinematics. The place follows the measurement, slowly while it is
//! near and fast when it is far. So a foot put down wrongly finds its place, and a dragged one is
//! not left behind. A lifted foot leaves its place within a few ticks, not in one. This is a prior,
//! not evidence: the ankle's angles stay flagged as unobserved.

use nalgebra::Vector3;

use crate::body::skeleton::{Joint, Joints, Side};

/// Largest height of a standing foot's ankle above the floor, metres.
const LOW_M: f64 = 0.16;
/// Speed of the ankle below which a foot is put down, and above which it is lifted, metres per
/// second. A standing foot's measured speed is that of the network's errors, up to 0.4 m/s; a
/// swinging foot soon exceeds it.
const SLOW_M_S: [f64; 2] = [0.15, 0.4];
/// Least cosine of the shank's tilt for a standing foot (50 degrees).
const UPRIGHT_COSINE: f64 = 0.64;
/// Distance of the measured heel from its place at which the foot is lifted, metres.
const FARTHEST_M: f64 = 0.05;
/// Time constant with which the place follows the measured foot, seconds ...
const FOLLOW_S: f64 = 1.0;
/// ... while the ankle is nearer than this, metres; at this distance it is half of that.
const NEAR_M: f64 = 0.02;
/// Time in which a lifted foot leaves its place, seconds.
const LEAVE_S: f64 = 0.08;

/// Remainder that counts as zero, metres.
const LEFT_M: f64 = 1e-4;

/// Ankle, knee, heel and toe of a side.
const JOINTS: [[Joint; 4]; 2] = [
    [
        Joint::LeftAnkle,
        Joint::LeftKnee,
        Joint::LeftHeel,
        Joint::LeftToe,
    ],
    [
        Joint::RightAnkle,
        Joint::RightKnee,
        Joint::RightHeel,
        Joint::RightToe,
    ],
];

/// Ankle, heel and toe of one foot, or displacements of them, world, metres.
type FootPoints = [Vector3<f64>; 3];

#[derive(Debug, Clone, Copy, Default)]
struct Foot {
    stands: bool,
    /// From the measured place to the target; zero for a foot in the air.
    offset_m: FootPoints,
    aim_m: FootPoints,
}

/// Both feet of a person.
#[derive(Debug, Clone)]
pub(crate) struct Feet {
    floor_m: f64,
    feet: [Foot; 2],
}

impl Feet {
    /// Feet in the air above a floor at the height `floor_m`, world z, metres.
    pub(crate) fn above(floor_m: f64) -> Self {
        Self {
            floor_m,
            feet: [Foot::default(); 2],
        }
    }

    /// Puts feet down and lifts them, from the smoothed joints (world, metres) and their
    /// velocities.
    pub(crate) fn step(&mut self, joints_m: &Joints, velocity_m_s: &Joints, dt_s: f64) {
        for (foot, [ankle, knee, heel, toe]) in self.feet.iter_mut().zip(JOINTS) {
            let at = |joint: Joint| joints_m[joint.index()];
            let shank = at(knee) - at(ankle);
            let is_low = at(ankle).z - self.floor_m < LOW_M;
            let may_stand = is_low && shank.z > UPRIGHT_COSINE * shank.norm();
            let speed_m_s = velocity_m_s[ankle.index()].norm();
            let measured_m = [ankle, heel, toe].map(at);
            foot.step(&measured_m, speed_m_s, may_stand, dt_s);
        }
    }

    /// Target of a joint of a foot that stands, or was just lifted.
    pub(crate) fn place_of(&self, joint: Joint) -> Option<Vector3<f64>> {
        let (side, point) = match joint {
            Joint::LeftAnkle => (Side::Left, 0),
            Joint::LeftHeel => (Side::Left, 1),
            Joint::LeftToe => (Side::Left, 2),
            Joint::RightAnkle => (Side::Right, 0),
            Joint::RightHeel => (Side::Right, 1),
            Joint::RightToe => (Side::Right, 2),
            _ => return None,
        };
        let foot = &self.feet[usize::from(side == Side::Right)];
        let is_held = foot.stands || foot.offset_m[point].norm() > LEFT_M;
        is_held.then_some(foot.aim_m[point])
    }
}

impl Foot {
    fn step(&mut self, measured_m: &FootPoints, speed_m_s: f64, may_stand: bool, dt_s: f64) {
        let left = 1.0 - (dt_s / LEAVE_S).clamp(0.0, 1.0);
        let was_standing = self.stands;
        if was_standing {
            // The place stays while the measurement moves.
            for (offset, (aim, measured)) in self
                .offset_m
                .iter_mut()
                .zip(self.aim_m.iter().zip(measured_m))
            {
                *offset = aim - measured;
            }
        }
        let [ankle_off, heel_off, _] = self.offset_m;
        self.stands = may_stand
            && if was_standing {
                speed_m_s < SLOW_M_S[1] && heel_off.norm() < FARTHEST_M
            } else {
                speed_m_s < SLOW_M_S[0]
            };
        let kept = match (was_standing, self.stands) {
            (true, true) => {
                let hurry = 1.0 + ankle_off.norm_squared() / (NEAR_M * NEAR_M);
                1.0 - (hurry * dt_s / FOLLOW_S).clamp(0.0, 1.0)
            }
            _ => left,
        };
        for (aim, (offset, measured)) in self
            .aim_m
            .iter_mut()
            .zip(self.offset_m.iter_mut().zip(measured_m))
        {
            *offset *= kept;
            *aim = measured + *offset;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Kinematics, N_JOINTS, Pose, Proportions, Skeleton};
    use nalgebra::UnitQuaternion;

    const DT_S: f64 = 1.0 / 60.0;

    fn standing() -> Joints {
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let pose = Pose::neutral(
            Vector3::new(0.0, 0.0, 0.53 * 1.75),
            UnitQuaternion::identity(),
        );
        let mut kinematics = Kinematics::default();
        skeleton.forward(&pose, &mut kinematics);
        Joint::ALL.map(|joint| kinematics.joint_m(joint))
    }

    fn moving(m_s: f64) -> Joints {
        [Vector3::new(m_s, 0.0, 0.0); N_JOINTS]
    }

    #[test]
    fn a_standing_foot_keeps_its_place_while_it_trembles() {
        let (mut feet, mut joints_m) = (Feet::above(0.0), standing());
        feet.step(&joints_m, &moving(0.0), DT_S);
        let put = feet.place_of(Joint::LeftToe).unwrap();
        joints_m[Joint::LeftToe.index()].x += 0.03;
        joints_m[Joint::LeftHeel.index()].x += 0.03;
        feet.step(&joints_m, &moving(0.1), DT_S);
        let moved_m = (feet.place_of(Joint::LeftToe).unwrap() - put).norm();
        assert!(moved_m < 0.001, "{moved_m} m in a tick");
    }

    #[test]
    fn a_moving_foot_is_lifted() {
        let (mut feet, mut joints_m) = (Feet::above(0.0), standing());
        feet.step(&joints_m, &moving(0.0), DT_S);
        feet.step(&joints_m, &moving(1.0), DT_S);
        assert_eq!(feet.place_of(Joint::LeftHeel), None);
        feet.step(&joints_m, &moving(0.0), DT_S);
        for joint in &mut joints_m {
            joint.z += 0.3;
        }
        for _ in 0..60 {
            feet.step(&joints_m, &moving(0.0), DT_S);
        }
        assert_eq!(feet.place_of(Joint::RightHeel), None);
    }

    #[test]
    fn feet_of_a_lying_person_do_not_stand() {
        let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1.5);
        let lying = standing().map(|joint| turned * joint * 0.1);
        let mut feet = Feet::above(0.0);
        feet.step(&lying, &moving(0.0), DT_S);
        assert_eq!(feet.place_of(Joint::LeftToe), None);
    }

    #[test]
    fn a_foot_stands_on_the_floor_of_the_field() {
        let on_stage = standing().map(|at_m| at_m + Vector3::new(0.0, 0.0, 1.2));
        let still = [Vector3::zeros(); N_JOINTS];
        let stands_above = |floor_m: f64| {
            let mut feet = Feet::above(floor_m);
            feet.step(&on_stage, &still, DT_S);
            feet.place_of(Joint::LeftToe).is_some()
        };
        assert!(stands_above(1.2));
        assert!(!stands_above(0.0));
    }

    #[test]
    fn a_standing_ankle_trembles_no_more_than_its_heel() {
        let (mut feet, mut joints_m) = (Feet::above(0.0), standing());
        feet.step(&joints_m, &moving(0.0), DT_S);
        let put = feet.place_of(Joint::LeftAnkle).unwrap();
        joints_m[Joint::LeftAnkle.index()].y += 0.01;
        feet.step(&joints_m, &moving(0.3), DT_S);
        let moved_m = (feet.place_of(Joint::LeftAnkle).unwrap() - put).norm();
        assert!(moved_m < 0.0005, "{moved_m} m in a tick");
    }

    #[test]
    fn a_lifted_foot_leaves_its_place_without_a_jump() {
        // 40 mm in one tick would be 2.4 m/s for a foot that may only have trembled.
        let (mut feet, mut joints_m) = (Feet::above(0.0), standing());
        feet.step(&joints_m, &moving(0.0), DT_S);
        let put = feet.place_of(Joint::LeftHeel).unwrap();
        for joint in &mut joints_m {
            joint.x += 0.04;
        }
        feet.step(&joints_m, &moving(1.0), DT_S);
        let moved_m = (feet.place_of(Joint::LeftHeel).unwrap() - put).norm();
        assert!((0.005..0.015).contains(&moved_m), "{moved_m} m in a tick");
    }

    #[test]
    fn a_dragged_foot_is_not_left_behind() {
        const DRAGGED_M_S: f64 = 0.15;
        let (mut feet, mut joints_m) = (Feet::above(0.0), standing());
        feet.step(&joints_m, &moving(0.0), DT_S);
        for _ in 0..120 {
            feet.step(&joints_m, &moving(DRAGGED_M_S), DT_S);
            for joint in &mut joints_m {
                joint.x += DRAGGED_M_S * DT_S;
            }
        }
        let ankle_m = joints_m[Joint::LeftAnkle.index()];
        let behind_m = (feet.place_of(Joint::LeftAnkle).unwrap() - ankle_m).norm();
        assert!(behind_m < 0.045, "{behind_m} m behind");
    }
}
