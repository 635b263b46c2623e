//! The adjustment of all cameras to all keypoints of the matched persons, repeated with new matches.

use farfield_proto::order_statistics::upper_median;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::associate::{Person, persons};
use super::plan::{KEYPOINT_M, KEYPOINT_PX};
use super::view::{View, velocity_px};
use crate::adjustment::{
    AdjustedCamera, Block, CameraState, Free, Limits, Loss, Observation, Path, Problem, adjust,
};
use crate::points::{Lenses, freedom};

/// Tuning constant of Cauchy's loss: 95 % efficient for normal errors.
const CAUCHY: f64 = 2.385;
/// Median of the length of a residual of unit standard deviation per axis (Rayleigh).
const RAYLEIGH_MEDIAN: f64 = 1.1774;
/// Limits of a camera's noise relative to the expected one. Without limits, one of few cameras can gain so much weight that all
/// points follow it, and its noise falls further.
const NOISE: [f64; 2] = [0.3, 5.0];
/// Limits of a camera's noise relative to the median camera.
const NOISE_RATIOS: [f64; 2] = [0.6, 4.0];
/// Smallest factor by which a low score reduces the weight of a keypoint.
const LEAST_SCORE: f64 = 0.3;
/// A round of matching persons and adjusting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Round {
    /// Gate of a matching keypoint, standard deviations.
    gate: f64,
    /// Approximate number of keypoints.
    most: usize,
    steps: usize,
    decrease: f64,
}

impl Round {
    const fn new(gate: f64, most: usize, steps: usize, decrease: f64) -> Self {
        Self {
            gate,
            most,
            steps,
            decrease,
        }
    }

    /// For rough poses.
    pub(super) const FIRST: [Self; 2] = [
        Self::new(14.0, 2500, 25, 1e-3),
        Self::new(7.0, 4000, 25, 1e-3),
    ];
    /// For the rounds between.
    pub(super) const NEXT: [Self; 1] = [Self::new(5.0, 4000, 12, 1e-3)];
    /// For the end.
    pub(super) const LAST: [Self; 2] = [
        Self::new(4.0, 6000, 25, 1e-4),
        Self::new(4.0, MOST_POINTS, 30, 1e-7),
    ];
}

/// Keypoints of the last adjustment.
const MOST_POINTS: usize = 16_000;

/// The origin of a point of the problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PointOf {
    /// Index of the person.
    pub(super) person: usize,
    /// Index of its keypoint.
    pub(super) keypoint: usize,
}

/// The result of an adjustment.
#[derive(Debug, Clone)]
pub(super) struct Adjusted {
    pub(super) problem: Problem,
    /// For each camera of the problem, its index in the request.
    pub(super) posed: Vec<usize>,
    pub(super) persons: Vec<Person>,
    /// Per point of the path, in the order of time.
    pub(super) points: Vec<PointOf>,
    /// Per camera of the problem, the noise of its keypoints relative to the expected one.
    pub(super) noise: Vec<f64>,
    /// The number of ticks that each processed tick stands for.
    pub(super) ticks_per_sample: f64,
}

/// The state of the cameras during the rounds, by their index in the request.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Settling {
    pub(super) cameras: Vec<Option<CameraState>>,
    /// The noise of their keypoints relative to the expected one.
    noise: Vec<f64>,
}

impl Settling {
    pub(super) fn new(cameras: Vec<Option<CameraState>>) -> Self {
        Self {
            noise: vec![1.0; cameras.len()],
            cameras,
        }
    }
}

/// Improves `settling` round by round; lenses change in the last round only. `None` if no persons are matched.
pub(super) fn settle(
    views: &[View],
    settling: &mut Settling,
    lenses: Lenses,
    rounds: &[Round],
) -> Option<Adjusted> {
    let Settling {
        cameras: current,
        noise,
    } = settling;
    let mut last = None;
    for (number, round) in rounds.iter().enumerate() {
        let is_last = number + 1 == rounds.len();
        let (found, ticks_per_sample) = found_persons(views, current, round.gate, round.most);
        let freed = if is_last { lenses } else { Lenses::Given };
        let mut adjusted = problem(views, current, found, freed, noise)?;
        adjusted.ticks_per_sample = ticks_per_sample;
        let limits = Limits {
            steps: round.steps,
            decrease: round.decrease,
        };
        adjust(&mut adjusted.problem, limits);
        for (camera, index) in adjusted.problem.cameras.iter().zip(&adjusted.posed) {
            current[*index] = Some(camera.state);
        }
        let ratios = noise_ratios(&adjusted.problem);
        let before = noise.clone();
        for (ratio, index) in ratios.iter().zip(&adjusted.posed) {
            noise[*index] *= ratio;
        }
        bound(noise, &adjusted.posed);
        if is_last {
            // The covariance of the cameras depends on the measured noise of the keypoints.
            for observation in &mut adjusted.problem.observations {
                let own = adjusted.posed.get(observation.camera);
                let ratio = own.map_or(1.0, |i| noise[*i] / before[*i]);
                observation.sigma_px *= ratio;
            }
            adjusted.noise = adjusted.posed.iter().map(|i| noise[*i]).collect();
        }
        last = Some(adjusted);
    }
    last
}

/// Limits the noise of each camera relative to the median camera.
fn bound(noise: &mut [f64], posed: &[usize]) {
    let known = posed.iter().filter_map(|i| noise.get(*i).copied());
    let middle = upper_median(known.collect()).unwrap_or(1.0);
    for noise in noise {
        *noise = noise
            .clamp(NOISE_RATIOS[0] * middle, NOISE_RATIOS[1] * middle)
            .clamp(NOISE[0], NOISE[1]);
    }
}

/// Persons at evenly spaced ticks with about `most` keypoints, and the number of ticks that each processed tick stands for.
fn found_persons(
    views: &[View],
    cameras: &[Option<CameraState>],
    gate: f64,
    most: usize,
) -> (Vec<Person>, f64) {
    let posed = views.iter().zip(cameras).filter(|(_, c)| c.is_some());
    let mut ticks: Vec<i64> = posed.flat_map(|(v, _)| v.ticks.keys().copied()).collect();
    ticks.sort_unstable();
    ticks.dedup();
    let at = |ticks: &[i64]| {
        let each: Vec<Vec<Person>> = ticks
            .par_iter()
            .map(|tick| persons(views, cameras, *tick, gate))
            .collect();
        each.into_iter().flatten().collect::<Vec<Person>>()
    };
    // A few ticks give the number of keypoints per tick.
    let few: Vec<i64> = evenly(&ticks, 30);
    let keypoints = |persons: &[Person]| {
        let each = persons.iter().flat_map(|it| &it.joints_m);
        each.flatten().count()
    };
    let per_tick = keypoints(&at(&few)) as f64 / few.len().max(1) as f64;
    let count = (most as f64 / per_tick.max(0.1)).ceil() as usize;
    let sampled = evenly(&ticks, count.max(10));
    // If networks process every fifth frame only, a frame stands for five.
    let steps = ticks.windows(2).map(|pair| (pair[1] - pair[0]) as f64);
    let usual_step = upper_median(steps.collect()).unwrap_or(1.0);
    let per_sample = usual_step * ticks.len() as f64 / sampled.len().max(1) as f64;
    (at(&sampled), per_sample)
}

fn evenly(all: &[i64], most: usize) -> Vec<i64> {
    if all.len() <= most {
        return all.to_vec();
    }
    let each = (0..most).filter_map(|k| all.get(k * all.len() / most));
    each.copied().collect()
}

fn problem(
    views: &[View],
    cameras: &[Option<CameraState>],
    persons: Vec<Person>,
    lenses: Lenses,
    noise: &[f64],
) -> Option<Adjusted> {
    let posed: Vec<usize> = (0..views.len()).filter(|i| cameras[*i].is_some()).collect();
    let mut adjusted = Vec::new();
    for index in &posed {
        let state = cameras[*index]?;
        let given = CameraState {
            intrinsics: views[*index].state.intrinsics,
            distortion: views[*index].state.distortion,
            ..state
        };
        let free = freedom(lenses, &given);
        adjusted.push(AdjustedCamera {
            state,
            start: given,
            free: if posed.len() < 2 {
                Free::none().with(Block::Pose)
            } else {
                free
            },
        });
    }
    let (mut nodes, mut points, mut observations) = (Vec::new(), Vec::new(), Vec::new());
    for (number, person) in persons.iter().enumerate() {
        for (keypoint, joint) in person.joints_m.iter().enumerate() {
            let Some(joint) = joint else { continue };
            let own = person.members.iter().filter_map(|(camera, index)| {
                let column = posed.iter().position(|it| it == camera)?;
                let body = views[*camera].ticks.get(&person.tick)?.get(*index)?;
                let seen = body.joints.get(keypoint).copied().flatten()?;
                let state = &adjusted[column].state;
                let depth_m = (joint - state.center_w).norm().max(0.3);
                let on_body_px = KEYPOINT_M * views[*camera].focal_px() / depth_m;
                let confidence = seen.score.clamp(LEAST_SCORE, 1.0);
                Some(Observation {
                    camera: column,
                    point: nodes.len(),
                    frame: person.tick as f64,
                    px: seen.px,
                    sigma_px: libm::hypot(on_body_px, KEYPOINT_PX) * noise[*camera] / confidence,
                    velocity: [0.0; 2],
                })
            });
            let own: Vec<Observation> = own.collect();
            if own.len() < 2 {
                continue;
            }
            observations.extend(own);
            nodes.push(*joint);
            points.push(PointOf {
                person: number,
                keypoint,
            });
        }
    }
    (!nodes.is_empty()).then(|| Adjusted {
        problem: Problem {
            cameras: adjusted,
            path: Path::Points(nodes),
            observations,
            loss: Loss::Cauchy(CAUCHY),
        },
        noise: vec![1.0; posed.len()],
        ticks_per_sample: 1.0,
        posed,
        persons,
        points,
    })
}

/// Per camera, the length of residuals relative to their predicted standard deviations, from the median.
///
/// Points are unknowns too: the ratio is raised by that of all coordinates to the degrees of freedom.
fn noise_ratios(problem: &Problem) -> Vec<f64> {
    let mut lengths = vec![Vec::new(); problem.cameras.len()];
    let residuals = problem.residuals_px();
    for (observation, length) in problem.observations.iter().zip(&residuals) {
        if let Some(length) = length {
            lengths[observation.camera].push(length / observation.sigma_px);
        }
    }
    let coordinates = 2.0 * problem.observations.len() as f64;
    let unknowns = 3.0 * problem.path.nodes().len() as f64;
    let raise = (coordinates / (coordinates - unknowns).max(0.2 * coordinates)).sqrt();
    let ratio = |lengths: Vec<f64>| {
        let median = upper_median(lengths).unwrap_or(RAYLEIGH_MEDIAN);
        (raise * median / RAYLEIGH_MEDIAN).max(1e-3)
    };
    lengths.into_iter().map(ratio).collect()
}

impl Adjusted {
    /// Sets the velocities of keypoints in the pictures, pixels per tick, from the sights of each camera up to `reaches` ticks
    /// before and after.
    pub(super) fn measure_velocities(&mut self, views: &[View], reaches: &[i64]) {
        for observation in &mut self.problem.observations {
            let point = self.points.get(observation.point);
            let of = point.and_then(|of| Some((of.keypoint, self.persons.get(of.person)?)));
            let (Some((keypoint, person)), Some(index)) = (of, self.posed.get(observation.camera))
            else {
                continue;
            };
            let member = person.members.iter().find(|(camera, _)| camera == index);
            let velocity = member.zip(views.get(*index)).and_then(|((_, body), view)| {
                velocity_px(view, person.tick, *body, keypoint, *reaches.get(*index)?)
            });
            observation.velocity = velocity.unwrap_or_default().into();
        }
    }

    /// The positions of the keypoints of each person in the world of the problem.
    pub(super) fn bodies(&self, keypoints: usize) -> Vec<Vec<Option<Vector3<f64>>>> {
        let mut bodies = vec![vec![None; keypoints]; self.persons.len()];
        for (of, at) in self.points.iter().zip(self.problem.path.nodes()) {
            if let Some(joint) = bodies
                .get_mut(of.person)
                .and_then(|body| body.get_mut(of.keypoint))
            {
                *joint = Some(*at);
            }
        }
        bodies
    }
}
