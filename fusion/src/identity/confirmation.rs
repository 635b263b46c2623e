//! A tentative person is confirmed: its lengths are estimated from all its ticks, and the ticks are
//! solved again with them, so that the lengths are the same from the first published pose to the last.

use farfield_proto::message::{PersonPose, PersonState};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::track::Track;
use crate::body::fit::fit;
use crate::body::initial_pose::PoseFinder;
use crate::body::observed::ObservedJoints;
use crate::body::skeleton::Skeleton;
use crate::identity::tentative::TentativeTick;
use crate::method::Method;

impl Track {
    /// Settles the body and returns the poses of the tentative ticks, in order. Who was here before has
    /// the body that is `known`.
    pub(crate) fn settle(
        &mut self,
        known: Option<&Skeleton>,
        method: &Method,
    ) -> Vec<(Tick, PersonPose)> {
        let ticks = std::mem::take(&mut self.tentative);
        // The fit poses the last of its ticks: backwards, that is the first sighting.
        let backwards: Vec<ObservedJoints> = ticks
            .iter()
            .rev()
            .map(|t| ObservedJoints::from_estimates(&t.estimates, &method.sites))
            .collect();
        let body = fit(
            &backwards,
            &method.parameters.ik,
            method.range_of_motion.as_ref(),
        );
        // Without a fit its first body stays: that fitted the first sighting.
        let (skeleton, pose) = body.map_or_else(
            |_| (self.skeleton.clone(), self.pose),
            |body| (body.skeleton, body.pose),
        );
        let bounds = method.range_of_motion.as_ref();
        let as_known = known.and_then(|known| {
            let mut finder = PoseFinder::new(&method.parameters.ik, bounds);
            Some((known.clone(), finder.find(known, backwards.last()?)?))
        });
        let (skeleton, pose) = as_known.unwrap_or((skeleton, pose));
        self.restart(skeleton, &pose);
        if self.born_m_s != Vector3::zeros() {
            self.set_velocity(self.born_m_s);
        }
        self.uncertainty.reset();
        // Who is near now says nothing about the ticks before.
        self.push(None);
        ticks
            .iter()
            .enumerate()
            .map(|(index, tick)| self.replay(index, tick, method))
            .collect()
    }

    fn replay(
        &mut self,
        index: usize,
        tick: &TentativeTick,
        method: &Method,
    ) -> (Tick, PersonPose) {
        self.estimates.clone_from(&tick.estimates);
        // At the first sighting the pose is the fit itself: there is nothing to smooth with.
        self.begin(method);
        self.fit_keypoints(method);
        if index > 0 {
            self.smooth(method);
        }
        self.fit_joints(method);
        self.tell_anew(tick.tick);
        (
            tick.tick,
            PersonPose {
                state: PersonState::Tentative,
                ..self.published()
            },
        )
    }
}
