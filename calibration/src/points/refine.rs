//! The last adjustment: all moments, noise estimated per camera, lenses free as requested.

use farfield_proto::order_statistics::upper_median;

use super::chain::problem;
use super::request::Lenses;
use super::view::View;
use crate::adjustment::{AdjustedCamera, Block, CameraState, Free, Limits, Loss, Problem, adjust};

/// Most moments of the last adjustment.
const MOST_MOMENTS: usize = 4000;
/// Tuning constant of Cauchy's loss: 95 % efficient for normal errors.
const CAUCHY: f64 = 2.385;
/// Median of the length of a residual of unit standard deviation per axis (Rayleigh).
const RAYLEIGH_MEDIAN: f64 = 1.1774;
/// Least standard deviation of a sight, pixels.
const LEAST_SIGMA_PX: f64 = 0.02;
/// Limits of a camera's noise relative to the median camera. Without limits, one of few cameras can gain so much weight that
/// all points follow it, and its noise falls further.
const NOISE_RATIOS: [f64; 2] = [0.5, 4.0];
/// Rounds of estimating the noise and adjusting.
const ROUNDS: usize = 4;
/// Relative standard deviation of a given focal length that is adjusted.
const FOCAL_PRIOR: f64 = 0.03;
/// The same for the principal point, relative to the focal length.
const PRINCIPAL_PRIOR: f64 = 0.02;
/// The same for coefficients, absolute.
const COEFFICIENT_PRIOR: f64 = 0.05;

/// A refined problem, with the index of each of its cameras in the request.
#[derive(Debug, Clone)]
pub(super) struct Refined {
    pub(super) problem: Problem,
    pub(super) posed: Vec<usize>,
}

/// The parameters of a camera that are adjusted.
pub(crate) fn freedom(lenses: Lenses, state: &CameraState) -> Free {
    let focal_px = state.intrinsics.fx_px;
    let pose = Free::none().with(Block::Pose);
    match lenses {
        Lenses::Given => pose,
        Lenses::Focal => pose.with_prior(Block::Focal, FOCAL_PRIOR),
        Lenses::All => {
            let coefficients = if state.is_fisheye {
                Block::FisheyeCoefficients
            } else if state.distortion[5..].iter().any(|c| *c != 0.0) {
                Block::EightCoefficients
            } else {
                Block::FiveCoefficients
            };
            pose.with_prior(Block::Focal, FOCAL_PRIOR)
                .with_prior(Block::Principal, PRINCIPAL_PRIOR * focal_px)
                .with_prior(coefficients, COEFFICIENT_PRIOR)
        }
    }
}

/// Adjusts all `views` with a pose, on the moments that several of them saw.
pub(super) fn refine(
    views: &[View],
    cameras: &[Option<CameraState>],
    lenses: Lenses,
    gate_px: f64,
) -> Refined {
    let mut current = cameras.to_vec();
    let mut gate = gate_px;
    let mut sigmas: Option<Vec<f64>> = None;
    let mut last = None;
    for round in 0..ROUNDS {
        let seen = if lenses == Lenses::Given {
            views.to_vec()
        } else {
            seen_through(views, &current)
        };
        let (mut problem, posed) = problem(&seen, &current, gate, MOST_MOMENTS);
        problem.loss = Loss::Cauchy(CAUCHY);
        for (adjusted, index) in problem.cameras.iter_mut().zip(&posed) {
            let given = CameraState {
                intrinsics: views[*index].state.intrinsics,
                distortion: views[*index].state.distortion,
                ..adjusted.state
            };
            let free = freedom(lenses, &given);
            *adjusted = AdjustedCamera {
                state: adjusted.state,
                start: given,
                free,
            };
        }
        if let Some(sigmas) = &sigmas {
            weigh(&mut problem, sigmas);
        }
        let limits = Limits {
            steps: 40,
            decrease: if round + 1 < ROUNDS { 1e-4 } else { 1e-8 },
        };
        adjust(&mut problem, limits);
        for (camera, index) in problem.cameras.iter().zip(&posed) {
            current[*index] = Some(camera.state);
        }
        let found = bounded(&noise_px(&problem));
        gate = found
            .iter()
            .fold(0.3f64, |most, s| most.max(3.0 * s))
            .min(gate_px);
        sigmas = Some(found);
        last = Some(Refined { problem, posed });
    }
    last.unwrap_or_else(|| {
        let (problem, posed) = problem(views, cameras, gate_px, 0);
        Refined { problem, posed }
    })
}

/// The views with bearings from the lenses of `cameras`.
fn seen_through(views: &[View], cameras: &[Option<CameraState>]) -> Vec<View> {
    let mut seen = views.to_vec();
    for (view, camera) in seen.iter_mut().zip(cameras) {
        let Some(camera) = camera else { continue };
        let fold_radius = camera.fold_radius();
        for sight in view.seen.values_mut() {
            if let Some(bearing) = camera.bearing(sight.px, fold_radius) {
                sight.bearing = bearing;
            }
        }
    }
    seen
}

/// Sets the standard deviation of each observation to the noise of its camera.
pub(super) fn weigh(problem: &mut Problem, sigmas: &[f64]) {
    for observation in &mut problem.observations {
        if let Some(sigma) = sigmas.get(observation.camera) {
            observation.sigma_px = *sigma;
        }
    }
}

/// Standard deviation per axis of each camera's residuals, from their median, pixels.
///
/// Points are unknowns too: the median is raised by the ratio of all coordinates to the degrees of freedom.
pub(super) fn noise_px(problem: &Problem) -> Vec<f64> {
    let mut lengths = vec![Vec::new(); problem.cameras.len()];
    let residuals = problem.residuals_px();
    for (observation, length) in problem.observations.iter().zip(&residuals) {
        if let Some(length) = length {
            lengths[observation.camera].push(*length);
        }
    }
    let coordinates = 2.0 * problem.observations.len() as f64;
    let unknowns = 3.0 * problem.path.node_count() as f64;
    let raise = (coordinates / (coordinates - unknowns).max(0.2 * coordinates)).sqrt();
    let sigma = |lengths: Vec<f64>| {
        let median = upper_median(lengths).unwrap_or(1.0);
        (raise * median / RAYLEIGH_MEDIAN).max(LEAST_SIGMA_PX)
    };
    lengths.into_iter().map(sigma).collect()
}

/// The noise that adjustments use as weight: limited relative to the median camera.
pub(super) fn bounded(noise_px: &[f64]) -> Vec<f64> {
    let usual = upper_median(noise_px.to_vec()).unwrap_or(1.0);
    let [low, high] = NOISE_RATIOS.map(|ratio| ratio * usual);
    noise_px.iter().map(|s| s.clamp(low, high)).collect()
}
