//! Uncertainty of the cameras: the inverse of the reduced matrix, without the seven free directions.
//!
//! The result is the uncertainty after alignment of the camera centres with the true ones by a similarity: the displacements
//! of the centres have no mean, no rotation and no scale about their middle (Umeyama 1991, linearised). If the centres are on
//! a line, the cameras do not rotate about it on average. So the result can be compared with a truth, and does not depend on
//! which camera is the first.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::normal::{Columns, Normal};
use super::path::Path;
use super::problem::Problem;
use super::projection::TIME;

/// Least eigenvalue of the scaled matrix for a determined direction.
const LEAST_EIGENVALUE: f64 = 1e-9;

/// Centres lie on a line if the share of their spread off it is smaller.
const ON_A_LINE: f64 = 1e-6;

/// Least share of a camera in an undetermined direction to be listed.
const LEAST_SHARE: f64 = 0.05;

/// Standard deviations of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSigma {
    /// Of the centre: root of the summed variances of the three axes, in the world's unit.
    pub position: f64,
    /// Of the rotation: root of the summed variances about the three axes, radians.
    pub rotation_rad: f64,
    /// Of the focal length, relative; zero if it is fixed.
    pub focal_share: f64,
    /// Of the time, seconds; zero if it is fixed.
    pub time_s: f64,
    /// Covariance of the centre.
    pub position_covariance: Matrix3<f64>,
}

/// A direction that the sights do not determine.
#[derive(Debug, Clone, PartialEq)]
pub struct Degenerate {
    /// Eigenvalue of the scaled matrix: 1 as if nothing else were free, 0 if undetermined.
    pub eigenvalue: f64,
    /// Cameras that move in this direction, the largest share first (the shares sum to at most one).
    pub cameras: Vec<(usize, f64)>,
}

/// The uncertainty of all cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// One per camera; `None` if its pose is fixed.
    pub cameras: Vec<Option<CameraSigma>>,
    /// Undetermined directions.
    pub degenerate: Vec<Degenerate>,
}

/// The covariance of the cameras of `problem` at its minimum; `None` without a free camera or observations.
pub fn covariance(problem: &Problem) -> Option<Covariance> {
    let columns = Columns::new(problem);
    let normal = Normal::new(problem, &columns);
    let matrix = normal.reduce(0.0)?.matrix;
    let n = columns.count;
    if n == 0 {
        return None;
    }
    // Scale each parameter by its own information.
    let scale: Vec<f64> = (0..n)
        .map(|i| 1.0 / normal.cameras[(i, i)].max(1e-300).sqrt())
        .collect();
    let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let free = complement(&gauge(problem, &columns, &scale));
    let inner = free.transpose() * scaled * &free;
    let eigen = inner.symmetric_eigen();
    let vectors = &free * &eigen.eigenvectors;
    let mut degenerate: Vec<Degenerate> = Vec::new();
    let mut found = DMatrix::zeros(n, n);
    for (k, &eigenvalue) in eigen.eigenvalues.iter().enumerate() {
        let v = vectors.column(k);
        if eigenvalue < LEAST_EIGENVALUE {
            degenerate.push(Degenerate {
                eigenvalue,
                cameras: shares(&columns, v.as_slice()),
            });
        }
        let variance = 1.0 / eigenvalue.max(LEAST_EIGENVALUE * 1e-3);
        found += v * v.transpose() * variance;
    }
    degenerate.sort_by(|a, b| a.eigenvalue.total_cmp(&b.eigenvalue));
    let entry = |i: usize, j: usize| found[(i, j)] * scale[i] * scale[j];
    let cameras = columns.of_camera.iter().map(|own| {
        let column = |parameter| {
            own.iter()
                .find(|(p, _, _)| *p == parameter)
                .map(|(_, column, _)| *column)
        };
        let first = column(0)?;
        let sigma = |parameter| column(parameter).map_or(0.0, |c| entry(c, c).max(0.0).sqrt());
        let norm = |from: usize| {
            let variances = (from..from + 3).map(|p| sigma(p) * sigma(p));
            variances.sum::<f64>().sqrt()
        };
        Some(CameraSigma {
            position: norm(3),
            rotation_rad: norm(0),
            focal_share: sigma(6),
            time_s: sigma(TIME),
            position_covariance: Matrix3::from_fn(|i, j| entry(first + 3 + i, first + 3 + j)),
        })
    });
    Some(Covariance {
        cameras: cameras.collect(),
        degenerate,
    })
}

fn shares(columns: &Columns, v: &[f64]) -> Vec<(usize, f64)> {
    let share =
        |own: &[(usize, usize, f64)]| own.iter().map(|(_, c, _)| v[*c] * v[*c]).sum::<f64>();
    let mut shares: Vec<(usize, f64)> = columns
        .of_camera
        .iter()
        .map(|own| share(own))
        .enumerate()
        .filter(|(_, share)| *share > LEAST_SHARE)
        .collect();
    shares.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    shares
}

/// The conditions that fix the gauge, one column each, over the scaled parameters: the displacements of the centres have no
/// mean, no rotation and no scale; and, if every camera's clock is free along a curve, the clocks have no mean.
fn gauge(problem: &Problem, columns: &Columns, scale: &[f64]) -> DMatrix<f64> {
    let posed: Vec<(usize, Vector3<f64>)> = problem
        .cameras
        .iter()
        .zip(&columns.of_camera)
        .filter_map(|(camera, own)| {
            let (_, column, _) = own.iter().find(|(p, _, _)| *p == 3)?;
            Some((*column, camera.state.center_w))
        })
        .collect();
    let n = columns.count;
    let mut conditions = DMatrix::zeros(n, 9);
    // Fixed cameras fix the gauge themselves.
    if posed.len() == problem.cameras.len() && posed.len() > 1 {
        let middle = posed
            .iter()
            .fold(Vector3::zeros(), |total, (_, center)| total + center)
            / posed.len() as f64;
        for (column, center) in &posed {
            let arm = center - middle;
            for axis in 0..3 {
                let row = column + axis;
                let s = scale[row];
                conditions[(row, axis)] = s;
                let turned = Vector3::ith(axis, 1.0);
                for about in 0..3 {
                    conditions[(row, 3 + about)] =
                        s * Vector3::ith(about, 1.0).cross(&arm).dot(&turned);
                }
                conditions[(row, 6)] = s * arm[axis];
            }
        }
        if let Some(line) = line(&posed, &middle) {
            fix_rotation_about(&mut conditions, problem, columns, scale, &line);
        }
    }
    let clocks: Vec<usize> = columns
        .of_camera
        .iter()
        .filter_map(|own| Some(own.iter().find(|(p, _, _)| *p == TIME)?.1))
        .collect();
    let is_curve = matches!(problem.path, Path::Curve(_));
    if is_curve && clocks.len() == problem.cameras.len() {
        for clock in clocks {
            conditions[(clock, 7)] = scale[clock];
        }
    }
    conditions
}

/// The line of all centres, if they are on one.
fn line(posed: &[(usize, Vector3<f64>)], middle: &Vector3<f64>) -> Option<Vector3<f64>> {
    let spread = posed.iter().fold(Matrix3::zeros(), |spread, (_, center)| {
        spread + (center - middle) * (center - middle).transpose()
    });
    let eigen = spread.symmetric_eigen();
    let most = eigen.eigenvalues.imax();
    let off_line = spread.trace() - eigen.eigenvalues[most];
    (off_line < ON_A_LINE * spread.trace()).then(|| eigen.eigenvectors.column(most).into_owned())
}

/// Adds the condition that cameras do not rotate about `line` on average: centres on it do not determine such a rotation.
fn fix_rotation_about(
    conditions: &mut DMatrix<f64>,
    problem: &Problem,
    columns: &Columns,
    scale: &[f64],
    line: &Vector3<f64>,
) {
    for (camera, own) in problem.cameras.iter().zip(&columns.of_camera) {
        let about_c = camera.state.camera_from_world * line;
        for &(parameter, column, _) in own.iter().filter(|(p, _, _)| *p < 3) {
            conditions[(column, 8)] = scale[column] * about_c[parameter];
        }
    }
}

/// An orthonormal basis of the complement of the columns of `conditions`.
fn complement(conditions: &DMatrix<f64>) -> DMatrix<f64> {
    let n = conditions.nrows();
    let mut normed = conditions.clone();
    for mut column in normed.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    let projector = &normed * normed.transpose();
    let eigen = projector.symmetric_eigen();
    let kept: Vec<usize> = (0..n).filter(|k| eigen.eigenvalues[*k] < 1e-9).collect();
    DMatrix::from_fn(n, kept.len(), |i, k| eigen.eigenvectors[(i, kept[k])])
}
