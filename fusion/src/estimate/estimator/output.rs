//! What an estimator tells others: its pose, how sure it is, and the boxes of its next crops.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{CameraBox, PersonPose, PersonState};
use nalgebra::Vector3;

use super::Estimator;
use crate::body::skeleton::reported_angles;
use crate::estimate::uncertainty;
use crate::method::Method;

impl Estimator {
    /// Where the person will be in `cameras`, `horizon_ticks` after the newest pose, paper (2) and (4): in
    /// those that will see it.
    pub fn boxes(
        &mut self,
        cameras: &[(CameraIndex, &CameraModel)],
        horizon_ticks: f64,
        method: &Method,
    ) -> Vec<CameraBox> {
        let estimate = &mut self.estimate;
        let (mut now_m, mut next_m) = (estimate.ahead_m, estimate.ahead_m);
        let prediction = &method.parameters.prediction;
        let motion = &estimate.motion;
        motion.predict(horizon_ticks, method.dt_s, prediction, &mut now_m);
        motion.predict(horizon_ticks + 1.0, method.dt_s, prediction, &mut next_m);
        let shape = method.box_shape.after(horizon_ticks * method.dt_s);
        let boxes = &mut estimate.boxes;
        let seen = cameras.iter().filter_map(|(index, model)| {
            boxes.camera_box(*index, model, (&now_m, &next_m), &shape)
        });
        seen.map(|seen| seen.snapped()).collect()
    }

    /// The pose as it is published, of `person` in `state`.
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

    /// Says how sure the new pose is, `dt_s` after the last one.
    pub(crate) fn update_uncertainty(&mut self, dt_s: f64, method: &Method) {
        let made_of = self.made_of(method);
        let estimate = &mut self.estimate;
        estimate.uncertainty.step(&uncertainty::TickEvidence {
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
