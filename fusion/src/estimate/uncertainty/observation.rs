//! Variance of the joints from the views of one tick, through the skeleton.

use nalgebra::Matrix3;

use super::{MadeOf, lasting};
use crate::body::ik::{JointSpread, PointInformation};
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::{Joint, Kinematics, N_JOINTS, Site};

/// Error of a keypoint per viewpoint and axis of its image if only the number of views is known,
/// metres: for a sighting at an initiation.
pub(super) const SIGHTED_M: f64 = 0.03;
/// Remaining share of the variance of heel and toe about the ankle: feet do not use the whole range
/// of motion of an ankle.
const FOOT_SHARE: f64 = 0.55;
/// Factor on the variance of a pose from one viewpoint relative to its keypoints: its distance
/// follows from the size of the body, which is known only to some percent.
pub(super) const ONE_VIEW_M2: f64 = 4.0;

/// Ankle, heel and toe of a side.
pub(super) const FEET: [[Joint; 3]; 2] = [
    [Joint::LeftAnkle, Joint::LeftHeel, Joint::LeftToe],
    [Joint::RightAnkle, Joint::RightHeel, Joint::RightToe],
];

/// The observation of a body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyObservation<'a> {
    /// The keypoints.
    pub(crate) estimates: &'a [KeypointEstimate],
    /// Their sites.
    pub(crate) sites: &'a [Option<Site>],
    /// The body, in its pose.
    pub(crate) body: &'a Kinematics,
}

impl BodyObservation<'_> {
    /// Variance per axis of each joint, m², from these keypoints alone, without lasting errors.
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

    /// Lasting error of `joint`, variance per axis, m².
    pub(crate) fn lasting_m2(joint: Joint) -> f64 {
        lasting::sigma_m(joint).powi(2)
    }
}

/// The information about a keypoint; for a sighted one, from its number of views.
fn information_of(estimate: &KeypointEstimate) -> Matrix3<f64> {
    let is_sighted = estimate.weight > 0.0 && estimate.views >= 2;
    if is_sighted && estimate.information == Matrix3::zeros() {
        // Each view determines two of three directions.
        let per_view = 2.0 / 3.0 / (SIGHTED_M * SIGHTED_M);
        return Matrix3::identity() * (per_view * f64::from(estimate.views));
    }
    estimate.information
}
