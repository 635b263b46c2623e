//! The solver.

use farfield_proto::venue::parameters::IkParameters;
use nalgebra::{Matrix3, Vector3};

use super::Priors;
use super::normal::{Factor, NormalEquations};
use super::observability::Observability;
use crate::body::skeleton::dof::{DofGroup, first_of};
use crate::body::skeleton::{
    Joint, Kinematics, N_DOF, N_JOINT_DOF, N_ROOT_DOF, Pose, RangeOfMotion, Side, Site, Skeleton,
    wrap,
};

/// First damping, as a share of the diagonal of the targets' normal equations.
const FIRST_DAMPING: f64 = 1e-5;
/// Damping beyond which no step helps.
const MAX_DAMPING: f64 = 1e6;
/// A step that made it worse raises the damping by this factor (and at least to `RETRY_DAMPING`),
/// one that helped lowers it.
const DAMPING_UP: f64 = 20.0;
const DAMPING_DOWN: f64 = 0.1;
const RETRY_DAMPING: f64 = 1e-3;
/// Longest step of an angle in one iteration, radians: the linear model is worth nothing beyond.
const MAX_STEP_RAD: f64 = 1.0;
/// Most times that DoF are added to the active set within one step.
const MAX_ROUNDS: usize = 8;

/// Where a point of the body should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// The joint that the point belongs to.
    pub joint: Joint,
    /// Offset of the point from the joint in the frame of [`Joint::link`], metres.
    pub offset_m: Vector3<f64>,
    /// Where it should be in the world, metres.
    pub position_m: Vector3<f64>,
    /// Inverse covariance, world axes, 1/m²: symmetric, without negative eigenvalues. It may be singular: of a
    /// keypoint that one viewpoint sees, nothing is known along its ray. A target whose information is zero,
    /// or not finite, is left out.
    pub information: Matrix3<f64>,
}

impl Target {
    /// A target that is known equally well along all axes, with the inverse variance `weight` per axis, 1/m².
    pub fn isotropic(site: &Site, position_m: Vector3<f64>, weight: f64) -> Self {
        Self {
            joint: site.joint,
            offset_m: site.offset_m,
            position_m,
            information: Matrix3::from_diagonal_element(weight),
        }
    }

    fn site(&self) -> Site {
        Site {
            joint: self.joint,
            offset_m: self.offset_m,
        }
    }

    fn counts(&self) -> bool {
        self.information.trace() > 0.0
            && self.information.iter().all(|v| v.is_finite())
            && self.position_m.iter().all(|v| v.is_finite())
    }
}

/// What a solve found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The pose; inside the bounds exactly, if there were any.
    pub pose: Pose,
    /// Bit `i` is set where the targets did not determine reported angle `i` (see [`super`]). Only
    /// keypoints are evidence: the joints of a pose that priors made (the targets of the second
    /// IK) determine everything and say nothing.
    pub unobserved: u64,
}

/// A reusable solver; a solve allocates nothing. It keeps no state from solve to solve that a result
/// depends on.
#[derive(Debug, Clone)]
pub struct IkSolver {
    max_iterations: u32,
    tolerance: f64,
    body: Kinematics,
    normal: NormalEquations,
    factor: Factor,
    observability: Observability,
    prior: PriorTerm,
}

/// The priors as one quadratic per DoF, already weighted by what the targets leave open.
#[derive(Debug, Clone)]
struct PriorTerm {
    rest_precision: [f64; N_JOINT_DOF],
    change_precision: [f64; N_DOF],
}

/// What a step must respect.
struct SolverStep<'a> {
    pose: &'a Pose,
    gradient: [f64; N_DOF],
    diagonal: [f64; N_DOF],
    bounds: Option<&'a RangeOfMotion>,
}

impl IkSolver {
    /// A solver with the iterations and the tolerance of `parameters`.
    pub fn new(parameters: &IkParameters) -> Self {
        Self::with_limits(parameters.iterations, parameters.tolerance_rad)
    }

    /// A solver that stops after `max_iterations` steps, or when no angle moves by `tolerance_rad`
    /// (and the pelvis by as many metres).
    pub fn with_limits(max_iterations: u32, tolerance_rad: f64) -> Self {
        Self {
            max_iterations,
            tolerance: tolerance_rad,
            body: Kinematics::default(),
            normal: NormalEquations::new(),
            factor: Factor::new(),
            observability: Observability::new(),
            prior: PriorTerm {
                rest_precision: [0.0; N_JOINT_DOF],
                change_precision: [0.0; N_DOF],
            },
        }
    }

    /// Finds the pose that `targets` and `priors` ask for, from `start` on. Without `bounds` this
    /// is the paper's (10), with them (14). Whatever the targets, the result is finite if `start`
    /// and `priors` are.
    pub fn solve(
        &mut self,
        skeleton: &Skeleton,
        start: &Pose,
        targets: &[Target],
        priors: &Priors,
        bounds: Option<&RangeOfMotion>,
    ) -> Solution {
        // Free angles are wrapped when all is done: a step across ±π is then like any other.
        let inside = |pose: Pose| bounds.map_or(pose, |range| range.clamp(pose));
        let mut pose = inside(*start);
        let mut cost = self.place(skeleton, &pose, targets);
        self.linearise(targets);
        self.weigh(priors);
        cost += self.prior.cost(&pose, priors);
        let mut damping = FIRST_DAMPING;
        let mut iterations = 0;
        let mut is_linearised = true;
        while iterations < self.max_iterations && damping < MAX_DAMPING {
            iterations += 1;
            if !is_linearised {
                self.linearise(targets);
                is_linearised = true;
            }
            let step = self.step(&pose, priors, bounds, damping);
            let moved = inside(pose.moved(&step));
            let moved_cost =
                self.place(skeleton, &moved, targets) + self.prior.cost(&moved, priors);
            let longest = step.iter().fold(0.0_f64, |longest, d| longest.max(d.abs()));
            if moved_cost <= cost && moved_cost.is_finite() {
                (pose, cost, is_linearised) = (moved, moved_cost, false);
                damping *= DAMPING_DOWN;
            } else {
                damping = (damping * DAMPING_UP).max(RETRY_DAMPING);
            }
            if longest < self.tolerance {
                break;
            }
        }
        if bounds.is_none() {
            pose = pose.wrapped();
        }
        skeleton.forward(&pose, &mut self.body);
        self.linearise(targets);
        self.observability.measure(&self.normal, &mut self.factor);
        Solution {
            pose,
            unobserved: self.observability.unobserved(&pose),
        }
    }

    /// Places the body and returns the targets' part of the cost.
    fn place(&mut self, skeleton: &Skeleton, pose: &Pose, targets: &[Target]) -> f64 {
        skeleton.forward(pose, &mut self.body);
        let cost = |t: &Target| {
            let residual_m = self.body.site_m(&t.site()) - t.position_m;
            residual_m.dot(&(t.information * residual_m))
        };
        0.5 * targets.iter().filter(|t| t.counts()).map(cost).sum::<f64>()
    }

    /// Builds the normal equations where the body was placed.
    fn linearise(&mut self, targets: &[Target]) {
        self.normal.clear();
        for target in targets.iter().filter(|t| t.counts()) {
            let point_m = self.body.site_m(&target.site());
            let residual_m = point_m - target.position_m;
            self.normal.add(
                &self.body,
                target.joint.link(),
                &point_m,
                &residual_m,
                &target.information,
            );
        }
    }

    /// Lets the priors give way where the targets know better.
    fn weigh(&mut self, priors: &Priors) {
        self.observability.measure(&self.normal, &mut self.factor);
        for (i, precision) in self.prior.change_precision.iter_mut().enumerate() {
            *precision = (self.observability.ignorance(i) / priors.change_sigma[i]).powi(2);
        }
        for (i, precision) in self.prior.rest_precision.iter_mut().enumerate() {
            let ignorance = self.observability.ignorance(N_ROOT_DOF + i);
            *precision = ignorance.powi(3) / priors.rest_sigma_rad[i].powi(2);
        }
    }

    /// The damped step from `pose`, no further than the bounds and `MAX_STEP_RAD`.
    fn step(
        &mut self,
        pose: &Pose,
        priors: &Priors,
        bounds: Option<&RangeOfMotion>,
        damping: f64,
    ) -> [f64; N_DOF] {
        let mut gradient = self.prior.gradient(pose, priors);
        let mut diagonal = self.prior.precision();
        for i in 0..N_DOF {
            gradient[i] += self.normal.gradient()[i];
            diagonal[i] += damping * (self.normal.diagonal(i) + diagonal[i]);
        }
        let mut step = self.bounded_step(&SolverStep {
            pose,
            gradient,
            diagonal,
            bounds,
        });
        let longest = step[3..]
            .iter()
            .fold(0.0_f64, |longest, d| longest.max(d.abs()));
        if longest > MAX_STEP_RAD {
            for d in &mut step {
                *d *= MAX_STEP_RAD / longest;
            }
        }
        step
    }

    /// Minimises the quadratic model within the bounds by an active set: DoF that push outward at
    /// their bound are held, and DoF whose step would cross a bound are held there, until none does.
    fn bounded_step(&mut self, at: &SolverStep<'_>) -> [f64; N_DOF] {
        let mut held = [false; N_DOF];
        let mut step = [0.0; N_DOF];
        if let Some(range) = at.bounds {
            for (i, &q) in at.pose.dof.iter().enumerate() {
                let g = at.gradient[N_ROOT_DOF + i];
                held[N_ROOT_DOF + i] =
                    (q <= range.lo_rad(i) && g > 0.0) || (q >= range.hi_rad(i) && g < 0.0);
            }
        }
        for _ in 0..MAX_ROUNDS {
            let mut rhs = at.gradient.map(|g| -g);
            self.normal.move_prescribed(&held, &step, &mut rhs);
            for i in 0..N_DOF {
                if held[i] {
                    rhs[i] = step[i];
                }
            }
            self.factor.compute(&self.normal, &at.diagonal, &held);
            self.factor.solve(&mut rhs);
            let Some(range) = at.bounds else { return rhs };
            let mut crossed = false;
            for (i, &q) in at.pose.dof.iter().enumerate() {
                let k = N_ROOT_DOF + i;
                let (lo, hi) = (range.lo_rad(i), range.hi_rad(i));
                if !held[k] && !(lo..=hi).contains(&(q + rhs[k])) {
                    held[k] = true;
                    rhs[k] = (q + rhs[k]).clamp(lo, hi) - q;
                    crossed = true;
                }
            }
            step = rhs;
            if !crossed {
                break;
            }
        }
        step
    }
}

impl PriorTerm {
    /// Precision per DoF.
    fn precision(&self) -> [f64; N_DOF] {
        let mut precision = self.change_precision;
        for (p, rest) in precision[N_ROOT_DOF..].iter_mut().zip(&self.rest_precision) {
            *p += rest;
        }
        precision
    }

    /// Gradient at `pose`. (For the root's rotation vector r the inverse right Jacobian leaves r as
    /// it is, so this is exact.)
    fn gradient(&self, pose: &Pose, priors: &Priors) -> [f64; N_DOF] {
        let mut gradient = change(&priors.last, pose);
        for (g, precision) in gradient.iter_mut().zip(&self.change_precision) {
            *g *= precision;
        }
        for (i, precision) in self.rest_precision.iter().enumerate() {
            gradient[N_ROOT_DOF + i] += precision * turn(i, priors.rest[i], pose.dof[i]);
        }
        gradient
    }

    fn cost(&self, pose: &Pose, priors: &Priors) -> f64 {
        let change: f64 = change(&priors.last, pose)
            .iter()
            .zip(&self.change_precision)
            .map(|(d, p)| p * d * d)
            .sum();
        let rest = |(i, p): (usize, &f64)| p * turn(i, priors.rest[i], pose.dof[i]).powi(2);
        0.5 * (change
            + self
                .rest_precision
                .iter()
                .enumerate()
                .map(rest)
                .sum::<f64>())
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

/// How far joint DoF `i` turns, radians: the shorter way round, unless it is one of the two swings of a
/// shoulder, which wrap together and only where no arm points.
fn turn(i: usize, from_rad: f64, to_rad: f64) -> f64 {
    if is_swing(i) {
        to_rad - from_rad
    } else {
        wrap(to_rad - from_rad)
    }
}

fn is_swing(i: usize) -> bool {
    Side::BOTH.into_iter().any(|side| {
        let first = first_of(side, DofGroup::Shoulder);
        (first..first + 2).contains(&i)
    })
}
