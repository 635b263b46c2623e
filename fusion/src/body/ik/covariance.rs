//! How far the joints of a pose may be from where they are, when points of the body are known so well.
//!
//! ```text
//!   H = Σₜ Jₜᵀ Iₜ Jₜ + diag(1/spreadᵢ²),     var(p) = trace(Jₚ H⁻¹ Jₚᵀ)/3
//! ```
//!
//! Iₜ is the information (inverse covariance, 1/m²) that was seen of a point, Jₜ its Jacobian; a DoF of
//! which nothing is seen keeps the spread of its clinical range, so that a limb without evidence is
//! somewhere within its reach, and not anywhere.

use nalgebra::{Matrix3, Vector3};

use super::normal::{Factor, NormalEquations};
use super::observability::spread_before;
use crate::body::skeleton::dof::MAX_CHAIN;
use crate::body::skeleton::{Joint, Kinematics, N_DOF, N_JOINTS, Site, chain_of};

/// What is known of one point of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointInformation {
    /// Where the point is on the body.
    pub site: Site,
    /// Inverse covariance of its place in the world, 1/m²; may be singular (a ray tells nothing along
    /// itself).
    pub information: Matrix3<f64>,
}

/// The spread of the joints about a pose; reusable, nothing is allocated from call to call.
#[derive(Debug, Clone)]
pub struct JointSpread {
    normal: NormalEquations,
    factor: Factor,
    /// Precision of what is known before, per DoF.
    before: [f64; N_DOF],
}

impl Default for JointSpread {
    fn default() -> Self {
        Self {
            normal: NormalEquations::new(),
            factor: Factor::new(),
            before: spread_before().map(|s| 1.0 / (s * s)),
        }
    }
}

impl JointSpread {
    /// Variance per axis (a third of the covariance's trace, m²) of each joint of `body`, given
    /// `points`. Information that is not finite counts as none.
    pub fn variances_m2(
        &mut self,
        body: &Kinematics,
        points: impl Iterator<Item = PointInformation>,
    ) -> [f64; N_JOINTS] {
        self.normal.clear();
        for point in points.filter(|p| p.information.iter().all(|v| v.is_finite())) {
            let place_m = body.site_m(&point.site);
            self.normal.add(
                body,
                point.site.joint.link(),
                &place_m,
                &Vector3::zeros(),
                &point.information,
            );
        }
        self.factor
            .compute(&self.normal, &self.before, &[false; N_DOF]);
        Joint::ALL.map(|joint| {
            let chain = chain_of(joint.link());
            let place_m = body.joint_m(joint);
            let mut columns = [Vector3::zeros(); MAX_CHAIN];
            for (column, &dof) in columns.iter_mut().zip(chain) {
                *column = body.moving_column(dof, &place_m);
            }
            self.factor.trace_of(chain, &mut columns) / 3.0
        })
    }
}
