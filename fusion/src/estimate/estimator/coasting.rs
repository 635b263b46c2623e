//! Prediction of a person, or a limb, while too few views show it.
//!
//! Without evidence the filter's velocity carries the body and decays. One viewpoint alone gives
//! the place of a body across its rays and, by its known lengths, roughly its distance: that steers
//! it. An unseen limb keeps the body's motion, and its own velocity relative to the body decays.

use super::Estimator;
use crate::body::skeleton::Joint;
use crate::estimate::uncertainty::MadeOf;
use crate::method::Method;

impl Estimator {
    /// The evidence of this tick.
    pub fn made_of(&self, method: &Method) -> MadeOf {
        MadeOf::from_estimates(&self.evidence.estimates, method.enough_keypoints())
    }

    /// Largest possible distance, per axis, of an unseen person from its carried place, metres.
    pub fn adrift_m(&self) -> f64 {
        self.estimate.uncertainty.adrift_m()
    }

    /// Standard deviation of that distance, per axis, metres.
    pub fn carried_off_m(&self) -> f64 {
        self.estimate.uncertainty.carried_off_m()
    }

    /// Low-pass filter on the innovation, paper (13). Without evidence a person, or a limb, coasts.
    pub fn smooth(&mut self, method: &Method) {
        let parameters = &method.parameters.smoothing;
        if self.made_of(method) == MadeOf::Motion {
            self.estimate.filter.coast(method.dt_s, parameters);
            return;
        }
        self.estimate
            .filter
            .step(&self.estimate.measured_m, method.dt_s, parameters);
        let unseen = self.unseen_ends();
        if unseen != 0 {
            let carried = |joint: Joint| unseen >> joint.index() & 1 == 1;
            self.estimate
                .filter
                .decay_towards(Joint::Pelvis, carried, method.dt_s, parameters);
        }
    }

    /// The elbows, wrists, knees and ankles, with the joints beyond them, whose keypoint no view
    /// supports and that carry no supported one: one bit per joint.
    fn unseen_ends(&self) -> u64 {
        let supported = |joint: Joint| {
            let mut own = self.body.sites.iter().zip(&self.evidence.estimates);
            own.any(|(site, e)| site.is_some_and(|site| site.joint == joint) && e.weight > 0.0)
        };
        let mut unseen = 0;
        for (middle, end, rest) in LIMBS {
            let end_unseen = !supported(end);
            if end_unseen {
                for joint in rest.iter().chain([&end]) {
                    unseen |= 1 << joint.index();
                }
            }
            if end_unseen && !supported(middle) {
                unseen |= 1 << middle.index();
            }
        }
        unseen
    }
}

/// Middle and end of each limb, and the joints fixed to the end.
const LIMBS: [(Joint, Joint, &[Joint]); 4] = [
    (Joint::LeftElbow, Joint::LeftWrist, &[Joint::LeftHand]),
    (Joint::RightElbow, Joint::RightWrist, &[Joint::RightHand]),
    (
        Joint::LeftKnee,
        Joint::LeftAnkle,
        &[Joint::LeftHeel, Joint::LeftToe],
    ),
    (
        Joint::RightKnee,
        Joint::RightAnkle,
        &[Joint::RightHeel, Joint::RightToe],
    ),
];
