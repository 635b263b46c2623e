//! What a person's track tells others: its pose, how sure it is, and where cameras shall look.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::{PersonBoxes, PersonPose};
use nalgebra::Vector3;

use super::track::Track;
use crate::body::skeleton::reported_angles;
use crate::estimate::uncertainty::Moment;
use crate::method::Method;

impl Track {
    /// Where the person will be in `cameras`, `horizon_ticks` after the newest pose, paper (2) and (4);
    /// `None` when none of them will see it.
    pub fn boxes(
        &mut self,
        cameras: &[(CameraIndex, &CameraModel)],
        horizon_ticks: f64,
        method: &Method,
    ) -> Option<PersonBoxes> {
        let (mut now_m, mut next_m) = (self.ahead_m, self.ahead_m);
        let prediction = &method.parameters.prediction;
        self.motion
            .predict(horizon_ticks, method.dt_s, prediction, &mut now_m);
        self.motion
            .predict(horizon_ticks + 1.0, method.dt_s, prediction, &mut next_m);
        let shape = method.box_shape.after(horizon_ticks * method.dt_s);
        let seen = cameras.iter().filter_map(|(index, model)| {
            self.boxes
                .camera_box(*index, model, (&now_m, &next_m), &shape)
        });
        let cameras: Vec<_> = seen.map(|seen| seen.snapped()).collect();
        (!cameras.is_empty()).then_some(PersonBoxes {
            person: self.wire_id,
            cameras,
        })
    }

    /// The pose as it is published.
    pub fn published(&self) -> PersonPose {
        let to_f32 = |p: &Vector3<f64>| [p.x as f32, p.y as f32, p.z as f32];
        PersonPose {
            person: self.id,
            state: self.life.published(),
            joints_m: self.joints_m().iter().map(to_f32).collect(),
            keypoints_m: self.keypoints_m().iter().map(to_f32).collect(),
            sigma_m: (self.uncertainty.sigma_m().iter().flatten())
                .map(|sigma_m| *sigma_m as f32)
                .collect(),
            angles: reported_angles(&self.pose)
                .iter()
                .map(|a| *a as f32)
                .collect(),
            unobserved: self.unobserved,
            views: self.n_views(),
        }
    }

    /// Says how sure the new pose is, `dt_s` after the last one.
    pub(crate) fn doubt(&mut self, dt_s: f64, method: &Method) {
        let made_of = self.made_of(method);
        self.uncertainty.step(&Moment {
            estimates: &self.estimates,
            sites: &self.sites,
            body: &self.kinematics,
            velocity_m_s: self.smoother.velocity_m_s(),
            made_of,
            dt_s,
            coast_decay_s: method.parameters.smoothing.coast_decay_s,
        });
    }
}
