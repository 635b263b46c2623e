//! Projection of a point by a camera, with derivatives by all parameters.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, SMatrix, UnitQuaternion, Vector2, Vector3};

use super::camera_state::CameraState;

/// Number of a camera's parameters, in this order: rotation (3, rad), centre (3, m), focal length (relative), principal point
/// (2, px), distortion (8), time (s), rate (relative to the period).
pub const PARAMETERS: usize = 19;

/// Index of the time among the parameters; the rate follows.
pub(super) const TIME: usize = 17;

/// Points closer than this, in units of the world, are not projected.
const NEAR: f64 = 1e-6;

/// Least derivative of the distorted radius by that of the pinhole.
const LEAST_SLOPE: f64 = 0.02;

/// Step of the search for the fold, at the axis.
const FOLD_STEP: f64 = 0.005;

/// Largest angle off the axis of a fisheye, radians (80 degrees): points farther out have extremely large coordinates in the
/// ideal pinhole.
const FISHEYE_HALF_VIEW_RAD: f64 = 80.0 * std::f64::consts::PI / 180.0;

/// Most steps of the inverse of the lens.
const MOST_NEWTON_STEPS: usize = 40;
/// Accuracy of the inverse of the lens, in focal lengths.
const UNDISTORTED: f64 = 1e-12;

/// A projection with its derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    /// Distorted pixels.
    pub px: Vector2<f64>,
    /// By the world point, px/m.
    pub by_point: Matrix2x3<f64>,
    /// By the camera's parameters; zero for time and rate, which act through the path.
    pub by_camera: SMatrix<f64, 2, PARAMETERS>,
}

impl CameraState {
    /// The distorted pixel of `point_w`; `None` behind the camera, or where the lens model folds.
    pub fn project(&self, point_w: &Vector3<f64>, fold_radius: f64) -> Option<Vector2<f64>> {
        let (n, _) = self.normalised(point_w, fold_radius)?;
        let (drawn, _) = self.draw(&n);
        Some(self.pixel_of(&drawn))
    }

    /// As [`Self::project`], with derivatives.
    pub fn project_with_derivatives(
        &self,
        point_w: &Vector3<f64>,
        fold_radius: f64,
    ) -> Option<Projected> {
        let (n, point_c) = self.normalised(point_w, fold_radius)?;
        let (drawn, by_normalised) = self.draw(&n);
        let focal = Matrix2::new(self.intrinsics.fx_px, 0.0, 0.0, self.intrinsics.fy_px);
        let depth = point_c.z;
        let pinhole = Matrix2x3::new(1.0, 0.0, -n.x, 0.0, 1.0, -n.y) / depth;
        let by_point_c = focal * by_normalised * pinhole;
        let rotation = self.camera_from_world.to_rotation_matrix();
        let by_point = by_point_c * rotation.matrix();
        let mut by_camera = SMatrix::<f64, 2, PARAMETERS>::zeros();
        by_camera
            .fixed_view_mut::<2, 3>(0, 0)
            .copy_from(&(-by_point_c * cross_matrix(&point_c)));
        by_camera.fixed_view_mut::<2, 3>(0, 3).copy_from(&-by_point);
        by_camera.set_column(6, &(focal * drawn));
        by_camera[(0, 7)] = 1.0;
        by_camera[(1, 8)] = 1.0;
        by_camera
            .fixed_view_mut::<2, 8>(0, 9)
            .copy_from(&(focal * self.by_coefficients(&n)));
        Some(Projected {
            px: self.pixel_of(&drawn),
            by_point,
            by_camera,
        })
    }

    /// The state after `step`, in the order and units of [`PARAMETERS`].
    #[must_use]
    pub fn moved(&self, step: &[f64; PARAMETERS]) -> Self {
        let mut moved = *self;
        let turn = Vector3::new(step[0], step[1], step[2]);
        moved.camera_from_world = UnitQuaternion::from_scaled_axis(turn) * self.camera_from_world;
        moved.camera_from_world.renormalize();
        moved.center_w += Vector3::new(step[3], step[4], step[5]);
        let focal = libm::exp(step[6]);
        moved.intrinsics.fx_px *= focal;
        moved.intrinsics.fy_px *= focal;
        moved.intrinsics.cx_px += step[7];
        moved.intrinsics.cy_px += step[8];
        for (coefficient, by) in moved.distortion.iter_mut().zip(&step[9..17]) {
            *coefficient += by;
        }
        moved.pivot_s += step[TIME];
        moved.period_s *= libm::exp(step[TIME + 1]);
        moved
    }

    /// The difference from `start` in the parameters; zero for the pose, which has no prior.
    pub(super) fn distance_from(&self, start: &Self) -> [f64; PARAMETERS] {
        let mut d = [0.0; PARAMETERS];
        d[6] = libm::log(self.intrinsics.fx_px / start.intrinsics.fx_px);
        d[7] = self.intrinsics.cx_px - start.intrinsics.cx_px;
        d[8] = self.intrinsics.cy_px - start.intrinsics.cy_px;
        for i in 0..8 {
            d[9 + i] = self.distortion[i] - start.distortion[i];
        }
        d[TIME] = self.pivot_s - start.pivot_s;
        d[TIME + 1] = libm::log(self.period_s / start.period_s);
        d
    }

    /// The radius (tangent of the angle to the axis) at which the lens model folds, or 50 if it does not fold before; for a
    /// fisheye at most that of 80 degrees.
    pub fn fold_radius(&self) -> f64 {
        if self.is_fisheye {
            return self.fisheye_fold_radius();
        }
        if self.distortion.iter().all(|c| *c == 0.0) {
            return 1e6;
        }
        let mut r = 0.0;
        let mut last = 0.0;
        while r < 50.0 {
            let next = r + FOLD_STEP * (1.0 + r);
            let (g, _, denominator) = self.radial(next * next);
            if denominator <= 0.0 || next * g - last < LEAST_SLOPE * (next - r) {
                return r;
            }
            last = next * g;
            r = next;
        }
        r
    }

    fn fisheye_fold_radius(&self) -> f64 {
        let mut theta = 0.0;
        let mut last = 0.0;
        while theta < FISHEYE_HALF_VIEW_RAD {
            let next = f64::min(theta + FOLD_STEP, FISHEYE_HALF_VIEW_RAD);
            let drawn = self.draw(&Vector2::new(libm::tan(next), 0.0)).0.x;
            if drawn - last < LEAST_SLOPE * (next - theta) {
                break;
            }
            (theta, last) = (next, drawn);
        }
        libm::tan(theta)
    }

    /// The direction of `px`, a unit vector in camera axes; `None` if the lens model folds before it reaches the pixel.
    pub fn bearing(&self, px: [f64; 2], fold_radius: f64) -> Option<Vector3<f64>> {
        let i = &self.intrinsics;
        let target = Vector2::new((px[0] - i.cx_px) / i.fx_px, (px[1] - i.cy_px) / i.fy_px);
        let mut n = target;
        if self.is_fisheye {
            // Start from the angle: with the pinhole's radius the steps near the rim would be long.
            let theta = f64::min(target.norm(), libm::atan(0.9 * fold_radius));
            n *= libm::tan(theta) / target.norm().max(f64::MIN_POSITIVE);
        }
        if n.norm() > 0.9 * fold_radius {
            n *= 0.9 * fold_radius / n.norm();
        }
        let mut missed = self.draw(&n).0 - target;
        for _ in 0..MOST_NEWTON_STEPS {
            if missed.norm() < UNDISTORTED {
                return Some(Vector3::new(n.x, n.y, 1.0).normalize());
            }
            let mut step = self.draw(&n).1.try_inverse()? * missed;
            let better = (0..20).find_map(|_| {
                let next = n - step;
                step *= 0.5;
                let next_missed = self.draw(&next).0 - target;
                let helps = next.norm() <= fold_radius && next_missed.norm() < missed.norm();
                helps.then_some((next, next_missed))
            });
            (n, missed) = better?;
        }
        None
    }

    fn normalised(
        &self,
        point_w: &Vector3<f64>,
        fold_radius: f64,
    ) -> Option<(Vector2<f64>, Vector3<f64>)> {
        let point_c = self.camera_from_world * (point_w - self.center_w);
        if point_c.z <= NEAR {
            return None;
        }
        let n = Vector2::new(point_c.x / point_c.z, point_c.y / point_c.z);
        (n.norm_squared() <= fold_radius * fold_radius).then_some((n, point_c))
    }

    fn pixel_of(&self, drawn: &Vector2<f64>) -> Vector2<f64> {
        let i = &self.intrinsics;
        Vector2::new(i.fx_px * drawn.x + i.cx_px, i.fy_px * drawn.y + i.cy_px)
    }

    /// The radial factor, its derivative by r2 and its denominator.
    fn radial(&self, r2: f64) -> (f64, f64, f64) {
        let [k1, k2, _, _, k3, k4, k5, k6] = self.distortion;
        let numerator = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let denominator = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let g = numerator / denominator;
        let rise = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);
        let fall = k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6);
        (g, (rise - g * fall) / denominator, denominator)
    }

    /// OpenCV's lens (documentation of `calib3d`) on normalised coordinates, and its Jacobian.
    fn draw(&self, n: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        if self.is_fisheye {
            return self.lens().draw_with_jacobian(*n);
        }
        let [_, _, p1, p2, ..] = self.distortion;
        let (x, y, r2) = (n.x, n.y, n.norm_squared());
        let (g, slope, _) = self.radial(r2);
        let drawn = Vector2::new(
            x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let off = 2.0 * slope * x * y + 2.0 * (p1 * x + p2 * y);
        let jacobian = Matrix2::new(
            g + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            off,
            off,
            g + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (drawn, jacobian)
    }

    /// Derivatives of [`Self::draw`] by the eight coefficients.
    fn by_coefficients(&self, n: &Vector2<f64>) -> SMatrix<f64, 2, 8> {
        let (x, y, r2) = (n.x, n.y, n.norm_squared());
        if self.is_fisheye {
            return by_fisheye_coefficients(n);
        }
        let (g, _, denominator) = self.radial(r2);
        let powers = [r2, r2 * r2, r2 * r2 * r2];
        let mut by = SMatrix::<f64, 2, 8>::zeros();
        for (power, (above, below)) in powers.into_iter().zip([(0, 5), (1, 6), (4, 7)]) {
            by.set_column(above, &(n * (power / denominator)));
            by.set_column(below, &(n * (-g * power / denominator)));
        }
        by.set_column(2, &Vector2::new(2.0 * x * y, r2 + 2.0 * y * y));
        by.set_column(3, &Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y));
        by
    }
}

/// The powers 3, 5, 7, 9 of the angle in the direction of `n`; zero for the last four coefficients.
fn by_fisheye_coefficients(n: &Vector2<f64>) -> SMatrix<f64, 2, 8> {
    let mut by = SMatrix::<f64, 2, 8>::zeros();
    let Some(direction) = n.try_normalize(1e-12) else {
        return by;
    };
    let theta = libm::atan(n.norm());
    let mut power = theta;
    for coefficient in 0..4 {
        power *= theta * theta;
        by.set_column(coefficient, &(direction * power));
    }
    by
}

fn cross_matrix(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}
