//! Confirmation of a tentative person: its lengths are estimated from all its ticks.
//! The ticks are then solved again, so that the lengths are the same from the first published pose
//! to the last.

use farfield_proto::message::{PersonPose, PersonState};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::memory::Departed;
use super::tentative::TentativeTick;
use super::track::Track;
use crate::body::fit::fit;
use crate::body::initial_pose::PoseFinder;
use crate::body::observed::ObservedJoints;
use crate::estimate::estimator::TickSnapshot;
use crate::method::Method;

impl Track {
    /// Takes the id and the body of `known`, who was here before. The poses so far must be solved
    /// again.
    pub(crate) fn take_identity_of(&mut self, known: Departed, rate_hz: f64) {
        self.identity.id = known.id;
        self.identity.lived_ticks += known.lived_ticks(rate_hz);
        let body = &mut self.estimator.body;
        body.sites = known.body.sites;
        body.remeasure = known.body.remeasure;
        body.known = known.body.known;
        self.identity.tentative.known = Some(known.body.skeleton);
    }

    /// Estimates the body and returns the poses of the tentative ticks, in order. The phase is
    /// already that of a confirmed person. A recognised person keeps the known body.
    pub(crate) fn solve_again(&mut self, method: &Method) -> Vec<(Tick, PersonPose)> {
        let record = std::mem::take(&mut self.identity.tentative);
        let ticks = record.ticks;
        // The fit returns the pose of its last tick: in reverse order, that is the first sighting.
        let backwards: Vec<ObservedJoints> = ticks
            .iter()
            .rev()
            .map(|t| ObservedJoints::from_estimates(&t.estimates, &method.sites))
            .collect();
        let ik = &method.parameters.ik;
        let bounds = method.range_of_motion.as_ref();
        // If the fit fails, the first body stays: it fitted the first sighting.
        let (skeleton, pose) = fit(&backwards, ik, bounds).map_or_else(
            |_| {
                let estimator = &self.estimator;
                (estimator.body.skeleton.clone(), *estimator.pose())
            },
            |body| (body.skeleton, body.pose),
        );
        let as_known = record.known.and_then(|skeleton| {
            let mut finder = PoseFinder::new(ik, bounds);
            let pose = finder.find(&skeleton, backwards.last()?)?;
            Some((skeleton, pose))
        });
        let (skeleton, pose) = as_known.unwrap_or((skeleton, pose));
        let estimator = &mut self.estimator;
        estimator.restart(skeleton, &pose);
        if record.velocity_m_s != Vector3::zeros() {
            estimator.set_velocity(record.velocity_m_s);
        }
        estimator.forget_uncertainty();
        // The people who are near now are no evidence about earlier ticks.
        estimator.push(None);
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
        let estimates = &mut self.estimator.evidence.estimates;
        estimates.clone_from(&tick.estimates);
        // At the first sighting the pose is the fit itself: there is nothing to smooth with.
        self.estimator.begin(method);
        self.fit_keypoints(method);
        if index > 0 {
            self.estimator.smooth(method);
        }
        self.estimator.fit_joints(method);
        let mut moment = TickSnapshot::default();
        self.estimator
            .write_snapshot(tick.tick, PersonState::Tentative, &mut moment);
        self.identity.changed.solved.push(moment);
        let id = self.identity.id;
        let pose = self.estimator.published(id, PersonState::Tentative);
        (tick.tick, pose)
    }
}
