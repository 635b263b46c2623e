//! Information of a tick's points about constants of the body, with the pose eliminated.
//!
//! A pose adapts to errors of its body: a knee that is seen away from the joint bends the leg. Only
//! the residual that no pose can remove is information about the body,
//!
//! ```text
//!   M = CᵀIC - CᵀIJ H⁻¹ JᵀIC,    m = CᵀIr - CᵀIJ H⁻¹ JᵀIr,    H = JᵀIJ + diag(1/spreadᵢ²)
//! ```
//!
//! with J and C the Jacobians of the points by pose and constants, I their information and r the
//! displacement from the body's points to the seen ones: the normal equations of both, with the
//! pose eliminated (a Schur complement). M and m of many ticks add up.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::normal::{Factor, NormalEquations};
use super::observability::spread_before;
use crate::body::skeleton::{Joint, Kinematics, N_DOF, chain_of};

/// A seen point of a body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeenPoint<const N: usize> {
    pub(crate) joint: Joint,
    /// Its place on the body, world, metres.
    pub(crate) place_m: Vector3<f64>,
    /// From there to the seen place, world, metres.
    pub(crate) off_m: Vector3<f64>,
    /// Inverse covariance of the seen place, 1/m².
    pub(crate) information: Matrix3<f64>,
    /// Its motion per unit of each constant in a fixed pose, world, metres.
    pub(crate) moves: [Vector3<f64>; N],
}

/// Information of a tick about a body's constants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConstantsInformation<const N: usize> {
    /// M: inverse covariance of the constants.
    pub(crate) information: SMatrix<f64, N, N>,
    /// m: M times the displacement from the body's constants to the seen ones.
    pub(crate) pull: SVector<f64, N>,
}

/// The elimination of the pose, with reused buffers: does not allocate.
#[derive(Debug, Clone)]
pub(crate) struct PoseElimination {
    normal: NormalEquations,
    factor: Factor,
    /// Prior precision of each DoF.
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

    /// The information of `points` of `body` about its constants.
    pub(crate) fn information<const N: usize>(
        &mut self,
        body: &Kinematics,
        points: &[SeenPoint<N>],
    ) -> ConstantsInformation<N> {
        self.normal.begin(body);
        for point in points {
            let (link, pull) = (point.joint.link(), point.information * point.off_m);
            self.normal
                .add(link, &point.place_m, &point.information, &pull);
        }
        self.normal.gather(body, false);
        self.factor
            .compute(&self.normal, &self.before, &[false; N_DOF]);
        // H⁻¹ JᵀIr, the pose's part of r.
        let mut by_pose = *self.normal.gradient();
        self.factor.solve(&mut by_pose);
        let mut result = ConstantsInformation {
            information: SMatrix::zeros(),
            pull: SVector::zeros(),
        };
        // JᵀIC, one constant per row.
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
                result.pull[a] += pull.dot(&point.off_m);
                for (b, by_b) in point.moves.iter().enumerate() {
                    result.information[(a, b)] += pull.dot(by_b);
                }
            }
        }
        for a in 0..N {
            result.pull[a] -= dot(&shared[a], &by_pose);
            let mut taken = shared[a];
            self.factor.solve(&mut taken);
            for (b, shared) in shared.iter().enumerate() {
                result.information[(a, b)] -= dot(shared, &taken);
            }
        }
        result
    }
}

fn dot(u: &[f64; N_DOF], v: &[f64; N_DOF]) -> f64 {
    u.iter().zip(v).map(|(u, v)| u * v).sum()
}
