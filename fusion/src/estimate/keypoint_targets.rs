//! What the first inverse kinematics aims at: the keypoints of a tick.
//!
//! ```text
//!   A = c I + (p/σ²) 1          seen: I of `uncertainty::views`, what all views together know of the place
//!   A = (p/σ²) 1                not seen: held where it was predicted
//! ```
//!
//! The paper weighs a keypoint by a number, (12). Views know different things along different axes: two that face each
//! other know nothing along the line between them, and one alone nothing along its ray. There p holds the place
//! that the search kept, the prediction's.

use nalgebra::Matrix3;

use crate::body::ik::Target;
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::Site;
use crate::method::Method;

/// c: what a tick's information counts against the last pose. A network's error lasts, so ten ticks know little more
/// than one; found on the project's own scenes (0.02 to 1.4 were tried: below 0.05 the pose lags, above it jitters).
const SHARE_OF_INFORMATION: f64 = 0.1;

/// Fills `targets` with the keypoints that `estimates` found, at their `sites`.
pub(crate) fn aim_at_keypoints(
    estimates: &[KeypointEstimate],
    sites: &[Option<Site>],
    method: &Method,
    targets: &mut Vec<Target>,
) {
    let ik = &method.parameters.ik;
    let full = 1.0 / (ik.keypoint_sigma_m * ik.keypoint_sigma_m);
    targets.clear();
    let keypoints = estimates.iter().zip(sites);
    for ((estimate, site), sigma) in keypoints.zip(&method.relative_sigmas) {
        let Some(site) = site else { continue };
        let full = full / (sigma * sigma);
        let mut target = Target::isotropic(site, estimate.position_m, ik.prediction_weight * full);
        if estimate.weight > 0.0 {
            // Of a sighting nobody said what its views know.
            let is_known = estimate.information.trace() > 0.0;
            target.information += if is_known {
                estimate.information * SHARE_OF_INFORMATION
            } else {
                Matrix3::from_diagonal_element(estimate.weight.max(ik.min_weight) * full)
            };
        }
        targets.push(target);
    }
}
