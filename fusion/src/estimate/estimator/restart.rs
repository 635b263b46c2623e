//! Restarts of an estimator: at another pose, with another body, or at an earlier place.

use nalgebra::Vector3;

use super::{Estimator, joints_of};
use crate::body::skeleton::{Kinematics, Pose, Skeleton};
use crate::estimate::predict::Motion;
use crate::estimate::uncertainty::UncertaintySnapshot;
use crate::method::Method;

/// A pose with its uncertainty, to go back to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RestartPoint {
    pose: Pose,
    known: UncertaintySnapshot,
}

impl Estimator {
    /// Starts over with another body and pose.
    pub(crate) fn restart(&mut self, skeleton: Skeleton, pose: &Pose) {
        self.body.skeleton = skeleton;
        self.restart_at(pose);
    }

    /// Starts over in another pose, with the same body.
    pub(crate) fn restart_at(&mut self, pose: &Pose) {
        let estimate = &mut self.estimate;
        estimate.pose = *pose;
        self.body
            .skeleton
            .forward(&estimate.pose, &mut estimate.kinematics);
        let joints_m = joints_of(&estimate.kinematics);
        estimate.motion = Motion::at_rest(joints_m);
        estimate.filter.reset(&joints_m);
        estimate.measured_m = joints_m;
    }

    /// Whether a search within `half_width_m` of the current keypoints reaches those of another
    /// `pose`.
    pub(crate) fn reaches(&self, pose: &Pose, half_width_m: f64) -> bool {
        let mut there = Kinematics::default();
        self.body.skeleton.forward(pose, &mut there);
        let sites = self.body.sites.iter().flatten();
        let mut off_m =
            sites.map(|site| there.site_m(site) - self.estimate.kinematics.site_m(site));
        off_m.all(|off_m| off_m.amax() < half_width_m)
    }

    /// Sets the velocity of the whole body, `velocity_m_s` (world).
    pub(crate) fn set_velocity(&mut self, velocity_m_s: Vector3<f64>) {
        let estimate = &mut self.estimate;
        estimate.filter.set_velocity(velocity_m_s);
        let joints_m = *estimate.filter.position_m();
        estimate
            .motion
            .push(&joints_m, estimate.filter.velocity_m_s());
    }

    /// Resets the uncertainty of the pose.
    pub(crate) fn forget_uncertainty(&mut self) {
        self.estimate.uncertainty.reset();
    }

    /// The current pose and its uncertainty.
    pub(crate) fn restart_point(&self) -> RestartPoint {
        RestartPoint {
            pose: self.estimate.pose,
            known: self.estimate.uncertainty.known(),
        }
    }

    /// Goes back to where it was `ago_s` seconds ago, as uncertain as if it had not been seen
    /// since.
    pub(crate) fn go_back_to(&mut self, before: &RestartPoint, ago_s: f64, method: &Method) {
        self.evidence.estimates.clear();
        self.restart_at(&before.pose);
        self.estimate.uncertainty.go_back_to(&before.known);
        self.update_uncertainty(ago_s, method);
    }
}
