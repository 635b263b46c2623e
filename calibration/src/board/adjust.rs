//! Levenberg-Marquardt over one camera and the poses of its boards. The poses are eliminated block by block, so that the system
//! has only the camera's parameters.

use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix2x6, Matrix6, Translation3, UnitQuaternion, Vector2,
    Vector3, Vector6,
};

use super::projection::Optics;

/// Most steps of a fit.
const MOST_STEPS: usize = 200;
/// A fit ends at a smaller relative decrease of the cost.
const SMALL_SHARE: f64 = 1e-12;

/// One picture: points of the board (metres) and their pixels.
#[derive(Debug, Clone)]
pub(super) struct Sighting {
    pub(super) board: Vec<Vector3<f64>>,
    pub(super) pixels: Vec<Vector2<f64>>,
}

/// A camera and the poses of the boards in it.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) optics: Optics,
    pub(super) poses: Vec<Isometry3<f64>>,
}

/// Normal equations of one picture.
struct Block {
    camera: DMatrix<f64>,
    mixed: DMatrix<f64>,
    pose: Matrix6<f64>,
    camera_gradient: DVector<f64>,
    pose_gradient: Vector6<f64>,
    cost: f64,
}

/// The derivative by a small rotation and shift of the camera's axes: p' = p + turn x p + shift.
pub(super) fn by_pose(by_point: &nalgebra::Matrix2x3<f64>, p: &Vector3<f64>) -> Matrix2x6<f64> {
    let turned = by_point * -p.cross_matrix();
    let mut all = Matrix2x6::zeros();
    all.fixed_view_mut::<2, 3>(0, 0).copy_from(&turned);
    all.fixed_view_mut::<2, 3>(0, 3).copy_from(by_point);
    all
}

/// `pose` after the small rotation and shift `step`.
pub(super) fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let shift = Translation3::from(step.fixed_rows::<3>(3).into_owned());
    let mut moved = Isometry3::from_parts(shift, turn) * pose;
    moved.rotation.renormalize();
    moved
}

/// Projected minus observed, pixels; `None` if a point cannot be projected.
pub(super) fn residuals(
    optics: &Optics,
    pose: &Isometry3<f64>,
    sighting: &Sighting,
) -> Option<Vec<Vector2<f64>>> {
    let points = sighting.board.iter().zip(&sighting.pixels);
    points
        .map(|(board, seen)| {
            let p = (pose * nalgebra::Point3::from(*board)).coords;
            Some(optics.draw(&p)?.pixel - seen)
        })
        .collect()
}

fn cost(state: &State, sightings: &[Sighting]) -> Option<f64> {
    let mut sum = 0.0;
    for (pose, sighting) in state.poses.iter().zip(sightings) {
        let all = residuals(&state.optics, pose, sighting)?;
        sum += all.iter().map(Vector2::norm_squared).sum::<f64>();
    }
    sum.is_finite().then_some(sum)
}

fn block(optics: &Optics, pose: &Isometry3<f64>, sighting: &Sighting) -> Option<Block> {
    let m = optics.coefficients.count();
    let mut block = Block {
        camera: DMatrix::zeros(m, m),
        mixed: DMatrix::zeros(m, 6),
        pose: Matrix6::zeros(),
        camera_gradient: DVector::zeros(m),
        pose_gradient: Vector6::zeros(),
        cost: 0.0,
    };
    for (board, seen) in sighting.board.iter().zip(&sighting.pixels) {
        let p = (pose * nalgebra::Point3::from(*board)).coords;
        let drawn = optics.draw(&p)?;
        let residual = drawn.pixel - seen;
        let by_pose = by_pose(&drawn.by_point, &p);
        let by_camera =
            DMatrix::from_fn(2, m, |i, j| drawn.by_parameter.get(j).map_or(0.0, |v| v[i]));
        block.camera += by_camera.tr_mul(&by_camera);
        block.mixed += by_camera.tr_mul(&by_pose);
        block.pose += by_pose.transpose() * by_pose;
        block.camera_gradient += by_camera.tr_mul(&residual);
        block.pose_gradient += by_pose.transpose() * residual;
        block.cost += residual.norm_squared();
    }
    Some(block)
}

fn damped<D: nalgebra::Dim, S>(
    m: &nalgebra::Matrix<f64, D, D, S>,
    damping: f64,
) -> nalgebra::OMatrix<f64, D, D>
where
    S: nalgebra::storage::Storage<f64, D, D>,
    nalgebra::DefaultAllocator: nalgebra::allocator::Allocator<D, D>,
{
    let mut m = m.clone_owned();
    for i in 0..m.nrows() {
        m[(i, i)] += damping * m[(i, i)].max(1e-12);
    }
    m
}

/// The camera's normal matrix with the poses eliminated; its inverse times the variance is the covariance.
pub(super) fn reduced(state: &State, sightings: &[Sighting]) -> Option<DMatrix<f64>> {
    let m = state.optics.coefficients.count();
    let mut sum = DMatrix::zeros(m, m);
    for (pose, sighting) in state.poses.iter().zip(sightings) {
        let block = block(&state.optics, pose, sighting)?;
        let solved = block.pose.cholesky()?.solve(&block.mixed.transpose());
        sum += block.camera - block.mixed * solved;
    }
    Some(sum)
}

/// One step with this damping.
fn step(state: &State, blocks: &[Block], damping: f64) -> Option<State> {
    let m = state.optics.coefficients.count();
    let mut matrix = DMatrix::zeros(m, m);
    let mut right = DVector::zeros(m);
    for block in blocks {
        let pose = damped(&block.pose, damping).cholesky()?;
        matrix +=
            damped(&block.camera, damping) - &block.mixed * pose.solve(&block.mixed.transpose());
        right -= &block.camera_gradient - &block.mixed * pose.solve(&block.pose_gradient);
    }
    // Scale the parameters: focal lengths are in pixels, others are sixth-order coefficients.
    let scale = matrix.diagonal().map(|d| 1.0 / d.max(1e-30).sqrt());
    let scaled = DMatrix::from_fn(m, m, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let change = scaled
        .cholesky()?
        .solve(&right.component_mul(&scale))
        .component_mul(&scale);
    let mut next = state.clone();
    for (value, change) in next.optics.values.iter_mut().zip(change.iter()) {
        *value += change;
    }
    for (pose, block) in next.poses.iter_mut().zip(blocks) {
        let rest = -(block.pose_gradient + block.mixed.tr_mul(&change));
        let change = damped(&block.pose, damping)
            .cholesky()?
            .solve(&Vector6::from_column_slice(rest.as_slice()));
        *pose = moved(pose, &change);
    }
    Some(next)
}

/// The state with the least sum of squared residuals, from `state`; `None` if the start does not project all points.
pub(super) fn adjust(mut state: State, sightings: &[Sighting]) -> Option<State> {
    let mut lowest = cost(&state, sightings)?;
    let mut damping = 1e-3;
    for _ in 0..MOST_STEPS {
        let pictures = state.poses.iter().zip(sightings);
        let blocks = pictures
            .map(|(pose, s)| block(&state.optics, pose, s))
            .collect::<Option<Vec<_>>>()?;
        let mut gained = None;
        while damping < 1e12 {
            let next = step(&state, &blocks, damping);
            let found = next.and_then(|next| Some((cost(&next, sightings)?, next)));
            match found {
                Some((cost, next)) if cost < lowest => {
                    gained = Some(lowest - cost);
                    (lowest, state) = (cost, next);
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
                _ => damping *= 10.0,
            }
        }
        if gained.is_none_or(|gained| gained <= SMALL_SHARE * lowest) {
            break;
        }
    }
    Some(state)
}

/// Adjusts the pose alone, with a known camera, from `start`.
pub(super) fn adjust_pose(
    optics: &Optics,
    start: Isometry3<f64>,
    sighting: &Sighting,
) -> Option<Isometry3<f64>> {
    let cost = |pose: &Isometry3<f64>| {
        let all = residuals(optics, pose, sighting)?;
        let sum = all.iter().map(Vector2::norm_squared).sum::<f64>();
        sum.is_finite().then_some(sum)
    };
    let mut pose = start;
    let mut lowest = cost(&pose)?;
    let mut damping = 1e-3;
    for _ in 0..MOST_STEPS {
        let now = block(optics, &pose, sighting)?;
        let mut gained = None;
        while damping < 1e12 {
            let solved = damped(&now.pose, damping)
                .cholesky()
                .map(|c| c.solve(&-now.pose_gradient));
            let next = solved.map(|step| moved(&pose, &step));
            match next.and_then(|next| Some((cost(&next)?, next))) {
                Some((next_cost, next)) if next_cost < lowest => {
                    gained = Some(lowest - next_cost);
                    (lowest, pose) = (next_cost, next);
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
                _ => damping *= 10.0,
            }
        }
        if gained.is_none_or(|gained| gained <= SMALL_SHARE * lowest) {
            break;
        }
    }
    Some(pose)
}

/// The inverse of a pose's normal matrix, the covariance for a variance of one square pixel: rotation (rad), then shift (m).
pub(super) fn pose_covariance(
    optics: &Optics,
    pose: &Isometry3<f64>,
    sighting: &Sighting,
) -> Option<Matrix6<f64>> {
    Some(block(optics, pose, sighting)?.pose.cholesky()?.inverse())
}
