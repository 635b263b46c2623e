//! What the views of one tick tell of the joints, through the skeleton.

use nalgebra::Matrix3;

use super::{MadeOf, lasting};
use crate::body::ik::{JointSpread, PointInformation};
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::{Joint, Kinematics, N_JOINTS, Site};

/// What is known of a keypoint per viewpoint and axis of its image where nobody kept more than how many
/// saw it, metres: of a sighting at an initiation.
pub(super) const SIGHTED_M: f64 = 0.03;
/// Share of the variance of heel and toe about the ankle that is left: feet do not use all of the
/// range of motion of an ankle.
const FOOT_SHARE: f64 = 0.55;
/// By what one viewpoint's poses are less sure than their keypoints, as variance: the size of a body, from
/// which its distance follows, is no better known than to some percent.
pub(super) const ONE_VIEW_M2: f64 = 4.0;

/// Ankle, heel and toe of a side.
pub(super) const FEET: [[Joint; 3]; 2] = [
    [Joint::LeftAnkle, Joint::LeftHeel, Joint::LeftToe],
    [Joint::RightAnkle, Joint::RightHeel, Joint::RightToe],
];

/// What was seen of a body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyObservation<'a> {
    /// The keypoints.
    pub(crate) estimates: &'a [KeypointEstimate],
    /// Where they sit.
    pub(crate) sites: &'a [Option<Site>],
    /// The body, in its pose.
    pub(crate) body: &'a Kinematics,
}

impl BodyObservation<'_> {
    /// Variance per axis of each joint, m², from these keypoints alone; what is the same in all ticks is left
    /// out.
    pub(crate) fn variances_m2(
        &self,
        spread: &mut JointSpread,
        made_of: MadeOf,
    ) -> [f64; N_JOINTS] {
        let points = self.estimates.iter().zip(self.sites);
        let points = points.filter_map(|(estimate, site)| {
            Some(PointInformation {
                site: (*site)?,
                information: information_of(estimate),
            })
        });
        let mut variances_m2 = spread.variances_m2(self.body, points);
        for [ankle, heel, toe] in FEET {
            for end in [heel, toe] {
                let about_ankle_m2 = variances_m2[end.index()] - variances_m2[ankle.index()];
                variances_m2[end.index()] -= (1.0 - FOOT_SHARE) * about_ankle_m2.max(0.0);
            }
        }
        if made_of == MadeOf::OneView {
            for variance_m2 in &mut variances_m2 {
                *variance_m2 *= ONE_VIEW_M2;
            }
        }
        variances_m2
    }

    /// What no tick can show of `joint`, variance per axis, m².
    pub(crate) fn lasting_m2(joint: Joint) -> f64 {
        lasting::sigma_m(joint).powi(2)
    }
}

/// What the views told of a keypoint; of a sighted one, that so many views saw it.
fn information_of(estimate: &KeypointEstimate) -> Matrix3<f64> {
    let is_sighted = estimate.weight > 0.0 && estimate.views >= 2;
    if is_sighted && estimate.information == Matrix3::zeros() {
        // Each view tells two of three directions.
        let per_view = 2.0 / 3.0 / (SIGHTED_M * SIGHTED_M);
        return Matrix3::identity() * (per_view * f64::from(estimate.views));
    }
    estimate.information
}
