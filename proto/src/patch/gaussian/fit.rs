//! Fits a peak's position, height and widths to its cells.

use super::mode::{FittedPeak, MapScale};

/// Distance from the highest cell within which a peak is fitted, units: a little over two typical
/// sigmas.
const REACH: f32 = 4.5;
/// Cells below this share of the highest one do not count.
const LEAST_SHARE: f32 = 0.12;
/// Cells below this value, of 255, do not count.
const LEAST: f32 = 8.0;

/// Most columns used for a peak: the stride limits them to twice the reach in units, plus one.
const MOST_COLUMNS: usize = 20;

/// Fits Gaussians; contains a table of logarithms.
#[derive(Debug, Clone)]
pub(in crate::patch) struct Fitter {
    /// Natural logarithm of every cell's value; that of 0 is 0.
    logarithms: [f32; 256],
}

/// Sums of weights times powers of the position (columns, then rows), and the same with logarithms.
#[derive(Default)]
struct Moments {
    weight: [[f64; 5]; 5],
    logarithm: [[f64; 3]; 3],
}

impl Fitter {
    pub(in crate::patch) fn new() -> Self {
        let mut logarithms = [0.0; 256];
        for (value, logarithm) in logarithms.iter_mut().enumerate().skip(1) {
            *logarithm = libm::logf(value as f32);
        }
        Self { logarithms }
    }

    /// The peak around the cell `at`. Other modes already `explain` a part; cells of which they
    /// explain half belong to them. The width is limited to that of a mode.
    ///
    /// Least squares of the logarithm, which is a parabola, weighted by the squared cells; near the
    /// top these are the least squares of the cells.
    pub(in crate::patch) fn peak(
        &self,
        cells: &[u8],
        explained: &[u8],
        at: [usize; 2],
        scale: &MapScale,
    ) -> FittedPeak {
        let first = self.about(cells, explained, at, scale);
        let center = [
            first.at[0].round().max(0.0) as usize,
            first.at[1].round().max(0.0) as usize,
        ];
        let off = center[0].abs_diff(at[0]).max(center[1].abs_diff(at[1]));
        let inside = center[0] < scale.width && center[1] < scale.height;
        if off >= 2 && inside && off as f32 <= REACH * scale.cells {
            self.about(cells, explained, center, scale)
        } else {
            first
        }
    }

    fn about(
        &self,
        cells: &[u8],
        explained: &[u8],
        at: [usize; 2],
        scale: &MapScale,
    ) -> FittedPeak {
        let top = f32::from(cells[at[1] * scale.width + at[0]]);
        let usual = FittedPeak {
            at: at.map(|n| n as f32),
            height: top,
            sigma: [2.05 * scale.cells; 2],
            correlation: 0.0,
        };
        let reach = REACH * scale.cells;
        let moments = self.moments(cells, explained, at, reach, scale);
        let Some(c) = moments.parabola() else {
            return usual;
        };
        // log = c0 + c1 x + c2 y + c3 x^2 + c4 y^2 + c5 x y; minus its second derivative is the
        // inverse of the covariance.
        let (hxx, hyy, hxy) = (-2.0 * c[3], -2.0 * c[4], -c[5]);
        let det = hxx * hyy - hxy * hxy;
        if !(hxx > 1e-6 && hyy > 1e-6 && det > 1e-3 * hxx * hyy) {
            return usual;
        }
        let (x, y) = (
            (c[1] * hyy - c[2] * hxy) / det,
            (c[2] * hxx - c[1] * hxy) / det,
        );
        let height = libm::exp(c[0] + 0.5 * (c[1] * x + c[2] * y)) as f32;
        let (x, y) = (x as f32 * reach, y as f32 * reach);
        let sigma = [hyy / det, hxx / det].map(|variance| variance.sqrt() as f32 * reach);
        if x.abs() > reach || y.abs() > reach || sigma.iter().any(|s| *s > 8.0 * scale.cells) {
            return usual;
        }
        FittedPeak {
            at: [usual.at[0] + x, usual.at[1] + y],
            height: height.clamp(1.0, (1.15 * top).clamp(1.0, 255.0)),
            sigma,
            correlation: (-hxy / (hxx * hyy).sqrt()) as f32,
        }
    }

    /// Positions are relative to `at`, in `reach`.
    fn moments(
        &self,
        cells: &[u8],
        explained: &[u8],
        at: [usize; 2],
        reach: f32,
        scale: &MapScale,
    ) -> Moments {
        let mut moments = Moments::default();
        let stride = (scale.cells as usize).max(1);
        let most = reach as usize / stride;
        let top = f32::from(cells[at[1] * scale.width + at[0]]);
        let least = (LEAST_SHARE * top).max(LEAST);
        let columns = at[0] - at[0].min(most * stride) / stride * stride;
        let rows = at[1] - at[1].min(most * stride) / stride * stride;
        let end = |at: usize, size: usize| (at + most * stride + 1).min(size);
        let columns = columns..end(at[0], scale.width);
        // Per column: the factors of weights, then those of logarithms.
        let mut powers = [[0.0f32; 8]; MOST_COLUMNS];
        for (powers, x) in powers.iter_mut().zip(columns.clone().step_by(stride)) {
            let dx = (x as f32 - at[0] as f32) / reach;
            let square = dx * dx;
            *powers = [
                1.0,
                dx,
                square,
                square * dx,
                square * square,
                1.0,
                dx,
                square,
            ];
        }
        for y in (rows..end(at[1], scale.height)).step_by(stride) {
            let row = y * scale.width;
            let (of_map, of_others) = (&cells[row..], &explained[row..]);
            let mut sums = [0.0f32; 8];
            for (x, powers) in columns.clone().step_by(stride).zip(&powers) {
                let cell = of_map[x];
                let value = f32::from(cell);
                let counts = value >= least && cell / 2 >= of_others[x];
                let weight = if counts { value * value } else { 0.0 };
                let logarithm = weight * self.logarithms[usize::from(cell)];
                let (w, l) = (weight, logarithm);
                let factors = [w, w, w, w, w, l, l, l];
                for i in 0..8 {
                    sums[i] += factors[i] * powers[i];
                }
            }
            let dy = (f64::from(y as u32) - f64::from(at[1] as u32)) / f64::from(reach);
            moments.add_row(&sums, dy);
        }
        moments
    }
}

impl Moments {
    /// Adds the sums of a row: five of weights, three of logarithms.
    fn add_row(&mut self, sums: &[f32; 8], dy: f64) {
        let (weight, logarithm) = sums.split_at(5);
        let mut power = 1.0;
        for q in 0..5 {
            for (sums, row) in self.weight.iter_mut().zip(weight).take(5 - q) {
                sums[q] += f64::from(*row) * power;
            }
            for (sums, row) in self
                .logarithm
                .iter_mut()
                .zip(logarithm)
                .take(3usize.saturating_sub(q))
            {
                sums[q] += f64::from(*row) * power;
            }
            power *= dy;
        }
    }

    /// Coefficients of 1, x, y, x^2, y^2 and x y; `None` when the cells do not determine them.
    fn parabola(&self) -> Option<[f64; 6]> {
        const POWERS: [[usize; 2]; 6] = [[0, 0], [1, 0], [0, 1], [2, 0], [0, 2], [1, 1]];
        let mut lower = [[0.0; 6]; 6];
        let mut right = [0.0; 6];
        for i in 0..6 {
            right[i] = self.logarithm[POWERS[i][0]][POWERS[i][1]];
            for j in 0..=i {
                lower[i][j] = self.weight[POWERS[i][0] + POWERS[j][0]][POWERS[i][1] + POWERS[j][1]];
            }
        }
        solve(lower, right)
    }
}

/// Solves a symmetric positive definite system, given by its lower triangle, by Cholesky
/// decomposition; `None` when it is not definite.
fn solve(mut a: [[f64; 6]; 6], mut b: [f64; 6]) -> Option<[f64; 6]> {
    let scale = a[0][0];
    for i in 0..6 {
        for j in 0..=i {
            let sum = (0..j).fold(a[i][j], |sum, k| sum - a[i][k] * a[j][k]);
            if i == j {
                if sum.is_nan() || sum <= 1e-9 * scale {
                    return None;
                }
                a[i][i] = sum.sqrt();
            } else {
                a[i][j] = sum / a[j][j];
            }
        }
    }
    for i in 0..6 {
        b[i] = (0..i).fold(b[i], |sum, k| sum - a[i][k] * b[k]) / a[i][i];
    }
    for i in (0..6).rev() {
        b[i] = (i + 1..6).fold(b[i], |sum, k| sum - a[k][i] * b[k]) / a[i][i];
    }
    Some(b)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::patch::gaussian::mode::Mode;

    proptest! {
        #[test]
        fn a_drawn_mode_is_recovered_by_the_fit(
            at in (8.0f32..40.0, 8.0f32..56.0), height in 60.0f32..250.0,
            sigma in (1.6f32..3.0, 1.6f32..3.0), correlation in -0.4f32..0.4,
        ) {
            let scale = MapScale { width: 48, height: 64, cells: 1.0 };
            let drawn = FittedPeak { at: [at.0, at.1], height, sigma: [sigma.0, sigma.1], correlation };
            let mode = Mode::from_peak(&drawn, &scale);
            let mut cells = vec![0; 48 * 64];
            mode.draw(&scale, &mut cells);
            let highest = (0..cells.len()).max_by_key(|&i| cells[i]).unwrap();
            let at = [highest % 48, highest / 48];
            let found = Fitter::new().peak(&cells, &vec![0; cells.len()], at, &scale);
            let again = Mode::from_peak(&found, &scale);
            prop_assert!((0..2).all(|i| again.at[i].abs_diff(mode.at[i]) <= 1), "{mode:?} {again:?}");
            prop_assert!((0..2).all(|i| again.width[i].abs_diff(mode.width[i]) <= 1), "{mode:?} {again:?}");
            prop_assert!(again.height.abs_diff(mode.height) <= 4 && again.tilt.abs_diff(mode.tilt) <= 1);
        }
    }
}
