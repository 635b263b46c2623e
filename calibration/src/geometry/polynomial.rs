//! Polynomials in three unknowns up to the third degree, by their coefficients, and the real roots of a quartic.

use nalgebra::{Matrix4, Schur};

/// Exponents of x, y, z. A polynomial of first degree has the last 4, of second degree the last 10, of third degree all.
const EXPONENTS: [[u8; 3]; 20] = [
    [3, 0, 0],
    [2, 1, 0],
    [2, 0, 1],
    [1, 2, 0],
    [1, 1, 1],
    [1, 0, 2],
    [0, 3, 0],
    [0, 2, 1],
    [0, 1, 2],
    [0, 0, 3],
    [2, 0, 0],
    [1, 1, 0],
    [1, 0, 1],
    [0, 2, 0],
    [0, 1, 1],
    [0, 0, 2],
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [0, 0, 0],
];

/// Indices of the products of a polynomial of `N` coefficients with one of first degree.
const fn products<const N: usize>() -> [[usize; 4]; N] {
    let mut places = [[0; 4]; N];
    let mut i = 0;
    while i < N {
        let mut j = 0;
        while j < 4 {
            let (a, b) = (EXPONENTS[20 - N + i], EXPONENTS[16 + j]);
            let mut k = 0;
            while k < 20 {
                let e = EXPONENTS[k];
                if e[0] == a[0] + b[0] && e[1] == a[1] + b[1] && e[2] == a[2] + b[2] {
                    places[i][j] = k;
                }
                k += 1;
            }
            j += 1;
        }
        i += 1;
    }
    places
}

const LINEAR_BY_LINEAR: [[usize; 4]; 4] = products();
const QUADRATIC_BY_LINEAR: [[usize; 4]; 10] = products();

pub(super) type Linear = [f64; 4];
pub(super) type Quadratic = [f64; 10];
pub(super) type Cubic = [f64; 20];

/// Adds `factor` a b to `sum`.
pub(super) fn add_square(sum: &mut Quadratic, a: &Linear, b: &Linear, factor: f64) {
    for (places, a) in LINEAR_BY_LINEAR.iter().zip(a) {
        for (place, b) in places.iter().zip(b) {
            sum[place - 10] += factor * a * b;
        }
    }
}

/// Adds `factor` a b to `sum`.
pub(super) fn add_cube(sum: &mut Cubic, a: &Quadratic, b: &Linear, factor: f64) {
    for (places, a) in QUADRATIC_BY_LINEAR.iter().zip(a) {
        for (place, b) in places.iter().zip(b) {
            sum[*place] += factor * a * b;
        }
    }
}

/// The real roots of c\[0\] + c\[1\] x + ... + c\[4\] x^4.
pub(super) fn quartic_roots(c: &[f64; 5]) -> Vec<f64> {
    let largest = c.iter().fold(0.0f64, |most, c| most.max(c.abs()));
    if c[4].abs() <= 1e-14 * largest {
        return Vec::new();
    }
    let companion = Matrix4::from_fn(|i, j| {
        if j == 3 {
            -c[i] / c[4]
        } else if i == j + 1 {
            1.0
        } else {
            0.0
        }
    });
    if companion.iter().any(|v| !v.is_finite()) {
        return Vec::new();
    }
    let Some(schur) = Schur::try_new(companion, f64::EPSILON, 200) else {
        return Vec::new();
    };
    let roots = schur.complex_eigenvalues();
    let real = roots
        .iter()
        .filter(|r| r.im.abs() < 1e-4 * (1.0 + r.re.abs()));
    real.map(|r| polished(c, r.re)).collect()
}

fn polished(c: &[f64; 5], mut x: f64) -> f64 {
    for _ in 0..3 {
        let value = (((c[4] * x + c[3]) * x + c[2]) * x + c[1]) * x + c[0];
        let slope = ((4.0 * c[4] * x + 3.0 * c[3]) * x + 2.0 * c[2]) * x + c[1];
        let next = x - value / slope;
        if !next.is_finite() {
            break;
        }
        x = next;
    }
    x
}
