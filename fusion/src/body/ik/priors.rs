//! Priors of a pose: the rest pose and the last pose.
//!
//! Keypoints do not determine the ankles, how scapula and shoulder share a raised arm, the pelvis'
//! tilt relative to the spine, or the twist of a straight limb. These go to the rest pose and stay
//! near their last value. [`super`] describes how the priors yield to targets.

use std::sync::LazyLock;

use farfield_proto::venue::parameters::IkParameters;
use nalgebra::{UnitQuaternion, Vector3};

use super::observability::Observability;
use crate::body::skeleton::dof::{DofGroup, LUMBAR, NECK, first_of};
use crate::body::skeleton::{N_DOF, N_JOINT_DOF, N_ROOT_DOF, Pose, Side, wrap};

/// Rate for which `change_sigma_rad` is defined, hertz.
const STATED_RATE_HZ: f64 = 60.0;
/// Sigma of the pelvis' position between two ticks at that rate, metres (9 m/s).
const ROOT_CHANGE_SIGMA_M: f64 = 0.15;

/// Sigma of the rest pose per DoF, in units of `rest_sigma_rad`: trunk and neck, then one side.
/// Joints that keypoints always determine are nearly free.
const TRUNK_AND_NECK_SIGMA: [f64; 6] = [1.0; 6];
const SIDE_SIGMA: [f64; 14] = [
    1.0, 1.0, 0.5, // scapula: elevation, protraction, tilt
    3.0, 3.0, 2.0, // shoulder: swings, twist
    3.0, // elbow
    3.0, 1.5, 1.0, // hip: flexion, adduction, rotation
    3.0, // knee
    0.7, 0.5, 0.3, // ankle
];

/// Twist of a relaxed arm, radians (20 degrees): near the middle of the clinical rotations in every
/// direction of the arm.
const ARM_TWIST_REST_RAD: f64 = 0.35;
/// A relaxed elbow, radians (10 degrees).
const ELBOW_REST_RAD: f64 = 0.17;

/// Elevation of the arm up to which the scapula rests, radians (30 degrees).
const RHYTHM_FROM_RAD: f64 = 0.524;
/// Elevation of our scapula per elevation of the arm beyond. Half of the scapula's third (rhythm
/// 2:1) happens at the sternoclavicular joint, about which our scapula turns, so 30 of 150 degrees
/// (Neumann, see [`crate::body::skeleton::range_of_motion`]).
const RHYTHM_SHARE: f64 = 0.2;

/// The DoF of the neutral pose.
static NEUTRAL: LazyLock<[f64; N_JOINT_DOF]> =
    LazyLock::new(|| Pose::neutral(Vector3::zeros(), UnitQuaternion::identity()).dof);

/// The two priors of one solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Priors {
    /// Rest value per joint DoF, radians.
    pub rest: [f64; N_JOINT_DOF],
    /// Its standard deviation, radians.
    pub rest_sigma_rad: [f64; N_JOINT_DOF],
    /// The last pose, or a prediction from it.
    pub last: Pose,
    /// Standard deviation of the change from it per DoF: metres for the root's translation, else
    /// radians.
    pub change_sigma: [f64; N_DOF],
}

impl Priors {
    /// The priors of a solve `elapsed_s` seconds after `last`. The scapulas rest at the
    /// scapulohumeral rhythm of the last pose's arms.
    pub fn new(parameters: &IkParameters, last: &Pose, elapsed_s: f64) -> Self {
        let ticks = (elapsed_s * STATED_RATE_HZ).abs().max(1.0);
        let mut change_sigma = [parameters.change_sigma_rad * ticks; N_DOF];
        change_sigma[..3].fill(ROOT_CHANGE_SIGMA_M * ticks);
        let mut priors = Self {
            rest: *NEUTRAL,
            rest_sigma_rad: [parameters.rest_sigma_rad; N_JOINT_DOF],
            last: *last,
            change_sigma,
        };
        scale(
            &mut priors.rest_sigma_rad[LUMBAR..NECK + 3],
            &TRUNK_AND_NECK_SIGMA,
        );
        for side in Side::BOTH {
            let first = first_of(side, DofGroup::Scapula);
            scale(
                &mut priors.rest_sigma_rad[first..first + SIDE_SIGMA.len()],
                &SIDE_SIGMA,
            );
            priors.rest[first_of(side, DofGroup::Elbow)] = ELBOW_REST_RAD;
            priors.rest[first_of(side, DofGroup::Shoulder) + 2] = ARM_TWIST_REST_RAD;
        }
        priors.follow_arms();
        priors
    }

    /// Sets the rest elevation of the scapulas to the rhythm's for the last pose's arms.
    fn follow_arms(&mut self) {
        for side in Side::BOTH {
            let raised = self.last.arm_elevation_rad(side);
            let elevation = (raised - RHYTHM_FROM_RAD).max(0.0) * RHYTHM_SHARE;
            self.rest[first_of(side, DofGroup::Scapula)] = elevation;
        }
    }
}

fn scale(sigmas: &mut [f64], factors: &[f64]) {
    for (sigma, factor) in sigmas.iter_mut().zip(factors) {
        *sigma *= factor;
    }
}

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
