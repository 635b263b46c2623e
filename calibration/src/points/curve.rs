//! The last adjustment of cameras that are not synchronised: every sight at its own time, the point on a smooth curve.

use farfield_proto::order_statistics::value_after;
use nalgebra::Vector3;

use super::chain::{evenly, points};
use super::refine::{Refined, bounded, freedom, noise_px, weigh};
use super::request::Lenses;
use super::timing::range_s;
use super::view::{Track, View};
use crate::adjustment::{
    AdjustedCamera, Block, CameraState, Limits, Loss, Observation, Path, Problem, Spline, adjust,
};

/// Most sights of a camera, evenly spaced.
const MOST_SIGHTS: usize = 3000;
/// Time between knots.
const SPACING_S: f64 = 0.25;
/// Most knots.
const MOST_KNOTS: f64 = 3000.0;
/// Stiffness of the curve: the bend between knots that counts as one standard deviation, relative to the usual distance
/// between knots.
const USUAL_BEND: f64 = 2.0;
/// Relative standard deviation of a given rate.
const RATE_PRIOR: f64 = 2e-3;
/// Rounds of estimating the noise and adjusting.
const ROUNDS: usize = 4;
/// Tuning constant of Cauchy's loss.
const CAUCHY: f64 = 2.385;

/// Whether clocks are adjusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clocks {
    Given,
    Free,
}

/// Adjusts all posed cameras to all their sights; `views` are the sights at common moments from which the curve starts.
pub(super) fn refine_curve(
    tracks: &[Track],
    views: &[View],
    cameras: &[Option<CameraState>],
    lenses: Lenses,
    clocks: Clocks,
    gate_px: f64,
) -> Option<Refined> {
    let mut refined = start(tracks, views, cameras, gate_px)?;
    let longest = refined
        .posed
        .iter()
        .copied()
        .max_by_key(|i| tracks[*i].seen.len());
    for (camera, index) in refined.problem.cameras.iter_mut().zip(&refined.posed) {
        let given = CameraState {
            intrinsics: tracks[*index].state.intrinsics,
            distortion: tracks[*index].state.distortion,
            ..camera.state
        };
        let mut free = freedom(lenses, &given);
        if clocks == Clocks::Free && Some(*index) != longest {
            free = free
                .with(Block::TimeOffset)
                .with_prior(Block::Rate, RATE_PRIOR);
        }
        *camera = AdjustedCamera {
            state: camera.state,
            start: given,
            free,
        };
    }
    for round in 0..ROUNDS {
        let limits = Limits {
            steps: 30,
            decrease: if round + 1 < ROUNDS { 1e-4 } else { 1e-7 },
        };
        adjust(&mut refined.problem, limits);
        let sigmas = bounded(&noise_px(&refined.problem));
        weigh(&mut refined.problem, &sigmas);
    }
    Some(refined)
}

fn start(
    tracks: &[Track],
    views: &[View],
    cameras: &[Option<CameraState>],
    gate_px: f64,
) -> Option<Refined> {
    let posed: Vec<usize> = (0..tracks.len())
        .filter(|i| cameras[*i].is_some())
        .collect();
    let ranges: Vec<[f64; 2]> = posed.iter().filter_map(|i| range_s(&tracks[*i])).collect();
    let from = ranges
        .iter()
        .fold(f64::INFINITY, |least, r| least.min(r[0]));
    let to = ranges
        .iter()
        .fold(f64::NEG_INFINITY, |most, r| most.max(r[1]));
    let spacing_s = SPACING_S.max((to - from) / MOST_KNOTS);
    let known = known(views, cameras, gate_px);
    let mut spline = Spline::over(from - spacing_s, to + spacing_s, spacing_s, 0.0);
    let mut travelled = Vec::new();
    for k in 0..spline.controls.len() {
        let time_s = spline.start_s + (k as f64 - 1.0) * spacing_s;
        spline.controls[k] = between(&known, time_s)?;
        if k > 0 {
            travelled.push((spline.controls[k] - spline.controls[k - 1]).norm());
        }
    }
    travelled.sort_by(f64::total_cmp);
    let usual = value_after(&travelled, 0.75)?;
    let bend = USUAL_BEND * usual;
    spline.stiffness = if bend > 0.0 { 1.0 / (bend * bend) } else { 1.0 };
    let mut observations = Vec::new();
    for (camera, index) in posed.iter().enumerate() {
        for seen in evenly(&tracks[*index].seen, MOST_SIGHTS) {
            observations.push(Observation {
                camera,
                point: 0,
                frame: seen.frame,
                px: seen.px,
                sigma_px: gate_px / 3.0,
                velocity: [0.0; 2],
            });
        }
    }
    let free = freedom(Lenses::Given, &tracks[*posed.first()?].state);
    let adjusted = posed
        .iter()
        .filter_map(|i| Some(AdjustedCamera::new(cameras[*i]?, free)));
    Some(Refined {
        problem: Problem {
            cameras: adjusted.collect(),
            path: Path::Curve(spline),
            observations,
            loss: Loss::Cauchy(CAUCHY),
        },
        posed,
    })
}

/// Points on which several cameras agree, by time.
fn known(
    views: &[View],
    cameras: &[Option<CameraState>],
    gate_px: f64,
) -> Vec<(f64, Vector3<f64>)> {
    let found = points(views, cameras, 2.0 * gate_px, usize::MAX);
    let each = found.iter().filter_map(|(tick, point)| {
        let (view, seen) = views
            .iter()
            .zip(cameras)
            .find_map(|(view, camera)| Some((camera.as_ref()?, view.seen.get(tick)?)))?;
        Some((view.time_s(seen.frame), *point))
    });
    each.collect()
}

/// Interpolates linearly between the known points around `time_s`; constant beyond both ends.
fn between(known: &[(f64, Vector3<f64>)], time_s: f64) -> Option<Vector3<f64>> {
    let after = known.partition_point(|(t, _)| *t < time_s);
    let (Some(b), Some(a)) = (
        known.get(after),
        after.checked_sub(1).and_then(|i| known.get(i)),
    ) else {
        let nearest = known.get(after).or_else(|| known.last());
        return nearest.map(|(_, point)| *point);
    };
    let share = (time_s - a.0) / (b.0 - a.0).max(1e-9);
    Some(a.1 + (b.1 - a.1) * share)
}
