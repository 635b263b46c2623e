//! Feet that stand stay where they stand.
//!
//! The keypoints of most networks end at the ankles, so heels and toes hang from priors, and turn
//! with the shank while a real foot stays flat on the floor. A foot counts as standing while its
//! ankle is low, slow and below an upright shank; its heel and toe are then aimed at where they were
//! put down, in the second inverse kinematics. The place follows what is measured slowly, so
//! that a foot put down wrongly finds its place. This is a prior, not evidence: the ankle's angles stay
//! flagged as unobserved.

use nalgebra::Vector3;

use crate::body::skeleton::Joints;
use crate::body::skeleton::{Joint, Side};

/// Ankle height above the floor up to which a foot may stand, metres.
const LOW_M: f64 = 0.16;
/// Speed of the ankle below which a foot is put down, and above which it is taken up, metres per second.
const SLOW_M_S: [f64; 2] = [0.15, 0.30];
/// Cosine of the shank's tilt from which nobody stands on the foot (50 degrees).
const UPRIGHT_COSINE: f64 = 0.64;
/// How far the measured foot may be from its place until it is taken up, metres.
const FARTHEST_M: f64 = 0.05;
/// Time constant with which the place follows the measured foot, seconds.
const FOLLOW_S: f64 = 1.0;

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

/// Where a standing foot is, world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FootContact {
    heel_m: Vector3<f64>,
    toe_m: Vector3<f64>,
}

/// Both feet of a person.
#[derive(Debug, Clone)]
pub(crate) struct Feet {
    floor_m: f64,
    places: [Option<FootContact>; 2],
}

impl Feet {
    /// Feet in the air above a floor at the height `floor_m`, world z, metres.
    pub(crate) fn above(floor_m: f64) -> Self {
        Self {
            floor_m,
            places: [None; 2],
        }
    }

    /// Puts feet down and takes them up, from the smoothed joints (world, metres) and their velocities.
    pub(crate) fn step(&mut self, joints_m: &Joints, velocity_m_s: &Joints, dt_s: f64) {
        let share = (dt_s / FOLLOW_S).clamp(0.0, 1.0);
        for (place, [ankle, knee, heel, toe]) in self.places.iter_mut().zip(JOINTS) {
            let at = |joint: Joint| joints_m[joint.index()];
            let shank = at(knee) - at(ankle);
            let speed_m_s = velocity_m_s[ankle.index()].norm();
            let is_low = at(ankle).z - self.floor_m < LOW_M;
            let may_stand = is_low && shank.z > UPRIGHT_COSINE * shank.norm();
            let measured = FootContact {
                heel_m: at(heel),
                toe_m: at(toe),
            };
            *place = match *place {
                _ if !may_stand => None,
                None => (speed_m_s < SLOW_M_S[0]).then_some(measured),
                Some(at_m) => {
                    let off_m = measured.heel_m - at_m.heel_m;
                    (speed_m_s < SLOW_M_S[1] && off_m.norm() < FARTHEST_M).then(|| FootContact {
                        heel_m: at_m.heel_m + off_m * share,
                        toe_m: at_m.toe_m + (measured.toe_m - at_m.toe_m) * share,
                    })
                }
            };
        }
    }

    /// Where a joint of a standing foot is, if it is one.
    pub(crate) fn place_of(&self, joint: Joint) -> Option<Vector3<f64>> {
        let of = |side: Side| self.places[usize::from(side == Side::Right)];
        match joint {
            Joint::LeftHeel => of(Side::Left).map(|place| place.heel_m),
            Joint::RightHeel => of(Side::Right).map(|place| place.heel_m),
            Joint::LeftToe => of(Side::Left).map(|place| place.toe_m),
            Joint::RightToe => of(Side::Right).map(|place| place.toe_m),
            _ => None,
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
    fn a_foot_that_stands_keeps_its_place_while_it_trembles() {
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
    fn a_foot_that_is_moved_is_taken_up() {
        let (mut feet, mut joints_m) = (Feet::above(0.0), standing());
        feet.step(&joints_m, &moving(0.0), DT_S);
        feet.step(&joints_m, &moving(1.0), DT_S);
        assert_eq!(feet.place_of(Joint::LeftHeel), None);
        feet.step(&joints_m, &moving(0.0), DT_S);
        for joint in &mut joints_m {
            joint.z += 0.3;
        }
        feet.step(&joints_m, &moving(0.0), DT_S);
        assert_eq!(feet.place_of(Joint::RightHeel), None);
    }

    #[test]
    fn nobody_stands_on_the_feet_of_a_lying_person() {
        let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1.5);
        let lying = standing().map(|joint| turned * joint * 0.1);
        let mut feet = Feet::above(0.0);
        feet.step(&lying, &moving(0.0), DT_S);
        assert_eq!(feet.place_of(Joint::LeftToe), None);
    }

    #[test]
    fn a_foot_stands_on_the_floor_that_the_field_has() {
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
}
