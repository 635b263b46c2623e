//! Separation of bodies that overlap.
//!
//! At a barrier, after smoothing, each person gets the capsules of [`crate::estimate::occlusion`],
//! slimmer. Where two of different persons overlap by p, both are moved apart along the line
//! between their axes, by
//!
//! ```text
//!   e_a x_a^2 + e_b x_b^2 + w (p - x_a - x_b)^2      least:      x_a = p (1/e_a)/(1/w + 1/e_a + 1/e_b)
//! ```
//!
//! e is how well each limb is seen at the contact (0 to 1), w the weight of the separation. A well
//! seen limb stays where it is seen; a predicted one moves out of the way. The prediction
//! determines the side of a limb: a limb that has passed through another within a tick is moved
//! back, not on.
//!
//! The moved joints are targets of the second inverse kinematics. The filter does not use them, so
//! a push has no lasting effect once there is evidence.

use nalgebra::Vector3;

use crate::body::skeleton::{Joints, N_JOINTS};
use crate::estimate::estimator::Estimator;
use crate::estimate::occlusion::{BodyCapsules, Touch};
use crate::method::Method;

/// Least visibility of a limb, so that two unseen limbs also separate.
const LEAST_SEEN: f64 = 1e-4;

/// The pushes of a tick, with their buffers.
#[derive(Debug, Clone, Default)]
pub struct Separation {
    bodies: Vec<BodyCapsules>,
    pushes_m: Vec<Joints>,
    any_touch: bool,
}

impl Separation {
    /// Finds the displacement of each of `tracks`, which are smoothed; `predicted` are the bodies
    /// predicted for the tick.
    ///
    /// Cost: one distance per pair of persons apart, 400 per pair that is near each other.
    pub fn find(
        &mut self,
        tracks: &[impl AsRef<Estimator>],
        predicted: &[BodyCapsules],
        method: &Method,
    ) {
        let contact = &method.parameters.contact;
        self.pushes_m.clear();
        self.bodies.clear();
        self.any_touch = false;
        if contact.separation_weight <= 0.0 || tracks.len() < 2 {
            return;
        }
        let (occlusion, ik) = (&method.parameters.occlusion, &method.parameters.ik);
        let bodies = tracks
            .iter()
            .map(|track| BodyCapsules::from_joints(track.as_ref().smoothed_m(), occlusion));
        self.bodies.extend(bodies);
        self.pushes_m
            .resize(tracks.len(), [Vector3::zeros(); N_JOINTS]);
        for b in 1..tracks.len() {
            for a in 0..b {
                let pair = (&self.bodies[a], &self.bodies[b]);
                let before = (&predicted[a], &predicted[b]);
                for touch in BodyCapsules::touches(pair, before, contact.body_share) {
                    self.any_touch = true;
                    let seen = [(a, &touch.first), (b, &touch.second)].map(|(person, at)| {
                        at.weighed(|joint| tracks[person].as_ref().seen(joint, ik))
                    });
                    let moves_m = moves(&touch, seen, contact.separation_weight);
                    touch.first.push(moves_m[0], &mut self.pushes_m[a]);
                    touch.second.push(moves_m[1], &mut self.pushes_m[b]);
                }
            }
        }
    }

    /// Displacements of the joints of the track at `index`, world, metres; `None` if no persons
    /// touch.
    pub fn push_m(&self, index: usize) -> Option<&Joints> {
        self.pushes_m.get(index).filter(|_| self.any_touch)
    }
}

/// How far the two sides of a contact move, world, metres.
fn moves(touch: &Touch, [e_a, e_b]: [f64; 2], w: f64) -> [Vector3<f64>; 2] {
    let [a, b] = [e_a, e_b].map(|e| 1.0 / e.max(LEAST_SEEN));
    let all = 1.0 / w + a + b;
    [touch.apart_m * (a / all), touch.apart_m * (-b / all)]
}

#[cfg(test)]
mod tests {
    use super::super::meeting_fixture::MeetingFixture;
    use super::*;
    use crate::body::skeleton::Joint;

    /// Two people who stand so close that their arms overlap; the first is seen as well as `seen`,
    /// the second fully.
    fn two(seen: f64) -> MeetingFixture {
        let mut meeting = MeetingFixture::at(&[[0.0, -0.21, 0.0], [0.0, 0.21, 0.0]]);
        for estimate in &mut meeting.tracks[0].evidence.estimates {
            estimate.weight = seen;
        }
        meeting
    }

    fn separate(meeting: &mut MeetingFixture) -> Separation {
        meeting.begin();
        let bodies = meeting.place();
        let mut separation = Separation::default();
        separation.find(&meeting.tracks, &bodies, &meeting.method);
        separation
    }

    fn farthest_m(push_m: &Joints) -> f64 {
        push_m.iter().map(Vector3::norm).fold(0.0, f64::max)
    }

    #[test]
    fn a_predicted_limb_gives_way_to_a_seen_one() {
        let separation = separate(&mut two(0.0));
        let [pushed, seen] = [0, 1].map(|i| farthest_m(separation.push_m(i).unwrap()));
        assert!(pushed > 0.005 && seen < 0.02 * pushed, "{pushed} {seen}");
    }

    #[test]
    fn two_well_seen_limbs_hardly_move() {
        let unseen = farthest_m(separate(&mut two(0.0)).push_m(0).unwrap());
        let seen = farthest_m(separate(&mut two(0.9)).push_m(0).unwrap());
        assert!(seen < 0.1 * unseen, "{seen} of {unseen}");
    }

    #[test]
    fn pushes_lead_away_from_each_other() {
        let separation = separate(&mut two(0.0));
        let push_m = separation.push_m(0).unwrap();
        let elbow = push_m[Joint::LeftElbow.index()];
        assert!(elbow.y < 0.0, "{elbow:?}");
    }

    #[test]
    fn distant_people_and_a_zero_weight_give_no_push() {
        let mut apart = MeetingFixture::at(&[[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]);
        assert!(separate(&mut apart).push_m(0).is_none());
        let mut careless = two(0.0);
        careless.method.parameters.contact.separation_weight = 0.0;
        assert!(separate(&mut careless).push_m(0).is_none());
    }
}
