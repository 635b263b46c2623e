//! What the first inverse kinematics aims at: the keypoints of a tick.

use crate::body::ik::Target;
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::Site;
use crate::method::Method;

/// Fills `targets` with the keypoints that `estimates` found, at their `sites`: each weighed by what it is
/// worth, and where nothing was seen the prediction, with little weight.
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
        let weight = if estimate.weight > 0.0 {
            estimate.weight.max(ik.min_weight)
        } else {
            ik.prediction_weight
        };
        let target = Target {
            joint: site.joint,
            offset_m: site.offset_m,
            position_m: estimate.position_m,
            weight: weight * full,
            across: estimate.ray,
        };
        targets.push(target);
        if estimate.ray.is_some() {
            // Along the ray nothing was seen: there the prediction carries the limb on.
            let weight = ik.prediction_weight * full;
            targets.push(Target {
                weight,
                across: None,
                ..target
            });
        }
    }
}
