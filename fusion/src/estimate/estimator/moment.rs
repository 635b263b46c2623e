//! Measurements of a person at one tick, for the smoother.

use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::Estimator;
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::Joints;
use crate::body::skeleton::{N_JOINTS, Pose};
use crate::estimate::uncertainty::MadeOf;

/// One person at one tick.
#[derive(Debug)]
pub struct TickSnapshot {
    /// The tick.
    pub tick: Tick,
    /// The keypoints from the views.
    pub estimates: Vec<KeypointEstimate>,
    /// The joints after the first inverse kinematics, with the displacement out of others' limbs,
    /// world, metres.
    pub measured_m: Joints,
    /// Variance per axis of each from this tick alone, m²; infinite without evidence.
    pub variance_m2: [f64; N_JOINTS],
    /// Velocity of each, world, metres per second.
    pub velocity_m_s: Joints,
    /// The published pose.
    pub pose: Pose,
    /// Its joints, world, metres.
    pub joints_m: Joints,
    /// Their variance per axis, m²; `None` if unknown.
    pub published_m2: Option<[f64; N_JOINTS]>,
    /// Which evidence it had.
    pub made_of: MadeOf,
    /// Its state.
    pub state: PersonState,
    /// Bit i: angle i comes from a prior.
    pub unobserved: u64,
    /// Viewpoints that gave evidence.
    pub views: u16,
}

impl Default for TickSnapshot {
    fn default() -> Self {
        Self {
            tick: Tick::default(),
            estimates: Vec::new(),
            measured_m: [Vector3::zeros(); N_JOINTS],
            variance_m2: [f64::INFINITY; N_JOINTS],
            velocity_m_s: [Vector3::zeros(); N_JOINTS],
            pose: Pose::neutral(Vector3::zeros(), nalgebra::UnitQuaternion::identity()),
            joints_m: [Vector3::zeros(); N_JOINTS],
            published_m2: None,
            made_of: MadeOf::Motion,
            state: PersonState::Tentative,
            unobserved: 0,
            views: 0,
        }
    }
}

impl Clone for TickSnapshot {
    fn clone(&self) -> Self {
        let mut clone = Self::default();
        clone.clone_from(self);
        clone
    }

    fn clone_from(&mut self, other: &Self) {
        let mut estimates = std::mem::take(&mut self.estimates);
        estimates.clone_from(&other.estimates);
        *self = Self {
            estimates,
            ..*other
        };
    }
}

impl TickSnapshot {
    /// Discards evidence that belonged to another person: only the place that the person went
    /// `back` to is known.
    pub(crate) fn withdraw(&mut self, back: &Self) {
        self.estimates.clear();
        self.measured_m = back.joints_m;
        self.velocity_m_s = back.velocity_m_s;
        (self.pose, self.joints_m) = (back.pose, back.joints_m);
        self.published_m2 = back.published_m2;
        self.variance_m2 = [f64::INFINITY; N_JOINTS];
        self.made_of = MadeOf::Motion;
        self.state = PersonState::Coasting;
        self.views = 0;
    }
}

impl Estimator {
    /// Writes the result of the last tick, `tick`, for a person in `state` to `into`. Allocates
    /// only while `into` grows.
    pub fn write_snapshot(&self, tick: Tick, state: PersonState, into: &mut TickSnapshot) {
        let Self {
            evidence, estimate, ..
        } = self;
        into.tick = tick;
        into.estimates.clone_from(&evidence.estimates);
        into.measured_m = estimate.measured_m;
        for (measured_m, push_m) in into.measured_m.iter_mut().zip(&estimate.push_m) {
            *measured_m += push_m;
        }
        into.variance_m2 = estimate.uncertainty.of_tick_m2();
        into.velocity_m_s = *estimate.motion.velocity_m_s();
        into.pose = estimate.pose;
        into.joints_m = *self.joints_m();
        into.published_m2 = estimate.uncertainty.variance_m2();
        into.made_of = estimate.uncertainty.made_of();
        into.state = state;
        into.unobserved = estimate.unobserved;
        into.views = self.n_views();
    }
}
