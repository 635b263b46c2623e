//! A small hall with cameras in its corners and their view of bodies, for tests.

use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::{Point, Transform};
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::{KeypointPeak, Sighting};
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::agreement::Gates;
use crate::body::fixture::Noise;
use crate::sightings::finder::PersonFinder;

/// Cameras two metres outside the corners of an 8 m x 6 m field, one per viewpoint, and the default
/// parameters.
pub(crate) fn hall() -> TestHall {
    let corners = [[-5.0, -4.0], [5.0, -4.2], [5.0, 4.0], [-5.2, 4.1]];
    let cameras = corners.iter().enumerate().map(|(i, &[x, y])| {
        (
            ViewpointIndex(i as u16),
            looking_at_the_middle(&format!("corner-{i}"), Point3::new(x, y, 2.5)),
        )
    });
    TestHall {
        cameras: cameras.collect(),
        parameters: BirthParameters::default(),
    }
}

/// As [`hall`], with sixteen cameras around the field.
pub(crate) fn hall_of_sixteen() -> TestHall {
    let cameras = (0..16).map(|i| {
        let (sin, cos) = libm::sincos(f64::from(i) * std::f64::consts::PI / 8.0);
        let eye = Point3::new(5.5 * cos, 4.5 * sin, 2.5);
        (
            ViewpointIndex(i as u16),
            looking_at_the_middle("around", eye),
        )
    });
    TestHall {
        cameras: cameras.collect(),
        parameters: BirthParameters::default(),
    }
}

/// The gates of `hall`.
pub(crate) fn gates(hall: &TestHall) -> Gates {
    Gates {
        ray_distance_m: hall.parameters.ray_distance_m,
        min_keypoints: hall.parameters.min_keypoints as usize,
        field_min_m: Vector3::new(-4.0, -3.0, -0.3),
        field_max_m: Vector3::new(4.0, 3.0, 2.6),
    }
}

pub(crate) struct TestHall {
    pub(crate) cameras: Vec<(ViewpointIndex, CameraModel)>,
    pub(crate) parameters: BirthParameters,
}

impl TestHall {
    pub(crate) fn finder(&self) -> PersonFinder {
        let field = Field {
            min_m: [-4.0, -3.0, -0.3],
            max_m: [4.0, 3.0, 2.6],
            floor_m: 0.0,
        };
        PersonFinder::new(
            self.cameras.clone(),
            KeypointSet::coco17(),
            &field,
            &self.parameters,
        )
    }

    /// What each camera sees of `bodies` with `noise_px` per axis: whole bodies without occlusion,
    /// in arbitrary order.
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
    looking_at(name, eye.coords.into(), [0.0, 0.0, 0.9], 1000.0)
}

/// A 1920 x 1200 camera at `eye_m` that looks at `aim_m`, with this focal length.
pub(crate) fn looking_at(
    name: &str,
    eye_m: [f64; 3],
    aim_m: [f64; 3],
    focal_px: f64,
) -> CameraModel {
    let (eye, aim) = (Point3::from(eye_m), Point3::from(aim_m));
    let up_is_y = Isometry3::look_at_rh(&eye, &aim, &Vector3::z());
    let down_is_y = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let camera_from_world = Isometry3::from_parts(Translation3::identity(), down_is_y) * up_is_y;
    let intrinsics = Intrinsics {
        fx_px: focal_px,
        fy_px: focal_px,
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
