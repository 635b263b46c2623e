//! Fits the circle that most points of an outline lie on, or an ellipse where the outline is blurred by motion.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// A round outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Round {
    pub(super) centre: Vector2<f64>,
    /// Geometric mean of the half axes.
    pub(super) radius: f64,
    /// Minor over major axis.
    pub(super) axes_ratio: f64,
    /// Share of the points that lie on it.
    pub(super) share: f64,
    /// Standard deviation of the centre along each axis, from the residuals of those points.
    pub(super) sigma: f64,
    /// Mean over all points of the squared ratio of distance to tolerance, each at most 1.
    cost: f64,
    /// Standard deviation of the distances of the points that lie on it, pixels.
    noise: f64,
}

/// Greatest distance of a point on the outline, pixels; the larger of both limits holds.
const ON_IT_PX: f64 = 0.5;
/// Greatest distance of a point on the outline, share of the radius.
const ON_IT_SHARE: f64 = 0.025;
/// Start positions of the triples of points that propose circles.
const STARTS: usize = 16;
/// A triple's points are a third, a quarter or a sixth of the outline apart.
const PARTS: [usize; 3] = [3, 4, 6];
/// Steps of the last fit.
const STEPS: usize = 6;
/// Tolerance of the last fit, standard deviations.
const SIGMAS: f64 = 3.0;
/// Least assumed noise of one point of an outline, pixels.
const LEAST_NOISE: f64 = 0.02;
/// Least minor over major axis of a ball blurred by motion.
const LEAST_AXES_RATIO: f64 = 0.7;
/// Least share of the points on an ellipse: no part of a blurred ball may be hidden.
const ELLIPSE_SHARE: f64 = 0.75;
/// Greatest cost of an ellipse over that of a circle, for the ellipse to be chosen.
const ELLIPSE_GAIN: f64 = 0.7;
/// Greatest noise of the points on an ellipse over that of the points on a circle. An ellipse can pass near all points of a
/// small circle that is partly hidden, but the visible points fit the circle far better. Of noisy points, a circle has only
/// those that happen to be near it, so its noise is underestimated.
const ELLIPSE_NOISE: f64 = 1.5;

/// The circle that most of `points` lie on, or the ellipse if it fits clearly better. `points` are in order around the outline.
/// `None` for fewer than eight.
pub(super) fn fit(points: &[Vector2<f64>]) -> Option<Round> {
    if points.len() < 8 {
        return None;
    }
    let circle = circle(points);
    let is_whole = circle.is_some_and(|it| it.cost < 0.1);
    if is_whole {
        return circle;
    }
    let ellipse = ellipse(points);
    match (circle, ellipse) {
        (Some(circle), Some(ellipse)) => {
            let is_better = ellipse.cost < ELLIPSE_GAIN * circle.cost
                && ellipse.noise <= ELLIPSE_NOISE * circle.noise;
            Some(if is_better { ellipse } else { circle })
        }
        (circle, ellipse) => circle.or(ellipse),
    }
}

fn tolerance(radius: f64) -> f64 {
    ON_IT_PX.max(ON_IT_SHARE * radius)
}

fn cost(points: &[Vector2<f64>], distance: impl Fn(&Vector2<f64>) -> f64, tolerance: f64) -> f64 {
    let each = points.iter().map(|p| {
        let d = distance(p) / tolerance;
        (d * d).min(1.0)
    });
    each.sum::<f64>() / points.len() as f64
}

/// Standard deviation of distances from a curve of `parameters` parameters.
fn noise(distances: &[f64], parameters: f64) -> f64 {
    let squares: f64 = distances.iter().map(|d| d * d).sum();
    let freedom = (distances.len() as f64 - parameters).max(1.0);
    (squares / freedom).sqrt().max(LEAST_NOISE)
}

fn circle(points: &[Vector2<f64>]) -> Option<Round> {
    let n = points.len();
    let mut best: Option<(f64, Vector2<f64>, f64)> = None;
    for start in 0..STARTS {
        let first = start * n / STARTS;
        for part in PARTS {
            let at = |index: usize| points.get(index % n);
            let (Some(a), Some(b), Some(c)) =
                (at(first), at(first + n / part), at(first + 2 * n / part))
            else {
                continue;
            };
            let Some((centre, radius)) = circle_through(a, b, c) else {
                continue;
            };
            let off = |p: &Vector2<f64>| (p - centre).norm() - radius;
            let cost = cost(points, off, tolerance(radius));
            if best.is_none_or(|(least, _, _)| cost < least) {
                best = Some((cost, centre, radius));
            }
        }
    }
    let (_, centre, radius) = best?;
    refined(points, centre, radius)
}

/// Least squares over the points near the circle, with their distances to it as residuals.
fn refined(points: &[Vector2<f64>], mut centre: Vector2<f64>, mut radius: f64) -> Option<Round> {
    let mut near = tolerance(radius);
    let mut sigma = 0.0;
    for _ in 0..STEPS {
        let mut matrix = Matrix3::zeros();
        let mut right = Vector3::zeros();
        let (mut squares, mut count) = (0.0, 0.0);
        for p in points {
            let arm = p - centre;
            let length = arm.norm();
            let residual = length - radius;
            if residual.abs() > near || length <= 0.0 {
                continue;
            }
            let row = Vector3::new(arm.x / length, arm.y / length, 1.0);
            matrix += row * row.transpose();
            right += row * residual;
            squares += residual * residual;
            count += 1.0;
        }
        if count < 6.0 {
            return None;
        }
        let solved = matrix.cholesky()?;
        let step = solved.solve(&right);
        centre += Vector2::new(step.x, step.y);
        radius += step.z;
        let noise = (squares / (count - 3.0)).sqrt().max(LEAST_NOISE);
        let inverse = solved.inverse();
        sigma = noise * (0.5 * (inverse[(0, 0)] + inverse[(1, 1)])).sqrt();
        near = (SIGMAS * noise).clamp(0.3 * tolerance(radius), tolerance(radius));
    }
    let off = |p: &Vector2<f64>| (p - centre).norm() - radius;
    let limit = tolerance(radius);
    let on_it: Vec<f64> = points
        .iter()
        .map(off)
        .filter(|d| d.abs() <= limit)
        .collect();
    (radius > 0.0 && radius.is_finite()).then(|| Round {
        centre,
        radius,
        axes_ratio: 1.0,
        share: on_it.len() as f64 / points.len() as f64,
        sigma,
        cost: cost(points, off, limit),
        noise: noise(&on_it, 3.0),
    })
}

/// Centre and radius of the circle through three points; `None` if they are on a line.
pub(super) fn circle_through(
    a: &Vector2<f64>,
    b: &Vector2<f64>,
    c: &Vector2<f64>,
) -> Option<(Vector2<f64>, f64)> {
    let (p, q) = (b - a, c - a);
    let twice_area = p.perp(&q);
    if twice_area.abs() < 1e-6 * (p.norm_squared() + q.norm_squared()) {
        return None;
    }
    let (pp, qq) = (p.norm_squared(), q.norm_squared());
    let centre = Vector2::new(q.y * pp - p.y * qq, p.x * qq - q.x * pp) / (2.0 * twice_area);
    Some((a + centre, centre.norm()))
}

/// The ellipse of least squared algebraic distance, fitted to all points and again to those near it.
fn ellipse(points: &[Vector2<f64>]) -> Option<Round> {
    let mut kept: Vec<Vector2<f64>> = points.to_vec();
    for round in 0..2 {
        let found = algebraic(&kept)?;
        let radius = (found.half_axes[0] * found.half_axes[1]).sqrt();
        let ratio = found.half_axes[1] / found.half_axes[0];
        if ratio.is_nan() || ratio < LEAST_AXES_RATIO {
            return None;
        }
        let limit = tolerance(radius);
        if round == 0 {
            kept.retain(|p| found.distance(p).abs() <= 2.0 * limit);
            if kept.len() < 10 {
                return None;
            }
            continue;
        }
        let off = |p: &Vector2<f64>| found.distance(p);
        let on_it: Vec<f64> = points
            .iter()
            .map(off)
            .filter(|d| d.abs() <= limit)
            .collect();
        let share = on_it.len() as f64 / points.len() as f64;
        let noise = noise(&on_it, 5.0);
        return (share >= ELLIPSE_SHARE).then(|| Round {
            centre: found.centre,
            radius,
            axes_ratio: ratio,
            share,
            // Of points all around, half of each squared distance is along either axis.
            sigma: noise * (2.0 / on_it.len() as f64).sqrt(),
            cost: cost(points, off, limit),
            noise,
        });
    }
    None
}

struct Ellipse {
    centre: Vector2<f64>,
    /// Major half axis first.
    half_axes: [f64; 2],
    /// Q in (p - centre)' Q (p - centre) = 1.
    form: Matrix2<f64>,
}

impl Ellipse {
    /// Distance along the ray from the centre, corrected to first order to that along the normal.
    fn distance(&self, p: &Vector2<f64>) -> f64 {
        let arm = p - self.centre;
        let along = (arm.dot(&(self.form * arm))).sqrt();
        let slope = (self.form * arm).norm() / along.max(1e-9);
        (along - 1.0) / slope.max(1e-12)
    }
}

/// Solves a x^2 + b x y + c y^2 + d x + e y = 1, about the mean of the points and in units of their spread.
fn algebraic(points: &[Vector2<f64>]) -> Option<Ellipse> {
    let n = points.len() as f64;
    let middle = points.iter().fold(Vector2::zeros(), |s, p| s + p) / n;
    let spread = (points
        .iter()
        .map(|p| (p - middle).norm_squared())
        .sum::<f64>()
        / n)
        .sqrt();
    if spread <= 0.0 {
        return None;
    }
    let mut matrix = SMatrix::<f64, 5, 5>::zeros();
    let mut right = SVector::<f64, 5>::zeros();
    for p in points {
        let at = (p - middle) / spread;
        let (x, y) = (at.x, at.y);
        let row = SVector::<f64, 5>::from([x * x, x * y, y * y, x, y]);
        matrix += row * row.transpose();
        right += row;
    }
    let [a, b, c, d, e]: [f64; 5] = matrix.cholesky()?.solve(&right).into();
    let quadratic = Matrix2::new(a, 0.5 * b, 0.5 * b, c);
    let linear = Vector2::new(d, e);
    let centre = quadratic.try_inverse()? * linear * -0.5;
    let level = 1.0 + centre.dot(&(quadratic * centre));
    let form = quadratic / level;
    let eigen = form.symmetric_eigenvalues();
    let (low, high) = (eigen.min(), eigen.max());
    (low > 0.0).then(|| Ellipse {
        centre: middle + centre * spread,
        half_axes: [spread / low.sqrt(), spread / high.sqrt()],
        form: form / (spread * spread),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn around(count: usize, at: impl Fn(f64) -> Vector2<f64>) -> Vec<Vector2<f64>> {
        let turns = (0..count).map(|i| std::f64::consts::TAU * i as f64 / count as f64);
        turns.map(at).collect()
    }

    /// Points of an ellipse about (x, 0), each moved outward by `off`.
    fn smeared(
        x: f64,
        r: f64,
        ratio: f64,
        turn: f64,
        off: impl Fn(usize) -> f64,
    ) -> Vec<Vector2<f64>> {
        let ellipse = around(50, |t| {
            let (u, v) = (r * libm::cos(t), ratio * r * libm::sin(t));
            let (c, s) = (libm::cos(turn), libm::sin(turn));
            Vector2::new(c * u - s * v, s * u + c * v)
        });
        let moved = ellipse.iter().enumerate();
        moved
            .map(|(i, arm)| Vector2::new(x, 0.0) + arm + arm.normalize() * off(i))
            .collect()
    }

    proptest! {
        #[test]
        fn partly_hidden_circles_are_recovered(
            x in -5.0f64..5.0, y in -5.0f64..5.0, r in 4.0f64..60.0, hidden in 0.0f64..0.35,
        ) {
            let points = around(60, |t| {
                let depth = if t < hidden * std::f64::consts::TAU { 0.6 } else { 1.0 };
                Vector2::new(x + depth * r * libm::cos(t), y + depth * r * libm::sin(t))
            });
            let found = fit(&points).unwrap();
            prop_assert!((found.centre - Vector2::new(x, y)).norm() < 0.02, "{:?}", found);
            prop_assert!((found.radius - r).abs() < 0.02);
        }

        #[test]
        fn blurred_outlines_keep_their_middle(
            x in -5.0f64..5.0, r in 5.0f64..60.0, ratio in 0.72f64..0.9, turn in 0.0f64..3.0,
        ) {
            let found = fit(&smeared(x, r, ratio, turn, |_| 0.0)).unwrap();
            prop_assert!((found.centre - Vector2::new(x, 0.0)).norm() < 0.05 + 0.01 * r, "{:?}", found);
        }
    }

    /// A circle through noisy points has those that happen to be near it, and thus little noise.
    #[test]
    fn noisy_blurred_outlines_are_mostly_recognised() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        // 0.29 px at one standard deviation.
        let mut noise_px = || rng.random_range(-0.5..0.5);
        for r in [6.0, 10.0, 20.0] {
            let is_found = |turn: u32| {
                let noise: Vec<f64> = (0..50).map(|_| noise_px()).collect();
                let found =
                    fit(&smeared(0.0, r, 0.75, 0.03 * f64::from(turn), |i| noise[i])).unwrap();
                found.axes_ratio < 0.9 && found.centre.norm() < 0.5
            };
            let found = (0..100).map(is_found).filter(|found| *found).count();
            println!("of 100 blurred balls of {r} px, with noise: {found} recognised");
            assert!(found >= 90, "{found} of 100 at {r} px");
        }
    }

    /// An ellipse passes within half a pixel of nine tenths of these points.
    #[test]
    fn a_small_circle_with_a_hidden_third_is_not_an_ellipse() {
        let points = around(60, |t| {
            let depth = if t < 0.336 * std::f64::consts::TAU {
                0.6
            } else {
                1.0
            };
            Vector2::new(libm::cos(t), libm::sin(t)) * (4.0 * depth)
        });
        let found = fit(&points).unwrap();
        assert!(found.centre.norm() < 0.02, "{found:?}");
        assert!((found.radius - 4.0).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn a_square_is_not_round() {
        let points = around(60, |t| {
            let (c, s) = (libm::cos(t), libm::sin(t));
            Vector2::new(c, s) * (20.0 / c.abs().max(s.abs()))
        });
        assert!(fit(&points).unwrap().share < 0.6);
    }
}
