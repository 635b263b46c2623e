//! Damped steps (Levenberg-Marquardt).

use super::normal::{Columns, Normal, Step, cost, fold_radii, residual};
use super::problem::Problem;
use super::projection::PARAMETERS;

/// The limits of an adjustment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Most attempted steps.
    pub steps: usize,
    /// Relative decrease of the cost below which it has converged.
    pub decrease: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            steps: 100,
            decrease: 1e-9,
        }
    }
}

/// The outcome of an adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Half the summed loss at the start and at the end.
    pub cost: [f64; 2],
    /// Attempted steps.
    pub steps: usize,
    /// Whether the cost stopped falling within the limits.
    pub converged: bool,
}

/// Damping at the start.
const DAMPING: f64 = 1e-4;
/// An adjustment ends at this damping.
const MOST_DAMPING: f64 = 1e12;
/// Least damping.
const LEAST_DAMPING: f64 = 1e-12;

/// Moves the cameras and the path of `problem` to the nearest minimum of its cost.
///
/// Seven directions (six if priors fix the scale) have no effect, and damping leaves them unchanged.
pub fn adjust(problem: &mut Problem, limits: Limits) -> Outcome {
    let columns = Columns::new(problem);
    let mut current = cost(problem);
    let start = current;
    let (mut damping, mut growth) = (DAMPING, 2.0);
    let mut steps = 0;
    let mut converged = false;
    let mut slow = 0;
    'steps: while steps < limits.steps {
        let normal = Normal::new(problem, &columns);
        loop {
            steps += 1;
            let tried = normal.reduce(damping).and_then(|reduced| reduced.solve());
            let better = tried.and_then(|step| {
                let moved = moved(problem, &columns, &step);
                let found = cost(&moved);
                (found < current).then(|| (moved, found, predicted(&normal, &step, damping)))
            });
            if let Some((moved, found, predicted)) = better {
                let gain = (current - found) / predicted.max(f64::MIN_POSITIVE);
                *problem = moved;
                let decrease = (current - found) / current.max(f64::MIN_POSITIVE);
                current = found;
                let shrink = 1.0 - (2.0 * gain - 1.0) * (2.0 * gain - 1.0) * (2.0 * gain - 1.0);
                damping = (damping * shrink.clamp(0.1, 2.0)).max(LEAST_DAMPING);
                growth = 2.0;
                // A single small step can be an exception.
                slow = if decrease < limits.decrease {
                    slow + 1
                } else {
                    0
                };
                if slow >= 2 {
                    converged = true;
                    break 'steps;
                }
                break;
            }
            damping *= growth;
            growth *= 2.0;
            if damping > MOST_DAMPING {
                converged = true;
                break 'steps;
            }
            if steps >= limits.steps {
                break 'steps;
            }
        }
    }
    Outcome {
        cost: [start, current],
        steps,
        converged,
    }
}

/// The decrease of the cost by the quadratic model: -g'd - 1/2 d'Hd with (H + damping D) d = -g.
fn predicted(normal: &Normal, step: &Step, damping: f64) -> f64 {
    let mut total = 0.0;
    for (i, d) in step.cameras.iter().enumerate() {
        let diagonal = normal.cameras[(i, i)];
        total += d * (damping * diagonal * d - normal.camera_gradient[i]);
    }
    for (row, d) in step.nodes.iter().enumerate() {
        let diagonal = normal.nodes.diagonal(row);
        total += d * (damping * diagonal * d - normal.node_gradient[row]);
    }
    0.5 * total
}

fn moved(problem: &Problem, columns: &Columns, step: &Step) -> Problem {
    let mut moved = problem.clone();
    for (camera, own) in moved.cameras.iter_mut().zip(&columns.of_camera) {
        let mut by = [0.0; PARAMETERS];
        for &(parameter, column, _) in own {
            by[parameter] = step.cameras[column];
        }
        camera.state = camera.state.moved(&by);
    }
    moved.path.step(&step.nodes);
    moved
}

impl Problem {
    /// Half the summed loss, with priors and the stiffness of the path.
    pub fn cost(&self) -> f64 {
        cost(self)
    }

    /// Length of each residual in pixels, in the order of the observations; `None` without a projection.
    pub fn residuals_px(&self) -> Vec<Option<f64>> {
        let folds = fold_radii(self);
        let each = self.observations.iter();
        each.map(|it| Some(residual(self, it, &folds)?.norm() * it.sigma_px))
            .collect()
    }
}
