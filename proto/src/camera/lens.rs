//! Lens distortion, the radius up to which it is monotonic, and its inverse.

use nalgebra::{Matrix2, Vector2};

/// Least stretch of the lens, distorted over undistorted length in the direction that is squeezed
/// most, down to which the model counts as monotonic: at less, rounding alone moves the inverse by
/// more than 1e-9 px.
const MIN_STRETCH: f64 = 1e-3;

/// Largest tangent of the angle to the optical axis at which a lens model is used (89 degrees).
const MAX_RADIUS: f64 = 57.0;

/// OpenCV's rational lens distortion (its documentation of `calib3d`), in normalised image coordinates (x, y) =
/// (X/Z, Y/Z), no unit.
///
/// ```text
///   x' = x g + 2 p1 x y + p2 (r2 + 2 x2)        g = (1 + k1 r2 + k2 r4 + k3 r6) / (1 + k4 r2 + k5 r4 + k6 r6)
///   y' = y g + p1 (r2 + 2 y2) + 2 p2 x y
/// ```
///
/// Its Jacobian is symmetric; where it is positive definite the model is monotonic.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial, second order; dimensionless, as all of OpenCV's.
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

    /// Whether the lens is an ideal one.
    pub fn is_none(&self) -> bool {
        self.coefficients().iter().all(|&c| c == 0.0)
    }

    /// The factor g, its derivative by r2, and its denominator.
    fn radial(&self, r2: f64) -> (f64, f64, f64) {
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

    /// The distorted position of normalised (x, y), and the Jacobian there.
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

    /// Whether J - [`MIN_STRETCH`] I has a positive determinant all around the circle of radius
    /// `r`; on every circle from 0 to `r`, it makes the model monotonic on that disc.
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

/// A lens model with the region in which it may be used: the disc around the axis on which it is
/// monotonic. Without distortion that is the whole plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lens {
    distortion: Distortion,
    /// In focal lengths.
    monotonic_radius: f64,
}

impl Lens {
    pub(super) fn new(distortion: Distortion) -> Self {
        Self {
            distortion,
            monotonic_radius: distortion.monotonic_radius(),
        }
    }

    pub(super) fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Where the normalised point `p` is drawn; `None` outside the monotonic disc.
    pub(super) fn draw(&self, p: Vector2<f64>) -> Option<Vector2<f64>> {
        (p.norm() <= self.monotonic_radius).then(|| self.distortion.apply(p).0)
    }

    /// Where the last point in the direction of `p` that may be used is drawn.
    pub(super) fn rim(&self, p: Vector2<f64>) -> Vector2<f64> {
        let direction = p.try_normalize(1e-12).unwrap_or_else(Vector2::x);
        self.distortion.apply(direction * self.monotonic_radius).0
    }

    /// The point that is drawn at `target`, with a residual of at most `tolerance`.
    pub(super) fn undo(&self, target: Vector2<f64>, tolerance: f64) -> Option<Vector2<f64>> {
        // The target itself is the best start; the axis is the one from which every point can be
        // reached without leaving the disc.
        let from_axis = || self.solve(target, Vector2::zeros(), tolerance);
        self.solve(target, target, tolerance).or_else(from_axis)
    }

    /// Newton's method with the analytic Jacobian; steps are halved until they help and stay on
    /// the disc.
    fn solve(
        &self,
        target: Vector2<f64>,
        start: Vector2<f64>,
        tolerance: f64,
    ) -> Option<Vector2<f64>> {
        const MOST_STEPS: usize = 60;
        const MOST_HALVINGS: usize = 24;
        let inside = |p: &Vector2<f64>| p.norm() <= self.monotonic_radius;
        let mut p = if inside(&start) {
            start
        } else {
            Vector2::zeros()
        };
        let (mut drawn, mut jacobian) = self.distortion.apply(p);
        for _ in 0..MOST_STEPS {
            let residual = drawn - target;
            let step = solve_symmetric(&jacobian, &residual)?;
            if step.norm() <= f64::EPSILON * 0.5 * (1.0 + p.norm()) {
                break;
            }
            let mut share = 1.0;
            let better = (0..MOST_HALVINGS).find_map(|_| {
                let next = p - step * share;
                share *= 0.5;
                let (next_drawn, next_jacobian) = self.distortion.apply(next);
                let helps =
                    inside(&next) && (next_drawn - target).norm_squared() < residual.norm_squared();
                helps.then_some((next, next_drawn, next_jacobian))
            });
            // Nothing nearer: rounding is reached, or the point is not drawn at all.
            let Some(better) = better else { break };
            (p, drawn, jacobian) = better;
        }
        ((drawn - target).norm() <= tolerance).then_some(p)
    }
}

/// Solves the symmetric 2 x 2 system; `None` when it is singular.
fn solve_symmetric(m: &Matrix2<f64>, v: &Vector2<f64>) -> Option<Vector2<f64>> {
    let determinant = m.m11 * m.m22 - m.m12 * m.m21;
    let solved = Vector2::new(m.m22 * v.x - m.m12 * v.y, m.m11 * v.y - m.m21 * v.x) / determinant;
    (determinant != 0.0 && solved.iter().all(|s| s.is_finite())).then_some(solved)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_distortion() -> impl Strategy<Value = Distortion> {
        (prop::array::uniform8(-1.0f64..1.0), prop::bool::ANY).prop_map(|(c, rational)| {
            let denominator = f64::from(u8::from(rational));
            Distortion {
                k1: c[0],
                k2: c[1],
                p1: 0.05 * c[2],
                p2: 0.05 * c[3],
                k3: c[4],
                k4: c[5] * denominator,
                k5: c[6] * denominator,
                k6: c[7] * denominator,
            }
        })
    }

    fn at(radius: f64, angle: f64) -> Vector2<f64> {
        Vector2::new(libm::cos(angle), libm::sin(angle)) * radius
    }

    proptest! {
        #[test]
        fn the_jacobian_is_the_derivative(d in any_distortion(), radius in 0.0f64..0.7, angle in 0.0f64..7.0) {
            const STEP: f64 = 1e-6;
            let p = at(radius, angle);
            let (_, jacobian) = d.apply(p);
            prop_assume!(d.radial(radius * radius).2 > 0.2);
            for axis in 0..2 {
                let mut h = Vector2::zeros();
                h[axis] = STEP;
                let slope = (d.apply(p + h).0 - d.apply(p - h).0) / (2.0 * STEP);
                prop_assert!((slope - jacobian.column(axis)).norm() < 1e-5 * (1.0 + slope.norm()));
            }
        }

        #[test]
        fn the_model_is_monotonic_up_to_its_radius(
            d in any_distortion(), share in 0.0f64..1.0, angle in 0.0f64..7.0,
        ) {
            let lens = Lens::new(d);
            let p = at(share * lens.monotonic_radius, angle);
            let jacobian = d.apply(p).1;
            let least = jacobian.symmetric_eigenvalues().min();
            prop_assert!(least > 0.99 * MIN_STRETCH, "{least} at {p}");
        }

        #[test]
        fn what_is_drawn_comes_back(d in any_distortion(), share in 0.0f64..1.0, angle in 0.0f64..7.0) {
            let lens = Lens::new(d);
            let p = at(share * lens.monotonic_radius.min(10.0), angle);
            let drawn = lens.draw(p).unwrap_or_else(|| lens.rim(p));
            // 1e-9 px at a focal length of 1000 px; beside a pole a lens draws out of any image.
            let back = lens.undo(drawn, 1e-13);
            prop_assert!(drawn.norm() > 4.0 || back.is_some_and(|b| (b - p).norm() < 1e-12), "{p} {back:?}");
        }
    }
}
