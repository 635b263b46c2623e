//! Maps pixels to a plane in which the outline of a sphere is a circle, and back.

use farfield_proto::camera::{CameraError, CameraModel, Intrinsics, LensModel};
use farfield_proto::frames::Transform;
use nalgebra::{Isometry3, Vector2, Vector3};

use crate::adjustment::CameraState;

/// The lens of a camera, for outlines.
#[derive(Debug, Clone, Copy)]
pub struct BallLens {
    state: CameraState,
    fold_radius: f64,
    focal_px: f64,
}

impl BallLens {
    /// The lens of pictures of `size_px`.
    ///
    /// # Errors
    /// [`CameraError`] for numbers that a lens cannot have. A model that folds in a corner is allowed: outlines there are fitted
    /// without it.
    pub fn new(
        size_px: [u32; 2],
        intrinsics: Intrinsics,
        lens: impl Into<LensModel>,
    ) -> Result<Self, CameraError> {
        let (pose, lens) = (Transform::new(Isometry3::identity()), lens.into());
        match CameraModel::new("ball", size_px, intrinsics, lens, pose) {
            Ok(_) | Err(CameraError::Folds { .. }) => {}
            Err(error) => return Err(error),
        }
        let state = CameraState::at_origin(intrinsics, lens);
        Ok(Self {
            fold_radius: state.fold_radius(),
            focal_px: (intrinsics.fx_px * intrinsics.fy_px).sqrt(),
            state,
        })
    }

    fn bearing(&self, px: [f64; 2]) -> Option<Vector3<f64>> {
        self.state.bearing(px, self.fold_radius)
    }

    fn project(&self, bearing: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.state.project(bearing, self.fold_radius)
    }
}

/// A plane about one position of the picture.
///
/// With a lens: the stereographic projection of the unit sphere from the point opposite to that position, in focal lengths. It
/// maps every circle on the sphere to a circle. The outline of a ball is one, as all its tangent rays are at one angle to the
/// ray of its centre. Without a lens: the picture itself.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chart<'a> {
    lens: Option<(&'a BallLens, [Vector3<f64>; 3])>,
    about_px: [f64; 2],
}

impl<'a> Chart<'a> {
    pub(super) fn about(lens: Option<&'a BallLens>, px: [f64; 2]) -> Self {
        let axes = lens.and_then(|lens| {
            let z = lens.bearing(px)?;
            let x = Vector3::y().cross(&z).try_normalize(1e-9)?;
            Some((lens, [x, z.cross(&x), z]))
        });
        Self {
            lens: axes,
            about_px: px,
        }
    }

    pub(super) fn on_plane(&self, px: [f64; 2]) -> Option<Vector2<f64>> {
        let Some((lens, [x, y, z])) = &self.lens else {
            return Some(Vector2::from(px) - Vector2::from(self.about_px));
        };
        let bearing = lens.bearing(px)?;
        let scale = 2.0 * lens.focal_px / (1.0 + bearing.dot(z));
        Some(scale * Vector2::new(bearing.dot(x), bearing.dot(y)))
    }

    /// The pixel of the centre of a ball whose outline is the circle of `radius` about `centre`, and the angle that the ball
    /// spans, in focal lengths.
    pub(super) fn ball(&self, centre: Vector2<f64>, radius: f64) -> Option<([f64; 2], f64)> {
        let Some((lens, [x, y, z])) = &self.lens else {
            let px = centre + Vector2::from(self.about_px);
            return Some((px.into(), 2.0 * radius));
        };
        let away = centre.norm();
        let toward = if away > 1e-9 {
            centre / away
        } else {
            Vector2::x()
        };
        // The nearest and the farthest point of the circle from the plane's origin, as angles.
        let angle = |r: f64| 2.0 * libm::atan(r / (2.0 * lens.focal_px));
        let (near, far) = (angle(away - radius), angle(away + radius));
        let (middle, half) = (0.5 * (near + far), 0.5 * (far - near));
        let across = x * toward.x + y * toward.y;
        let axis = z * libm::cos(middle) + across * libm::sin(middle);
        let px = lens.project(&axis)?;
        Some((px.into(), 2.0 * half * lens.focal_px))
    }

    /// Pixels of the picture over pixels of the plane, about `centre`.
    pub(super) fn scale(&self, centre: Vector2<f64>) -> f64 {
        let at = |by: Vector2<f64>| self.ball(centre + by, 1.0).map(|(px, _)| Vector2::from(px));
        let (Some(o), Some(x), Some(y)) =
            (at(Vector2::zeros()), at(Vector2::x()), at(Vector2::y()))
        else {
            return 1.0;
        };
        (0.5 * ((x - o).norm_squared() + (y - o).norm_squared())).sqrt()
    }
}

/// Distance by which the middle of a ball's outline is farther from the principal point than its centre, pixels of a pinhole of
/// `focal_px`: f tan(theta) sin(alpha)^2 / (cos(theta)^2 - sin(alpha)^2).
///
/// theta is the angle of the centre to the axis, alpha the angular radius of the ball, radians. In the plane through the axis
/// the ends of the outline are at f tan(theta -+ alpha); the result is their mean less f tan(theta).
pub fn outline_offset_px(focal_px: f64, theta_rad: f64, alpha_rad: f64) -> f64 {
    let (sine, cosine) = (libm::sin(alpha_rad), libm::cos(theta_rad));
    focal_px * libm::tan(theta_rad) * sine * sine / (cosine * cosine - sine * sine)
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::Distortion;
    use proptest::prelude::*;

    use super::*;

    fn lens(k1: f64) -> BallLens {
        let intrinsics = Intrinsics {
            fx_px: 1400.0,
            fy_px: 1390.0,
            cx_px: 955.0,
            cy_px: 610.0,
        };
        let distortion = Distortion {
            k1,
            p1: 0.001,
            ..Distortion::default()
        };
        BallLens::new([1920, 1200], intrinsics, distortion).unwrap()
    }

    proptest! {
        #[test]
        fn tangent_rays_of_a_ball_give_its_centre_and_size(
            x in -3.0f64..3.0,
            y in -1.8f64..1.8,
            z in 4.0f64..30.0,
            k1 in -0.1f64..0.05,
            off in prop::array::uniform2(-3.0f64..3.0),
        ) {
            let lens = lens(k1);
            let centre = Vector3::new(x, y, z);
            let radius_m = 0.11;
            let seen = lens.project(&centre).unwrap();
            let chart = Chart::about(Some(&lens), [seen.x + off[0], seen.y + off[1]]);
            // Three tangent rays, and the circle through them.
            let axis = centre.normalize();
            let alpha = libm::asin(radius_m / centre.norm());
            let side = axis.cross(&Vector3::y()).normalize();
            let up = axis.cross(&side);
            let rim: Vec<Vector2<f64>> = [0.3f64, 2.0, 4.4].iter().map(|turn| {
                let across = side * libm::cos(*turn) + up * libm::sin(*turn);
                let ray = axis * libm::cos(alpha) + across * libm::sin(alpha);
                let px = lens.project(&ray).unwrap();
                chart.on_plane(px.into()).unwrap()
            }).collect();
            let (circle, r) = crate::ball::round::circle_through(&rim[0], &rim[1], &rim[2]).unwrap();
            let (px, diameter) = chart.ball(circle, r).unwrap();
            prop_assert!((Vector2::from(px) - seen).norm() < 1e-5);
            prop_assert!((diameter - 2.0 * alpha * lens.focal_px).abs() < 1e-5);
        }
    }

    #[test]
    fn the_outline_offset_equals_known_values() {
        // Ball of 0.11 m at 3 m and 10 m, 30 degrees off the axis, focal length of 1,400 px.
        let offset = |distance_m: f64| {
            outline_offset_px(1400.0, 30f64.to_radians(), libm::asin(0.11 / distance_m))
        };
        assert!((offset(3.0) - 1.45).abs() < 0.01);
        assert!((offset(10.0) - 0.13).abs() < 0.005);
        let (theta, alpha) = (0.4, 0.03);
        let ends = 0.5 * 1400.0 * (libm::tan(theta - alpha) + libm::tan(theta + alpha));
        let direct = ends - 1400.0 * libm::tan(theta);
        assert!((direct - outline_offset_px(1400.0, theta, alpha)).abs() < 1e-9);
    }
}
