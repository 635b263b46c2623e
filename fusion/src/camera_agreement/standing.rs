//! How tall everybody is and how high everybody stands: what tells the unit of a calibration, and its floor, where all
//! cameras agree with each other.

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::order_statistics::{mean_median, percentile, upper_median};

use super::report::DisagreementCause;
use crate::body::observed::ObservedJoints;
use crate::body::segment::stature_m;
use crate::body::skeleton::Joint;
use crate::estimate::estimator::Estimator;
use crate::identity::track::Track;

/// Statures and heights that are kept, the newest.
const MAX_KEPT: usize = 256;
/// Least statures that tell the unit of a calibration.
const MIN_STATURES: usize = 8;
/// Median stature of everybody outside which the unit of the calibration is doubted, metres: school children are taller,
/// and no team is.
const STATURES_M: std::ops::RangeInclusive<f64> = 1.2..=2.15;
/// Least heights of feet that tell of the floor.
const MIN_HEIGHTS: usize = 20;
/// Viewpoints that must see an ankle: legs behind a desk are made up.
const MIN_VIEWS: u16 = 2;
/// How far the feet of three in four are under the floor if it is elsewhere, metres. Heels and toes that no keypoint tells
/// were seen to be 0.05 off.
const UNDER_FLOOR_M: f64 = 0.15;
/// The same of three in four above it: who runs is in the air for less than half of the time, and treadmills are lower.
const ABOVE_FLOOR_M: f64 = 0.25;
/// The lowest points of a skeleton that stands.
const FEET: [Joint; 4] = [
    Joint::LeftHeel,
    Joint::RightHeel,
    Joint::LeftToe,
    Joint::RightToe,
];

/// People of whom one was measured at some instant.
#[derive(Debug, Clone, Default)]
pub(super) struct Standing {
    statures_m: Vec<f64>,
    /// Of each the lowest point of the feet above the floor.
    feet_m: Vec<f64>,
}

impl Standing {
    /// People of these statures, whose feet are so high.
    #[cfg(test)]
    pub(super) fn of(statures_m: Vec<f64>, feet_m: Vec<f64>) -> Self {
        Self { statures_m, feet_m }
    }

    /// Keeps what the `tracks` are now, above a floor at `floor_m`.
    pub(super) fn note(&mut self, tracks: &[Track], keypoints: &KeypointSet, floor_m: f64) {
        let ankles = ["left_ankle", "right_ankle"].map(|name| keypoints.index_of(name));
        let seen = tracks.iter().filter(|track| !track.is_tentative());
        for track in seen.filter(|track| track.estimator().n_views() >= MIN_VIEWS) {
            let mut body = ObservedJoints::default();
            for (joint, position_m) in Joint::ALL.iter().zip(track.estimator().joints_m()) {
                body.set(*joint, *position_m, 1.0);
            }
            keep(&mut self.statures_m, stature_m([&body]));
            let lowest_m = lowest_m(track.estimator(), &ankles);
            keep(&mut self.feet_m, lowest_m.map(|z| z - floor_m));
        }
    }

    /// That people have sizes which people do not have.
    pub(super) fn doubtful_scale(&self) -> Option<DisagreementCause> {
        if self.statures_m.len() < MIN_STATURES {
            return None;
        }
        let stature_m = upper_median(self.statures_m.clone())?;
        let cause = DisagreementCause::WorldScale { stature_m };
        (!STATURES_M.contains(&stature_m)).then_some(cause)
    }

    /// That people stand under the floor, or nobody on it.
    pub(super) fn doubtful_floor(&self) -> Option<DisagreementCause> {
        if self.feet_m.len() < MIN_HEIGHTS {
            return None;
        }
        let mut feet_m = self.feet_m.clone();
        feet_m.sort_by(f64::total_cmp);
        let is_under = percentile(&feet_m, 0.75)? < -UNDER_FLOOR_M;
        let is_above = percentile(&feet_m, 0.25)? > ABOVE_FLOOR_M;
        let above_m = mean_median(&feet_m)?;
        (is_under || is_above).then_some(DisagreementCause::FloorHeight { above_m })
    }
}

fn keep(kept: &mut Vec<f64>, new: Option<f64>) {
    let Some(new) = new.filter(|new| new.is_finite()) else {
        return;
    };
    if kept.len() == MAX_KEPT {
        kept.remove(0);
    }
    kept.push(new);
}

/// How high the lowest point of the feet is, world, metres; `None` where not both ankles are seen.
fn lowest_m(estimator: &Estimator, ankles: &[Option<usize>; 2]) -> Option<f64> {
    let is_seen = |ankle: &Option<usize>| {
        let estimate = ankle.and_then(|ankle| estimator.estimates().get(ankle));
        estimate.is_some_and(|estimate| estimate.views >= MIN_VIEWS)
    };
    let heights_m = FEET.map(|joint| estimator.joints_m()[joint.index()].z);
    ankles
        .iter()
        .all(is_seen)
        .then(|| heights_m.into_iter().fold(f64::INFINITY, f64::min))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn above_m(feet_m: impl Iterator<Item = f64>) -> Option<f64> {
        match Standing::of(Vec::new(), feet_m.collect()).doubtful_floor()? {
            DisagreementCause::FloorHeight { above_m } => Some(above_m),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn people_under_the_floor_and_people_in_the_air_are_told_by_how_much() {
        // They walk: a foot is up to 5 cm off the ground they walk on.
        let walk = |floor_m: f64| (0..40).map(move |i| floor_m + 0.01 * f64::from(i % 6));
        for floor_m in [-1.0, -0.22, 0.3, 1.2] {
            let found_m = above_m(walk(floor_m)).unwrap();
            assert!((found_m - floor_m).abs() < 0.06, "{floor_m}: {found_m}");
        }
        for floor_m in [-0.1, 0.0, 0.2] {
            assert_eq!(above_m(walk(floor_m)), None, "{floor_m}");
        }
    }

    #[test]
    fn nothing_is_said_of_some_on_a_stage_of_who_jumps_and_of_a_moment() {
        // Half of them stand 1.2 m higher; somebody is in the air for 60 % of the time; half a second of one person.
        assert_eq!(above_m((0..40).map(|i| 1.2 * f64::from(i % 2))), None);
        assert_eq!(
            above_m((0..50).map(|i| if i % 5 < 3 { 0.5 } else { 0.0 })),
            None
        );
        assert_eq!(above_m((0..10).map(|_| -1.0)), None);
        // A spectator below a stand, and two on it.
        assert_eq!(
            above_m((0..60).map(|i| if i % 3 == 0 { -0.9 } else { 0.0 })),
            None
        );
    }
}
