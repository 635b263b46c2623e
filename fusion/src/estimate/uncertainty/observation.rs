//! Variance of the joints from the views of one tick, through the skeleton.
//!
//! # Information of the views about a keypoint
//!
//! ```text
//!   I = Σⱼ (1 - dⱼ dⱼᵀ) / ((b rₖ/hⱼ)² + (e aⱼ)²)
//! ```
//!
//! A view j locates a keypoint across its ray dⱼ. Its error there has two parts. One is the
//! network's, b rₖ (rₖ as in [`crate::body::ik::relative_sigmas`]), larger if its map is low at the
//! common place (hⱼ: the keypoint is hidden, or this view's peak is elsewhere). The other is e
//! native pixels, each aⱼ wide there. Errors of different views count as independent, those of one
//! view from tick to tick as equal: a network repeats its error for seconds, so nothing averages
//! out.
//!
//! # Lasting errors, the same in all ticks
//!
//! A network's hip or knee is some 30 mm from the joint's centre (a track learns about half of it,
//! see the sites of a person). And body proportions differ from the model's where there is no
//! keypoint: neck and collar bones, the lower end of the spine, hands and feet. Fitted on the
//! project's own clips, with original bodies and with the links of each changed by 6 % and 13 mm
//! (standard deviations, left as right).

use nalgebra::{Matrix3, Vector2, Vector3};

use super::MadeOf;
use crate::body::ik::{JointSpread, PointInformation};
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::{Joint, Kinematics, N_JOINTS, Site};
use crate::estimate::evidence::View;

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
        sigma_m(joint).powi(2)
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

/// Standard deviation per axis, metres.
pub(super) const fn sigma_m(joint: Joint) -> f64 {
    use Joint::{
        Head, LeftAnkle, LeftEar, LeftElbow, LeftEye, LeftHand, LeftHeel, LeftHip, LeftKnee,
        LeftScapula, LeftShoulder, LeftToe, LeftWrist, Neck, Nose, Pelvis, RightAnkle, RightEar,
        RightElbow, RightEye, RightHand, RightHeel, RightHip, RightKnee, RightScapula,
        RightShoulder, RightToe, RightWrist, Spine,
    };
    match joint {
        Pelvis => 0.0115,
        Spine => 0.012,
        Neck => 0.020,
        LeftScapula | RightScapula => 0.022,
        LeftHip | RightHip => 0.0155,
        LeftKnee | RightKnee => 0.0165,
        LeftHand | RightHand => 0.018,
        LeftHeel | RightHeel => 0.010,
        LeftToe | RightToe => 0.036,
        LeftShoulder | RightShoulder | LeftAnkle | RightAnkle => 0.004,
        Nose => 0.0035,
        LeftEye | RightEye => 0.002,
        Head | LeftEar | RightEar | LeftElbow | RightElbow | LeftWrist | RightWrist => 0.0,
    }
}

/// b: error of a network's limb keypoint in one view per axis of the image, metres at the person,
/// if seen well. Networks err by some 0.4 of COCO's annotators in two dimensions (0.084 of a scale
/// of 0.71 m for the mean limb keypoint: 0.017 m per axis); the last millimetre is fitted.
const NETWORK_M: f64 = 0.018;
/// e: error of any view, native pixels.
const PIXEL_ERROR: f64 = 0.5;
/// Least h that counts: a lower map does not show the keypoint there.
const LEAST_HEIGHT: f64 = 0.1;
/// Least depth in front of a camera, metres.
const LEAST_DEPTH_M: f64 = 0.05;

/// Variance of a view per axis of its picture if its map is `height` and a native pixel `pixel_m`
/// wide, m².
pub(super) fn variance_m2(relative_sigma: f64, height: f64, pixel_m: f64) -> f64 {
    (NETWORK_M * relative_sigma / height).powi(2) + (PIXEL_ERROR * pixel_m).powi(2)
}

/// The information of one view about keypoint `k` at `offset_m` from the prediction.
pub(super) fn information_of_view(
    view: &View,
    k: usize,
    offset_m: Vector3<f64>,
    relative: f64,
) -> Matrix3<f64> {
    let none = Matrix3::zeros();
    let Some(expected) = view.expected(k) else {
        return none;
    };
    let place_m = expected.position_m + offset_m;
    let cell_from_world = view.cell_from_world(k);
    let h = cell_from_world * place_m.push(1.0);
    let cell = Vector2::new(h.x, h.y) / h.z;
    if h.z < LEAST_DEPTH_M || !view.knows(k, cell) {
        return none;
    }
    let height = view.map(k).bilinear(cell);
    if height < LEAST_HEIGHT {
        return none;
    }
    // Mean of the two axes' cells per metre, as in the lattice.
    let cells_per_m = (cell_from_world.fixed_view::<2, 3>(0, 0)
        - cell * cell_from_world.fixed_view::<1, 3>(2, 0))
    .norm()
        / (2.0f64.sqrt() * h.z);
    let pixel_m = 1.0 / (cells_per_m * view.grid(k).pixels_per_cell());
    let variance_m2 = variance_m2(relative, height, pixel_m);
    let ray = (place_m - view.center_m()).normalize();
    (Matrix3::identity() - ray * ray.transpose()) / variance_m2
}
