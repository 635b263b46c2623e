//! When cameras that were started by hand took their frames, by the people that they saw.
//!
//! Whole seconds come from feet: the lag at which the floors of two cameras lie on each other best. What is left comes
//! from the adjustment: a camera that is late sees everybody a little behind where they are, along their way.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::floor_match::{Effort, Feet, motions};
use super::pair::Walkers;
use crate::people::adjust::Adjusted;
use crate::people::view::{Clock, View};

/// Ticks between the lags that are tried first, at ten ticks per second.
const COARSE_TICKS: i64 = 3;
/// Share of the shorter recording that a lag must leave in common, and the least time, ticks.
const LEAST_COMMON_SHARE: f64 = 0.35;
const LEAST_COMMON_TICKS: f64 = 80.0;
/// Lags of which the neighbours are tried.
const MOST_KEPT: usize = 3;
/// What is believed of given rates, a share.
const RATE_SIGMA: f64 = 2e-4;
/// What is believed of the time before it is measured, seconds; only keeps the sums from being singular.
const TIME_SIGMA_S: f64 = 1.0;
/// Residuals beyond so many standard deviations tell nothing of time.
const MOST_SIGMAS: f64 = 4.0;

/// How late the second camera is to the first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lag {
    first: usize,
    second: usize,
    ticks: i64,
    score: f64,
}

/// Per camera the ticks to be added to its own so that all agree, from the pairs that agree best; zero where none do.
pub(in crate::people) fn lags(walkers: &[Option<Walkers<'_>>], seed: u64) -> Vec<i64> {
    let indices: Vec<(usize, usize)> = (0..walkers.len())
        .flat_map(|i| (i + 1..walkers.len()).map(move |j| (i, j)))
        .collect();
    let found: Vec<Lag> = indices
        .into_par_iter()
        .filter_map(|(first, second)| {
            let (a, b) = (walkers[first].as_ref()?, walkers[second].as_ref()?);
            let (ticks, score) = lag(&a.feet, &b.feet, seed)?;
            Some(Lag {
                first,
                second,
                ticks,
                score,
            })
        })
        .collect();
    spread(walkers.len(), &found)
}

/// Prim's tree over the pairs, the best first.
fn spread(count: usize, lags: &[Lag]) -> Vec<i64> {
    let mut ticks: Vec<Option<i64>> = vec![None; count];
    let root = lags.iter().max_by(|a, b| a.score.total_cmp(&b.score));
    if let Some(root) = root {
        ticks[root.first] = Some(0);
    }
    loop {
        let open = lags
            .iter()
            .filter(|it| ticks[it.first].is_some() != ticks[it.second].is_some());
        let Some(next) = open.max_by(|a, b| a.score.total_cmp(&b.score)) else {
            break;
        };
        if let Some(first) = ticks[next.first] {
            ticks[next.second] = Some(first + next.ticks);
        } else if let Some(second) = ticks[next.second] {
            ticks[next.first] = Some(second - next.ticks);
        }
    }
    ticks.into_iter().map(|it| it.unwrap_or(0)).collect()
}

/// The ticks to be added to those of `b`, and how well feet then agree.
fn lag(a: &Feet, b: &Feet, seed: u64) -> Option<(i64, f64)> {
    let ends = |feet: &Feet| Some((*feet.keys().next()?, *feet.keys().next_back()?));
    let ((from_a, to_a), (from_b, to_b)) = (ends(a)?, ends(b)?);
    let shorter = (to_a - from_a).min(to_b - from_b) as f64;
    let common = (LEAST_COMMON_SHARE * shorter).max(LEAST_COMMON_TICKS) as i64;
    let (least, most) = (from_a + common - to_b, to_a - common - from_b);
    let score = |ticks: i64, effort: Effort| {
        let moved: Feet = b
            .iter()
            .map(|(tick, feet)| (tick + ticks, feet.clone()))
            .collect();
        let best = motions(a, &moved, effort, seed)
            .first()
            .map(|it| it.score)?;
        // Few common ticks agree by chance.
        let shared = a.keys().filter(|tick| moved.contains_key(tick)).count();
        Some(best * (shared as f64 / shorter.max(1.0)).min(1.0).sqrt())
    };
    let mut coarse: Vec<(i64, f64)> = Vec::new();
    let mut ticks = least;
    while ticks <= most {
        coarse.extend(score(ticks, Effort::QUICK).map(|score| (ticks, score)));
        ticks += COARSE_TICKS;
    }
    coarse.sort_by(|x, y| y.1.total_cmp(&x.1));
    let near = coarse.iter().take(MOST_KEPT).flat_map(|(ticks, _)| {
        let ticks = *ticks;
        (-COARSE_TICKS..=COARSE_TICKS).map(move |by| ticks + by)
    });
    let fine = near.filter_map(|ticks| Some((ticks, score(ticks, Effort::FULL)?)));
    fine.max_by(|x, y| x.1.total_cmp(&y.1))
}

/// Moves each posed camera's clock by what its keypoints are behind or ahead along their way, and returns the largest
/// change, seconds. The clocks keep their mean.
pub(in crate::people) fn refine(clocks: &mut [Clock], views: &[View], adjusted: &Adjusted) -> f64 {
    let mut sums: BTreeMap<usize, (Matrix2<f64>, Vector2<f64>)> = BTreeMap::new();
    let problem = &adjusted.problem;
    let middle_s = {
        let ticks = adjusted.persons.iter().map(|it| it.tick as f64);
        let count = adjusted.persons.len().max(1) as f64;
        ticks.sum::<f64>() / count / clocks.first().and_then(|it| it.ticks_hz).unwrap_or(1.0)
    };
    let folds: Vec<f64> = problem
        .cameras
        .iter()
        .map(|c| c.state.fold_radius())
        .collect();
    for observation in &problem.observations {
        let column = observation.camera;
        let (Some(of), Some(point)) = (
            adjusted.points.get(observation.point),
            problem.path.nodes().get(observation.point),
        ) else {
            continue;
        };
        let (Some(index), Some(camera)) = (adjusted.posed.get(column), problem.cameras.get(column))
        else {
            continue;
        };
        let Some(person) = adjusted.persons.get(of.person) else {
            continue;
        };
        let Some(ticks_hz) = clocks.get(*index).and_then(|it| it.ticks_hz) else {
            continue;
        };
        let member = person.members.iter().find(|(camera, _)| camera == index);
        let Some(velocity) = member
            .and_then(|(_, body)| velocity_px(views.get(*index)?, person.tick, *body, of.keypoint))
        else {
            continue;
        };
        let velocity = velocity * ticks_hz;
        let Some(drawn) = camera.state.project(point, folds[column]) else {
            continue;
        };
        let ahead = Vector2::from(observation.px) - drawn;
        let weight = 1.0 / (observation.sigma_px * observation.sigma_px);
        if ahead.norm_squared() * weight > MOST_SIGMAS * MOST_SIGMAS {
            continue;
        }
        let since_s = person.tick as f64 / ticks_hz - middle_s;
        let by = Vector2::new(1.0, since_s);
        let entry = sums
            .entry(*index)
            .or_insert((Matrix2::zeros(), Vector2::zeros()));
        entry.0 += by * by.transpose() * (velocity.norm_squared() * weight);
        entry.1 += by * (velocity.dot(&ahead) * weight);
    }
    let steps: BTreeMap<usize, Vector2<f64>> = sums
        .into_iter()
        .filter_map(|(index, (mut matrix, right))| {
            matrix[(0, 0)] += 1.0 / (TIME_SIGMA_S * TIME_SIGMA_S);
            matrix[(1, 1)] += 1.0 / (RATE_SIGMA * RATE_SIGMA);
            Some((index, matrix.cholesky()?.solve(&right)))
        })
        .collect();
    let count = steps.len().max(1) as f64;
    let mean = steps
        .values()
        .fold(Vector2::zeros(), |sum, step| sum + step)
        / count;
    let mut most_s: f64 = 0.0;
    for (index, step) in steps {
        let Some(clock) = clocks.get_mut(index) else {
            continue;
        };
        // What is ahead was taken later than its clock says.
        let step = step - mean;
        clock.offset_s += step.x - step.y * middle_s + clock.offset_s * step.y;
        clock.rate_hz /= 1.0 + step.y;
        most_s = most_s.max(step.x.abs());
    }
    most_s
}

/// How fast a keypoint moves in the picture, pixels per tick, by the same tracklet one tick before and after.
fn velocity_px(view: &View, tick: i64, body: usize, keypoint: usize) -> Option<Vector2<f64>> {
    let own = view.ticks.get(&tick)?.get(body)?;
    let at = |tick: i64| {
        let mut bodies = view.ticks.get(&tick)?.iter();
        let same = bodies.find(|it| it.tracklet == own.tracklet)?;
        let joint = same.joints.get(keypoint).copied().flatten()?;
        Some(Vector2::from(joint.px))
    };
    Some((at(tick + 1)? - at(tick - 1)?) / 2.0)
}
