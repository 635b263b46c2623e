//! From a local maximum of the coarse lattice to a position that is not quantised.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use super::LatticeMode;
use super::witness::{Witness, Witnesses};
use crate::estimate::evidence::View;

/// Newton steps that seek the maximum of F; three settle to a hundredth of a cell.
const PULLED_STEPS: usize = 3;
/// Newton steps that seek the maximum of S. Each leaves lambda/(h + lambda) of the pull, h the
/// curvature of S: about a tenth with cells of 35 mm.
const FREE_STEPS: usize = 3;
/// How far Newton may go, in fine steps, before the lattice's own answer is kept.
const FARTHEST_STEPS: f64 = 6.0;
/// Share of S that Newton may lose before the lattice's own answer is kept. Bilinear samples make
/// the value at a maximum itself uncertain by less than this.
const LOSS: f64 = 0.85;

/// The best of a point and its 26 neighbours at `step_m`.
pub(super) fn best_neighbour(
    mode: LatticeMode,
    step_m: f64,
    score: impl Fn(Vector3<f64>) -> LatticeMode,
) -> LatticeMode {
    let mut best = mode;
    for i in (0..27).filter(|&i| i != 13) {
        let place = Vector3::new(i % 3, i / 3 % 3, i / 9).map(|v| f64::from(v) - 1.0);
        let candidate = score(mode.offset_m + place * step_m);
        if candidate.score > best.score {
            best = candidate;
        }
    }
    best
}

/// Damped Newton on S from `mode` (found with fine steps of `step_m`); returns the offset from the
/// prediction, metres.
///
/// ```text
///   (H + lambda I) delta = g - lambda d,    lambda = S/sigma^2,    then: = g
/// ```
///
/// Each view's map counts once more by its own value (S here is the sum of its squares): a network
/// that is unsure draws a lower peak, and is wrong by more. g and -H are gradient and curvature of S
/// from a quadratic per view (least squares over 5 x 5 cells around the projection), curvatures that
/// point the wrong way left out, so H + lambda I is positive definite. The steps with lambda d seek the
/// maximum of F, which lies towards the prediction; the others take that pull back where the views
/// determine the position, and leave it where they do not (along the ray of a single view).
pub(super) fn newton(
    witnesses: &Witnesses,
    views: &[View],
    keypoint: usize,
    (mode, step_m): (LatticeMode, f64),
    prior_sigma_m: f64,
) -> Vector3<f64> {
    let support = |offset_m| witnesses.support(views, keypoint, offset_m);
    let mut offset_m = mode.offset_m;
    for step in 0..PULLED_STEPS + FREE_STEPS {
        let mut s = Local::default();
        for witness in witnesses.iter() {
            s.add(witness, &views[witness.view], keypoint, offset_m);
        }
        let lambda = s.value.max(1e-3) / (prior_sigma_m * prior_sigma_m);
        let pull = if step < PULLED_STEPS {
            offset_m * lambda
        } else {
            Vector3::zeros()
        };
        let Some(cholesky) = (s.curvature + Matrix3::identity() * lambda).cholesky() else {
            return mode.offset_m;
        };
        let delta = cholesky.solve(&(s.gradient - pull));
        offset_m += delta * (step_m / delta.norm().max(step_m));
    }
    let near = (offset_m - mode.offset_m).norm() <= FARTHEST_STEPS * step_m;
    if near && support(offset_m) >= LOSS * support(mode.offset_m) {
        offset_m
    } else {
        mode.offset_m
    }
}

/// S around an offset, to second order: value, gradient (per metre), minus the Hessian.
#[derive(Default)]
struct Local {
    value: f64,
    gradient: Vector3<f64>,
    curvature: Matrix3<f64>,
}

impl Local {
    /// Adds one view's part.
    fn add(&mut self, witness: &Witness, view: &View, keypoint: usize, offset_m: Vector3<f64>) {
        let m = &witness.cell_from_offset;
        let h = m * offset_m.push(1.0);
        let cell = Vector2::new(h.x, h.y) / h.z;
        let jacobian: Matrix2x3<f64> =
            (m.fixed_view::<2, 3>(0, 0) - cell * m.fixed_view::<1, 3>(2, 0)) / h.z;
        let (value, gradient, curvature) = quadratic(view.cells(keypoint), view.map_size(), cell);
        let weight = witness.weight * value.max(0.0);
        self.value += weight * value;
        self.gradient += jacobian.transpose() * gradient * weight;
        self.curvature += jacobian.transpose() * hill(curvature) * jacobian * weight;
    }
}

/// Value, gradient and minus the Hessian, at a fractional cell, of the quadratic that fits the 5 x 5
/// cells around it best (clamped to the border). Values are 0 to 1, lengths cells.
///
/// The least-squares kernels over u, v in -2..=2 are: slope u/50, curvature (u^2 - 2)/35 (the second
/// derivative, 2 x (u^2 - 2)/70), cross u v/100, mean 1/25.
fn quadratic(
    cells: &[u8],
    (width, height): (usize, usize),
    cell: Vector2<f64>,
) -> (f64, Vector2<f64>, Matrix2<f64>) {
    let x = cell.x.max(0.0).min((width - 1) as f64);
    let y = cell.y.max(0.0).min((height - 1) as f64);
    let (column, row) = ((x + 0.5) as usize, (y + 0.5) as usize);
    let (mut mean, mut su, mut sv, mut suu, mut svv, mut suv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for j in 0..5usize {
        let line = &cells[(row + j).saturating_sub(2).min(height - 1) * width..][..width];
        let v = j as f64 - 2.0;
        for i in 0..5usize {
            let u = i as f64 - 2.0;
            let value = f64::from(line[(column + i).saturating_sub(2).min(width - 1)]);
            mean += value;
            su += value * u;
            sv += value * v;
            suu += value * (u * u - 2.0);
            svv += value * (v * v - 2.0);
            suv += value * u * v;
        }
    }
    let scale = 1.0 / 255.0;
    let (gu, gv) = (su * scale / 50.0, sv * scale / 50.0);
    let (huu, hvv, huv) = (suu * scale / 35.0, svv * scale / 35.0, suv * scale / 100.0);
    // At the window's centre; the mean of u^2 over it is 2.
    let at_center = mean * scale / 25.0 - huu - hvv;
    let (u, v) = (x - column as f64, y - row as f64);
    let value = at_center + gu * u + gv * v + 0.5 * (huu * u * u + hvv * v * v) + huv * u * v;
    let gradient = Vector2::new(gu + huu * u + huv * v, gv + huv * u + hvv * v);
    (value, gradient, -Matrix2::new(huu, huv, huv, hvv))
}

/// The nearest symmetric matrix without negative eigenvalues.
fn hill(m: Matrix2<f64>) -> Matrix2<f64> {
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

    proptest! {
        #[test]
        fn a_hill_has_no_negative_curvature_and_keeps_the_positive(
            a in -1.0f64..1.0, b in -1.0f64..1.0, c in -1.0f64..1.0,
        ) {
            let m = Matrix2::new(a, b, b, c);
            let expected = {
                let e = m.symmetric_eigen();
                e.eigenvectors * Matrix2::from_diagonal(&e.eigenvalues.map(|v| v.max(0.0))) * e.eigenvectors.transpose()
            };
            prop_assert!((hill(m) - expected).norm() < 1e-12);
        }

        #[test]
        fn a_quadratic_map_is_read_exactly_but_for_its_rounding(
            x in 4.0f64..11.0, y in 4.0f64..11.0, a in 0.5f64..2.0, b in 0.5f64..2.0, c in -0.4f64..0.4,
        ) {
            let f = |u: f64, v: f64| 220.0 - a * u * u - b * v * v - c * u * v;
            let cells: Vec<u8> =
                (0..256).map(|i| f(f64::from(i % 16) - 7.5, f64::from(i / 16) - 7.5).round() as u8).collect();
            let (value, gradient, curvature) = quadratic(&cells, (16, 16), Vector2::new(x, y));
            let (u, v) = (x - 7.5, y - 7.5);
            let slope = Vector2::new(-2.0 * a * u - c * v, -2.0 * b * v - c * u);
            // Each cell is rounded by up to half a step of 1/255.
            prop_assert!((value * 255.0 - f(u, v)).abs() < 1.0);
            prop_assert!((gradient * 255.0 - slope).norm() < 0.6);
            prop_assert!((curvature * 255.0 - Matrix2::new(2.0 * a, c, c, 2.0 * b)).norm() < 0.6);
        }
    }
}
