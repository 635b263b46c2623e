//! Lines of sight of cameras, and the distance at which two of them pass each other.

use std::ops::Range;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Least sine of the angle between two lines of sight that are compared (6 degrees).
const MIN_ANGLE_SINE: f64 = 0.1;

/// Number of sample points along a line of sight.
const N_PLACES: usize = 12;

/// A camera without lens distortion.
#[derive(Debug, Clone)]
pub(super) struct SightLines {
    /// World, metres.
    pub(super) center_m: Vector3<f64>,
    size_px: Vector2<f64>,
    world_from_camera: Matrix3<f64>,
    focal_px: Vector2<f64>,
    principal_px: Vector2<f64>,
    /// The camera if it is a fisheye: its field of view is not that of a pinhole of its size.
    fisheye: Option<CameraModel>,
}

impl SightLines {
    pub(super) fn from_camera(model: &CameraModel) -> Self {
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

    /// A camera in which point p of this camera (right, down, ahead, metres) lies at
    /// `turn p + shift_m`, with the focal lengths times `focal_factor`.
    pub(super) fn displaced(
        &self,
        turn: &Matrix3<f64>,
        shift_m: &Vector3<f64>,
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

    /// The direction of the undistorted pixel (x, y), world; its depth is one metre.
    pub(super) fn direction(&self, pixel: [f32; 2]) -> Vector3<f64> {
        self.world(self.normalised(pixel))
    }

    /// The normalised coordinates of the undistorted pixel (x, y).
    pub(super) fn normalised(&self, pixel: [f32; 2]) -> Vector2<f64> {
        let at = Vector2::new(f64::from(pixel[0]), f64::from(pixel[1])) - self.principal_px;
        at.component_div(&self.focal_px)
    }

    /// The direction of normalised coordinates, world; its depth is one metre.
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

    /// The share of places along `direction` from `from_m`, at `depths_m`, in view, 0 to 1.
    pub(super) fn share_in_view(
        &self,
        from_m: &Vector3<f64>,
        direction: &Vector3<f64>,
        depths_m: Range<f64>,
    ) -> f64 {
        let is_seen = |place: usize| {
            let share = (place as f64 + 0.5) / N_PLACES as f64;
            let depth_m = depths_m.start + (depths_m.end - depths_m.start) * share;
            let seen = self.project(&(from_m + direction * depth_m));
            seen.is_some_and(|(px, _)| {
                if let Some(fisheye) = &self.fisheye {
                    return fisheye.sees(Pixel::new(px.x, px.y));
                }
                (0.0..self.size_px.x).contains(&px.x) && (0.0..self.size_px.y).contains(&px.y)
            })
        };
        (0..N_PLACES).filter(|&place| is_seen(place)).count() as f64 / N_PLACES as f64
    }

    /// Whether its lens is a fisheye.
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

/// The place at which two lines of sight are nearest to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_field_names, reason = "the unit is in the name")]
pub(super) struct Meeting {
    /// Least distance, metres; infinite if it is behind a camera.
    pub(super) gap_m: f64,
    /// The same with a sign, by the side on which the second line passes.
    pub(super) signed_gap_m: f64,
    /// Depths in the two cameras, metres.
    pub(super) depths_m: [f64; 2],
}

/// The meeting of the lines from `a_m` and `b_m`, with directions of [`SightLines::direction`].
/// `None` if they are nearly parallel.
pub(super) fn meeting(
    (a_m, a_direction): (&Vector3<f64>, &Vector3<f64>),
    (b_m, b_direction): (&Vector3<f64>, &Vector3<f64>),
) -> Option<Meeting> {
    let normal = a_direction.cross(b_direction);
    let squared = normal.norm_squared();
    let lengths2 = a_direction.norm_squared() * b_direction.norm_squared();
    let is_apart = squared >= MIN_ANGLE_SINE * MIN_ANGLE_SINE * lengths2;
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
