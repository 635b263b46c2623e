//! What the points of a tick say of numbers that stay the same for a body, once its pose has taken its share.
//!
//! A pose gives way to whatever is wrong with its body: a knee that is seen beside the joint bends the leg. What no pose
//! can follow is what a tick says of the body,
//!
//! ```text
//!   M = CᵀIC - CᵀIJ H⁻¹ JᵀIC,    m = CᵀIr - CᵀIJ H⁻¹ JᵀIr,    H = JᵀIJ + diag(1/spreadᵢ²)
//! ```
//!
//! with J and C the Jacobians of the points by pose and constants, I their information and r the way from where the
//! body has them to where they were seen: the normal equations of both, the pose eliminated (a Schur complement). M and
//! m of many ticks add up.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::factor::Factor;
use super::normal::NormalEquations;
use super::observability::spread_before;
use crate::body::skeleton::{Joint, Kinematics, N_DOF, chain_of};

/// A point of a body that was seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeenPoint<const N: usize> {
    /// The joint that it belongs to.
    pub(crate) joint: Joint,
    /// Where the body has it, world, metres.
    pub(crate) place_m: Vector3<f64>,
    /// From there to where it was seen, world, metres.
    pub(crate) off_m: Vector3<f64>,
    /// Inverse covariance of where it was seen, 1/m².
    pub(crate) information: Matrix3<f64>,
    /// By what it moves per unit of each constant while the pose stays, world, metres.
    pub(crate) moves: [Vector3<f64>; N],
}

/// What a tick says of a body's constants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SaidOfConstants<const N: usize> {
    /// M: inverse covariance of the constants.
    pub(crate) information: SMatrix<f64, N, N>,
    /// m: M times the way from the constants that the body has to those that were seen.
    pub(crate) pull: SVector<f64, N>,
}

/// The elimination of the pose; reusable, nothing is allocated from call to call.
#[derive(Debug, Clone)]
pub(crate) struct PoseElimination {
    normal: NormalEquations,
    factor: Factor,
    /// Precision of each DoF before anything is seen.
    before: [f64; N_DOF],
}

impl PoseElimination {
    pub(crate) fn new() -> Self {
        Self {
            normal: NormalEquations::new(),
            factor: Factor::new(),
            before: spread_before().map(|s| 1.0 / (s * s)),
        }
    }

    /// What `points` of `body` say of its constants.
    pub(crate) fn said<const N: usize>(
        &mut self,
        body: &Kinematics,
        points: &[SeenPoint<N>],
    ) -> SaidOfConstants<N> {
        self.normal.begin(body);
        for point in points {
            let (link, pull) = (point.joint.link(), point.information * point.off_m);
            self.normal
                .add(link, &point.place_m, &point.information, &pull);
        }
        self.normal.gather(body, false);
        self.factor
            .compute(&self.normal, &self.before, &[false; N_DOF]);
        // H⁻¹ JᵀIr, what the pose takes of r.
        let mut by_pose = *self.normal.gradient();
        self.factor.solve(&mut by_pose);
        let mut said = SaidOfConstants {
            information: SMatrix::zeros(),
            pull: SVector::zeros(),
        };
        // JᵀIC, a constant a row.
        let mut shared = [[0.0; N_DOF]; N];
        for point in points {
            for (a, by_a) in point.moves.iter().enumerate() {
                if *by_a == Vector3::zeros() {
                    continue;
                }
                let pull = point.information * by_a;
                for &dof in chain_of(point.joint.link()) {
                    shared[a][dof] += body.moving_column(dof, &point.place_m).dot(&pull);
                }
                said.pull[a] += pull.dot(&point.off_m);
                for (b, by_b) in point.moves.iter().enumerate() {
                    said.information[(a, b)] += pull.dot(by_b);
                }
            }
        }
        for a in 0..N {
            said.pull[a] -= dot(&shared[a], &by_pose);
            let mut taken = shared[a];
            self.factor.solve(&mut taken);
            for (b, shared) in shared.iter().enumerate() {
                said.information[(a, b)] -= dot(shared, &taken);
            }
        }
        said
    }
}

fn dot(u: &[f64; N_DOF], v: &[f64; N_DOF]) -> f64 {
    u.iter().zip(v).map(|(u, v)| u * v).sum()
}
