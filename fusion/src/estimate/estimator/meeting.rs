//! Interactions of a person with others nearby.

use farfield_proto::venue::parameters::IkParameters;
use nalgebra::Vector3;

use super::Estimator;
use crate::body::skeleton::{Joint, Joints, N_JOINTS};
use crate::estimate::evidence::View;
use crate::method::Method;

/// Joints without keypoints in most networks, and the joints that determine them.
const DETERMINED_BY: [(Joint, [Joint; 2]); 10] = [
    (Joint::Pelvis, [Joint::LeftHip, Joint::RightHip]),
    (Joint::Spine, [Joint::LeftHip, Joint::RightHip]),
    (Joint::Neck, [Joint::LeftShoulder, Joint::RightShoulder]),
    (Joint::Head, [Joint::LeftEar, Joint::RightEar]),
    (Joint::LeftHand, [Joint::LeftWrist, Joint::LeftElbow]),
    (Joint::RightHand, [Joint::RightWrist, Joint::RightElbow]),
    (Joint::LeftHeel, [Joint::LeftAnkle, Joint::LeftKnee]),
    (Joint::RightHeel, [Joint::RightAnkle, Joint::RightKnee]),
    (Joint::LeftToe, [Joint::LeftAnkle, Joint::LeftKnee]),
    (Joint::RightToe, [Joint::RightAnkle, Joint::RightKnee]),
];

impl Estimator {
    /// The views of this tick.
    pub(crate) fn views(&self) -> &[View] {
        &self.evidence.views[..self.evidence.n_views]
    }

    /// The views of this tick.
    pub(crate) fn views_mut(&mut self) -> &mut [View] {
        &mut self.evidence.views[..self.evidence.n_views]
    }

    /// Undoes left-right swaps of single views; the views must be placed.
    pub fn undo_left_right_swaps(&mut self, method: &Method) {
        let margin = method.parameters.contact.exchange_margin;
        if margin <= 1.0 {
            self.evidence
                .swaps
                .undo(&mut self.evidence.views[..self.evidence.n_views], margin);
        }
    }

    /// Finds the peaks of all maps around the expected keypoints; the views must be placed.
    pub(crate) fn find_peaks(&mut self, method: &Method) {
        for view in self.views_mut() {
            view.find_peaks(method.parameters.lattice.half_width_m);
        }
    }

    /// How well the views of this tick determine a joint, 0 to 1: the share of a full keypoint's
    /// weight in the first inverse kinematics, for it or the joints that determine it.
    pub(crate) fn seen(&self, joint: Joint, ik: &IkParameters) -> f64 {
        let determined_by = DETERMINED_BY.iter().find(|(silent, _)| *silent == joint);
        let by = determined_by.map_or([joint; 2], |(_, by)| *by);
        by.map(|joint| self.keypoint_seen(joint, ik))
            .iter()
            .sum::<f64>()
            / 2.0
    }

    fn keypoint_seen(&self, joint: Joint, ik: &IkParameters) -> f64 {
        let at = self
            .body
            .sites
            .iter()
            .position(|site| site.is_some_and(|site| site.joint == joint));
        let estimate = at.and_then(|k| self.evidence.estimates.get(k));
        let seen = estimate.filter(|estimate| estimate.views >= 2 && estimate.weight > 0.0);
        seen.map_or(ik.prediction_weight, |estimate| {
            estimate.weight.max(ik.min_weight)
        })
    }

    /// Moves the targets of the second inverse kinematics of this tick, world, metres.
    pub fn push(&mut self, push_m: Option<&Joints>) {
        self.estimate.push_m = push_m.copied().unwrap_or([Vector3::zeros(); N_JOINTS]);
    }
}
