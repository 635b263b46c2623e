//! How tall everybody is and how high everybody stands: what tells the unit of a calibration, and its floor, where all
//! cameras agree with each other.

pub(super) mod ankles;
mod statures;
mod tilt;

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::order_statistics::{mean_median, percentile};
use farfield_proto::venue::Venue;
use nalgebra::Vector3;

use self::ankles::AnkleHeights;
use self::statures::Statures;
use self::tilt::{Stance, tilt_rad};
use super::report::DisagreementCause;
use crate::body::skeleton::{Joint, Joints};
use crate::estimate::estimator::Estimator;
use crate::identity::track::Track;

/// Heights that are kept, the newest.
const MAX_KEPT: usize = 256;
/// Places where somebody stood that are kept, the newest: of several people at an instant.
const MAX_STANCES: usize = 1024;
/// Least instants that tell of the floor, and of one that is so far from everybody's feet, metres, that it is no jump.
const MIN_INSTANTS: usize = 20;
const FEW_INSTANTS: usize = 8;
const FAR_FROM_FLOOR_M: f64 = 0.6;
/// Viewpoints that must see an ankle: legs behind a desk are made up.
const MIN_VIEWS: u16 = 2;
/// Least downward part of the direction of thigh and shank of a leg on which somebody stands: within 40 degrees. Who sits,
/// kneels, lies or rides does not stand.
const DOWNWARD: f64 = 0.77;
/// How far everybody's feet are under the floor in three of four instants if it is elsewhere, metres. Heels and toes that no
/// keypoint tells were seen to be 0.05 off, and the floor of a calibration 0.10 (on the Shelf).
const UNDER_FLOOR_M: f64 = 0.15;
/// The same above it: who runs is in the air for less than half of the time.
const ABOVE_FLOOR_M: f64 = 0.25;
/// The lowest points of a skeleton that stands.
const FEET: [Joint; 4] = [
    Joint::LeftHeel,
    Joint::RightHeel,
    Joint::LeftToe,
    Joint::RightToe,
];
/// Hip, knee and ankle.
const LEGS: [[Joint; 3]; 2] = [
    [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle],
    [Joint::RightHip, Joint::RightKnee, Joint::RightAnkle],
];

/// People of whom one was measured at some instant.
#[derive(Debug, Clone)]
pub(super) struct Standing {
    /// The keypoints at the ankles, where the network knows them.
    ankles: [Option<usize>; 2],
    floor_m: f64,
    statures: Statures,
    /// Per instant how high the feet of those who stand are above the floor: of the lowest person, and of the highest.
    feet_m: Vec<[f64; 2]>,
    /// Where they stood, and how they leant.
    stances: Vec<Stance>,
    ankle_heights: AnkleHeights,
}

impl Standing {
    /// Nobody yet in the `venue`.
    pub(super) fn new(keypoints: &KeypointSet, venue: &Venue) -> Self {
        let statures = Statures::expecting(&venue.subjects);
        Self::with(keypoints, venue.field.floor_m, statures)
    }

    fn with(keypoints: &KeypointSet, floor_m: f64, statures: Statures) -> Self {
        Self {
            ankles: ["left_ankle", "right_ankle"].map(|name| keypoints.index_of(name)),
            floor_m,
            statures,
            feet_m: Vec::with_capacity(MAX_KEPT),
            stances: Vec::with_capacity(MAX_STANCES),
            ankle_heights: AnkleHeights::default(),
        }
    }

    /// People of these statures, whose feet are so high.
    #[cfg(test)]
    pub(super) fn of(statures_m: &[f64], feet_m: Vec<[f64; 2]>) -> Self {
        Self {
            feet_m,
            ..Self::with(&KeypointSet::coco17(), 0.0, Statures::of(statures_m))
        }
    }

    /// Keeps what the `tracks` are now.
    pub(super) fn note(&mut self, tracks: &[Track]) {
        self.statures.begin();
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        let seen = tracks.iter().filter(|track| !track.is_tentative());
        for track in seen.filter(|track| track.estimator().n_views() >= MIN_VIEWS) {
            let joints_m = track.estimator().joints_m();
            self.statures.note(track.id(), joints_m);
            if sees_both(track.estimator(), &self.ankles)
                && let Some(foot_m) = foot_of_who_stands(joints_m)
            {
                self.ankle_heights.note(track.id(), joints_m, self.floor_m);
                let stance = Stance::of(joints_m, foot_m);
                keep(&mut self.stances, stance, MAX_STANCES);
                let above_m = foot_m.z - self.floor_m;
                range = [range[0].min(above_m), range[1].max(above_m)];
            }
        }
        if range.iter().all(|m| m.is_finite()) {
            keep(&mut self.feet_m, range, MAX_KEPT);
        }
    }

    /// That people have sizes which people do not have, also where they seem so many times as large as they are for what is known
    /// already.
    pub(super) fn doubtful_scale(&self, larger: f64, is_alone: bool) -> Option<DisagreementCause> {
        self.statures.doubtful_scale(larger, is_alone)
    }

    /// That all who stand do so under the floor, or nobody on it.
    pub(super) fn doubtful_floor(&self) -> Option<DisagreementCause> {
        let above_m = self
            .far_from_floor_m()
            .or_else(|| self.ankle_heights.elsewhere_m())?;
        Some(DisagreementCause::FloorHeight {
            above_m,
            floor_m: self.floor_m,
        })
    }

    /// How high the feet of those who stand are above the floor, by the lowest points of all of them, metres.
    fn far_from_floor_m(&self) -> Option<f64> {
        if self.feet_m.len() < FEW_INSTANTS {
            return None;
        }
        let sorted = |of: usize| {
            let mut feet_m: Vec<f64> = self.feet_m.iter().map(|range| range[of]).collect();
            feet_m.sort_by(f64::total_cmp);
            feet_m
        };
        let [lowest_m, highest_m] = [sorted(0), sorted(1)];
        let told_m = if percentile(&highest_m, 0.75)? < -UNDER_FLOOR_M {
            highest_m
        } else if percentile(&lowest_m, 0.25)? > ABOVE_FLOOR_M {
            lowest_m
        } else {
            return None;
        };
        let above_m = mean_median(&told_m)?;
        let are_enough = told_m.len() >= MIN_INSTANTS || above_m.abs() >= FAR_FROM_FLOOR_M;
        are_enough.then_some(above_m)
    }

    /// That the world is tilted.
    pub(super) fn doubtful_tilt(&self) -> Option<DisagreementCause> {
        let degrees = tilt_rad(&self.stances)?.to_degrees();
        Some(DisagreementCause::WorldTilted {
            degrees: (10.0 * degrees).round() / 10.0,
        })
    }
}

fn keep<T>(kept: &mut Vec<T>, new: T, most: usize) {
    if kept.len() == most {
        kept.remove(0);
    }
    kept.push(new);
}

/// Whether two viewpoints see each ankle.
fn sees_both(estimator: &Estimator, ankles: &[Option<usize>; 2]) -> bool {
    ankles.iter().all(|ankle| {
        let estimate = ankle.and_then(|ankle| estimator.estimates().get(ankle));
        estimate.is_some_and(|estimate| estimate.views >= MIN_VIEWS)
    })
}

/// The lowest point of the feet, world, metres; `None` of who stands on neither leg.
fn foot_of_who_stands(joints_m: &Joints) -> Option<Vector3<f64>> {
    let at = |joint: Joint| joints_m[joint.index()];
    let is_down = |from: Joint, to: Joint| {
        let along_m = at(to) - at(from);
        along_m.z < -DOWNWARD * along_m.norm()
    };
    let mut legs = LEGS.into_iter();
    let stands = legs.any(|[hip, knee, ankle]| is_down(hip, knee) && is_down(knee, ankle));
    let feet_m = FEET.map(at).into_iter();
    let lowest_m = feet_m.min_by(|a, b| a.z.total_cmp(&b.z))?;
    let is_finite = lowest_m.iter().all(|m| m.is_finite());
    (stands && is_finite).then_some(lowest_m)
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::body::skeleton::dof::{DofGroup, first_of};
    use crate::body::skeleton::{Kinematics, Pose, Proportions, Side, Skeleton};

    /// What is found of people whose feet are so high, all at once.
    fn above_m(feet_m: impl Iterator<Item = [f64; 2]>) -> Option<f64> {
        match Standing::of(&[], feet_m.collect()).doubtful_floor()? {
            DisagreementCause::FloorHeight { above_m, .. } => Some(above_m),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn people_under_the_floor_and_people_in_the_air_are_told_by_how_much() {
        // They walk: a foot is up to 5 cm off the ground they walk on.
        let walk = |floor_m: f64| (0..40).map(move |i| [floor_m + 0.01 * f64::from(i % 6); 2]);
        for floor_m in [-1.0, -0.22, 0.3, 1.2] {
            let found_m = above_m(walk(floor_m)).unwrap();
            assert!((found_m - floor_m).abs() < 0.06, "{floor_m}: {found_m}");
        }
        for floor_m in [-0.1, 0.0, 0.2] {
            assert_eq!(above_m(walk(floor_m)), None, "{floor_m}");
        }
    }

    #[test]
    fn nothing_is_said_where_one_stands_on_the_floor_of_who_jumps_and_of_a_moment() {
        // A conductor before a choir on its steps, and a spectator below a stand with others on it.
        assert_eq!(above_m((0..40).map(|_| [0.0, 0.6])), None);
        assert_eq!(above_m((0..40).map(|_| [-0.9, 0.0])), None);
        // Somebody is in the air for 60 % of the time.
        let jumps = (0..50).map(|i| [if i % 5 < 3 { 0.5 } else { 0.0 }; 2]);
        assert_eq!(above_m(jumps), None);
        assert_eq!(above_m((0..19).map(|_| [-0.4; 2])), None);
        assert_eq!(above_m((0..7).map(|_| [-1.0; 2])), None);
        assert!(above_m((0..9).map(|_| [-1.0; 2])).is_some());
    }

    /// The joints of a body of 1.8 m with these bends of both hips and knees, radians, turned so and with its pelvis so high.
    fn body(hip: f64, knee: f64, turn: f64, pelvis_m: f64) -> Joints {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn);
        let mut pose = Pose::neutral(Vector3::new(0.0, 0.0, pelvis_m), rotation);
        for side in Side::BOTH {
            pose.dof[first_of(side, DofGroup::Hip)] = hip;
            pose.dof[first_of(side, DofGroup::Knee)] = knee;
        }
        let mut kinematics = Kinematics::default();
        Skeleton::new(&Proportions::from_stature(1.8)).forward(&pose, &mut kinematics);
        Joint::ALL.map(|joint| kinematics.joint_m(joint))
    }

    #[test]
    fn the_feet_count_of_who_stands_and_not_of_who_sits_kneels_or_lies() {
        let standing_m = foot_of_who_stands(&body(0.0, 0.0, 0.0, 0.96)).unwrap().z;
        assert!(standing_m.abs() < 0.1, "{standing_m}");
        assert!(foot_of_who_stands(&body(0.3, 0.4, 0.0, 0.9)).is_some());
        for (what, joints_m) in [
            ("sits", body(1.5, 1.5, 0.0, 0.5)),
            ("kneels", body(0.0, 1.5, 0.0, 0.5)),
            ("lies", body(0.0, 0.0, 1.57, 0.1)),
            ("stands on the hands", body(0.0, 0.0, 3.1, 1.1)),
        ] {
            assert_eq!(foot_of_who_stands(&joints_m), None, "{what}");
        }
    }
}
