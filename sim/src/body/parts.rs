//! The parts of a body: pelvis, abdomen, chest, neck, head, arms and legs, and the axes of the
//! trunk.
//!
//! Sizes are shares of the stature, from mean breadths and depths of adults. Axes are x forward, y
//! to the person's left, z towards the head.

use farfield_fusion::body::skeleton::{Joint, Joints, Side};
use nalgebra::{Matrix3, Vector3};

use super::build::{Build, Hair};
use super::cone::{BodyPart, Cone};

pub(super) fn add_trunk(cones: &mut Vec<Cone>, joints: &Joints, axes: &TrunkAxes, build: &Build) {
    let at = |j: Joint| joints[j as usize];
    let h = build.stature_m;
    let g = build.girth;
    let [forward, left, up] = [0, 1, 2].map(|c| axes.pelvis.column(c).into_owned());
    let chest_forward = axes.chest.column(0).into_owned();
    let chest_up = axes.chest.column(2).into_owned();
    let hips = at(Joint::Pelvis) + (up * 0.004 - forward * 0.004) * h;
    let half = left * (0.036 * h * build.hips);
    cones.push(Cone::squashed(
        BodyPart::Pelvis,
        [hips - half, hips + half],
        [0.063 * h * g; 2],
        forward,
        0.95,
    ));
    // The lumbosacral joint has different depths in different clips, so the waist is interpolated
    // between pelvis and neck.
    let waist = at(Joint::Pelvis)
        + (at(Joint::Neck) - at(Joint::Pelvis)) * 0.36
        + chest_forward * (0.006 * h);
    cones.push(Cone::squashed(
        BodyPart::Abdomen,
        [at(Joint::Pelvis) + up * (0.03 * h), waist],
        [0.084 * h * g * build.hips, 0.077 * h * g],
        forward + chest_forward,
        0.68,
    ));
    let bust = at(Joint::Neck) - chest_up * (0.087 * h) + chest_forward * (0.012 * h);
    cones.push(Cone::squashed(
        BodyPart::Chest,
        [waist, bust],
        [0.077 * h * g, 0.087 * h * build.chest * (0.5 + 0.5 * g)],
        chest_forward,
        0.68,
    ));
    let root = at(Joint::Neck) - chest_up * (0.024 * h) + chest_forward * (0.008 * h);
    for shoulder in [Joint::LeftShoulder, Joint::RightShoulder] {
        let end = at(shoulder) - chest_up * (0.006 * h);
        cones.push(Cone::round(
            BodyPart::Girdle,
            [root, end],
            [0.038 * h, 0.0285 * h * (0.5 + 0.5 * g)],
        ));
    }
    add_head(cones, joints, axes, build);
}

fn add_head(cones: &mut Vec<Cone>, joints: &Joints, axes: &TrunkAxes, build: &Build) {
    let at = |j: Joint| joints[j as usize];
    let h = build.stature_m;
    let [forward, left, up] = [0, 1, 2].map(|c| axes.head.column(c).into_owned());
    let chest_forward = axes.chest.column(0).into_owned();
    let head = (at(Joint::LeftEar) + at(Joint::RightEar)) / 2.0;
    let place = |f: f64, l: f64, u: f64| head + (forward * f + left * l + up * u) * h;
    cones.push(Cone::round(
        BodyPart::Neck,
        [
            at(Joint::Neck) + chest_forward * (0.008 * h),
            place(-0.004, 0.0, -0.022),
        ],
        [0.035 * h, 0.031 * h],
    ));
    let skull = [0.053 * h, 0.0435 * h, 0.064 * h];
    cones.push(Cone::ellipsoid(
        BodyPart::Head,
        place(0.002, 0.0, 0.014),
        &axes.head,
        skull,
    ));
    cones.push(Cone::round(
        BodyPart::Head,
        [place(0.018, 0.0, -0.008), place(0.034, 0.0, -0.046)],
        [0.036 * h, 0.0175 * h],
    ));
    let nose = at(Joint::Nose);
    cones.push(Cone::round(
        BodyPart::Head,
        [
            nose + (up * 0.018 - forward * 0.010) * h,
            nose + (forward * 0.001 - up * 0.003) * h,
        ],
        [0.006 * h, 0.0095 * h],
    ));
    for (ear, side) in [(Joint::LeftEar, 1.0), (Joint::RightEar, -1.0)] {
        cones.push(Cone::ellipsoid(
            BodyPart::Head,
            at(ear) + left * (side * 0.001 * h),
            &axes.head,
            [0.011 * h, 0.006 * h, 0.018 * h],
        ));
    }
    let hair = |center: Vector3<f64>, halves: [f64; 3]| {
        Cone::ellipsoid(BodyPart::Hair, center, &axes.head, halves.map(|v| v * h))
    };
    if build.hair == Hair::Bald {
        return;
    }
    cones.push(hair(place(-0.011, 0.0, 0.026), [0.052, 0.0455, 0.058]));
    match build.hair {
        Hair::Long => {
            cones.push(hair(place(-0.022, 0.0, -0.022), [0.036, 0.048, 0.068]));
        }
        Hair::Tail => cones.push(Cone::round(
            BodyPart::Hair,
            [place(-0.066, 0.0, 0.030), place(-0.085, 0.0, -0.040)],
            [0.017 * h, 0.011 * h],
        )),
        Hair::Short | Hair::Bald => {}
    }
}

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

/// Shorter vectors have no reliable direction, metres.
const SHORT_M: f64 = 1e-3;

/// Axes of the three parts of the trunk, as columns (forward, left, up), world.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrunkAxes {
    pub(super) pelvis: Matrix3<f64>,
    pub(super) chest: Matrix3<f64>,
    pub(super) head: Matrix3<f64>,
}

impl TrunkAxes {
    pub(super) fn from_joints(joints: &Joints) -> Self {
        let at = |j: Joint| joints[j as usize];
        let spine = at(Joint::Neck) - at(Joint::Pelvis);
        let hips = at(Joint::LeftHip) - at(Joint::RightHip);
        let shoulders = at(Joint::LeftShoulder) - at(Joint::RightShoulder);
        // The lumbosacral joint is close to the pelvis, in some clips equal to it. The whole trunk
        // stabilises its direction.
        let low = at(Joint::Spine) - at(Joint::Pelvis) + spine * 0.2;
        let high = at(Joint::Neck) - at(Joint::Spine);
        let ears = at(Joint::LeftEar) - at(Joint::RightEar);
        let face = at(Joint::Nose) - (at(Joint::LeftEar) + at(Joint::RightEar)) / 2.0;
        let chest = up_first(high, shoulders);
        Self {
            pelvis: up_first(low, hips),
            chest,
            head: left_first(ears, face, &chest),
        }
    }
}

/// Axes whose up is exactly `up`, with the left as close to `left` as possible.
fn up_first(up: Vector3<f64>, left: Vector3<f64>) -> Matrix3<f64> {
    let z = up.try_normalize(SHORT_M).unwrap_or_else(Vector3::z);
    let y = across(left, &z);
    Matrix3::from_columns(&[y.cross(&z), y, z])
}

/// Axes whose left is exactly `left`, with the forward as close to `forward` as possible; the axes
/// of `other` if the joints do not define them.
fn left_first(left: Vector3<f64>, forward: Vector3<f64>, other: &Matrix3<f64>) -> Matrix3<f64> {
    let Some(y) = left.try_normalize(SHORT_M) else {
        return *other;
    };
    let rest = forward - y * y.dot(&forward);
    let Some(x) = rest.try_normalize(SHORT_M) else {
        return *other;
    };
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

/// The direction closest to `hint` perpendicular to the unit vector `axis`; an arbitrary one if the
/// two are parallel.
pub(super) fn across(hint: Vector3<f64>, axis: &Vector3<f64>) -> Vector3<f64> {
    let rest = |v: Vector3<f64>| (v - axis * axis.dot(&v)).try_normalize(SHORT_M);
    rest(hint)
        .or_else(|| rest(Vector3::x()))
        .or_else(|| rest(Vector3::y()))
        .unwrap_or_else(Vector3::z)
}
