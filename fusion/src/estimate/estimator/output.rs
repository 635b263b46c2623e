//! Output of an estimator: its pose with uncertainty, and the boxes of its next crops.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{CameraBox, PersonPose, PersonState};
use nalgebra::Vector3;

use super::Estimator;
use crate::body::skeleton::{Joints, reported_angles};
use crate::boxes::BoxShape;
use crate::estimate::uncertainty;
use crate::method::Method;

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
        BodyAhead {
            now_m: at(horizon_ticks),
            next_m: at(horizon_ticks + 1.0),
            shape: method.box_shape.after(horizon_ticks * method.dt_s),
        }
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
