//! The normal equations in blocks: nodes of the path (banded), cameras (dense), and the coupling.

use nalgebra::{DMatrix, DVector, Matrix2x3, SMatrix, Vector2};

use super::band::Band;
use super::camera_state::Observation;
use super::path::{Path, Support, sum};
use super::problem::{AdjustedCamera, Problem};
use super::projection::{PARAMETERS, TIME};

/// Residual of a sight without a projection (behind the camera, outside the range of the lens, off the path), standard deviations.
const NO_PROJECTION: f64 = 1e3;

/// The columns of the free parameters of each camera.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    /// Per camera, (parameter, column, standard deviation of the prior).
    pub(super) of_camera: Vec<Vec<(usize, usize, f64)>>,
    pub(super) count: usize,
}

impl Columns {
    pub(super) fn new(problem: &Problem) -> Self {
        let mut count = 0;
        let of_camera = problem.cameras.iter().map(|camera| {
            let mut columns = Vec::new();
            for (parameter, sigma) in camera.free.parameters() {
                columns.push((parameter, count, sigma));
                count += 1;
            }
            columns
        });
        let of_camera = of_camera.collect();
        Self { of_camera, count }
    }
}

/// Half the summed loss, with priors and the stiffness of the path.
pub(super) fn cost(problem: &Problem) -> f64 {
    let folds = fold_radii(problem);
    let seen = problem.observations.iter().map(|observation| {
        let s = residual(problem, observation, &folds)
            .map_or(NO_PROJECTION * NO_PROJECTION, |r| r.norm_squared());
        problem.loss.value_and_weight(s).0
    });
    let seen: f64 = seen.sum();
    0.5 * (seen + prior_cost(problem) + stiffness_cost(&problem.path))
}

/// Residual of a sight in standard deviations; `None` without a projection.
pub(super) fn residual(
    problem: &Problem,
    observation: &Observation,
    folds: &[f64],
) -> Option<Vector2<f64>> {
    let camera = problem.cameras.get(observation.camera)?;
    let point = problem.path.place(observation, &camera.state)?;
    let px = camera
        .state
        .project(&point, *folds.get(observation.camera)?)?;
    Some((px - seen_px(observation, camera)) / observation.sigma_px)
}

/// The observed pixel, corrected for the change of the camera's clock since the start.
fn seen_px(observation: &Observation, camera: &AdjustedCamera) -> Vector2<f64> {
    let later_s = camera.state.pivot_s - camera.start.pivot_s;
    Vector2::from(observation.px) - Vector2::from(observation.velocity) * later_s
}

pub(super) fn fold_radii(problem: &Problem) -> Vec<f64> {
    let cameras = problem.cameras.iter();
    cameras.map(|camera| camera.state.fold_radius()).collect()
}

fn prior_cost(problem: &Problem) -> f64 {
    let mut total = 0.0;
    for camera in &problem.cameras {
        let distance = camera.state.distance_from(&camera.start);
        for (parameter, sigma) in camera.free.parameters() {
            let pull = distance[parameter] / sigma;
            total += pull * pull;
        }
    }
    total
}

fn stiffness_cost(path: &Path) -> f64 {
    let Path::Curve(spline) = path else {
        return 0.0;
    };
    let bends = spline
        .controls
        .windows(3)
        .map(|w| (w[0] - w[1] * 2.0 + w[2]).norm_squared());
    spline.stiffness * bends.sum::<f64>()
}

/// Gauss-Newton Hessian, with the weights of the loss, and gradient of [`cost`].
#[derive(Debug, Clone)]
pub(super) struct Normal {
    pub(super) nodes: Band,
    /// Node rows by camera columns, row by row.
    pub(super) coupling: Vec<f64>,
    pub(super) cameras: DMatrix<f64>,
    pub(super) node_gradient: Vec<f64>,
    pub(super) camera_gradient: DVector<f64>,
    pub(super) columns: usize,
}

impl Normal {
    pub(super) fn new(problem: &Problem, columns: &Columns) -> Self {
        let rows = 3 * problem.path.node_count();
        let mut normal = Self {
            nodes: Band::zeros(rows, 3 * problem.path.reach() + 2),
            coupling: vec![0.0; rows * columns.count],
            cameras: DMatrix::zeros(columns.count, columns.count),
            node_gradient: vec![0.0; rows],
            camera_gradient: DVector::zeros(columns.count),
            columns: columns.count,
        };
        let folds = fold_radii(problem);
        for observation in &problem.observations {
            normal.add_observation(problem, observation, columns, &folds);
        }
        normal.add_priors(problem, columns);
        normal.add_stiffness(&problem.path);
        normal
    }

    fn add_observation(
        &mut self,
        problem: &Problem,
        observation: &Observation,
        columns: &Columns,
        folds: &[f64],
    ) -> Option<()> {
        let adjusted = problem.cameras.get(observation.camera)?;
        let camera = &adjusted.state;
        let support = problem.path.support(observation, camera)?;
        let nodes = problem.path.nodes();
        let point = problem.path.place(observation, camera)?;
        let mut drawn = camera.project_with_derivatives(&point, *folds.get(observation.camera)?)?;
        let velocity = sum(nodes, &support, &support.slopes);
        let by_time = drawn.by_point * velocity + Vector2::from(observation.velocity);
        drawn.by_camera.set_column(TIME, &by_time);
        let since_pivot_s = (observation.frame - camera.pivot_frame) * camera.period_s;
        drawn
            .by_camera
            .set_column(TIME + 1, &(by_time * since_pivot_s));
        let r = (drawn.px - seen_px(observation, adjusted)) / observation.sigma_px;
        let weight = problem.loss.value_and_weight(r.norm_squared()).1;
        let scale = weight.sqrt() / observation.sigma_px;
        let own = columns.of_camera.get(observation.camera)?;
        self.add_camera(own, &(drawn.by_camera * scale), &(r * weight.sqrt()));
        self.add_nodes(
            &support,
            &(drawn.by_point * scale),
            &(drawn.by_camera * scale),
            own,
            &(r * weight.sqrt()),
        );
        Some(())
    }

    fn add_camera(
        &mut self,
        own: &[(usize, usize, f64)],
        by_camera: &SMatrix<f64, 2, PARAMETERS>,
        r: &Vector2<f64>,
    ) {
        for &(a, column_a, _) in own {
            let by_a = by_camera.column(a);
            self.camera_gradient[column_a] += by_a.dot(r);
            for &(b, column_b, _) in own {
                self.cameras[(column_a, column_b)] += by_a.dot(&by_camera.column(b));
            }
        }
    }

    fn add_nodes(
        &mut self,
        support: &Support,
        by_point: &Matrix2x3<f64>,
        by_camera: &SMatrix<f64, 2, PARAMETERS>,
        own: &[(usize, usize, f64)],
        r: &Vector2<f64>,
    ) {
        for i in 0..support.count {
            let row = 3 * (support.first + i);
            let by_node = by_point * support.by_node(i);
            let gradient = by_node.transpose() * r;
            let coupled = by_node.transpose() * by_camera;
            for axis in 0..3 {
                self.node_gradient[row + axis] += gradient[axis];
                let start = (row + axis) * self.columns;
                for &(parameter, column, _) in own {
                    self.coupling[start + column] += coupled[(axis, parameter)];
                }
            }
            for j in 0..=i {
                let earlier = 3 * (support.first + j);
                let square = by_node.transpose() * by_point * support.by_node(j);
                for axis in 0..3 {
                    let last = if i == j { axis + 1 } else { 3 };
                    for other in 0..last {
                        let value = square[(axis, other)];
                        self.nodes.add(row + axis, earlier + other, value);
                    }
                }
            }
        }
    }

    fn add_priors(&mut self, problem: &Problem, columns: &Columns) {
        for (camera, own) in problem.cameras.iter().zip(&columns.of_camera) {
            let distance = camera.state.distance_from(&camera.start);
            for &(parameter, column, sigma) in own {
                let information = 1.0 / (sigma * sigma);
                self.cameras[(column, column)] += information;
                self.camera_gradient[column] += information * distance[parameter];
            }
        }
    }

    fn add_stiffness(&mut self, path: &Path) {
        const BEND: [f64; 3] = [1.0, -2.0, 1.0];
        let Path::Curve(spline) = path else { return };
        for (first, w) in spline.controls.windows(3).enumerate() {
            let bend = w[0] - w[1] * 2.0 + w[2];
            for (i, by) in BEND.into_iter().enumerate() {
                for axis in 0..3 {
                    let row = 3 * (first + i) + axis;
                    self.node_gradient[row] += spline.stiffness * by * bend[axis];
                    for (j, other) in BEND.into_iter().enumerate().take(i + 1) {
                        let value = spline.stiffness * by * other;
                        self.nodes.add(row, 3 * (first + j) + axis, value);
                    }
                }
            }
        }
    }

    /// Eliminates the nodes, with every diagonal entry increased by `damping` times itself.
    pub(super) fn reduce(&self, damping: f64) -> Option<Reduced> {
        let mut nodes = self.nodes.clone();
        for row in 0..self.node_gradient.len() {
            let diagonal = self.nodes.diagonal(row);
            nodes.add(
                row,
                row,
                damping * diagonal + f64::MIN_POSITIVE.max(1e-12 * diagonal),
            );
        }
        if !nodes.factorise() {
            return None;
        }
        let mut eliminated = self.coupling.clone();
        nodes.forward(&mut eliminated, self.columns);
        let mut node_right = self.node_gradient.clone();
        nodes.forward(&mut node_right, 1);
        let mut matrix = self.cameras.clone();
        for i in 0..self.columns {
            matrix[(i, i)] += damping * self.cameras[(i, i)];
        }
        let mut right = self.camera_gradient.clone();
        subtract_products(&mut matrix, &mut right, &eliminated, &node_right);
        Some(Reduced {
            nodes,
            eliminated,
            node_right,
            matrix,
            right,
        })
    }
}

/// Subtracts the squares of the rows of `eliminated` from `matrix`, and the rows times `node_right` from `right`.
fn subtract_products(
    matrix: &mut DMatrix<f64>,
    right: &mut DVector<f64>,
    eliminated: &[f64],
    node_right: &[f64],
) {
    let count = right.len();
    if count == 0 {
        return;
    }
    // Column-major, so the lower half is filled column by column.
    let entries = matrix.as_mut_slice();
    for (row, r) in eliminated.chunks_exact(count).zip(node_right) {
        for (column, &value) in row.iter().enumerate() {
            if value == 0.0 {
                continue;
            }
            right[column] -= value * r;
            let target = &mut entries[column * count + column..(column + 1) * count];
            for (entry, other) in target.iter_mut().zip(&row[column..]) {
                *entry -= value * other;
            }
        }
    }
    for column in 0..count {
        for row in column + 1..count {
            entries[row * count + column] = entries[column * count + row];
        }
    }
}

/// The system of the cameras alone, with the factors for the nodes.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    nodes: Band,
    eliminated: Vec<f64>,
    node_right: Vec<f64>,
    pub(super) matrix: DMatrix<f64>,
    right: DVector<f64>,
}

/// A step of cameras and nodes.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub(super) cameras: DVector<f64>,
    pub(super) nodes: Vec<f64>,
}

impl Reduced {
    /// The step that solves the system; `None` if it is not positive definite.
    pub(super) fn solve(&self) -> Option<Step> {
        let count = self.right.len();
        let cameras = if count == 0 {
            DVector::zeros(0)
        } else {
            -self.matrix.clone().cholesky()?.solve(&self.right)
        };
        let mut nodes = Vec::with_capacity(self.node_right.len());
        for (row, right) in self.node_right.iter().enumerate() {
            let coupled = self.eliminated.get(row * count..(row + 1) * count)?;
            let by_cameras: f64 = coupled.iter().zip(cameras.iter()).map(|(a, b)| a * b).sum();
            nodes.push(-right - by_cameras);
        }
        self.nodes.backward(&mut nodes);
        let finite = cameras.iter().chain(&nodes).all(|v| v.is_finite());
        finite.then_some(Step { cameras, nodes })
    }
}
