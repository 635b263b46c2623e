//! From a candidate to a position that is not quantised.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::candidates::Symmetric;
use super::witness::{Witness, Witnesses};
use super::{KeypointPlace, LatticeMode};
use crate::estimate::evidence::PackedMap;

/// Most Newton steps towards the maximum of F; three settle to a hundredth of a cell.
pub(super) const PULLED_STEPS: usize = 3;
/// Most Newton steps towards the maximum of S. Each leaves lambda/(h + lambda) of the pull, h the
/// curvature of S: about a tenth with cells of 35 mm.
const FREE_STEPS: usize = 3;
/// Steps shorter than this are the last of their kind, metres: first towards F, then towards S.
const LAST_PULLED_M: f64 = 1e-3;
const LAST_FREE_M: f64 = 1e-4;
/// Largest distance of Newton's steps, in fine steps; beyond it the candidate is kept.
const FARTHEST_STEPS: f64 = 6.0;
/// Share of S that Newton must keep; otherwise the candidate is kept. Bilinear samples make the
/// value at a maximum uncertain by less than this.
pub(super) const LOSS: f64 = 0.85;

/// The best of a point and its 26 neighbours at `step_m`.
pub(super) fn best_neighbour(
    mode: LatticeMode,
    step_m: f64,
    score: impl Fn(Vector3<f64>) -> f64,
) -> LatticeMode {
    let mut best = mode;
    for i in (0..27).filter(|&i| i != 13) {
        let place = Vector3::new(i % 3, i / 3 % 3, i / 9).map(|v| f64::from(v) - 1.0);
        let offset_m = mode.offset_m + place * step_m;
        let candidate = LatticeMode::new(offset_m, score(offset_m), mode.origin);
        if candidate.score > best.score {
            best = candidate;
        }
    }
    best
}

/// Newton's steps, with the fitted quadratics.
#[derive(Debug, Clone, Default)]
pub(super) struct Refiner {
    /// Per witness.
    hills: Vec<Option<Hill>>,
}

impl Refiner {
    /// Damped Newton on S from `start_m` in steps of at most `step_m`; returns the offset from the
    /// prediction, metres, unless it led far away.
    ///
    /// ```text
    ///   (H + lambda I) delta = g - lambda d,    lambda = S/sigma^2,    then: = g
    /// ```
    ///
    /// S is here half the sum of the maps' *squares*: each view's map has its own value as an
    /// additional weight, because an unsure network draws a lower peak, and its errors are larger.
    /// F, which is linear in the maps, has already selected the candidate. g and -H are gradient
    /// and curvature of S from a quadratic per view (least squares over 5 x 5 cells around the
    /// projection). Negative curvatures are removed, so H + lambda I is positive definite. The
    /// steps with lambda d seek the maximum of F, which lies towards the prediction. The others
    /// undo that pull where the views determine the position, and keep it elsewhere (along the ray
    /// of a single view). If the start is already such a maximum along undetermined directions, it
    /// needs no `pulled_steps`.
    pub(super) fn newton(
        &mut self,
        at: &KeypointPlace<'_>,
        witnesses: &Witnesses,
        (start_m, pulled_steps): (Vector3<f64>, usize),
        step_m: f64,
    ) -> Option<Vector3<f64>> {
        self.hills.clear();
        self.hills.resize(witnesses.iter().len(), None);
        let sigma_m = at.parameters.prior_sigma_m;
        let mut offset_m = start_m;
        for (steps, is_pulled, last_m) in [
            (pulled_steps, true, LAST_PULLED_M),
            (FREE_STEPS, false, LAST_FREE_M),
        ] {
            for _ in 0..steps {
                let mut s = Surroundings::default();
                for (witness, hill) in witnesses.iter().zip(&mut self.hills) {
                    s.add(witness, hill, at, &offset_m);
                }
                let lambda = s.value.max(1e-3) / (sigma_m * sigma_m);
                let pull = if is_pulled { lambda } else { 0.0 };
                let delta = s.curvature.solve(lambda, &(s.gradient - offset_m * pull));
                let length_m = delta.norm();
                if !length_m.is_finite() {
                    return None;
                }
                offset_m += delta * (step_m / length_m.max(step_m));
                if length_m < last_m {
                    break;
                }
            }
        }
        ((offset_m - start_m).norm() <= FARTHEST_STEPS * step_m).then_some(offset_m)
    }
}

/// Half the sum of the maps' squares around an offset, to second order: value, gradient (per
/// metre), minus the Hessian.
#[derive(Default)]
struct Surroundings {
    value: f64,
    gradient: Vector3<f64>,
    curvature: Symmetric,
}

impl Surroundings {
    /// Adds one view's part; `hill` is its last quadratic.
    fn add(
        &mut self,
        witness: &Witness,
        hill: &mut Option<Hill>,
        at: &KeypointPlace<'_>,
        offset_m: &Vector3<f64>,
    ) {
        let m = &witness.cell_from_offset;
        let h = m * offset_m.push(1.0);
        let inverse = 1.0 / h.z;
        let cell = Vector2::new(h.x, h.y) * inverse;
        let row = |i: usize| Vector3::new(m[(i, 0)], m[(i, 1)], m[(i, 2)]);
        let x = (row(0) - row(2) * cell.x) * inverse;
        let y = (row(1) - row(2) * cell.y) * inverse;
        let view = &at.views[witness.view];
        let hill = Hill::at(cell, view.map(at.keypoint), hill);
        let (value, gradient) = hill.read(cell);
        let weight = witness.weight * value.max(0.0);
        if weight <= 0.0 {
            return;
        }
        self.value += weight * value;
        self.gradient += (x * gradient.x + y * gradient.y) * weight;
        let round = hill.round;
        // Jt (curvature J), J with the rows x and y.
        let bent = [
            (&x, &((x * round.m11 + y * round.m12) * weight)),
            (&y, &((x * round.m12 + y * round.m22) * weight)),
        ];
        self.curvature.add(&Symmetric::of_products(bent), 1.0);
    }
}

/// The quadratic that fits the 5 x 5 cells around one (clamped to the border) best. Values are 0 to 1, lengths cells.
///
/// The least-squares kernels over u, v in -2..=2 are: slope u/50, curvature (u^2 - 2)/35 (the second
/// derivative, 2 x (u^2 - 2)/70), cross u v/100, mean 1/25.
#[derive(Debug, Clone, Copy)]
struct Hill {
    /// The cell in the middle.
    middle: (usize, usize),
    value: f64,
    slope: Vector2<f64>,
    /// The Hessian.
    bend: Matrix2<f64>,
    /// Minus the Hessian, without negative curvatures.
    round: Matrix2<f64>,
}

impl Hill {
    /// The one around a fractional cell; reuses `known` if it is that.
    fn at(cell: Vector2<f64>, map: PackedMap<'_>, known: &mut Option<Self>) -> Self {
        let (width, height) = map.size();
        // Casts turn negative values and NaN into 0.
        let nearest = |v: f64, size: usize| ((v + 0.5) as usize).min(size - 1);
        let middle = (nearest(cell.x, width), nearest(cell.y, height));
        if let Some(hill) = known.filter(|hill| hill.middle == middle) {
            return hill;
        }
        *known.insert(Self::around(middle, map))
    }

    fn around(middle: (usize, usize), map: PackedMap<'_>) -> Self {
        let (mut sum, mut su, mut sv, mut suu, mut svv, mut suv) = (0, 0, 0, 0, 0, 0);
        for (row, v) in map.square(middle).iter().zip(-2i32..) {
            let [a, b, c, d, e] = row.map(i32::from);
            // The sums of the row: of the values, times u, and times u^2 - 2.
            let (all, by_u) = (a + b + c + d + e, 2 * (e - a) + (d - b));
            let by_uu = 2 * (a + e) - (b + d) - 2 * c;
            sum += all;
            su += by_u;
            sv += v * all;
            suu += by_uu;
            svv += (v * v - 2) * all;
            suv += v * by_u;
        }
        let share = |sum: i32, of: f64| f64::from(sum) / (255.0 * of);
        let (huu, hvv, huv) = (share(suu, 35.0), share(svv, 35.0), share(suv, 100.0));
        Self {
            middle,
            // The mean of u^2 over the window is 2.
            value: share(sum, 25.0) - huu - hvv,
            slope: Vector2::new(share(su, 50.0), share(sv, 50.0)),
            bend: Matrix2::new(huu, huv, huv, hvv),
            round: rounded(-Matrix2::new(huu, huv, huv, hvv)),
        }
    }

    /// Value and gradient at a fractional cell.
    fn read(&self, cell: Vector2<f64>) -> (f64, Vector2<f64>) {
        let off = |v: f64, middle: usize| (v - middle as f64).clamp(-0.5, 0.5);
        let off = Vector2::new(off(cell.x, self.middle.0), off(cell.y, self.middle.1));
        let bent = self.bend * off;
        let value = self.value + self.slope.dot(&off) + 0.5 * off.dot(&bent);
        (value, self.slope + bent)
    }
}

/// The nearest symmetric matrix without negative eigenvalues.
fn rounded(m: Matrix2<f64>) -> Matrix2<f64> {
    let (mean, half) = (0.5 * (m.m11 + m.m22), 0.5 * (m.m11 - m.m22));
    let radius = libm::hypot(half, m.m12);
    let (low, high) = (mean - radius, mean + radius);
    if low >= 0.0 {
        m
    } else if high <= 0.0 {
        Matrix2::zeros()
    } else {
        // high > 0 > low: keep the part along the first eigenvector, high (m - low I)/(high - low).
        (m - Matrix2::identity() * low) * (high / (high - low))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::estimate::evidence::packed;

    proptest! {
        #[test]
        fn a_hill_keeps_only_positive_curvature(
            a in -1.0f64..1.0, b in -1.0f64..1.0, c in -1.0f64..1.0,
        ) {
            let m = Matrix2::new(a, b, b, c);
            let expected = {
                let e = m.symmetric_eigen();
                e.eigenvectors * Matrix2::from_diagonal(&e.eigenvalues.map(|v| v.max(0.0))) * e.eigenvectors.transpose()
            };
            prop_assert!((rounded(m) - expected).norm() < 1e-12);
        }

        #[test]
        fn a_quadratic_map_is_read_exactly_up_to_rounding(
            x in 4.0f64..11.0, y in 4.0f64..11.0, a in 0.5f64..2.0, b in 0.5f64..2.0, c in -0.4f64..0.4,
        ) {
            let f = |u: f64, v: f64| 220.0 - a * u * u - b * v * v - c * u * v;
            let cells: Vec<u8> =
                (0..256).map(|i| f(f64::from(i % 16) - 7.5, f64::from(i / 16) - 7.5).round() as u8).collect();
            let cell = Vector2::new(x, y);
            let packed = packed(&cells, (16, 16));
            let hill = Hill::at(cell, packed.map(0), &mut None);
            let (value, gradient) = hill.read(cell);
            let (u, v) = (x - 7.5, y - 7.5);
            let slope = Vector2::new(-2.0 * a * u - c * v, -2.0 * b * v - c * u);
            // Each cell is rounded by up to half a step of 1/255.
            prop_assert!((value * 255.0 - f(u, v)).abs() < 1.0);
            prop_assert!((gradient * 255.0 - slope).norm() < 0.6);
            prop_assert!((hill.bend * -255.0 - Matrix2::new(2.0 * a, c, c, 2.0 * b)).norm() < 0.6);
        }
    }
}
