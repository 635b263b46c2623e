//! Output of an estimator: its pose with uncertainty, and the boxes of its next crops.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{CameraBox, PersonPose, PersonState};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::Estimator;
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::{Joints, N_JOINTS, Pose, reported_angles};
use crate::boxes::BoxShape;
use crate::estimate::uncertainty;
use crate::estimate::uncertainty::MadeOf;
use crate::method::Method;

/// How far a box reaches around each predicted joint, in standard deviations of its joints.
const BOX_SIGMAS: f64 = 2.0;

/// A predicted body for the tick of a set of boxes.
#[derive(Debug, Clone)]
pub struct BodyAhead {
    /// The joints at that tick, and one tick later, world, metres.
    now_m: Joints,
    next_m: Joints,
    /// The shape of its boxes.
    shape: BoxShape,
}

impl Estimator {
    /// The predicted body `horizon_ticks` after the newest pose, paper (3).
    pub fn ahead(&self, horizon_ticks: f64, method: &Method) -> BodyAhead {
        let estimate = &self.estimate;
        let prediction = &method.parameters.prediction;
        let at = |ticks: f64| {
            let mut joints_m = estimate.ahead_m;
            let motion = &estimate.motion;
            motion.predict(ticks, method.dt_s, prediction, &mut joints_m);
            joints_m
        };
        // The lattice does not search farther.
        let farthest_m = method.parameters.lattice.half_width_m;
        let doubt_m = (BOX_SIGMAS * self.typical_sigma_m()).min(farthest_m);
        BodyAhead {
            now_m: at(horizon_ticks),
            next_m: at(horizon_ticks + 1.0),
            shape: (method.box_shape).after(horizon_ticks * method.dt_s, doubt_m),
        }
    }

    /// The median of the joints' standard deviations, metres per axis; infinite until the person was seen.
    fn typical_sigma_m(&self) -> f64 {
        let sigma_m = self.estimate.uncertainty.sigma_m();
        sigma_m.map_or(f64::INFINITY, |mut sigma_m| {
            *sigma_m
                .select_nth_unstable_by(N_JOINTS / 2, f64::total_cmp)
                .1
        })
    }

    /// The boxes of a person predicted as `ahead`, in those of `cameras` that will see it, paper
    /// (2) and (4).
    pub fn boxes<'a>(
        &mut self,
        cameras: impl Iterator<Item = (CameraIndex, &'a CameraModel)>,
        ahead: &BodyAhead,
    ) -> Vec<CameraBox> {
        let (joints_m, boxes) = ((&ahead.now_m, &ahead.next_m), &mut self.estimate.boxes);
        let seen = cameras
            .filter_map(|(index, model)| boxes.camera_box(index, model, joints_m, &ahead.shape));
        seen.map(|seen| seen.snapped()).collect()
    }

    /// The pose of `person` in `state`, as it is published.
    pub fn published(&self, person: PersonId, state: PersonState) -> PersonPose {
        let to_f32 = |p: &Vector3<f64>| [p.x as f32, p.y as f32, p.z as f32];
        let estimate = &self.estimate;
        PersonPose {
            person,
            state,
            joints_m: self.joints_m().iter().map(to_f32).collect(),
            keypoints_m: self.keypoints_m().iter().map(to_f32).collect(),
            sigma_m: (estimate.uncertainty.sigma_m().iter().flatten())
                .map(|sigma_m| *sigma_m as f32)
                .collect(),
            angles: reported_angles(&estimate.pose)
                .iter()
                .map(|a| *a as f32)
                .collect(),
            unobserved: estimate.unobserved,
            views: self.n_views(),
        }
    }

    /// Updates the uncertainty for the new pose, `dt_s` after the last one.
    pub(crate) fn update_uncertainty(&mut self, dt_s: f64, method: &Method) {
        let made_of = self.made_of(method);
        let seen = uncertainty::SeenPose {
            views: self.views(),
            sites: &self.body.sites,
            predicted_m: &self.evidence.predicted_m,
            body: &self.estimate.kinematics,
            relative_sigmas: &method.relative_sigmas,
        };
        let variance_factor = seen.variance_factor();
        let estimate = &mut self.estimate;
        estimate.uncertainty.step(&uncertainty::TickEvidence {
            variance_factor,
            estimates: &self.evidence.estimates,
            sites: &self.body.sites,
            body: &estimate.kinematics,
            velocity_m_s: estimate.filter.velocity_m_s(),
            made_of,
            dt_s,
            coast_decay_s: method.parameters.smoothing.coast_decay_s,
        });
    }
}

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
