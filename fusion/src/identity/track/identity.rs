//! Who a track is: what is known of its body, and what changes when it is recognised or found again.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::{Method, Track, joints_of};
use crate::body::fit::Fitted;
use crate::body::initial_pose::PoseFinder;
use crate::body::skeleton::{Pose, Skeleton};
use crate::estimate::predict::Motion;
use crate::estimate::uncertainty::Known;
use crate::identity::memory::{Departed, KnownBody, LastSeen};
use crate::sightings::finder::SightedPerson;

/// A person that is sighted this near to where it is carried is there already, metres: the lattice
/// finds it by itself.
const IN_PLACE_M: f64 = 0.1;
/// Longest absence after which the way back tells the speed, seconds: later people have turned.
const STRAIGHT_S: f64 = 1.5;

/// A person when nobody else was near for the last time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Apart {
    tick: Tick,
    pose: Pose,
    known: Known,
}

impl Track {
    /// By which the edges know the person. It is [`Self::id`] until the person is recognised as somebody
    /// who was here before: then the id is that one's, and the edges need not know.
    pub fn wire_id(&self) -> PersonId {
        self.wire_id
    }

    /// What is known of the body.
    pub(crate) fn known_body(&self) -> KnownBody {
        KnownBody {
            skeleton: self.skeleton.clone(),
            sites: self.sites.clone(),
            remeasure: self.remeasure.clone(),
        }
    }

    /// From now on this is somebody who was here before, with the body that is known; the poses so far
    /// are to be solved again.
    pub(crate) fn becomes(&mut self, known: &Departed, rate_hz: f64) {
        self.id = known.id;
        self.lived_ticks += known.lived_ticks(rate_hz);
        self.sites.clone_from(&known.body.sites);
        self.remeasure = known.body.remeasure.clone();
    }

    /// Notes that the person was seen well at `tick`, where it is.
    pub(crate) fn is_seen_at(&mut self, tick: Tick) {
        self.last_seen = Some(LastSeen {
            tick,
            place_m: self.pose.root_m,
        });
    }

    /// Notes that nobody else is near at `tick`.
    pub(crate) fn is_apart_at(&mut self, tick: Tick) {
        self.apart = Some(Apart {
            tick,
            pose: self.pose,
            known: self.uncertainty.known(),
        });
    }

    /// Whether there was a tick at which nobody else was near.
    pub(crate) fn was_apart(&self) -> bool {
        self.apart.is_some()
    }

    /// Gives back what was seen of somebody else: goes back to where it was when nobody else was near,
    /// and waits there, as unsure as if it had not been seen since.
    pub(crate) fn steps_back(&mut self, tick: Tick, method: &Method) {
        let Some(apart) = self.apart else {
            return;
        };
        let ticks = u32::try_from(tick - apart.tick).unwrap_or(0).max(1);
        self.life.was_mistaken_for(ticks);
        self.mistaken_since = Some(apart.tick);
        self.estimates.clear();
        let skeleton = self.skeleton.clone();
        self.restart(skeleton, &apart.pose);
        self.uncertainty.go_back_to(&apart.known);
        self.doubt(f64::from(ticks) * method.dt_s, method);
    }

    /// Takes a lost person back to where it was sighted at `tick`, with the body that is known; returns
    /// whether that body can be so.
    pub(crate) fn revive(&mut self, person: &SightedPerson, tick: Tick, method: &Method) -> bool {
        let observed = person.observed(&self.sites);
        let bounds = method.range_of_motion.as_ref();
        let mut finder = PoseFinder::new(&method.parameters.ik, bounds);
        let Some(pose) = finder.find(&self.skeleton, &observed) else {
            return false;
        };
        self.life.revive();
        self.estimates = person.estimates();
        if (pose.root_m - self.pose.root_m).norm() < IN_PLACE_M {
            return true;
        }
        let since = self.last_seen.map(|seen| {
            let absence_s = (tick - seen.tick) as f64 * method.dt_s;
            (pose.root_m - seen.place_m, absence_s)
        });
        let velocity_m_s = since
            .filter(|&(_, absence_s)| absence_s > 0.0 && absence_s <= STRAIGHT_S)
            .map_or_else(Vector3::zeros, |(way_m, absence_s)| way_m / absence_s);
        let skeleton = self.skeleton.clone();
        self.restart(skeleton, &pose);
        self.set_velocity(velocity_m_s);
        self.doubt(method.dt_s, method);
        true
    }

    /// Starts over at `tick` with another sighting, moving as fast as it must have since the first one.
    pub(crate) fn is_born_anew(&mut self, body: Fitted, tick: Tick, dt_s: f64) {
        let born = self.tentative.first().map_or(tick, |first| first.tick);
        let (first, place_m) = *self.sighted_first.get_or_insert((born, self.born_m));
        let since_s = (tick - first) as f64 * dt_s;
        self.born_m = body.pose.root_m;
        if since_s > 0.0 {
            self.born_m_s = (self.born_m - place_m) / since_s;
        }
        self.restart(body.skeleton, &body.pose);
        self.set_velocity(self.born_m_s);
    }

    /// Starts over with another body and pose, at the same place in life.
    pub(crate) fn restart(&mut self, skeleton: Skeleton, pose: &Pose) {
        self.skeleton = skeleton;
        self.pose = *pose;
        self.skeleton.forward(&self.pose, &mut self.kinematics);
        let joints_m = joints_of(&self.kinematics);
        self.motion = Motion::at_rest(joints_m);
        self.smoother.reset(&joints_m);
        self.measured_m = joints_m;
    }

    /// Moves the whole body at `velocity_m_s` (world) from here.
    pub(crate) fn set_velocity(&mut self, velocity_m_s: Vector3<f64>) {
        self.smoother.set_velocity(velocity_m_s);
        let joints_m = *self.smoother.position_m();
        self.motion.push(&joints_m, self.smoother.velocity_m_s());
    }
}
