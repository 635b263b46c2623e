//! OpenCV's rational distortion, and the radius up to which it is monotonic.

use nalgebra::{Matrix2, Vector2};

/// Smallest accepted stretch of the lens: distorted over undistorted length in the most squeezed
/// direction. Below it, rounding alone moves the inverse by more than 1e-9 px.
pub(super) const MIN_STRETCH: f64 = 1e-3;

/// Largest tangent of the angle to the optical axis at which a lens model is used (89 degrees).
const MAX_RADIUS: f64 = 57.0;

/// OpenCV's rational lens distortion (its documentation of `calib3d`), in normalised image
/// coordinates (x, y) = (X/Z, Y/Z), no unit.
///
/// ```text
///   x' = x g + 2 p1 x y + p2 (r2 + 2 x2)        g = (1 + k1 r2 + k2 r4 + k3 r6) / (1 + k4 r2 + k5 r4 + k6 r6)
///   y' = y g + p1 (r2 + 2 y2) + 2 p2 x y
/// ```
///
/// Its Jacobian is symmetric; where it is positive definite the model is monotonic.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial, second order; dimensionless, as all coefficients of OpenCV.
    pub k1: f64,
    /// Radial, fourth order; dimensionless.
    pub k2: f64,
    /// Tangential, vertical; dimensionless.
    pub p1: f64,
    /// Tangential, horizontal; dimensionless.
    pub p2: f64,
    /// Radial, sixth order; dimensionless.
    pub k3: f64,
    /// Radial, second order, of the denominator; dimensionless.
    pub k4: f64,
    /// Radial, fourth order, of the denominator; dimensionless.
    pub k5: f64,
    /// Radial, sixth order, of the denominator; dimensionless.
    pub k6: f64,
}

impl Distortion {
    pub(super) fn coefficients(&self) -> [f64; 8] {
        [
            self.k1, self.k2, self.p1, self.p2, self.k3, self.k4, self.k5, self.k6,
        ]
    }

    /// Whether the lens has no distortion.
    pub fn is_none(&self) -> bool {
        self.coefficients().iter().all(|&c| c == 0.0)
    }

    /// The factor g, its derivative by r2, and its denominator.
    pub(super) fn radial(&self, r2: f64) -> (f64, f64, f64) {
        let numerator = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let denominator = 1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6));
        let numerator_slope = self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3);
        let denominator_slope = self.k4 + r2 * (2.0 * self.k5 + r2 * 3.0 * self.k6);
        let g = numerator / denominator;
        (
            g,
            (numerator_slope - g * denominator_slope) / denominator,
            denominator,
        )
    }

    /// The distorted position of normalised (x, y), and its Jacobian.
    pub(super) fn apply(&self, p: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (p.x, p.y);
        let (g, slope, _) = self.radial(p.norm_squared());
        let tangential = Vector2::new(self.p2, self.p1);
        let along = tangential.dot(&p);
        let moved = p * (g + 2.0 * along) + tangential * p.norm_squared();
        let diagonal = g + 2.0 * along;
        let off = 2.0 * slope * x * y + 2.0 * (self.p2 * y + self.p1 * x);
        let jacobian = Matrix2::new(
            diagonal + 2.0 * slope * x * x + 4.0 * self.p2 * x,
            off,
            off,
            diagonal + 2.0 * slope * y * y + 4.0 * self.p1 * y,
        );
        (moved, jacobian)
    }

    /// Whether J - [`MIN_STRETCH`] I has a positive determinant on the whole circle of radius `r`.
    /// If this is so on every circle from 0 to `r`, the model is monotonic on that disc.
    ///
    /// At an angle with cosine c to the tangential vector q = |p| r, J is, in radial and tangential
    /// direction, ((a + 6 q c, 2 q s), (2 q s, b + 2 q c)) with a = d(r g)/dr and b = g.
    fn is_regular_at(&self, r: f64) -> bool {
        let (g, slope, denominator) = self.radial(r * r);
        let a = g + 2.0 * slope * r * r - MIN_STRETCH;
        let b = g - MIN_STRETCH;
        let q = libm::hypot(self.p1, self.p2) * r;
        let determinant =
            |c: f64| a * b - 4.0 * q * q + (2.0 * a + 6.0 * b) * q * c + 16.0 * q * q * c * c;
        let lowest = if q > 0.0 {
            (-(2.0 * a + 6.0 * b) / (32.0 * q)).clamp(-1.0, 1.0)
        } else {
            -1.0
        };
        denominator > 0.0 && a > 0.0 && b > 0.0 && determinant(lowest) > 0.0
    }

    /// The radius (tangent of the angle to the axis) up to which the model is monotonic.
    pub(super) fn monotonic_radius(&self) -> f64 {
        if self.is_none() {
            return f64::INFINITY;
        }
        let mut r = 0.0;
        while r < MAX_RADIUS {
            // Fine steps within the usual field of view, a hundredth of the radius beyond.
            let next = r + f64::max(0.001, 0.01 * (r - 2.0));
            if !self.is_regular_at(next) {
                return self.last_regular(r, next);
            }
            r = next;
        }
        MAX_RADIUS
    }

    fn last_regular(&self, mut good: f64, mut bad: f64) -> f64 {
        for _ in 0..40 {
            let middle = 0.5 * (good + bad);
            if self.is_regular_at(middle) {
                good = middle;
            } else {
                bad = middle;
            }
        }
        good
    }
}
