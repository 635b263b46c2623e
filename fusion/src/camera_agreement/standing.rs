//! Statures and standing heights of people. They reveal a wrong unit, tilt or floor of a
//! calibration if all cameras agree with each other.

pub(super) mod ankles;
mod statures;
mod tilt;

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::venue::Venue;
use nalgebra::Vector3;

use self::ankles::AnkleHeights;
use self::statures::Statures;
use self::tilt::{Stance, tilt_rad};
use super::report::DisagreementCause;
use crate::body::skeleton::{Joint, Joints};
use crate::estimate::estimator::Estimator;
use crate::identity::track::Track;

/// Number of stances that are kept, of all people together.
const MAX_STANCES: usize = 1024;
/// Least number of viewpoints that see an ankle: legs behind a desk are guessed.
const MIN_VIEWS: u16 = 2;
/// Least downward part of the unit directions of thigh and shank of a standing leg: within 40
/// degrees. People who sit, kneel, lie or ride do not stand.
const MIN_DOWNWARD: f64 = 0.77;
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

/// Measurements of the people of a run.
#[derive(Debug, Clone)]
pub(super) struct Standing {
    /// The keypoints at the ankles, if the network has them.
    ankles: [Option<usize>; 2],
    floor_m: f64,
    statures: Statures,
    stances: Vec<Stance>,
    ankle_heights: AnkleHeights,
}

impl Standing {
    /// No people yet in the `venue`.
    pub(super) fn new(keypoints: &KeypointSet, venue: &Venue) -> Self {
        let statures = Statures::expecting(&venue.subjects);
        Self::with(keypoints, venue.field.floor_m, statures)
    }

    fn with(keypoints: &KeypointSet, floor_m: f64, statures: Statures) -> Self {
        Self {
            ankles: ["left_ankle", "right_ankle"].map(|name| keypoints.index_of(name)),
            floor_m,
            statures,
            stances: Vec::with_capacity(MAX_STANCES),
            ankle_heights: AnkleHeights::default(),
        }
    }

    /// People of these statures with their feet at `feet_m`.
    #[cfg(test)]
    pub(super) fn from_statures(statures_m: &[f64], feet_m: f64) -> Self {
        let ids = 1..=statures_m.len() as u32;
        Self {
            ankle_heights: AnkleHeights::from_feet(ids.map(|id| (id, feet_m))),
            ..Self::with(
                &KeypointSet::coco17(),
                0.0,
                Statures::from_metres(statures_m),
            )
        }
    }

    /// Adds measurements of the `tracks` at this instant.
    pub(super) fn note(&mut self, tracks: &[Track]) {
        self.statures.begin_instant();
        let seen = tracks.iter().filter(|track| !track.is_tentative());
        for track in seen.filter(|track| track.estimator().n_views() >= MIN_VIEWS) {
            let joints_m = track.estimator().joints_m();
            self.statures.note(track.id(), joints_m);
            if sees_both(track.estimator(), &self.ankles)
                && let Some(foot_m) = standing_foot_m(joints_m)
            {
                self.ankle_heights.note(track.id(), joints_m, self.floor_m);
                let stance = Stance::new(joints_m, foot_m);
                push_newest(&mut self.stances, stance, MAX_STANCES);
            }
        }
    }

    /// A wrong scale, if people have implausible statures.
    pub(super) fn suspect_scale(&self) -> Option<DisagreementCause> {
        self.statures.suspect_scale()
    }

    /// A wrong floor height, if all standing people are under the floor, or all above it.
    pub(super) fn suspect_floor(&self) -> Option<DisagreementCause> {
        Some(DisagreementCause::FloorHeight {
            above_m: self.ankle_heights.above_floor_m()?,
            floor_m: self.floor_m,
        })
    }

    /// A tilted world, if people stand and lean accordingly.
    pub(super) fn suspect_tilt(&self) -> Option<DisagreementCause> {
        let degrees = tilt_rad(&self.stances)?.to_degrees();
        Some(DisagreementCause::WorldTilted {
            degrees: (10.0 * degrees).round() / 10.0,
        })
    }
}

/// Appends `new`, and drops the oldest item if there are `max_len` already.
fn push_newest<T>(items: &mut Vec<T>, new: T, max_len: usize) {
    if items.len() == max_len {
        items.remove(0);
    }
    items.push(new);
}

/// Whether two viewpoints see each ankle.
fn sees_both(estimator: &Estimator, ankles: &[Option<usize>; 2]) -> bool {
    ankles.iter().all(|ankle| {
        let estimate = ankle.and_then(|ankle| estimator.estimates().get(ankle));
        estimate.is_some_and(|estimate| estimate.views >= MIN_VIEWS)
    })
}

/// The lowest point of the feet, world, metres; `None` if the person stands on neither leg.
fn standing_foot_m(joints_m: &Joints) -> Option<Vector3<f64>> {
    let at = |joint: Joint| joints_m[joint.index()];
    let is_down = |from: Joint, to: Joint| {
        let along_m = at(to) - at(from);
        along_m.z < -MIN_DOWNWARD * along_m.norm()
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

    /// The joints of a body of 1.8 m with these bends of both hips and knees, turned about y
    /// (radians), with its pelvis at a height of `pelvis_m`.
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
    fn only_standing_people_have_a_standing_foot() {
        let standing_m = standing_foot_m(&body(0.0, 0.0, 0.0, 0.96)).unwrap().z;
        assert!(standing_m.abs() < 0.1, "{standing_m}");
        assert!(standing_foot_m(&body(0.3, 0.4, 0.0, 0.9)).is_some());
        for (what, joints_m) in [
            ("sits", body(1.5, 1.5, 0.0, 0.5)),
            ("kneels", body(0.0, 1.5, 0.0, 0.5)),
            ("lies", body(0.0, 0.0, 1.57, 0.1)),
            ("stands on the hands", body(0.0, 0.0, 3.1, 1.1)),
        ] {
            assert_eq!(standing_foot_m(&joints_m), None, "{what}");
        }
    }
}
