//! The information about all points of a link and of the links further out, as one matrix.
//!
//! A DoF moves every point below it as one rigid body: by v + ω × x, with (ω, v) its [`Twist`]
//! about an origin that all links share. So the information of the points of a link and of the
//! links further out can be summed independently of any DoF,
//!
//! ```text
//!   C = Σₜ Xₜᵀ Iₜ Xₜ,   w = Σₜ Xₜᵀ Iₜ rₜ,   Xₜ = (-[xₜ]×  1)        Hᵢⱼ = Sᵢᵀ Cᵢ Sⱼ,   gᵢ = Sᵢᵀ wᵢ
//! ```
//!
//! Sᵢ is the twist of DoF i, Cᵢ and wᵢ belong to the link that it turns, j = i or a DoF further in.
//! This is the composite rigid body algorithm (R. Featherstone, "Rigid Body Dynamics Algorithms",
//! 2008, chapter 6) with information in place of mass. The work grows with the points, not with
//! points times DoF squared.

use std::ops::{AddAssign, Range};

use nalgebra::{Matrix3, Vector3};

use crate::body::skeleton::N_DOF;

/// Motion of a rigid body per unit of a DoF.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Twist {
    /// Its rotation, ω.
    turn: Vector3<f64>,
    /// The motion of the origin, v, metres.
    shift_m: Vector3<f64>,
}

impl Twist {
    /// A rotation about `axis`, per unit, through `centre_m` from the origin.
    pub(super) fn about(axis: &Vector3<f64>, centre_m: &Vector3<f64>) -> Self {
        Self {
            turn: *axis,
            shift_m: centre_m.cross(axis),
        }
    }

    /// A motion along `axis` without rotation.
    pub(super) fn along(axis: &Vector3<f64>) -> Self {
        Self {
            turn: Vector3::zeros(),
            shift_m: *axis,
        }
    }

    /// Adds `share` of `other`.
    pub(super) fn add_share(&mut self, other: &Self, share: f64) {
        self.turn += other.turn * share;
        self.shift_m += other.shift_m * share;
    }

    /// Work of `push` along this twist.
    pub(super) fn dot(&self, push: &Push) -> f64 {
        self.turn.dot(&push.moment) + self.shift_m.dot(&push.force)
    }
}

/// The twists of all DoF, number by number, for vector instructions over several.
#[derive(Debug, Clone)]
pub(super) struct Motions {
    turn: [[f64; N_DOF]; 3],
    shift_m: [[f64; N_DOF]; 3],
}

impl Default for Motions {
    fn default() -> Self {
        Self {
            turn: [[0.0; N_DOF]; 3],
            shift_m: [[0.0; N_DOF]; 3],
        }
    }
}

impl Motions {
    /// Stores the twists.
    pub(super) fn set(&mut self, twists: &[Twist; N_DOF]) {
        let numbers = self.turn.iter_mut().zip(&mut self.shift_m);
        for (axis, (turn, shift_m)) in numbers.enumerate() {
            for (i, twist) in twists.iter().enumerate() {
                turn[i] = twist.turn[axis];
                shift_m[i] = twist.shift_m[axis];
            }
        }
    }

    /// [`Twist::dot`] of each of `dofs`, with the same bits.
    #[inline]
    pub(super) fn dot(&self, dofs: Range<usize>, push: &Push, into: &mut [f64]) {
        let own = dofs.start..dofs.start + into.len();
        let [a, b, c] = self.turn.each_ref().map(|turn| &turn[own.clone()]);
        let [x, y, z] = self.shift_m.each_ref().map(|shift_m| &shift_m[own.clone()]);
        let (moment, force) = (&push.moment, &push.force);
        for (i, into) in into.iter_mut().enumerate() {
            let turned = a[i] * moment.x + b[i] * moment.y + c[i] * moment.z;
            *into = turned + (x[i] * force.x + y[i] * force.y + z[i] * force.z);
        }
    }
}

/// Moment and force on a rigid body: the dual of a [`Twist`].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Push {
    moment: Vector3<f64>,
    force: Vector3<f64>,
}

impl Push {
    /// Adds a moment.
    pub(super) fn turn_by(&mut self, moment: &Vector3<f64>) {
        self.moment += moment;
    }
}

/// C and w of a link: symmetric 6 by 6, in blocks, and a push.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Composite {
    turn: Matrix3<f64>,
    /// Of the rotation's rows and the shift's columns.
    mixed: Matrix3<f64>,
    shift: Matrix3<f64>,
    /// Σ x fᵀ of the points x with the pulls f: gives the moment, and its change by a rotation.
    lever: Matrix3<f64>,
    force: Vector3<f64>,
}

impl Composite {
    /// Adds a point at `x_m` from the origin with `information` (1/m², symmetric) and `pull` =
    /// information times residual.
    pub(super) fn add(
        &mut self,
        x_m: &Vector3<f64>,
        information: &Matrix3<f64>,
        pull: &Vector3<f64>,
    ) {
        let mixed = crossed(x_m, information);
        self.turn += crossed(x_m, &mixed.transpose());
        self.mixed += mixed;
        self.shift += information;
        self.lever += x_m * pull.transpose();
        self.force += pull;
    }

    /// Reaction to a motion of all points by `twist`: C S.
    pub(super) fn resistance(&self, twist: &Twist) -> Push {
        Push {
            moment: self.turn * twist.turn + self.mixed * twist.shift_m,
            force: self.mixed.tr_mul(&twist.turn) + self.shift * twist.shift_m,
        }
    }

    /// w.
    pub(super) fn push(&self) -> Push {
        Push {
            moment: axial(&self.lever),
            force: self.force,
        }
    }

    /// Change of the moment of the pulls when all points rotate about an axis through `centre_m`,
    /// from the origin, with constant pulls: Σ (a × (x - c)) × f.
    pub(super) fn turned_moment(&self, twist: &Twist, centre_m: &Vector3<f64>) -> Vector3<f64> {
        let axis = &twist.turn;
        let along = self.lever.trace() - centre_m.dot(&self.force);
        self.lever * axis - centre_m * self.force.dot(axis) - axis * along
    }
}

impl AddAssign<&Self> for Composite {
    fn add_assign(&mut self, other: &Self) {
        self.turn += other.turn;
        self.mixed += other.mixed;
        self.shift += other.shift;
        self.lever += other.lever;
        self.force += other.force;
    }
}

/// Covariance of the twist of a rigid body, symmetric 6 by 6, in blocks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TwistCovariance {
    turn: Matrix3<f64>,
    /// Of the rotation's rows and the shift's columns.
    mixed: Matrix3<f64>,
    shift: Matrix3<f64>,
}

impl TwistCovariance {
    /// Adds a DoF that moves the body by `twist`, with this `variance`; `shared` is the sum of the
    /// earlier twists, each times its covariance with this one.
    pub(super) fn add(&mut self, twist: &Twist, variance: f64, shared: &Twist) {
        // S uᵀ + u Sᵀ + σ S Sᵀ = S wᵀ + w Sᵀ with w = u + σ/2 S.
        let mut with = *shared;
        with.add_share(twist, 0.5 * variance);
        let (turn, shift) = (&twist.turn, &twist.shift_m);
        self.turn += turn * with.turn.transpose() + with.turn * turn.transpose();
        self.mixed += turn * with.shift_m.transpose() + with.turn * shift.transpose();
        self.shift += shift * with.shift_m.transpose() + with.shift_m * shift.transpose();
    }

    /// Trace of the covariance of a point at `x_m` from the origin: X K Xᵀ, m².
    pub(super) fn trace_at(&self, x_m: &Vector3<f64>) -> f64 {
        let swept = x_m.norm_squared() * self.turn.trace() - x_m.dot(&(self.turn * x_m));
        swept - 2.0 * x_m.dot(&axial(&self.mixed)) + self.shift.trace()
    }
}

/// `[x]×` M.
fn crossed(x: &Vector3<f64>, m: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[
        x.cross(&m.column(0)),
        x.cross(&m.column(1)),
        x.cross(&m.column(2)),
    ])
}

/// Σ u × v, if `m` is Σ u vᵀ.
fn axial(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(
        m[(1, 2)] - m[(2, 1)],
        m[(2, 0)] - m[(0, 2)],
        m[(0, 1)] - m[(1, 0)],
    )
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-3.0f64..3.0).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn vectorised_dots_equal_single_ones_to_the_bit(
            vectors in prop::collection::vec((vector(), vector()), N_DOF), moment in vector(), force in vector(),
            first in 0..N_DOF, n in 0..=N_DOF,
        ) {
            let twists = std::array::from_fn(|i| Twist { turn: vectors[i].0, shift_m: vectors[i].1 });
            let mut motions = Motions::default();
            motions.set(&twists);
            let (push, dofs) = (Push { moment, force }, first..(first + n).min(N_DOF));
            let mut done = vec![0.0; dofs.len()];
            motions.dot(dofs.clone(), &push, &mut done);
            for (done, twist) in done.iter().zip(&twists[dofs]) {
                prop_assert_eq!(done.to_bits(), twist.dot(&push).to_bits());
            }
        }
    }
}
