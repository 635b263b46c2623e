//! Where a network's keypoints sit on *this* person, learned while it moves.
//!
//! What networks call a hip or a knee is some centimetres off the joint's centre, and fixed to the
//! body. While a person moves, the skeleton cannot follow such a point as if it were the joint: what
//! remains, turned into the link's own axes, has a mean. The offset follows that mean,
//!
//! ```text
//!   o += dt/tau r - dt/tau_0 o,      r = R' (P_key - site),
//! ```
//!
//! slowly enough that the network's other errors, which last for seconds, average out, and falls back
//! to the card's offset where nothing tells it.

use nalgebra::Vector3;

use super::observed::ObservedJoints;
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::{Joint, Kinematics, Site};

/// The joints whose keypoints are learned: those that lie deep in the body.
const DEEP: [Joint; 4] = [
    Joint::LeftHip,
    Joint::RightHip,
    Joint::LeftKnee,
    Joint::RightKnee,
];
/// Farthest that a keypoint is taken to be from where its card puts it, metres.
const FARTHEST_M: f64 = 0.06;
/// `tau`: how fast the offset follows what remains, seconds.
const FOLLOW_S: f64 = 4.0;
/// `tau_0`: how fast an offset that nothing tells falls back to the card's, seconds.
const FORGET_S: f64 = 10.0;
/// What a single tick may count, metres.
const LARGEST_M: f64 = 0.06;

/// Moves the sites of deep joints towards where the keypoints were seen, `dt_s` after the last tick. `of_card`
/// are the sites that the network's card gives.
pub(crate) fn learn(
    sites: &mut [Option<Site>],
    of_card: &[Option<Site>],
    estimates: &[KeypointEstimate],
    kinematics: &Kinematics,
    dt_s: f64,
) {
    for ((site, card), estimate) in sites.iter_mut().zip(of_card).zip(estimates) {
        let (Some(site), Some(card)) = (site, card) else {
            continue;
        };
        if !DEEP.contains(&site.joint) || estimate.views < 2 || estimate.weight <= 0.0 {
            continue;
        }
        let off_m = estimate.position_m - kinematics.site_m(site);
        let r = kinematics.rotation(site.joint.link()).transpose() * off_m;
        let r = r * (LARGEST_M / r.norm().max(LARGEST_M));
        let learned = site.offset_m - card.offset_m;
        let learned = learned + r * (dt_s / FOLLOW_S) - learned * (dt_s / FORGET_S);
        site.offset_m = card.offset_m + learned * (FARTHEST_M / learned.norm().max(FARTHEST_M));
    }
}

/// The joints that the keypoints with evidence from two viewpoints show, freed of their offsets.
pub(crate) fn without_offsets(
    estimates: &[KeypointEstimate],
    sites: &[Option<Site>],
    kinematics: &Kinematics,
) -> ObservedJoints {
    let mut joints = ObservedJoints::default();
    for (joint, point) in ObservedJoints::from_estimates(estimates, sites).iter() {
        let offset_m: Vector3<f64> = kinematics.rotation(joint.link()) * point.offset_m;
        joints.set(joint, point.position_m - offset_m, point.weight);
    }
    joints
}
