//! Lines of sight of cameras, and how near two of them pass each other.

use std::ops::Range;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Sine of the angle between two lines of sight below which their distance tells nothing (6 degrees).
const PARALLEL_SINE: f64 = 0.1;

/// Places along a line of sight that are looked at.
const PLACES: usize = 12;

/// A camera without its lens.
#[derive(Debug, Clone)]
pub(super) struct SightLines {
    /// World, metres.
    pub(super) center_m: Vector3<f64>,
    size_px: Vector2<f64>,
    world_from_camera: Matrix3<f64>,
    focal_px: Vector2<f64>,
    principal_px: Vector2<f64>,
    /// The camera, where it is a fisheye: what it shows is not what a pinhole of its size does.
    fisheye: Option<CameraModel>,
}

impl SightLines {
    pub(super) fn of(model: &CameraModel) -> Self {
        let intrinsics = model.intrinsics();
        let rotation = model.camera_from_world().isometry().rotation;
        Self {
            center_m: model.center().coordinates_m().coords,
            size_px: Vector2::from(model.size_px().map(f64::from)),
            world_from_camera: rotation.inverse().to_rotation_matrix().into_inner(),
            focal_px: Vector2::new(intrinsics.fx_px, intrinsics.fy_px),
            principal_px: Vector2::new(intrinsics.cx_px, intrinsics.cy_px),
            fisheye: model.lens().is_fisheye().then(|| model.clone()),
        }
    }

    /// Those of a camera that has at `turn p + shift_m` what this one has at p (right, down, ahead, metres), with focal lengths
    /// that are so many times as long.
    pub(super) fn displaced(
        &self,
        (turn, shift_m): (&Matrix3<f64>, &Vector3<f64>),
        focal_factor: f64,
    ) -> Self {
        let world_from_camera = self.world_from_camera * turn.transpose();
        Self {
            center_m: self.center_m - world_from_camera * shift_m,
            world_from_camera,
            focal_px: self.focal_px * focal_factor,
            ..self.clone()
        }
    }

    /// Where the undistorted pixel (x, y) points, world; as long as it takes to come one metre deeper.
    pub(super) fn direction(&self, pixel: [f32; 2]) -> Vector3<f64> {
        self.world(self.normalised(pixel))
    }

    /// The undistorted pixel (x, y) at a depth of one metre, camera, metres.
    pub(super) fn normalised(&self, pixel: [f32; 2]) -> Vector2<f64> {
        let at = Vector2::new(f64::from(pixel[0]), f64::from(pixel[1])) - self.principal_px;
        at.component_div(&self.focal_px)
    }

    /// Where a normalised place points, world; as long as it takes to come one metre deeper.
    pub(super) fn world(&self, normalised: Vector2<f64>) -> Vector3<f64> {
        self.world_from_camera * normalised.push(1.0)
    }

    /// A world point, metres, in the camera: right, down, ahead, metres.
    pub(super) fn in_camera(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_camera.tr_mul(&(point_m - self.center_m))
    }

    /// The undistorted pixel of a world point, metres, and its depth; `None` behind the camera.
    pub(super) fn project(&self, point_m: &Vector3<f64>) -> Option<(Vector2<f64>, f64)> {
        let p = self.in_camera(point_m);
        let pixel = || p.xy().component_mul(&self.focal_px) / p.z + self.principal_px;
        (p.z > 0.0).then(|| (pixel(), p.z))
    }

    /// Which share of the places along `direction` from `from_m`, as deep as `depths_m`, this camera sees, 0 to 1.
    pub(super) fn share_in_view(
        &self,
        (from_m, direction): (&Vector3<f64>, &Vector3<f64>),
        depths_m: Range<f64>,
    ) -> f64 {
        let is_seen = |place: usize| {
            let share = (place as f64 + 0.5) / PLACES as f64;
            let depth_m = depths_m.start + (depths_m.end - depths_m.start) * share;
            let seen = self.project(&(from_m + direction * depth_m));
            seen.is_some_and(|(px, _)| {
                if let Some(fisheye) = &self.fisheye {
                    return fisheye.sees(Pixel::new(px.x, px.y));
                }
                (0.0..self.size_px.x).contains(&px.x) && (0.0..self.size_px.y).contains(&px.y)
            })
        };
        (0..PLACES).filter(|&place| is_seen(place)).count() as f64 / PLACES as f64
    }

    /// Whether its lens is a fisheye's.
    pub(super) fn is_fisheye(&self) -> bool {
        self.fisheye.is_some()
    }

    /// Mean of the two focal lengths, pixels.
    pub(super) fn mean_focal_px(&self) -> f64 {
        0.5 * (self.focal_px.x + self.focal_px.y)
    }

    /// Both focal lengths, pixels.
    pub(super) fn focal_px(&self) -> Vector2<f64> {
        self.focal_px
    }

    /// Width and height of the picture, pixels.
    pub(super) fn size_px(&self) -> Vector2<f64> {
        self.size_px
    }

    /// The principal point, pixels.
    pub(super) fn principal_px(&self) -> Vector2<f64> {
        self.principal_px
    }
}

/// Where two lines of sight come nearest to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_field_names, reason = "the unit is in the name")]
pub(super) struct Meeting {
    /// How far from each other they pass, metres; infinite when they do so behind a camera.
    pub(super) gap_m: f64,
    /// The same with a side: negative where the second passes on the other one.
    pub(super) signed_gap_m: f64,
    /// How deep in front of the two cameras, metres.
    pub(super) depths_m: [f64; 2],
}

/// How the lines meet that start at `a_m` and `b_m` with these directions, as [`SightLines::direction`] has them;
/// `None` when they are too parallel to tell.
pub(super) fn meeting(
    (a_m, a_direction): (&Vector3<f64>, &Vector3<f64>),
    (b_m, b_direction): (&Vector3<f64>, &Vector3<f64>),
) -> Option<Meeting> {
    let normal = a_direction.cross(b_direction);
    let squared = normal.norm_squared();
    let lengths2 = a_direction.norm_squared() * b_direction.norm_squared();
    let is_apart = squared >= PARALLEL_SINE * PARALLEL_SINE * lengths2;
    if !is_apart || lengths2 == 0.0 {
        return None;
    }
    let between = b_m - a_m;
    let depth_m = |other: &Vector3<f64>| between.cross(other).dot(&normal) / squared;
    let depths_m = [depth_m(b_direction), depth_m(a_direction)];
    let signed_gap_m = between.dot(&normal) / squared.sqrt();
    let in_front = depths_m.iter().all(|&depth_m| depth_m > 0.0);
    Some(Meeting {
        gap_m: if in_front {
            signed_gap_m.abs()
        } else {
            f64::INFINITY
        },
        signed_gap_m,
        depths_m,
    })
}
