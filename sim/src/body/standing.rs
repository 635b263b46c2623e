//! A person who stands upright with hanging arms, for tests.

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use nalgebra::Vector3;

/// Offsets of the left joints from the pelvis, in statures: forward, left, up. The right side
/// mirrors them.
const LEFT: [(Joint, Joint, [f64; 3]); 10] = [
    (Joint::LeftEye, Joint::RightEye, [0.05, 0.019, 0.405]),
    (Joint::LeftEar, Joint::RightEar, [0.0, 0.042, 0.39]),
    (Joint::LeftScapula, Joint::RightScapula, [0.0, 0.02, 0.27]),
    (Joint::LeftShoulder, Joint::RightShoulder, [0.0, 0.11, 0.27]),
    (Joint::LeftElbow, Joint::RightElbow, [0.0, 0.125, 0.1]),
    (Joint::LeftWrist, Joint::RightWrist, [0.03, 0.13, -0.054]),
    (Joint::LeftHand, Joint::RightHand, [0.04, 0.13, -0.103]),
    (Joint::LeftHip, Joint::RightHip, [0.0, 0.05, 0.0]),
    (Joint::LeftKnee, Joint::RightKnee, [0.0, 0.055, -0.245]),
    (Joint::LeftAnkle, Joint::RightAnkle, [0.0, 0.06, -0.491]),
];

const MIDDLE: [(Joint, [f64; 3]); 5] = [
    (Joint::Pelvis, [0.0, 0.0, 0.0]),
    (Joint::Spine, [0.0, 0.0, 0.07]),
    (Joint::Neck, [0.0, 0.0, 0.29]),
    (Joint::Head, [0.0, 0.0, 0.39]),
    (Joint::Nose, [0.06, 0.0, 0.39]),
];

/// The joints (world, metres) of a person who stands at `at_m` and faces +x.
pub(crate) fn standing(stature_m: f64, at_m: [f64; 2]) -> Joints {
    let mut joints = [Vector3::zeros(); 29];
    let root = Vector3::new(at_m[0], at_m[1], 0.53 * stature_m);
    let mut put = |joint: Joint, [f, l, u]: [f64; 3]| {
        joints[joint as usize] = root + Vector3::new(f, l, u) * stature_m;
    };
    for (joint, at) in MIDDLE {
        put(joint, at);
    }
    for (left, right, [f, l, u]) in LEFT {
        put(left, [f, l, u]);
        put(right, [f, -l, u]);
    }
    for (heel, toe, side) in [
        (Joint::LeftHeel, Joint::LeftToe, 0.06),
        (Joint::RightHeel, Joint::RightToe, -0.06),
    ] {
        put(heel, [-0.03, side, -0.526]);
        put(toe, [0.12, side, -0.526]);
    }
    joints
}
