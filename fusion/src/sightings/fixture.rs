//! A small hall with cameras in its corners and bodies in it, for the tests of this folder.

use std::f64::consts::TAU;

use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::{Point, Transform};
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::{KeypointPeak, Sighting};
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::body::observed::ObservedJoints;
use crate::body::skeleton::dof::{Part, first_of};
use crate::body::skeleton::{Joint, Kinematics, Pose, Proportions, Side, Skeleton};
use crate::sightings::finder::BirthFinder;

/// Pseudo-random numbers that are the same on every run.
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    /// Uniform in 0..1 (splitmix64).
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal with mean 0 and sigma 1 (twelve uniforms, cut at 6 sigma).
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    /// Three independent normals of `sigma`.
    pub(crate) fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal() * sigma)
    }
}

/// Cameras two metres outside the corners of an 8 m x 6 m field, one per viewpoint, and the
/// default parameters.
pub(crate) fn hall() -> Hall {
    let corners = [[-5.0, -4.0], [5.0, -4.2], [5.0, 4.0], [-5.2, 4.1]];
    let cameras = corners.iter().enumerate().map(|(i, &[x, y])| {
        (
            ViewpointIndex(i as u16),
            looking_at_the_middle(&format!("corner-{i}"), Point3::new(x, y, 2.5)),
        )
    });
    Hall {
        cameras: cameras.collect(),
        parameters: BirthParameters::default(),
    }
}

pub(crate) struct Hall {
    pub(crate) cameras: Vec<(ViewpointIndex, CameraModel)>,
    pub(crate) parameters: BirthParameters,
}

impl Hall {
    pub(crate) fn finder(&self) -> BirthFinder {
        let field = Field {
            min_m: [-4.0, -3.0, -0.3],
            max_m: [4.0, 3.0, 2.6],
        };
        BirthFinder::new(
            self.cameras.clone(),
            KeypointSet::coco17(),
            &field,
            &self.parameters,
        )
    }

    /// What each camera sees of `bodies` with `noise_px` per axis: whole bodies without occlusion,
    /// in an order that says nothing.
    pub(crate) fn sightings(
        &self,
        bodies: &[Vec<Vector3<f64>>],
        noise_px: f64,
        noise: &mut Noise,
    ) -> Vec<Sighting> {
        let mut all = Vec::new();
        for camera in 0..self.cameras.len() {
            for i in 0..bodies.len() {
                let body = &bodies[(i + camera) % bodies.len()];
                all.push(self.sighting(camera, body, noise_px, noise));
            }
        }
        all
    }

    pub(crate) fn sighting(
        &self,
        camera: usize,
        body: &[Vector3<f64>],
        noise_px: f64,
        noise: &mut Noise,
    ) -> Sighting {
        let model = &self.cameras[camera].1;
        let keypoints = body.iter().map(|&p| {
            let pixel = model
                .project(Point::new(p.into()))
                .filter(|&pixel| model.sees(pixel))?;
            let x = pixel.x() + noise.normal() * noise_px;
            let y = pixel.y() + noise.normal() * noise_px;
            Some(KeypointPeak {
                position_px: [x as f32, y as f32],
                score: 0.8,
            })
        });
        Sighting {
            camera: CameraIndex(camera as u16),
            score: 0.9,
            keypoints: keypoints.collect(),
        }
    }
}

/// A 1920 x 1200 camera at `eye` that looks at the middle of the hall.
pub(crate) fn looking_at_the_middle(name: &str, eye: Point3<f64>) -> CameraModel {
    let up_is_y = Isometry3::look_at_rh(&eye, &Point3::new(0.0, 0.0, 0.9), &Vector3::z());
    let down_is_y = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let camera_from_world = Isometry3::from_parts(Translation3::identity(), down_is_y) * up_is_y;
    let intrinsics = Intrinsics {
        fx_px: 1000.0,
        fy_px: 1000.0,
        cx_px: 959.5,
        cy_px: 599.5,
    };
    CameraModel::new(
        name,
        [1920, 1200],
        intrinsics,
        Distortion::default(),
        Transform::new(camera_from_world),
    )
    .unwrap()
}

/// The 29 joints of a person of `skeleton` in `pose`, all with weight 1.
pub(crate) fn joints(skeleton: &Skeleton, pose: &Pose) -> ObservedJoints {
    let mut kinematics = Kinematics::default();
    skeleton.forward(pose, &mut kinematics);
    let mut observed = ObservedJoints::default();
    for joint in Joint::ALL {
        observed.set(joint, kinematics.joint_m(joint), 1.0);
    }
    observed
}

/// `body` with the 17 COCO keypoints alone, each where `moved` puts it.
pub(crate) fn coco_only(
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

/// `n` people in the middle of the hall, facing anywhere, with arms and legs anywhere that people
/// put them; spine and scapulas as they were born.
pub(crate) fn postures(n: usize, noise: &mut Noise) -> Vec<Pose> {
    (0..n).map(|_| posture(noise)).collect()
}

fn posture(noise: &mut Noise) -> Pose {
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), noise.uniform() * TAU);
    let mut pose = Pose::neutral(Vector3::new(0.0, 0.0, 0.9), heading);
    let mut set = |side, part, which: usize, low: f64, high: f64| {
        pose.dof[first_of(side, part) + which] = low + (high - low) * noise.uniform();
    };
    for side in Side::BOTH {
        set(side, Part::Shoulder, 0, -1.2, 1.5);
        set(side, Part::Shoulder, 1, -1.0, 0.8);
        set(side, Part::Elbow, 0, 0.3, 2.0);
        set(side, Part::Hip, 0, -0.3, 1.7);
        set(side, Part::Hip, 1, -0.5, 0.1);
        set(side, Part::Knee, 0, 0.3, 1.9);
    }
    pose
}

/// The 17 COCO keypoints of `body`.
pub(crate) fn coco(body: &ObservedJoints) -> Vec<Vector3<f64>> {
    let names = KeypointSet::coco17();
    names
        .names()
        .iter()
        .map(|name| body.position_m(Joint::from_name(name).unwrap()).unwrap())
        .collect()
}

/// The keypoints of a person of `stature_m` standing at (`x`, `y`) in some everyday posture.
pub(crate) fn standing(x: f64, y: f64, stature_m: f64, noise: &mut Noise) -> Vec<Vector3<f64>> {
    let skeleton = Skeleton::new(&Proportions::from_stature(stature_m));
    let mut pose = posture(noise);
    for side in Side::BOTH {
        pose.dof[first_of(side, Part::Hip)] *= 0.3;
        pose.dof[first_of(side, Part::Knee)] *= 0.3;
    }
    pose.root_m = Vector3::new(x, y, 0.53 * stature_m);
    coco(&joints(&skeleton, &pose))
}
