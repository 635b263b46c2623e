//! Bodies in everyday postures, and noise, for tests.

#![allow(
    clippy::unwrap_used,
    clippy::missing_panics_doc,
    reason = "a test that fails may panic"
)]

use std::f64::consts::TAU;

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::subject::{SubjectLink, SubjectProfile};
use nalgebra::{UnitQuaternion, Vector3};

use super::observed::ObservedJoints;
use super::skeleton::dof::{DofGroup, first_of};
use super::skeleton::{Joint, Kinematics, Pose, Proportions, Side, Skeleton};

/// Pseudo-random numbers that are the same on every run.
pub struct Noise(
    /// The state.
    pub u64,
);

impl Noise {
    /// Uniform in 0..1 (splitmix64).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal with mean 0 and sigma 1 (twelve uniforms, cut at 6 sigma).
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    /// Three independent normals of `sigma`.
    pub fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal() * sigma)
    }
}

/// The 29 joints of a person of `skeleton` in `pose`, all with weight 1.
pub fn joints(skeleton: &Skeleton, pose: &Pose) -> ObservedJoints {
    let mut kinematics = Kinematics::default();
    skeleton.forward(pose, &mut kinematics);
    let mut observed = ObservedJoints::default();
    for joint in Joint::ALL {
        observed.set(joint, kinematics.joint_m(joint), 1.0);
    }
    observed
}

/// `body` with the 17 COCO keypoints alone, each moved by `moved`.
pub fn coco_only(
    body: &ObservedJoints,
    mut moved: impl FnMut(Vector3<f64>) -> Vector3<f64>,
) -> ObservedJoints {
    let mut observed = ObservedJoints::default();
    for name in KeypointSet::coco17().names() {
        let joint = Joint::from_name(name).unwrap();
        observed.set(joint, moved(body.position_m(joint).unwrap()), 1.0);
    }
    observed
}

/// `n` people in the middle of the hall, with any heading and any everyday posture of arms and
/// legs; spine and scapulas at rest.
pub fn postures(n: usize, noise: &mut Noise) -> Vec<Pose> {
    (0..n).map(|_| posture(noise)).collect()
}

fn posture(noise: &mut Noise) -> Pose {
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), noise.uniform() * TAU);
    let mut pose = Pose::neutral(Vector3::new(0.0, 0.0, 0.9), heading);
    let mut set = |side, part, which: usize, low: f64, high: f64| {
        pose.dof[first_of(side, part) + which] = low + (high - low) * noise.uniform();
    };
    for side in Side::BOTH {
        set(side, DofGroup::Shoulder, 0, -1.2, 1.5);
        set(side, DofGroup::Shoulder, 1, -1.0, 0.8);
        set(side, DofGroup::Elbow, 0, 0.3, 2.0);
        set(side, DofGroup::Hip, 0, -0.3, 1.7);
        set(side, DofGroup::Hip, 1, -0.5, 0.1);
        set(side, DofGroup::Knee, 0, 0.3, 1.9);
    }
    pose
}

/// The 17 COCO keypoints of `body`.
pub fn coco(body: &ObservedJoints) -> Vec<Vector3<f64>> {
    let names = KeypointSet::coco17();
    names
        .names()
        .iter()
        .map(|name| body.position_m(Joint::from_name(name).unwrap()).unwrap())
        .collect()
}

/// The keypoints of a person of `stature_m` standing at (`x`, `y`) in an everyday posture.
pub fn standing(x: f64, y: f64, stature_m: f64, noise: &mut Noise) -> Vec<Vector3<f64>> {
    let skeleton = Skeleton::new(&Proportions::from_stature(stature_m));
    let mut pose = posture(noise);
    for side in Side::BOTH {
        pose.dof[first_of(side, DofGroup::Hip)] *= 0.3;
        pose.dof[first_of(side, DofGroup::Knee)] *= 0.3;
    }
    pose.root_m = Vector3::new(x, y, 0.53 * stature_m);
    coco(&joints(&skeleton, &pose))
}

/// The profile of a body, as a run writes it.
pub fn profile(body: &Proportions, sigma_m: f64) -> SubjectProfile {
    let mut kinematics = Kinematics::default();
    let pose = Pose::neutral(Vector3::zeros(), UnitQuaternion::identity());
    Skeleton::new(body).forward(&pose, &mut kinematics);
    let link = |joint: Joint| {
        let parent = joint.parent()?;
        let apart_m = kinematics.joint_m(joint) - kinematics.joint_m(parent);
        let offset_m = kinematics.rotation(joint.link()).tr_mul(&apart_m);
        let link = SubjectLink { offset_m, sigma_m };
        Some((joint.name().to_owned(), link))
    };
    SubjectProfile {
        name: "Anna".to_owned(),
        stature_m: 1.7,
        links: Joint::ALL.into_iter().filter_map(link).collect(),
    }
}

/// The same as the text of its file.
pub fn profile_text(profile: &SubjectProfile) -> String {
    let mut text = format!(
        "name = {:?}\nstature_m = {:?}\n",
        profile.name, profile.stature_m
    );
    for (joint, link) in &profile.links {
        let [x, y, z]: [f64; 3] = link.offset_m.into();
        let (length_m, sigma_m) = (link.offset_m.norm(), link.sigma_m);
        let lines = [
            format!("[link.{joint}]\noffset_m = [{x:?}, {y:?}, {z:?}]\n"),
            format!("length_m = {length_m:?}\nsigma_m = {sigma_m:?}\n"),
        ];
        text.extend(lines);
    }
    text
}
