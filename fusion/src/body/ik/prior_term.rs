//! The priors as one quadratic per DoF, weighted by what the targets leave open.

use super::Priors;
use super::observability::Observability;
use crate::body::skeleton::dof::{DofGroup, first_of};
use crate::body::skeleton::{N_DOF, N_JOINT_DOF, N_ROOT_DOF, Pose, Side, wrap};

/// Strength of the priors in one solve.
#[derive(Debug, Clone)]
pub(super) struct PriorTerm {
    rest_precision: [f64; N_JOINT_DOF],
    change_precision: [f64; N_DOF],
}

/// Cost and gradient of the priors for one pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct PriorPull {
    /// Their part of the cost.
    pub(super) cost: f64,
    /// Its gradient. (For the root's rotation vector r the inverse right Jacobian does not change
    /// r, so this is exact.)
    pub(super) gradient: [f64; N_DOF],
}

impl PriorTerm {
    pub(super) fn new() -> Self {
        Self {
            rest_precision: [0.0; N_JOINT_DOF],
            change_precision: [0.0; N_DOF],
        }
    }

    /// Weakens the priors where the targets, as measured in `known`, determine a DoF.
    pub(super) fn weigh(&mut self, priors: &Priors, known: &Observability) {
        for (i, precision) in self.change_precision.iter_mut().enumerate() {
            *precision = (known.ignorance(i) / priors.change_sigma[i]).powi(2);
        }
        for (i, precision) in self.rest_precision.iter_mut().enumerate() {
            let ignorance = known.ignorance(N_ROOT_DOF + i);
            *precision = ignorance.powi(3) / priors.rest_sigma_rad[i].powi(2);
        }
    }

    /// Precision per DoF.
    pub(super) fn precision(&self) -> [f64; N_DOF] {
        let mut precision = self.change_precision;
        for (p, rest) in precision[N_ROOT_DOF..].iter_mut().zip(&self.rest_precision) {
            *p += rest;
        }
        precision
    }

    /// Cost and gradient for `pose`.
    pub(super) fn at(&self, pose: &Pose, priors: &Priors) -> PriorPull {
        let mut gradient = change(&priors.last, pose);
        let mut cost = 0.0;
        for (g, precision) in gradient.iter_mut().zip(&self.change_precision) {
            let moved = *g;
            *g *= precision;
            cost += *g * moved;
        }
        for (i, precision) in self.rest_precision.iter().enumerate() {
            let turned = turn(i, priors.rest[i], pose.dof[i]);
            let pull = precision * turned;
            gradient[N_ROOT_DOF + i] += pull;
            cost += pull * turned;
        }
        PriorPull {
            cost: 0.5 * cost,
            gradient,
        }
    }
}

/// The motion from `last` to `pose`, each joint turning the shorter way round.
fn change(last: &Pose, pose: &Pose) -> [f64; N_DOF] {
    let mut step = last.step_to(pose);
    for (i, (from, to)) in last.dof.iter().zip(&pose.dof).enumerate() {
        step[N_ROOT_DOF + i] = turn(i, *from, *to);
    }
    step
}

/// How far joint DoF `i` turns, radians: the shorter way round. The two swings of a shoulder are an
/// exception: they wrap together, and only where no arm points.
fn turn(i: usize, from_rad: f64, to_rad: f64) -> f64 {
    if IS_SWING[i] {
        to_rad - from_rad
    } else {
        wrap(to_rad - from_rad)
    }
}

/// Whether a joint's DoF is one of the two swings of a shoulder.
const IS_SWING: [bool; N_JOINT_DOF] = {
    let mut is_swing = [false; N_JOINT_DOF];
    let right = first_of(Side::Right, DofGroup::Shoulder);
    let left = first_of(Side::Left, DofGroup::Shoulder);
    is_swing[right] = true;
    is_swing[right + 1] = true;
    is_swing[left] = true;
    is_swing[left + 1] = true;
    is_swing
};
