//! Calibration from a board that was moved as one rigid body: its corners have numbers, and their distances are known.
//!
//! Each camera finds the pose of the board at each instant. Cameras that saw it at the same instants give relative poses; the
//! pairs that agree best form one world. All is adjusted with a pose of the board per instant. So cameras are connected even
//! though no corner is seen by three of them, and metres come from the squares.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Translation3, Vector2, Vector3};
use rayon::prelude::*;

use super::chain::{Chain, Pair, evenly};
use super::refine::{Refined, bounded, freedom, noise_px, weigh};
use super::request::{Lenses, RigidBoard};
use super::view::View;
use crate::adjustment::{
    AdjustedCamera, Bodies, CameraState, Limits, Loss, Observation, Path, Problem, adjust,
};
use crate::board::pose_from_points;

/// The number of a sight is this times the instant, plus the number of the corner.
pub const CORNERS_PER_INSTANT: usize = 1000;
/// Least number of corners for a pose of the board: with four, a single wrong one would not be noticed.
const LEAST_CORNERS: usize = 5;
/// Least number of common instants of two cameras.
const LEAST_INSTANTS: usize = 3;
/// Most instants that are compared.
const MOST_INSTANTS: usize = 60;
/// Two cameras agree if the board's pose from one projects into the other with an error of at most so many gates.
const AGREES_GATES: f64 = 3.0;
/// Tuning constant of Cauchy's loss.
const CAUCHY: f64 = 2.385;
/// Rounds of estimating the noise and adjusting.
const ROUNDS: usize = 4;

/// The sights of a camera at one instant, by corner.
type Corners = BTreeMap<usize, [f64; 2]>;

/// The sights of the board in a camera.
struct Seen {
    state: CameraState,
    corners: BTreeMap<usize, Corners>,
    /// Per instant, the poses of the board in the camera, the best first.
    poses: BTreeMap<usize, Vec<Isometry3<f64>>>,
}

/// The relative pose of two cameras.
struct Link {
    first: usize,
    second: usize,
    second_from_first: Isometry3<f64>,
    common: usize,
    agreeing: usize,
}

/// Poses of as many of `views` as are connected by the board, adjusted.
pub(super) fn by_board(
    views: &[View],
    board: &RigidBoard,
    lenses: Lenses,
    gate_px: f64,
) -> (Chain, Refined) {
    let shape = board.shape();
    let seen: Vec<Seen> = views
        .par_iter()
        .map(|view| Seen::new(view, &shape))
        .collect();
    let indices: Vec<(usize, usize)> = (0..seen.len())
        .flat_map(|i| (i + 1..seen.len()).map(move |j| (i, j)))
        .collect();
    let links: Vec<Link> = indices
        .into_par_iter()
        .filter_map(|(i, j)| Link::between(&seen, [i, j], &shape, gate_px))
        .collect();
    let cameras = placed(&seen, &links);
    let refined = refine(&seen, &cameras, shape, lenses, gate_px);
    let pairs = links.iter().map(|link| Pair {
        first: link.first,
        second: link.second,
        common: link.common,
        agreeing: link.agreeing,
        pose: None,
    });
    let chain = Chain {
        shared_with_two: Vec::new(),
        pairs: pairs.collect(),
        cameras,
    };
    (chain, refined)
}

impl Seen {
    fn new(view: &View, shape: &[Vector3<f64>]) -> Self {
        let mut corners: BTreeMap<usize, Corners> = BTreeMap::new();
        for (number, sight) in &view.seen {
            let own = corners.entry(number / CORNERS_PER_INSTANT).or_default();
            own.insert(number % CORNERS_PER_INSTANT, sight.px);
        }
        let found = corners.iter().filter_map(|(instant, corners)| {
            let poses = poses(&view.state, corners, shape)?;
            Some((*instant, poses))
        });
        Self {
            state: view.state,
            poses: found.collect(),
            corners,
        }
    }

    /// Root mean squared distance of the corners at an instant from those of a board at a pose, pixels.
    fn off_px(
        &self,
        instant: usize,
        camera_from_board: &Isometry3<f64>,
        shape: &[Vector3<f64>],
    ) -> Option<f64> {
        let state = CameraState {
            camera_from_world: camera_from_board.rotation,
            center_w: camera_from_board.inverse().translation.vector,
            ..self.state
        };
        let fold_radius = state.fold_radius();
        let own = self.corners.get(&instant)?;
        let mut squares = 0.0;
        for (corner, px) in own {
            let drawn = state.project(shape.get(*corner)?, fold_radius)?;
            squares += (drawn - Vector2::from(*px)).norm_squared();
        }
        Some((squares / own.len().max(1) as f64).sqrt())
    }
}

/// The poses of the board in the camera, the best first: a board that looks small has two poses that fit nearly alike.
fn poses(
    state: &CameraState,
    corners: &Corners,
    shape: &[Vector3<f64>],
) -> Option<Vec<Isometry3<f64>>> {
    if corners.len() < LEAST_CORNERS {
        return None;
    }
    let points = corners.keys().filter_map(|it| shape.get(*it).copied());
    let points: Vec<[f64; 3]> = points.map(Into::into).collect();
    let pixels: Vec<[f64; 2]> = corners.values().copied().collect();
    let found = pose_from_points(&state.intrinsics, &state.lens(), &points, &pixels).ok()?;
    let other = found.other.filter(|_| found.is_ambiguous);
    let others = other.map(|it| it.camera_from_world);
    Some(
        std::iter::once(found.camera_from_world)
            .chain(others)
            .collect(),
    )
}

impl Link {
    /// The relative pose with which most common instants agree.
    fn between(
        seen: &[Seen],
        [first, second]: [usize; 2],
        shape: &[Vector3<f64>],
        gate_px: f64,
    ) -> Option<Self> {
        let (a, b) = (seen.get(first)?, seen.get(second)?);
        let common = a.poses.keys().filter(|it| b.poses.contains_key(it));
        let common: Vec<usize> = common.copied().collect();
        let common = evenly(&common, MOST_INSTANTS);
        let proposals = common.iter().flat_map(|instant| {
            let (a, b) = (a.poses.get(instant), b.poses.get(instant));
            let pairs = a
                .into_iter()
                .flatten()
                .flat_map(move |a| b.into_iter().flatten().map(move |b| b * a.inverse()));
            pairs.collect::<Vec<_>>()
        });
        let score = |second_from_first: &Isometry3<f64>| {
            let off = common.iter().filter_map(|instant| {
                let each = a.poses.get(instant)?.iter();
                let each =
                    each.filter_map(|it| b.off_px(*instant, &(second_from_first * it), shape));
                each.reduce(f64::min)
            });
            let off: Vec<f64> = off.filter(|px| *px < AGREES_GATES * gate_px).collect();
            // With equal counts, the smaller distances win.
            (off.len(), -off.iter().sum::<f64>())
        };
        let scored = proposals.map(|it| (score(&it), it));
        let best = scored.max_by(|((count, off), _), ((other, other_off), _)| {
            count.cmp(other).then(off.total_cmp(other_off))
        });
        let (agreeing, second_from_first) = best.map(|((count, _), it)| (count, it))?;
        Some(Self {
            first,
            second,
            second_from_first,
            common: common.len(),
            agreeing,
        })
    }
}

/// Poses of the cameras along the links with the most agreeing instants, in the world of the first.
fn placed(seen: &[Seen], links: &[Link]) -> Vec<Option<CameraState>> {
    let mut poses: Vec<Option<Isometry3<f64>>> = vec![None; seen.len()];
    let sound = || links.iter().filter(|it| it.agreeing >= LEAST_INSTANTS);
    if let Some(best) = sound().max_by_key(|it| it.agreeing) {
        poses[best.first] = Some(Isometry3::identity());
    }
    loop {
        let open = sound().filter(|it| poses[it.first].is_some() != poses[it.second].is_some());
        let Some(next) = open.max_by_key(|it| it.agreeing) else {
            break;
        };
        if let Some(first) = poses[next.first] {
            poses[next.second] = Some(next.second_from_first * first);
        } else if let Some(second) = poses[next.second] {
            poses[next.first] = Some(next.second_from_first.inverse() * second);
        }
    }
    let each = seen.iter().zip(poses).map(|(seen, pose)| {
        pose.map(|pose| CameraState {
            camera_from_world: pose.rotation,
            center_w: pose.inverse().translation.vector,
            ..seen.state
        })
    });
    each.collect()
}

/// The pose of the board at each instant that two placed cameras saw: the one that fits all of them best.
fn boards(
    seen: &[Seen],
    cameras: &[Option<CameraState>],
    shape: &[Vector3<f64>],
) -> BTreeMap<usize, Isometry3<f64>> {
    let placed = seen.iter().zip(cameras);
    let placed: Vec<(&Seen, Isometry3<f64>)> = placed
        .filter_map(|(seen, camera)| Some((seen, camera_from_world(camera.as_ref()?))))
        .collect();
    let mut instants: BTreeMap<usize, usize> = BTreeMap::new();
    for instant in placed.iter().flat_map(|(seen, _)| seen.corners.keys()) {
        *instants.entry(*instant).or_default() += 1;
    }
    let several = instants.iter().filter(|(_, count)| **count >= 2);
    let found = several.filter_map(|(instant, _)| {
        let proposals = placed.iter().flat_map(|(seen, camera)| {
            let own = seen.poses.get(instant).into_iter().flatten();
            own.map(|it| camera.inverse() * it)
        });
        let cost = |world_from_board: &Isometry3<f64>| {
            let off = placed
                .iter()
                .filter(|(seen, _)| seen.corners.contains_key(instant));
            let off = off.map(|(seen, camera)| {
                let off_px = seen.off_px(*instant, &(camera * world_from_board), shape);
                off_px.unwrap_or(f64::INFINITY)
            });
            off.sum::<f64>()
        };
        let scored = proposals.map(|it| (cost(&it), it));
        let best = scored.min_by(|a, b| a.0.total_cmp(&b.0))?;
        best.0.is_finite().then_some((*instant, best.1))
    });
    found.collect()
}

fn camera_from_world(camera: &CameraState) -> Isometry3<f64> {
    let shift = -(camera.camera_from_world * camera.center_w);
    Isometry3::from_parts(Translation3::from(shift), camera.camera_from_world)
}

/// Adjusts all placed cameras and boards to all corners.
fn refine(
    seen: &[Seen],
    cameras: &[Option<CameraState>],
    shape: Vec<Vector3<f64>>,
    lenses: Lenses,
    gate_px: f64,
) -> Refined {
    let boards = boards(seen, cameras, &shape);
    let index_of: BTreeMap<usize, usize> = boards.keys().copied().zip(0..).collect();
    let bodies = Bodies {
        poses: boards.into_values().collect(),
        shape,
    };
    let (mut adjusted, mut posed, mut observations) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (seen, camera)) in seen.iter().zip(cameras).enumerate() {
        let Some(state) = camera else { continue };
        for (instant, corners) in &seen.corners {
            let Some(moment) = index_of.get(instant) else {
                continue;
            };
            observations.extend(corners.iter().map(|(corner, px)| Observation {
                camera: adjusted.len(),
                point: bodies.point(*moment, *corner),
                frame: *instant as f64,
                px: *px,
                sigma_px: gate_px / 3.0,
                velocity: [0.0; 2],
            }));
        }
        adjusted.push(AdjustedCamera::new(*state, freedom(lenses, state)));
        posed.push(index);
    }
    let mut problem = Problem {
        cameras: adjusted,
        path: Path::Bodies(bodies),
        observations,
        loss: Loss::Cauchy(CAUCHY),
    };
    for round in 0..ROUNDS {
        let limits = Limits {
            steps: 40,
            decrease: if round + 1 < ROUNDS { 1e-4 } else { 1e-8 },
        };
        adjust(&mut problem, limits);
        let sigmas = bounded(&noise_px(&problem));
        weigh(&mut problem, &sigmas);
    }
    Refined { problem, posed }
}
