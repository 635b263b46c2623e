//! The evidence about a tentative person until it is confirmed.

use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::observed::ObservedJoints;
use crate::body::skeleton::Joint;

/// Detection passes before contradictions can end a tentative track: detectors sometimes miss
/// people.
const MIN_PASSES: u32 = 3;
/// Least time span of hips for a velocity, seconds: two points with errors of 50 mm each give it
/// within 0.7 m/s, and there are more than two.
const LEAST_TIME_S: f64 = 0.1;

/// The keypoint positions of one tick of a tentative person.
#[derive(Debug, Clone)]
pub(crate) struct TentativeTick {
    pub(crate) tick: Tick,
    pub(crate) estimates: Vec<KeypointEstimate>,
}

/// Velocity of a person from `seen` (time in seconds, joints), world, metres per second: the slope
/// of the least-squares line through the middles of the hips. A filter that began without a
/// velocity has only half of it by then.
pub(crate) fn velocity_m_s(seen: &[(f64, ObservedJoints)]) -> Option<Vector3<f64>> {
    let hips = [Joint::LeftHip, Joint::RightHip];
    let middles = seen
        .iter()
        .filter_map(|(at_s, joints)| Some((*at_s, joints.middle_m(hips)?)));
    let (first, last) = (middles.clone().next()?, middles.clone().next_back()?);
    if last.0 - first.0 < LEAST_TIME_S {
        return None;
    }
    // Relative to the first, so that no digits are lost far from the origin and late in a run.
    let points = middles.map(|(at_s, middle_m)| (at_s - first.0, middle_m - first.1));
    let (mut n, mut t, mut t2) = (0.0, 0.0, 0.0);
    let (mut x, mut xt) = (Vector3::zeros(), Vector3::zeros());
    for (at_s, offset_m) in points {
        n += 1.0;
        t += at_s;
        t2 += at_s * at_s;
        x += offset_m;
        xt += offset_m * at_s;
    }
    Some((xt * n - x * t) / (t2 * n - t * t))
}

/// Results of the detection passes since an initiation.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Votes {
    pub(crate) passes: u32,
    /// Viewpoints that saw it, summed over the passes.
    pub(crate) seen: u32,
    /// Viewpoints that should have seen it and did not, weighted by what their silence is worth
    /// (`crate::sightings::attention`), summed over the passes.
    pub(crate) missed: f64,
}

impl Votes {
    /// Counts one pass: how many viewpoints saw the body, and how many should have seen it and did
    /// not. A pass without either does not count.
    pub(crate) fn count(&mut self, (seen, missed): (u32, f64)) {
        if seen == 0 && missed <= 0.0 {
            return;
        }
        self.passes += 1;
        self.seen += seen;
        self.missed += missed;
    }

    /// Whether the viewpoints contradict the body.
    pub(crate) fn are_against(&self) -> bool {
        self.passes >= MIN_PASSES && self.missed >= f64::from(self.seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contradictions_end_a_tentative_track_but_single_misses_do_not() {
        let mut votes = Votes::default();
        votes.count((2, 1.0));
        votes.count((1, 3.0));
        assert!(!votes.are_against());
        votes.count((2, 1.0));
        assert!(votes.are_against());
        let mut votes = Votes::default();
        for _ in 0..10 {
            votes.count((2, 1.0));
        }
        assert!(!votes.are_against());
    }

    #[test]
    fn velocity_is_that_of_the_hips_and_needs_several_ticks() {
        let hips = |at_s: f64| {
            let x_m = 4.0 * at_s;
            let points = [
                ("left_hip", [x_m, 0.1, 0.9]),
                ("right_hip", [x_m, -0.1, 0.9]),
            ];
            (at_s, ObservedJoints::from_named(points))
        };
        let seen: Vec<_> = (0..12)
            .map(|tick| hips(1e3 + f64::from(tick) / 60.0))
            .collect();
        let velocity_m_s = velocity_m_s(&seen).unwrap();
        assert!((velocity_m_s - Vector3::new(4.0, 0.0, 0.0)).norm() < 1e-6);
        assert_eq!(super::velocity_m_s(&seen[..6]), None);
        assert_eq!(super::velocity_m_s(&[]), None);
        let nothing = |at_s| (at_s, ObservedJoints::from_named([]));
        assert_eq!(super::velocity_m_s(&[nothing(0.0), nothing(1.0)]), None);
    }

    #[test]
    fn passes_without_votes_contradict_no_track() {
        let mut votes = Votes::default();
        for _ in 0..3 {
            votes.count((0, 0.0));
        }
        assert!(!votes.are_against());
    }
}
