//! The targets of one solve, and the body's distance from them.

use nalgebra::Vector3;

use super::Target;
use super::normal::NormalEquations;
use crate::body::skeleton::Kinematics;

/// A target, and the point of the body that belongs to it.
#[derive(Debug, Clone)]
struct AimedPoint {
    target: Target,
    /// In the last placed pose, world, metres.
    point_m: Vector3<f64>,
    /// Information times residual there: gradient of the cost by the point.
    pull: Vector3<f64>,
}

/// Valid targets. Allocates only for more than ever before.
#[derive(Debug, Clone, Default)]
pub(super) struct Aims {
    points: Vec<AimedPoint>,
}

impl Aims {
    /// Selects the valid ones of `targets`.
    pub(super) fn set(&mut self, targets: &[Target]) {
        self.points.clear();
        let counting = targets.iter().filter(|target| target.counts());
        self.points.extend(counting.map(|&target| AimedPoint {
            target,
            point_m: Vector3::zeros(),
            pull: Vector3::zeros(),
        }));
    }

    /// Updates the points of `body`; returns the targets' part of the cost.
    pub(super) fn place(&mut self, body: &Kinematics) -> f64 {
        let mut cost = 0.0;
        for aimed in &mut self.points {
            let target = &aimed.target;
            aimed.point_m = body.site_m(&target.site());
            let residual_m = aimed.point_m - target.position_m;
            aimed.pull = target.information * residual_m;
            cost += residual_m.dot(&aimed.pull);
        }
        0.5 * cost
    }

    /// Builds the normal equations of the targets as evidence for `body`, the last placed one;
    /// their gradient is unused.
    pub(super) fn gather_evidence(&self, body: &Kinematics, normal: &mut NormalEquations) {
        normal.begin(body);
        let pull = Vector3::zeros();
        for AimedPoint {
            target, point_m, ..
        } in &self.points
        {
            normal.add(target.joint.link(), point_m, &target.evidence, &pull);
        }
        normal.gather(body, false);
    }

    /// Builds the normal equations for `body`, the last placed one; see
    /// [`NormalEquations::gather`].
    pub(super) fn linearise(
        &self,
        body: &Kinematics,
        is_curved: bool,
        normal: &mut NormalEquations,
    ) {
        normal.begin(body);
        for AimedPoint {
            target,
            point_m,
            pull,
        } in &self.points
        {
            normal.add(target.joint.link(), point_m, &target.information, pull);
        }
        normal.gather(body, is_curved);
    }
}
