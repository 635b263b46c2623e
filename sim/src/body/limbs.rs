//! Arms and legs.

use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::body::skeleton::{Joint, Side};
use nalgebra::Vector3;

use super::axes::{TrunkAxes, across};
use super::build::Build;
use super::cone::{BodyPart, Cone};

struct Arm {
    joints: [Joint; 4],
    parts: [BodyPart; 3],
}

struct LegParts {
    joints: [Joint; 5],
    parts: [BodyPart; 3],
}

fn arm_of(side: Side) -> Arm {
    match side {
        Side::Left => Arm {
            joints: [
                Joint::LeftShoulder,
                Joint::LeftElbow,
                Joint::LeftWrist,
                Joint::LeftHand,
            ],
            parts: [
                BodyPart::LeftUpperArm,
                BodyPart::LeftForearm,
                BodyPart::LeftHand,
            ],
        },
        Side::Right => Arm {
            joints: [
                Joint::RightShoulder,
                Joint::RightElbow,
                Joint::RightWrist,
                Joint::RightHand,
            ],
            parts: [
                BodyPart::RightUpperArm,
                BodyPart::RightForearm,
                BodyPart::RightHand,
            ],
        },
    }
}

fn leg_of(side: Side) -> LegParts {
    match side {
        Side::Left => LegParts {
            joints: [
                Joint::LeftHip,
                Joint::LeftKnee,
                Joint::LeftAnkle,
                Joint::LeftHeel,
                Joint::LeftToe,
            ],
            parts: [BodyPart::LeftThigh, BodyPart::LeftShank, BodyPart::LeftFoot],
        },
        Side::Right => LegParts {
            joints: [
                Joint::RightHip,
                Joint::RightKnee,
                Joint::RightAnkle,
                Joint::RightHeel,
                Joint::RightToe,
            ],
            parts: [
                BodyPart::RightThigh,
                BodyPart::RightShank,
                BodyPart::RightFoot,
            ],
        },
    }
}

pub(super) fn add_arm(
    cones: &mut Vec<Cone>,
    joints: &Joints,
    axes: &TrunkAxes,
    build: &Build,
    side: Side,
) {
    let Arm {
        joints: names,
        parts,
    } = arm_of(side);
    let [shoulder, elbow, wrist, hand] = names.map(|j| joints[j as usize]);
    let h = build.stature_m;
    let g = h * build.girth;
    let upper = elbow - shoulder;
    cones.push(
        Cone::round(
            parts[0],
            [shoulder, shoulder + upper * 0.45],
            [0.034 * g, 0.0295 * g],
        )
        .with_along([0.0, 0.45]),
    );
    cones.push(
        Cone::round(
            parts[0],
            [shoulder + upper * 0.45, elbow],
            [0.0295 * g, 0.024 * g],
        )
        .with_along([0.45, 1.0]),
    );
    let fore = wrist - elbow;
    cones.push(
        Cone::round(
            parts[1],
            [elbow, elbow + fore * 0.25],
            [0.024 * g, 0.0255 * g],
        )
        .with_along([1.0, 1.25]),
    );
    cones.push(
        Cone::round(
            parts[1],
            [elbow + fore * 0.25, wrist],
            [0.0255 * g, 0.0155 * g],
        )
        .with_along([1.25, 2.0]),
    );
    // A hanging hand lies against the thigh; a bent elbow turns nearly about the normal of the
    // palm.
    let sideways = axes.chest.column(1) * (Build::sign(side) * 0.05 * h * h);
    let palm = upper.cross(&fore) * Build::sign(side) * -1.0 + sideways;
    let hand = Hand {
        part: parts[2],
        wrist,
        joint: hand,
        palm,
    };
    add_hand(cones, &hand, h, side);
}

/// A hand, world, metres.
struct Hand {
    part: BodyPart,
    wrist: Vector3<f64>,
    /// The wrist's end of the hand.
    joint: Vector3<f64>,
    /// Direction of the palm, of any length.
    palm: Vector3<f64>,
}

fn add_hand(cones: &mut Vec<Cone>, hand: &Hand, h: f64, side: Side) {
    let &Hand {
        part, wrist, joint, ..
    } = hand;
    let along = (joint - wrist)
        .try_normalize(1e-6)
        .unwrap_or_else(Vector3::z);
    let palm = across(hand.palm, &along);
    let knuckles = joint + along * (0.004 * h);
    cones.push(Cone::squashed(
        part,
        [wrist + along * (0.012 * h), knuckles],
        [0.0145 * h, 0.0215 * h],
        palm,
        0.5,
    ));
    cones.push(Cone::squashed(
        part,
        [knuckles, joint + along * (0.036 * h) + palm * (0.006 * h)],
        [0.0205 * h, 0.0135 * h],
        palm,
        0.45,
    ));
    let thumb = along.cross(&palm) * -Build::sign(side);
    let thumb_root = wrist + along * (0.016 * h) + thumb * (0.008 * h);
    cones.push(Cone::round(
        part,
        [
            thumb_root,
            thumb_root + along * (0.032 * h) + thumb * (0.018 * h),
        ],
        [0.009 * h, 0.006 * h],
    ));
}

pub(super) fn add_leg(
    cones: &mut Vec<Cone>,
    joints: &Joints,
    build: &Build,
    axes: &TrunkAxes,
    side: Side,
) {
    let LegParts {
        joints: names,
        parts,
    } = leg_of(side);
    let [hip, knee, ankle, heel, toe] = names.map(|j| joints[j as usize]);
    let h = build.stature_m;
    let g = h * build.girth;
    let back = -axes.pelvis.column(0);
    // The thighs start outside the femoral heads.
    let out = axes.pelvis.column(1) * (Build::sign(side) * 0.004 * h);
    let seat = hip + out + back * (0.011 * h);
    let thigh = knee - hip;
    cones.push(Cone::round(
        BodyPart::Pelvis,
        [seat, seat + thigh * 0.1],
        [0.0475 * g * build.hips, 0.0465 * g],
    ));
    cones.push(
        Cone::round(
            parts[0],
            [hip + out, hip + thigh * 0.45],
            [0.0525 * g * build.hips, 0.047 * g],
        )
        .with_along([0.0, 0.45]),
    );
    cones.push(
        Cone::round(
            parts[0],
            [hip + thigh * 0.45, knee],
            [0.047 * g, 0.0325 * g],
        )
        .with_along([0.45, 1.0]),
    );
    let shank = ankle - knee;
    let down = shank.try_normalize(1e-6).unwrap_or_else(Vector3::z);
    let calf = knee + shank * 0.3 - across(toe - heel, &down) * (0.008 * h);
    cones
        .push(Cone::round(parts[1], [knee, calf], [0.0325 * g, 0.0325 * g]).with_along([1.0, 1.3]));
    cones.push(
        Cone::round(parts[1], [calf, ankle], [0.0325 * g, 0.0205 * g]).with_along([1.3, 2.0]),
    );
    add_foot(cones, parts[2], [ankle, heel, toe], h);
}

fn add_foot(cones: &mut Vec<Cone>, part: BodyPart, [ankle, heel, toe]: [Vector3<f64>; 3], h: f64) {
    let along = (toe - heel).try_normalize(1e-6).unwrap_or_else(Vector3::x);
    let up = across(ankle - heel, &along);
    let heel_ball = heel + (along * 0.021 + up * 0.014) * h;
    let ball = heel + (toe - heel) * 0.68 + up * (0.011 * h);
    let tip = toe + (up * 0.009 - along * 0.018) * h;
    cones.push(Cone::squashed(
        part,
        [heel_ball, ball],
        [0.0235 * h, 0.0275 * h],
        up,
        0.62,
    ));
    cones.push(Cone::squashed(
        part,
        [ball, tip],
        [0.0285 * h, 0.02 * h],
        up,
        0.58,
    ));
    // The upper, from the opening around the ankle to the laces.
    cones.push(Cone::round(
        part,
        [ankle - up * (0.006 * h), heel_ball],
        [0.0225 * h, 0.0215 * h],
    ));
    cones.push(Cone::round(
        part,
        [
            ankle - up * (0.008 * h) + along * (0.008 * h),
            ball + up * (0.002 * h),
        ],
        [0.0215 * h, 0.018 * h],
    ));
}
