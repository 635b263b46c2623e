//! The solver.

use farfield_proto::venue::parameters::IkParameters;

use super::normal::{Factor, NormalEquations};
use super::observability::Observability;
use super::priors::PriorTerm;
use super::target::Aims;
use super::{Priors, Solution, Target};
use crate::body::skeleton::{Kinematics, N_DOF, N_ROOT_DOF, Pose, RangeOfMotion, Skeleton};

/// First damping, as a share of the diagonal of the targets' normal equations.
const FIRST_DAMPING: f64 = 1e-5;
/// Damping at which a solve gives up.
const MAX_DAMPING: f64 = 1e6;
/// A failed step raises the damping by this factor (and at least to `RETRY_DAMPING`), a successful
/// one lowers it.
const DAMPING_UP: f64 = 20.0;
const DAMPING_DOWN: f64 = 0.1;
const RETRY_DAMPING: f64 = 1e-3;
/// Longest step of an angle in one iteration, radians: the linear model is invalid beyond.
const MAX_STEP_RAD: f64 = 1.0;
/// A solve ends if its next step would be shorter than this share of the tolerance, assuming steps
/// continue to shrink.
const CONVERGED: f64 = 0.3;
/// Least ratio of successive steps in that extrapolation: slow convergence shows late.
const LEAST_SHRINK: f64 = 0.1;
/// Most times that DoF are added to the active set within one step.
const MAX_ROUNDS: usize = 8;

/// A reusable solver that does not allocate. No state of a solve affects the next result.
#[derive(Debug, Clone)]
pub struct IkSolver {
    max_iterations: u32,
    tolerance: f64,
    aims: Aims,
    body: Kinematics,
    normal: NormalEquations,
    factor: Factor,
    observability: Observability,
    prior: PriorTerm,
}

/// State of a solve.
struct Progress {
    pose: Pose,
    cost: f64,
    /// The priors' gradient there.
    prior_gradient: [f64; N_DOF],
}

/// Limits of a step.
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
            aims: Aims::default(),
            body: Kinematics::default(),
            normal: NormalEquations::new(),
            factor: Factor::new(),
            observability: Observability::new(),
            prior: PriorTerm::new(),
        }
    }

    /// Finds the pose for `targets` and `priors`, starting at `start`, and the unobserved angles.
    /// Without `bounds` this is the paper's (10), with them (14). The result is finite if `start`
    /// and `priors` are.
    pub fn solve(
        &mut self,
        skeleton: &Skeleton,
        start: &Pose,
        targets: &[Target],
        priors: &Priors,
        bounds: Option<&RangeOfMotion>,
    ) -> Solution {
        let pose = self.fit(skeleton, start, targets, priors, bounds);
        self.aims.gather_evidence(&self.body, &mut self.normal);
        self.observability.measure(&self.normal, &mut self.factor);
        Solution {
            pose,
            unobserved: self.observability.unobserved(&pose),
        }
    }

    /// As [`Self::solve`], without unobserved angles.
    pub fn fit(
        &mut self,
        skeleton: &Skeleton,
        start: &Pose,
        targets: &[Target],
        priors: &Priors,
        bounds: Option<&RangeOfMotion>,
    ) -> Pose {
        self.aims.set(targets);
        // Free angles are wrapped at the end: so a step across ±π is like any other.
        let inside = |pose: Pose| bounds.map_or(pose, |range| range.clamp(pose));
        let (mut at, mut is_placed) = (self.begin(skeleton, &inside(*start), priors), true);
        let mut damping = FIRST_DAMPING;
        let mut iterations = 0;
        let mut is_linearised = true;
        let mut longest = 0.0;
        while iterations < self.max_iterations && damping < MAX_DAMPING {
            iterations += 1;
            if !is_linearised {
                let is_curved = bounds.is_none();
                self.aims.linearise(&self.body, is_curved, &mut self.normal);
                is_linearised = true;
            }
            let step = self.step(&at, bounds, damping, longest);
            let moved = inside(at.pose.moved(&step));
            skeleton.forward(&moved, &mut self.body);
            let prior = self.prior.at(&moved, priors);
            let cost = self.aims.place(&self.body) + prior.cost;
            is_placed = cost <= at.cost && cost.is_finite();
            if is_placed {
                at = Progress {
                    pose: moved,
                    cost,
                    prior_gradient: prior.gradient,
                };
                is_linearised = false;
                damping *= DAMPING_DOWN;
            } else {
                self.normal.straighten();
                damping = (damping * DAMPING_UP).max(RETRY_DAMPING);
            }
            let before = std::mem::replace(&mut longest, longest_of(&step));
            let ahead = longest * (longest / before).clamp(LEAST_SHRINK, 1.0);
            let is_converged = is_placed && ahead < CONVERGED * self.tolerance;
            if longest < self.tolerance || is_converged {
                break;
            }
        }
        let pose = if bounds.is_none() {
            at.pose.wrapped()
        } else {
            at.pose
        };
        if !is_placed || pose != at.pose {
            skeleton.forward(&pose, &mut self.body);
            self.aims.place(&self.body);
        }
        pose
    }

    /// The body in the last found pose.
    pub fn body(&self) -> &Kinematics {
        &self.body
    }

    /// Places the body at the start, and weakens the priors by the targets.
    fn begin(&mut self, skeleton: &Skeleton, start: &Pose, priors: &Priors) -> Progress {
        skeleton.forward(start, &mut self.body);
        let cost = self.aims.place(&self.body);
        self.aims.linearise(&self.body, false, &mut self.normal);
        self.observability.measure(&self.normal, &mut self.factor);
        self.prior.weigh(priors, &self.observability);
        let prior = self.prior.at(start, priors);
        Progress {
            pose: *start,
            cost: cost + prior.cost,
            prior_gradient: prior.gradient,
        }
    }

    /// The damped step from there, within the bounds and `MAX_STEP_RAD`. The curvature of the cost
    /// is used only if it leads to a nearby minimum: not farther than the step `before`.
    fn step(
        &mut self,
        at: &Progress,
        bounds: Option<&RangeOfMotion>,
        damping: f64,
        before: f64,
    ) -> [f64; N_DOF] {
        let (step, is_positive) = self.damped_step(at, bounds, damping);
        if !self.normal.is_curved() || (is_positive && longest_of(&step) <= before) {
            return step;
        }
        self.normal.straighten();
        self.damped_step(at, bounds, damping).0
    }

    /// The damped step for the current normal equations, and whether these are positive definite.
    fn damped_step(
        &mut self,
        at: &Progress,
        bounds: Option<&RangeOfMotion>,
        damping: f64,
    ) -> ([f64; N_DOF], bool) {
        let mut gradient = at.prior_gradient;
        let mut diagonal = self.prior.precision();
        for i in 0..N_DOF {
            gradient[i] += self.normal.gradient()[i];
            diagonal[i] += damping * (self.normal.diagonal(i) + diagonal[i]);
        }
        let (mut step, is_positive) = self.bounded_step(&SolverStep {
            pose: &at.pose,
            gradient,
            diagonal,
            bounds,
        });
        let longest = longest_of(&step[3..]);
        if longest > MAX_STEP_RAD {
            for d in &mut step {
                *d *= MAX_STEP_RAD / longest;
            }
        }
        (step, is_positive)
    }

    /// Minimises the quadratic model within the bounds by an active set: DoF that push outward at
    /// their bound are held, and DoF whose step would cross a bound are held there, until none
    /// does.
    fn bounded_step(&mut self, at: &SolverStep<'_>) -> ([f64; N_DOF], bool) {
        let mut is_positive = true;
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
            is_positive &= self.factor.compute(&self.normal, &at.diagonal, &held);
            self.factor.solve(&mut rhs);
            let Some(range) = at.bounds else {
                return (rhs, is_positive);
            };
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
        (step, is_positive)
    }
}

/// The longest of several motions.
fn longest_of(step: &[f64]) -> f64 {
    step.iter().fold(0.0, |longest, d| longest.max(d.abs()))
}
