//! Errors that are the same in all ticks.
//!
//! A network's hip or knee is some 30 mm from the joint's centre (a track learns about half of it,
//! see the sites of a person). And body proportions differ from the model's where there is no
//! keypoint: neck and collar bones, the lower end of the spine, hands and feet. Fitted on the
//! project's own clips, with original bodies and with the links of each changed by 6 % and 13 mm
//! (standard deviations, left as right).

use crate::body::skeleton::Joint;

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
