//! Rough poses without a start: first the best pair, then one camera after the other from the points known by then.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::view::View;
use crate::adjustment::{
    AdjustedCamera, Block, CameraState, Free, Limits, Loss, Observation, Path, Problem, adjust,
};
use crate::geometry::{RelativePose, Sight, relative_pose, resect, triangulate};

/// Least number of common moments of a pair.
const LEAST_COMMON: usize = 15;
/// Most common moments that are used.
const MOST_COMMON: usize = 250;
/// Least share of agreeing moments of a pair.
const LEAST_SHARE: f64 = 0.4;
/// Random samples per pair.
const PAIR_SAMPLES: usize = 400;
/// Random samples per resection.
const RESECTION_SAMPLES: usize = 400;
/// Least number of known points with which an added camera agrees.
const LEAST_POINTS: usize = 10;
/// Most moments of an intermediate adjustment.
const MOST_MOMENTS: usize = 300;
/// Parallax above which a pair does not improve, radians.
const ENOUGH_PARALLAX_RAD: f64 = 0.6;
/// Number of pairs that are tried as the first.
const STARTS: usize = 4;

/// The relative pose of two cameras.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pair {
    pub(super) first: usize,
    pub(super) second: usize,
    /// Number of compared moments.
    pub(super) common: usize,
    /// Number of agreeing moments.
    pub(super) agreeing: usize,
    pub(super) pose: Option<RelativePose>,
}

impl Pair {
    pub(super) fn share(&self) -> f64 {
        self.agreeing as f64 / self.common.max(1) as f64
    }

    /// Whether enough moments agree for a pose.
    pub(super) fn is_sound(&self) -> bool {
        self.common >= LEAST_COMMON && self.share() >= LEAST_SHARE
    }

    /// Its quality as the first pair.
    fn worth(&self) -> f64 {
        self.pose.as_ref().map_or(0.0, |pose| {
            let parallax = pose.parallax_rad.min(ENOUGH_PARALLAX_RAD);
            pose.inliers.len() as f64 * self.share() * parallax
        })
    }
}

/// Poses in a world whose first camera is the origin and whose first baseline is 1.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Chain {
    pub(super) cameras: Vec<Option<CameraState>>,
    pub(super) pairs: Vec<Pair>,
    /// Per camera, the moments that it and two others with a pose saw: only these relate its distances to the others.
    pub(super) shared_with_two: Vec<usize>,
}

impl Chain {
    /// Whether a camera shares too few moments with two others to relate its distances to them.
    pub(super) fn has_no_scale(&self, index: usize) -> bool {
        let shared = self.shared_with_two.get(index).copied();
        shared.unwrap_or(0) < LEAST_POINTS
    }
}

impl Chain {
    pub(super) fn count(&self) -> usize {
        self.cameras.iter().flatten().count()
    }
}

/// Poses of as many of `views` as agree within `gate_px`.
pub(super) fn chain(views: &[View], gate_px: f64, seed: u64) -> Chain {
    let pairs = all_pairs(views, gate_px, seed);
    let mut starts: Vec<&Pair> = pairs.iter().filter(|p| p.is_sound()).collect();
    starts.sort_by(|a, b| b.worth().total_cmp(&a.worth()));
    let mut best = Chain {
        cameras: vec![None; views.len()],
        pairs: Vec::new(),
        shared_with_two: Vec::new(),
    };
    for start in starts.into_iter().take(STARTS) {
        let grown = grow(views, start, gate_px, seed);
        if grown.iter().flatten().count() > best.count() {
            best.cameras = grown;
        }
        if best.count() == views.len() {
            break;
        }
    }
    best.pairs = pairs;
    best.shared_with_two = shared_with_two(views, &best.cameras);
    best
}

fn shared_with_two(views: &[View], cameras: &[Option<CameraState>]) -> Vec<usize> {
    let mut posed: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (index, (view, _)) in views
        .iter()
        .zip(cameras)
        .enumerate()
        .filter(|(_, (_, it))| it.is_some())
    {
        for tick in view.seen.keys() {
            posed.entry(*tick).or_default().push(index);
        }
    }
    let each = views.iter().enumerate().map(|(index, view)| {
        let has_two = |tick: &&usize| {
            let others = posed.get(tick).into_iter().flatten();
            others.filter(|other| **other != index).count() >= 2
        };
        view.seen.keys().filter(has_two).count()
    });
    each.collect()
}

fn all_pairs(views: &[View], gate_px: f64, seed: u64) -> Vec<Pair> {
    let indices: Vec<(usize, usize)> = (0..views.len())
        .flat_map(|i| (i + 1..views.len()).map(move |j| (i, j)))
        .collect();
    // Each pair has its own random numbers, so that the order of the threads does not matter.
    indices
        .into_par_iter()
        .map(|(i, j)| pair(views, i, j, gate_px, seed))
        .collect()
}

fn pair(views: &[View], first: usize, second: usize, gate_px: f64, seed: u64) -> Pair {
    let (a, b) = (&views[first], &views[second]);
    let both = a.seen.iter().filter_map(|(tick, seen)| {
        let other = b.seen.get(tick)?;
        Some((seen.bearing, other.bearing))
    });
    let both: Vec<_> = both.collect();
    let both = evenly(&both, MOST_COMMON);
    let common = both.len();
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ ((first as u64) << 32 | second as u64));
    let gate_rad = gate_px / a.focal_px().min(b.focal_px());
    let pose = (common >= LEAST_COMMON)
        .then(|| relative_pose(&both, gate_rad, PAIR_SAMPLES, &mut rng))
        .flatten();
    Pair {
        first,
        second,
        common,
        agreeing: pose.as_ref().map_or(0, |p| p.inliers.len()),
        pose,
    }
}

/// At most `most` of `all`, evenly spaced.
pub(super) fn evenly<T: Clone>(all: &[T], most: usize) -> Vec<T> {
    if all.len() <= most {
        return all.to_vec();
    }
    (0..most)
        .filter_map(|k| all.get(k * all.len() / most).cloned())
        .collect()
}

fn grow(views: &[View], start: &Pair, gate_px: f64, seed: u64) -> Vec<Option<CameraState>> {
    let mut cameras: Vec<Option<CameraState>> = vec![None; views.len()];
    let Some(pose) = &start.pose else {
        return cameras;
    };
    cameras[start.first] = Some(views[start.first].state);
    cameras[start.second] = Some(CameraState {
        camera_from_world: pose.rotation,
        center_w: -(pose.rotation.inverse() * pose.translation),
        ..views[start.second].state
    });
    let mut refused = vec![false; views.len()];
    loop {
        settle(views, &mut cameras, gate_px, MOST_MOMENTS);
        let points = points(views, &cameras, 2.0 * gate_px, usize::MAX);
        let waiting = (0..views.len()).filter(|i| cameras[*i].is_none() && !refused[*i]);
        let known = |i: usize| {
            views[i]
                .seen
                .keys()
                .filter(|t| points.contains_key(t))
                .count()
        };
        let Some(next) = waiting.max_by_key(|i| (known(*i), usize::MAX - i)) else {
            return cameras;
        };
        cameras[next] = placed(&views[next], &points, gate_px, seed ^ next as u64);
        if cameras[next].is_none() {
            refused[next] = true;
        } else {
            // With more points another camera may fit.
            refused = vec![false; views.len()];
        }
    }
}

fn placed(
    view: &View,
    points: &BTreeMap<usize, Vector3<f64>>,
    gate_px: f64,
    seed: u64,
) -> Option<CameraState> {
    let known = view
        .seen
        .iter()
        .filter_map(|(tick, seen)| Some((seen.bearing, *points.get(tick)?)));
    let known: Vec<_> = known.collect();
    let known = evenly(&known, 2 * MOST_COMMON);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let gate_rad = 2.0 * gate_px / view.focal_px();
    let found = resect(&known, gate_rad, RESECTION_SAMPLES, &mut rng)?;
    let is_enough = found.inliers.len() >= LEAST_POINTS
        && found.inliers.len() as f64 >= LEAST_SHARE * known.len() as f64;
    is_enough.then_some(CameraState {
        camera_from_world: found.camera_from_world,
        center_w: found.center_w,
        ..view.state
    })
}

/// The points on which the posed cameras agree, by tick; at most `most` ticks, evenly spaced.
pub(super) fn points(
    views: &[View],
    cameras: &[Option<CameraState>],
    gate_px: f64,
    most: usize,
) -> BTreeMap<usize, Vector3<f64>> {
    let mut sights: BTreeMap<usize, Vec<Sight>> = BTreeMap::new();
    let mut gate_rad: f64 = 0.0;
    for (view, camera) in views.iter().zip(cameras) {
        let Some(camera) = camera else { continue };
        gate_rad = gate_rad.max(gate_px / view.focal_px());
        let back = camera.camera_from_world.inverse();
        for (tick, seen) in &view.seen {
            let sight = (camera.center_w, back * seen.bearing);
            sights.entry(*tick).or_default().push(sight);
        }
    }
    let several: Vec<_> = sights.into_iter().filter(|(_, s)| s.len() >= 2).collect();
    let chosen = evenly(&several, most);
    let found = chosen.iter().filter_map(|(tick, sights)| {
        let (point, _) = triangulate(sights, gate_rad)?;
        Some((*tick, point))
    });
    found.collect()
}

/// Adjusts the current poses to their common sights.
pub(super) fn settle(
    views: &[View],
    cameras: &mut [Option<CameraState>],
    gate_px: f64,
    most: usize,
) {
    for _ in 0..2 {
        let (mut problem, posed) = problem(views, cameras, gate_px, most);
        let limits = Limits {
            steps: 15,
            decrease: 1e-4,
        };
        adjust(&mut problem, limits);
        for (camera, index) in problem.cameras.iter().zip(posed) {
            cameras[index] = Some(camera.state);
        }
    }
}

/// Velocity of the point in the picture from the frames before and after, pixels per frame; zero if one is missing.
fn velocity(view: &View, tick: usize) -> [f64; 2] {
    let px = |tick: Option<usize>| view.seen.get(&tick?).map(|it| it.px);
    let around = px(tick.checked_sub(1)).zip(px(tick.checked_add(1)));
    around.map_or([0.0; 2], |(before, after)| {
        [0, 1].map(|axis| (after[axis] - before[axis]) / 2.0)
    })
}

/// The problem of the posed cameras and their common sights, with the indices of its cameras in `views`.
pub(super) fn problem(
    views: &[View],
    cameras: &[Option<CameraState>],
    gate_px: f64,
    most: usize,
) -> (Problem, Vec<usize>) {
    let points = points(views, cameras, 3.0 * gate_px, most);
    let index_of: BTreeMap<usize, usize> = points.keys().copied().zip(0..).collect();
    let free = Free::none().with(Block::Pose);
    let (mut adjusted, mut posed, mut observations) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (view, camera)) in views.iter().zip(cameras).enumerate() {
        let Some(state) = camera else { continue };
        for (tick, seen) in &view.seen {
            let Some(point) = index_of.get(tick) else {
                continue;
            };
            observations.push(Observation {
                camera: adjusted.len(),
                point: *point,
                frame: seen.frame,
                px: seen.px,
                sigma_px: gate_px / 3.0,
                velocity: velocity(view, *tick),
            });
        }
        adjusted.push(AdjustedCamera::new(*state, free));
        posed.push(index);
    }
    let problem = Problem {
        cameras: adjusted,
        path: Path::Points(points.into_values().collect()),
        observations,
        loss: Loss::Cauchy(2.0),
    };
    (problem, posed)
}
