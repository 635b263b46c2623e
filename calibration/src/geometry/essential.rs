//! Essential matrices from five pairs of rays (Nister 2004, solved as in Stewenius, Engels and Nister 2006).

use nalgebra::{Matrix3, SMatrix, SVector, Schur, Vector3};

use super::polynomial::{Cubic, Linear, Quadratic, add_cube, add_square};

/// Most iterations for the eigenvalues; usually 20 to 40 are needed.
const MOST_ITERATIONS: usize = 300;

type Matrix10 = SMatrix<f64, 10, 10>;

/// All E with b' E a = 0 for the five pairs (a, b) of rays and the properties of an essential matrix; none if the rays are
/// degenerate.
pub(super) fn five_point(a: &[Vector3<f64>; 5], b: &[Vector3<f64>; 5]) -> Vec<Matrix3<f64>> {
    let Some(basis) = null_space(a, b) else {
        return Vec::new();
    };
    let Some(action) = action_matrix(&constraints(&basis)) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    // Without a limit nearly degenerate rays could cause an endless loop.
    let Some(schur) = Schur::try_new(action, f64::EPSILON, MOST_ITERATIONS) else {
        return Vec::new();
    };
    for root in schur.complex_eigenvalues().iter() {
        if root.im.abs() > 1e-8 * (1.0 + root.re.abs()) {
            continue;
        }
        let Some(v) = eigenvector(&action, root.re) else {
            continue;
        };
        if v[9].abs() < 1e-12 {
            continue;
        }
        let weights = [v[6] / v[9], v[7] / v[9], v[8] / v[9], 1.0];
        let e = basis
            .iter()
            .zip(weights)
            .fold(Matrix3::zeros(), |sum, (e, w)| sum + e * w);
        let norm = e.norm();
        if norm.is_finite() && norm > 0.0 {
            found.push(e / norm);
        }
    }
    found
}

/// Four orthonormal matrices that span all E with b' E a = 0.
fn null_space(a: &[Vector3<f64>; 5], b: &[Vector3<f64>; 5]) -> Option<[Matrix3<f64>; 4]> {
    // Orthonormal rows of the conditions, then rows orthogonal to them.
    let mut rows: Vec<SVector<f64, 9>> = Vec::with_capacity(9);
    for (a, b) in a.iter().zip(b) {
        let row = SVector::<f64, 9>::from_fn(|k, _| b[k / 3] * a[k % 3]);
        rows.push(orthogonal_part(&row, &rows, 1e-9)?);
    }
    for axis in 0..9 {
        if rows.len() == 9 {
            break;
        }
        let unit = SVector::<f64, 9>::ith(axis, 1.0);
        if let Some(row) = orthogonal_part(&unit, &rows, 0.1) {
            rows.push(row);
        }
    }
    let free: Vec<Matrix3<f64>> = rows
        .iter()
        .skip(5)
        .map(|row| Matrix3::from_row_iterator(row.iter().copied()))
        .collect();
    free.try_into().ok()
}

/// The part of `row` orthogonal to `others`, normalised; `None` if it is shorter than `least`.
fn orthogonal_part(
    row: &SVector<f64, 9>,
    others: &[SVector<f64, 9>],
    least: f64,
) -> Option<SVector<f64, 9>> {
    let mut rest = *row;
    // Twice, to reduce rounding errors.
    for _ in 0..2 {
        for other in others {
            rest -= other * other.dot(&rest);
        }
    }
    let norm = rest.norm();
    (norm > least * row.norm()).then(|| rest / norm)
}

/// det E = 0 and 2 E E' E - trace(E E') E = 0, for E = x E0 + y E1 + z E2 + E3.
fn constraints(basis: &[Matrix3<f64>; 4]) -> SMatrix<f64, 10, 20> {
    let e = |i: usize, j: usize| -> Linear {
        [
            basis[0][(i, j)],
            basis[1][(i, j)],
            basis[2][(i, j)],
            basis[3][(i, j)],
        ]
    };
    let mut square = [[Quadratic::default(); 3]; 3];
    for (i, row) in square.iter_mut().enumerate() {
        for (j, entry) in row.iter_mut().enumerate() {
            for k in 0..3 {
                add_square(entry, &e(i, k), &e(j, k), 2.0);
            }
        }
    }
    // 2 E E' less its half trace on the diagonal.
    let half_trace: Quadratic =
        std::array::from_fn(|k| 0.5 * (square[0][0][k] + square[1][1][k] + square[2][2][k]));
    for (i, row) in square.iter_mut().enumerate() {
        for (entry, trace) in row[i].iter_mut().zip(half_trace) {
            *entry -= trace;
        }
    }
    let mut rows = SMatrix::<f64, 10, 20>::zeros();
    for i in 0..3 {
        for j in 0..3 {
            let mut cubic = [0.0; 20];
            for (k, square) in square[i].iter().enumerate() {
                add_cube(&mut cubic, square, &e(k, j), 1.0);
            }
            set_row(&mut rows, 3 * i + j, &cubic);
        }
    }
    set_row(&mut rows, 9, &determinant(e));
    rows
}

fn determinant(e: impl Fn(usize, usize) -> Linear) -> Cubic {
    let mut cubic = [0.0; 20];
    for i in 0..3 {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let mut minor = Quadratic::default();
        add_square(&mut minor, &e(1, j), &e(2, k), 1.0);
        add_square(&mut minor, &e(1, k), &e(2, j), -1.0);
        add_cube(&mut cubic, &minor, &e(0, i), 1.0);
    }
    cubic
}

fn set_row(rows: &mut SMatrix<f64, 10, 20>, row: usize, cubic: &Cubic) {
    for (k, value) in cubic.iter().enumerate() {
        rows[(row, k)] = *value;
    }
}

/// Multiplication by x of the monomials x2, xy, xz, y2, yz, z2, x, y, z, 1, after elimination of the cubic ones.
fn action_matrix(rows: &SMatrix<f64, 10, 20>) -> Option<Matrix10> {
    let cubic: Matrix10 = rows.fixed_view::<10, 10>(0, 0).into_owned();
    let rest: Matrix10 = rows.fixed_view::<10, 10>(0, 10).into_owned();
    let reduced = cubic.lu().solve(&rest)?;
    let mut action = Matrix10::zeros();
    for (row, cubic) in [0, 1, 2, 3, 4, 5].into_iter().enumerate() {
        action.set_row(row, &-reduced.row(cubic));
    }
    for (row, column) in [(6, 0), (7, 1), (8, 2), (9, 6)] {
        action[(row, column)] = 1.0;
    }
    action.iter().all(|v| v.is_finite()).then_some(action)
}

/// The eigenvector of a known eigenvalue, by inverse iteration.
fn eigenvector(action: &Matrix10, value: f64) -> Option<SVector<f64, 10>> {
    let shift = value + 1e-10 * (1.0 + value.abs());
    let lu = (action - Matrix10::identity() * shift).lu();
    let mut v = SVector::<f64, 10>::from_element(1.0);
    for _ in 0..3 {
        v = lu.solve(&v)?;
        v /= v.norm();
    }
    v.iter().all(|v| v.is_finite()).then_some(v)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn five_pairs_of_rays_give_the_true_matrix_among_others(
            turn in prop::array::uniform3(-0.8f64..0.8),
            shift in prop::array::uniform3(-1.0f64..1.0),
            points in prop::array::uniform5(prop::array::uniform3(-1.0f64..1.0)),
        ) {
            let shift = Vector3::from(shift);
            prop_assume!(shift.norm() > 0.2);
            let rotation = Rotation3::from_scaled_axis(Vector3::from(turn));
            let a = points.map(|p| Vector3::from(p) + Vector3::new(0.0, 0.0, 4.0));
            let b = a.map(|p| (rotation * p + shift).normalize());
            let a = a.map(|p| p.normalize());
            let truth = shift.cross_matrix() * rotation.matrix();
            let truth = truth / truth.norm();
            let found = five_point(&a, &b);
            let nearest = found
                .iter()
                .map(|e| (e - truth).norm().min((e + truth).norm()))
                .fold(f64::INFINITY, f64::min);
            // Five random points can be nearly degenerate.
            prop_assert!(nearest < 1e-3, "{nearest} of {}", found.len());
        }
    }
}
