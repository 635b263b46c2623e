//! The two supported lens models, and a lens with its valid region and its inverse.

use nalgebra::{Matrix2, Vector2};

use super::fisheye::{self, FISHEYE_HALF_VIEW_RAD};
use super::rational::Distortion;

/// A lens model with its valid regions: discs around the axis on which it is monotonic. Without
/// distortion this is the whole plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lens {
    model: LensModel,
    /// Radius of the used part of the view, in focal lengths of an ideal pinhole.
    used_radius: f64,
    /// Radius of the drawn part of the view: larger than the used part for a fisheye, equal for
    /// other lenses.
    drawn_radius: f64,
}

/// A part of the view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ViewPart {
    /// The used part.
    Used,
    /// The drawn part.
    Drawn,
}

impl Lens {
    pub(super) fn new(model: LensModel) -> Self {
        let (used_radius, drawn_radius) = match &model {
            LensModel::Rational(distortion) => {
                let monotonic = distortion.monotonic_radius();
                (monotonic, monotonic)
            }
            LensModel::KannalaBrandt(k) => {
                let monotonic = fisheye::monotonic_radius(k);
                (monotonic.min(libm::tan(FISHEYE_HALF_VIEW_RAD)), monotonic)
            }
        };
        Self {
            model,
            used_radius,
            drawn_radius,
        }
    }

    pub(super) fn model(&self) -> &LensModel {
        &self.model
    }

    fn radius(&self, part: ViewPart) -> f64 {
        match part {
            ViewPart::Used => self.used_radius,
            ViewPart::Drawn => self.drawn_radius,
        }
    }

    /// The drawn position of the normalised point `p`; `None` outside `part`.
    pub(super) fn draw(&self, p: Vector2<f64>, part: ViewPart) -> Option<Vector2<f64>> {
        (p.norm() <= self.radius(part)).then(|| self.apply(p))
    }

    fn apply(&self, p: Vector2<f64>) -> Vector2<f64> {
        match &self.model {
            LensModel::Rational(distortion) => distortion.apply(p).0,
            LensModel::KannalaBrandt(k) => fisheye::draw(k, p),
        }
    }

    /// The drawn position of the last used point in the direction of `p`.
    pub(super) fn rim(&self, p: Vector2<f64>) -> Vector2<f64> {
        let direction = p.try_normalize(1e-12).unwrap_or_else(Vector2::x);
        self.apply(direction * self.used_radius)
    }

    /// The point of `part` that is drawn at `target`, with a residual of at most `tolerance`.
    pub(super) fn undo(
        &self,
        target: Vector2<f64>,
        part: ViewPart,
        tolerance: f64,
    ) -> Option<Vector2<f64>> {
        match &self.model {
            LensModel::Rational(distortion) => {
                // The target itself is the best start. From the axis every point can be reached
                // without leaving the disc.
                let from_axis = || self.solve(distortion, target, Vector2::zeros(), tolerance);
                self.solve(distortion, target, target, tolerance)
                    .or_else(from_axis)
            }
            LensModel::KannalaBrandt(k) => fisheye::undo(k, target, self.radius(part), tolerance),
        }
    }

    /// Whether the model describes the point drawn at `target`, or that point is not used. A
    /// fisheye that is monotonic in its used part draws all other points farther out.
    pub(super) fn accounts_for(&self, target: Vector2<f64>, tolerance: f64) -> bool {
        let is_cut = self.model.is_fisheye() && self.used_radius < self.drawn_radius;
        is_cut || self.undo(target, ViewPart::Used, tolerance).is_some()
    }

    /// Whether `p` is within the used part of a fisheye.
    pub(super) fn is_within_view(&self, p: Vector2<f64>) -> bool {
        !self.model.is_fisheye() || p.norm() <= self.used_radius
    }

    /// Moves `p` to the rim of a fisheye's used part if it is beyond it. Other lenses end at the
    /// edge of their pictures.
    pub(super) fn within_view(&self, p: Vector2<f64>) -> Vector2<f64> {
        if self.is_within_view(p) {
            p
        } else {
            p * (self.used_radius / p.norm())
        }
    }

    /// Newton's method with the analytic Jacobian; steps are halved until they improve and stay on
    /// the disc.
    fn solve(
        &self,
        distortion: &Distortion,
        target: Vector2<f64>,
        start: Vector2<f64>,
        tolerance: f64,
    ) -> Option<Vector2<f64>> {
        const MOST_STEPS: usize = 60;
        const MOST_HALVINGS: usize = 24;
        let inside = |p: &Vector2<f64>| p.norm() <= self.used_radius;
        let mut p = if inside(&start) {
            start
        } else {
            Vector2::zeros()
        };
        let (mut drawn, mut jacobian) = distortion.apply(p);
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
                let (next_drawn, next_jacobian) = distortion.apply(next);
                let helps =
                    inside(&next) && (next_drawn - target).norm_squared() < residual.norm_squared();
                helps.then_some((next, next_drawn, next_jacobian))
            });
            // No improvement: the rounding limit is reached, or the point is not drawn.
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

/// A lens model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LensModel {
    /// OpenCV's rational model with tangential terms.
    Rational(Distortion),
    /// Kannala and Brandt 2006 as in OpenCV's `fisheye`, k1 to k4. A point at the angle theta to
    /// the axis is drawn at the radius theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4
    /// theta^8), in focal lengths.
    KannalaBrandt([f64; 4]),
}

impl From<Distortion> for LensModel {
    fn from(distortion: Distortion) -> Self {
        Self::Rational(distortion)
    }
}

impl From<&Distortion> for LensModel {
    fn from(distortion: &Distortion) -> Self {
        Self::Rational(*distortion)
    }
}

impl LensModel {
    /// A lens without distortion.
    pub fn ideal() -> Self {
        Self::Rational(Distortion::default())
    }

    /// Whether the lens has no distortion.
    pub fn is_none(&self) -> bool {
        match self {
            Self::Rational(distortion) => distortion.is_none(),
            Self::KannalaBrandt(_) => false,
        }
    }

    /// Whether it is the fisheye model.
    #[inline]
    pub fn is_fisheye(&self) -> bool {
        matches!(self, Self::KannalaBrandt(_))
    }

    /// In OpenCV's order: 4 coefficients of the fisheye model, else 5, or 8 if the denominator is
    /// used.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::KannalaBrandt(k) => k.to_vec(),
            Self::Rational(d) => {
                let mut all = vec![d.k1, d.k2, d.p1, d.p2, d.k3];
                if [d.k4, d.k5, d.k6].iter().any(|&k| k != 0.0) {
                    all.extend([d.k4, d.k5, d.k6]);
                }
                all
            }
        }
    }

    /// The names of the coefficients, in OpenCV's order.
    pub fn coefficient_names(&self) -> &'static [&'static str] {
        match self {
            Self::KannalaBrandt(_) => &["k1", "k2", "k3", "k4"],
            Self::Rational(_) => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
        }
    }

    /// The rational model from OpenCV's order (k1, k2, p1, p2, k3, k4, k5, k6); missing
    /// coefficients are 0. `None` for more than 8 coefficients, unless all further ones (thin
    /// prism, tilt) are 0.
    pub fn rational(coefficients: &[f64]) -> Option<Self> {
        let at = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        if coefficients.len() > 14 || coefficients.iter().skip(8).any(|&c| c != 0.0) {
            return None;
        }
        Some(Self::Rational(Distortion {
            k1: at(0),
            k2: at(1),
            p1: at(2),
            p2: at(3),
            k3: at(4),
            k4: at(5),
            k5: at(6),
            k6: at(7),
        }))
    }

    /// The distorted position of an ideal pinhole's point `p`, and its derivative by `p`. Both are
    /// in focal lengths from the principal point; the valid region is not checked.
    pub fn draw_with_jacobian(&self, p: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match self {
            Self::Rational(distortion) => distortion.apply(p),
            Self::KannalaBrandt(k) => fisheye::apply(k, p),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::rational::MIN_STRETCH;
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
            let lens = Lens::new(d.into());
            let p = at(share * lens.used_radius, angle);
            let jacobian = d.apply(p).1;
            let least = jacobian.symmetric_eigenvalues().min();
            prop_assert!(least > 0.99 * MIN_STRETCH, "{least} at {p}");
        }

        #[test]
        fn drawn_points_are_recovered(d in any_distortion(), share in 0.0f64..1.0, angle in 0.0f64..7.0) {
            let lens = Lens::new(d.into());
            let p = at(share * lens.used_radius.min(10.0), angle);
            let drawn = lens.draw(p, ViewPart::Used).unwrap_or_else(|| lens.rim(p));
            // 1e-9 px at a focal length of 1000 px; near a pole a lens draws far outside any image.
            let back = lens.undo(drawn, ViewPart::Used, 1e-13);
            prop_assert!(drawn.norm() > 4.0 || back.is_some_and(|b| (b - p).norm() < 1e-12), "{p} {back:?}");
        }
    }
}
