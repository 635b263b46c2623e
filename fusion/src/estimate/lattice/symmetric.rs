//! Symmetric 3 x 3 matrices, for many small linear systems.

use nalgebra::Vector3;

/// A symmetric 3 x 3 matrix: xx, xy, xz, yy, yz, zz.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Symmetric([f64; 6]);

impl Symmetric {
    /// The sum of the outer products of two pairs of vectors, which is symmetric.
    pub(super) fn of_products([one, other]: [(&Vector3<f64>, &Vector3<f64>); 2]) -> Self {
        let entry = |i: usize, j: usize| one.0[i] * one.1[j] + other.0[i] * other.1[j];
        Self([
            entry(0, 0),
            entry(0, 1),
            entry(0, 2),
            entry(1, 1),
            entry(1, 2),
            entry(2, 2),
        ])
    }

    /// Adds `share` of `other`.
    pub(super) fn add(&mut self, other: &Self, share: f64) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            *own += other * share;
        }
    }

    /// Solves (self + `more` I) x = b by the adjugate; not finite unless self has no negative
    /// eigenvalues and `more` > 0.
    pub(super) fn solve(&self, more: f64, b: &Vector3<f64>) -> Vector3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        let (xx, yy, zz) = (xx + more, yy + more, zz + more);
        let (a, d, e) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let (f, g, h) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
        let inverse = 1.0 / (xx * a + xy * d + xz * e);
        Vector3::new(
            (a * b.x + d * b.y + e * b.z) * inverse,
            (d * b.x + f * b.y + g * b.z) * inverse,
            (e * b.x + g * b.y + h * b.z) * inverse,
        )
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_solution_solves_the_system(
            a in prop::array::uniform9(-3.0f64..3.0), b in prop::array::uniform3(-1.0f64..1.0), more in 0.1f64..10.0,
        ) {
            let a = Matrix3::from_row_slice(&a);
            let m = a * a.transpose();
            let b = Vector3::from(b);
            let x = Symmetric([m.m11, m.m12, m.m13, m.m22, m.m23, m.m33]).solve(more, &b);
            prop_assert!(((m + Matrix3::identity() * more) * x - b).norm() < 1e-9);
        }
    }
}
