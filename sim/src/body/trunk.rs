//! Pelvis, abdomen, chest, neck and head.
//!
//! Sizes are shares of the stature, from mean breadths and depths of adults.

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use nalgebra::Vector3;

use super::axes::TrunkAxes;
use super::build::{Build, Hair};
use super::cone::{BodyPart, Cone};

pub(super) fn add(cones: &mut Vec<Cone>, joints: &Joints, axes: &TrunkAxes, build: &Build) {
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
