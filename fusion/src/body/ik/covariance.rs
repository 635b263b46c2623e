//! Covariance of a pose's joints, from the information about points of the body.
//!
//! ```text
//!   H = Σₜ Jₜᵀ Iₜ Jₜ + diag(1/spreadᵢ²),     var(p) = trace(Jₚ H⁻¹ Jₚᵀ)/3
//! ```
//!
//! Iₜ is the information (inverse covariance, 1/m²) about a point, Jₜ its Jacobian. An unseen DoF
//! keeps the spread of its clinical range, so that a limb without evidence is somewhere within its
//! reach.

use nalgebra::{Matrix3, Vector3};

use super::composite::{Twist, TwistCovariance};
use super::normal::{Factor, NormalEquations, Row};
use super::observability::spread_before;
use crate::body::skeleton::dof::{ANCESTORS, LINKS, MAX_CHAIN};
use crate::body::skeleton::{Joint, Kinematics, N_DOF, N_JOINTS, N_LINKS, Site};

/// The information about one point of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointInformation {
    /// The place of the point on the body.
    pub site: Site,
    /// Inverse covariance of its place in the world, 1/m²; may be singular (a ray has no
    /// information along itself).
    pub information: Matrix3<f64>,
}

/// The spread of the joints about a pose, with reused buffers: does not allocate.
#[derive(Debug, Clone)]
pub struct JointSpread {
    normal: NormalEquations,
    factor: Factor,
    covariance: Box<[Row; N_DOF]>,
    /// Prior precision of each DoF.
    before: [f64; N_DOF],
}

impl Default for JointSpread {
    fn default() -> Self {
        Self {
            normal: NormalEquations::new(),
            factor: Factor::new(),
            covariance: Box::new([[0.0; MAX_CHAIN]; N_DOF]),
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
        self.normal.begin(body);
        for point in points.filter(|p| p.information.iter().all(|v| v.is_finite())) {
            let (link, place_m) = (point.site.joint.link(), body.site_m(&point.site));
            let (information, pull) = (&point.information, Vector3::zeros());
            self.normal.add(link, &place_m, information, &pull);
        }
        self.normal.gather(body, false);
        self.factor
            .compute(&self.normal, &self.before, &[false; N_DOF]);
        self.factor.invert(&mut self.covariance);
        let link_covariances = self.link_covariances();
        Joint::ALL.map(|joint| {
            let x_m = body.joint_m(joint) - self.normal.origin_m();
            link_covariances[joint.link() as usize].trace_at(&x_m) / 3.0
        })
    }

    /// The covariance of the twist of each link.
    fn link_covariances(&self) -> [TwistCovariance; N_LINKS] {
        let twists = self.normal.twists();
        let mut link_covariances = [TwistCovariance::default(); N_LINKS];
        for (l, link) in LINKS.iter().enumerate() {
            let mut known = link_covariances[link.parent as usize];
            for i in link.dofs() {
                let (row, ancestors) = (&self.covariance[i], ANCESTORS[i].dofs());
                let mut shared = Twist::default();
                for (covariance, &j) in row.iter().zip(ancestors) {
                    shared.add_share(&twists[j], *covariance);
                }
                known.add(&twists[i], row[ancestors.len()], &shared);
            }
            link_covariances[l] = known;
        }
        link_covariances
    }
}
