//! OpenCV's fisheye lens (Kannala and Brandt 2006), and the used part of its view.
//!
//! Theta is the angle between a line of sight and the optical axis. An ideal pinhole draws the line
//! at the radius r = tan(theta), in focal lengths. The lens draws it in the same direction at the
//! radius
//!
//! ```text
//!   theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
//! ```
//!
//! Source: OpenCV's documentation of `calib3d`, fisheye model. A fisheye may see more than a
//! half-space, but an ideal pinhole cannot: r grows without bound towards 90 degrees. All
//! computations use pixels of the pinhole, so only the view up to [`FISHEYE_HALF_VIEW_RAD`] off the
//! axis is used. There a pixel of the picture covers four pinhole pixels along the radius and two
//! across it. Farther out, crops would contain very few pixels.

use std::f64::consts::{FRAC_PI_3, PI};

use nalgebra::{Matrix2, Vector2};

use super::rational::MIN_STRETCH;

/// The used part of a fisheye's view, radians off its axis: 60 degrees, so 120 degrees of view.
pub const FISHEYE_HALF_VIEW_RAD: f64 = FRAC_PI_3;

/// The drawn part of a fisheye's view, radians off its axis (80 degrees).
pub(super) const DRAWN_HALF_VIEW_RAD: f64 = 80.0 * PI / 180.0;

/// Below this radius theta / r is 1 to the last bit.
const AXIS_RADIUS: f64 = 1e-8;

/// Step of the angles at which the model is tested for monotonicity, radians.
const STEP_RAD: f64 = 1e-3;

/// The drawn radius at the angle `theta`, and its derivative.
fn drawn_radius(k: &[f64; 4], theta: f64) -> (f64, f64) {
    let [k1, k2, k3, k4] = *k;
    let t2 = theta * theta;
    let drawn = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
    let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
    (drawn, slope)
}

/// The drawn position of normalised (x, y).
pub(super) fn draw(k: &[f64; 4], p: Vector2<f64>) -> Vector2<f64> {
    let r = p.norm();
    if r < AXIS_RADIUS {
        return p;
    }
    p * (drawn_radius(k, libm::atan(r)).0 / r)
}

/// The drawn position of normalised (x, y), and its Jacobian, which is symmetric.
pub(super) fn apply(k: &[f64; 4], p: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let r = p.norm();
    if r < AXIS_RADIUS {
        return (p, Matrix2::identity());
    }
    let (drawn, slope) = drawn_radius(k, libm::atan(r));
    let (along, across) = (slope / (1.0 + r * r), drawn / r);
    let u = p / r;
    let jacobian = Matrix2::identity() * across + u * u.transpose() * (along - across);
    (p * across, jacobian)
}

/// The radius (tangent of the angle to the axis) up to which the model is monotonic, limited to the
/// drawn part.
pub(super) fn monotonic_radius(k: &[f64; 4]) -> f64 {
    let is_regular = |theta: f64| {
        let (drawn, slope) = drawn_radius(k, theta);
        let r = libm::tan(theta);
        slope > MIN_STRETCH * (1.0 + r * r) && drawn > MIN_STRETCH * r
    };
    let mut theta = 0.0;
    while theta + STEP_RAD <= DRAWN_HALF_VIEW_RAD {
        if !is_regular(theta + STEP_RAD) {
            return libm::tan(theta);
        }
        theta += STEP_RAD;
    }
    libm::tan(DRAWN_HALF_VIEW_RAD)
}

/// The point within `most_radius` that is drawn at `target`, with a residual of at most
/// `tolerance`.
pub(super) fn undo(
    k: &[f64; 4],
    target: Vector2<f64>,
    most_radius: f64,
    tolerance: f64,
) -> Option<Vector2<f64>> {
    const MOST_STEPS: usize = 60;
    let wanted = target.norm();
    if wanted < AXIS_RADIUS {
        return Some(target);
    }
    // The drawn radius rises from 0 to that of the rim. The interval is narrowed by Newton steps
    // that stay inside it.
    let (mut low, mut high) = (0.0, libm::atan(most_radius));
    let mut theta = wanted.min(high);
    for _ in 0..MOST_STEPS {
        let (drawn, slope) = drawn_radius(k, theta);
        let missed = drawn - wanted;
        if missed > 0.0 {
            high = theta;
        } else {
            low = theta;
        }
        let next = theta - missed / slope;
        let next = if (low..=high).contains(&next) {
            next
        } else {
            0.5 * (low + high)
        };
        if (next - theta).abs() <= f64::EPSILON * theta {
            break;
        }
        theta = next;
    }
    let missed = (drawn_radius(k, theta).0 - wanted).abs();
    (missed <= tolerance).then(|| target * (libm::tan(theta) / wanted))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Coefficients of typical fits, and stronger ones.
    fn any_lens() -> impl Strategy<Value = [f64; 4]> {
        prop::array::uniform4(-0.15f64..0.15)
    }

    fn at(radius: f64, angle: f64) -> Vector2<f64> {
        Vector2::new(libm::cos(angle), libm::sin(angle)) * radius
    }

    proptest! {
        #[test]
        fn the_jacobian_is_the_derivative(k in any_lens(), radius in 0.0f64..5.0, angle in 0.0f64..7.0) {
            const STEP: f64 = 1e-6;
            let p = at(radius, angle);
            let (drawn, jacobian) = apply(&k, p);
            prop_assert!((drawn - draw(&k, p)).norm() < 1e-15);
            for axis in 0..2 {
                let mut h = Vector2::zeros();
                h[axis] = STEP;
                let slope = (draw(&k, p + h) - draw(&k, p - h)) / (2.0 * STEP);
                prop_assert!((slope - jacobian.column(axis)).norm() < 1e-7 * (1.0 + slope.norm()));
            }
        }

        #[test]
        fn the_model_is_monotonic_up_to_its_radius(k in any_lens(), share in 0.0f64..1.0, angle in 0.0f64..7.0) {
            let jacobian = apply(&k, at(share * monotonic_radius(&k), angle)).1;
            let least = jacobian.symmetric_eigenvalues().min();
            prop_assert!(least > 0.5 * MIN_STRETCH, "{least}");
        }

        #[test]
        fn drawn_points_are_recovered(k in any_lens(), share in 0.0f64..1.0, angle in 0.0f64..7.0) {
            let most = monotonic_radius(&k);
            let p = at(share * most, angle);
            let back = undo(&k, draw(&k, p), most, 1e-13);
            // An angle with one rounding error gives a radius with as many as the lens squeezes it.
            let tolerance = 1e-14 * (1.0 + p.norm_squared()) / MIN_STRETCH.max(drawn_radius(&k, libm::atan(p.norm())).1);
            prop_assert!(back.is_some_and(|b| (b - p).norm() < tolerance.max(1e-13)), "{p} {back:?}");
        }

        #[test]
        fn points_drawn_beyond_the_rim_are_not_recovered(k in any_lens(), angle in 0.0f64..7.0) {
            let most = monotonic_radius(&k).min(1.5);
            let rim = draw(&k, at(most, angle));
            prop_assert_eq!(undo(&k, rim * 1.001, most, 1e-13), None);
        }
    }
}
