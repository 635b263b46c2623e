//! Whether lines of sight would meet better with another lens distortion: of one camera, or of all.
//!
//! ```text
//!   y' = y (1 + k |y|²)        y: normalised, undistorted by the calibration; k: written k1 less the true one, nearly
//! ```
//!
//! People in the middle of a picture hardly show a distortion, and what they show is less than networks err; but networks
//! err to all sides. So the places of all keypoints are found again for each k, from all cameras together, and the k with
//! the least mean cost is taken: on real cameras that are right it leaves 0.996 of the cost, or more.

use std::collections::BTreeMap;

use farfield_proto::id::ViewpointIndex;
use nalgebra::{Matrix3, Vector2, Vector3};

use super::geometry::SightLines;
use super::samples::{Burst, PosedTick, Samples, SeenBody};

/// Of the ticks of a burst every so many are looked at.
const EVERY_TICKS: usize = 4;
/// Keypoints that are looked at, spread over all.
const MAX_POINTS: usize = 1200;
/// Least keypoints that tell.
const MIN_POINTS: usize = 150;
/// Viewpoints that must show a keypoint: two lines of sight meet with many distortions, and those of one viewpoint say
/// the same.
const MIN_VIEWPOINTS: usize = 3;
/// How far somebody must have moved: of who stays at one place networks err always alike, which looks like a distortion
/// (a k of 0.5 on a treadmill, all of whose cameras are right).
const MOVED_M: f64 = 1.2;
/// Keypoints that tell whose a sighting is, and at which distance one costs a half, metres.
const MIN_COMMON: usize = 5;
const NEAR_M: f64 = 0.15;
/// Rounds of weighting.
const ROUNDS: usize = 3;
/// Distances at which a line of sight weighs a quarter, and costs one half, metres.
const WEIGHT_M: f64 = 0.04;
const COST_M: f64 = 0.03;
/// Squared distance beyond which it makes no difference, square metres.
const FARTHEST_SQUARED_M: f64 = 1e6;
/// The k that are tried first; then those beside the best, nearer and nearer.
const TRIED: [f64; 6] = [-0.8, -0.4, -0.2, 0.2, 0.4, 0.8];
const REFINEMENTS: usize = 4;
/// Least k that is told of, and what it leaves of the cost: of a larger one there may be more left. Of cameras that are right
/// 0.995 and more was left by any k of 0.05 or larger.
const TOLD: [(f64, f64); 2] = [(0.1, 0.985), (0.2, 0.99)];
/// How many times as much as the next camera's it must explain: a wrong lens bends what others seem to show, too.
const STANDS_OUT: f64 = 1.5;

/// Another distortion.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DistortionFit {
    /// The cameras that have it: one, or all that tell and have one (fisheyes have another).
    pub(super) cameras: Vec<usize>,
    /// By how much k1 of the calibration is larger than it should be.
    pub(super) k1_over: f64,
    /// What it leaves of the cost.
    pub(super) ratio: f64,
}

/// A keypoint at a tick: per camera that shows it the normalised, undistorted place.
type Point = Vec<(usize, Vector2<f64>)>;

/// The distortion with which lines of sight meet best, where that is sure.
pub(super) fn distortion(
    bursts: &[&Burst],
    samples: &Samples,
    (lines, viewpoints): (&[SightLines], &[ViewpointIndex]),
) -> Option<DistortionFit> {
    if farthest_moved_m(samples) < MOVED_M {
        return None;
    }
    let mut points = points(bursts, lines);
    points.extend(sighted_points(samples, lines));
    points.retain(|point| {
        let mut shown: Vec<_> = point
            .iter()
            .map(|(camera, _)| viewpoints[*camera])
            .collect();
        shown.sort_unstable();
        shown.dedup();
        shown.len() >= MIN_VIEWPOINTS
    });
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    let points: Vec<Point> = points.into_iter().step_by(step).collect();
    if points.len() < MIN_POINTS {
        return None;
    }
    let before = mean_cost(&points, lines, |_| 0.0);
    let enough = |camera: usize| {
        let shown = points
            .iter()
            .filter(|p| p.iter().any(|(of, _)| *of == camera));
        shown.count() >= MIN_POINTS
    };
    let known: Vec<usize> = (0..lines.len())
        .filter(|&camera| !lines[camera].is_fisheye() && enough(camera))
        .collect();
    let alone = known.iter().map(|&camera| vec![camera]);
    let together = Some(known.clone()).filter(|known| known.len() > 1);
    let fits = together.into_iter().chain(alone).map(|cameras| {
        let cost = |k: f64| {
            let k_of = |of| if cameras.contains(&of) { k } else { 0.0 };
            mean_cost(&points, lines, k_of)
        };
        let (k1_over, least) = least(cost, before);
        DistortionFit {
            cameras,
            k1_over,
            ratio: least / before.max(f64::MIN_POSITIVE),
        }
    });
    let mut fits: Vec<DistortionFit> = fits.collect();
    fits.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    let best = fits.first()?;
    let gain = |fit: &DistortionFit| 1.0 - fit.ratio;
    // Of one camera alone among fisheyes nobody can say that it is not the others.
    let stands_out = fits
        .get(1)
        .is_some_and(|next| gain(best) > STANDS_OUT * gain(next));
    let is_told = |(k, ratio): (f64, f64)| best.k1_over.abs() >= k && best.ratio < ratio;
    (stands_out && TOLD.into_iter().any(is_told)).then(|| best.clone())
}

/// How far who moved most got, metres: the diagonal of all places of the middle of a body.
fn farthest_moved_m(samples: &Samples) -> f64 {
    let mut places: BTreeMap<u32, [Vector3<f32>; 2]> = BTreeMap::new();
    for (person, body) in samples.poses.iter().flat_map(|posed| &posed.people) {
        let sum: Vector3<f32> = body.iter().map(|&m| Vector3::from(m)).sum();
        let middle = sum / body.len().max(1) as f32;
        let range = places.entry(*person).or_insert([middle; 2]);
        *range = [range[0].inf(&middle), range[1].sup(&middle)];
    }
    let ways = places
        .values()
        .map(|[low, high]| f64::from((high - low).norm()));
    ways.fold(0.0, f64::max)
}

/// Where `cost` is least, and that; at 0 it is `before`.
fn least(cost: impl Fn(f64) -> f64, before: f64) -> (f64, f64) {
    let mut best = (0.0, before);
    let take = |best: &mut (f64, f64), k: f64| {
        let own = cost(k);
        if own < best.1 {
            *best = (k, own);
        }
    };
    for k in TRIED {
        take(&mut best, k);
    }
    let mut step = 0.5 * best.0.abs().max(0.2);
    for _ in 0..REFINEMENTS {
        let middle = best.0;
        take(&mut best, middle - step);
        take(&mut best, middle + step);
        step *= 0.5;
    }
    best
}

fn points(bursts: &[&Burst], lines: &[SightLines]) -> Vec<Point> {
    let mut all: Vec<Point> = Vec::new();
    for burst in bursts {
        let mut people: Vec<u32> = burst.trails.iter().map(|trail| trail.person).collect();
        people.sort_unstable();
        people.dedup();
        for person in people {
            let of = burst.trails.iter().filter(|trail| trail.person == person);
            let trails: Vec<_> = of.collect();
            let ticks = trails.iter().map(|trail| trail.len()).max().unwrap_or(0);
            for tick in (0..ticks).step_by(EVERY_TICKS) {
                let mut of_tick: Vec<Point> = Vec::new();
                for trail in &trails {
                    let Some((_, seen)) = trail.at(tick) else {
                        continue;
                    };
                    of_tick.resize_with(seen.len().max(of_tick.len()), Vec::new);
                    for (point, seen) in of_tick.iter_mut().zip(seen) {
                        if seen.score > 0.0 {
                            point.push((trail.camera, lines[trail.camera].normalised(seen.pixel)));
                        }
                    }
                }
                all.extend(of_tick);
            }
        }
    }
    all
}

/// Those of detection passes: whose a sighting is is told by where people were.
fn sighted_points(samples: &Samples, lines: &[SightLines]) -> Vec<Point> {
    let mut all: Vec<Point> = Vec::new();
    for pass in &samples.passes {
        let off = |posed: &PosedTick| (posed.tick.0 - pass.tick.0).abs();
        let posed = samples.poses.iter().min_by_key(|posed| off(posed));
        let Some(posed) = posed.filter(|posed| off(posed) < samples.pose_every_ticks()) else {
            continue;
        };
        for (_, person) in &posed.people {
            let mut of_person: Vec<Point> = vec![Vec::new(); person.len()];
            for (camera, bodies) in pass.of_camera.iter().enumerate() {
                let Some(body) = shown_by(bodies, person, &lines[camera]) else {
                    continue;
                };
                for (point, seen) in of_person.iter_mut().zip(body) {
                    point.extend(seen.map(|seen| (camera, lines[camera].normalised(seen.pixel))));
                }
            }
            all.extend(of_person);
        }
    }
    all
}

/// The sighting of a person, where one is clearly it.
fn shown_by<'a>(
    bodies: &'a [SeenBody],
    person: &[[f32; 3]],
    lines: &SightLines,
) -> Option<&'a SeenBody> {
    let projected = |m: &[f32; 3]| lines.project(&Vector3::from(m.map(f64::from)));
    let expected: Vec<_> = person.iter().map(projected).collect();
    let cost_of = |body: &'a SeenBody| {
        let both = body.iter().zip(&expected);
        let off_m = both.filter_map(|(seen, at)| {
            let ((px, depth_m), seen) = (at.as_ref()?, seen.as_ref()?);
            let seen = Vector2::from(seen.pixel.map(f64::from));
            Some((px - seen).norm() * depth_m / lines.mean_focal_px())
        });
        let costs: Vec<f64> = off_m.map(|m| m * m / (m * m + NEAR_M * NEAR_M)).collect();
        let mean = costs.iter().sum::<f64>() / costs.len().max(1) as f64;
        (costs.len() >= MIN_COMMON && mean < 0.5).then_some((mean, body))
    };
    let best = bodies.iter().filter_map(cost_of);
    Some(best.min_by(|a, b| a.0.total_cmp(&b.0))?.1)
}

fn mean_cost(points: &[Point], lines: &[SightLines], k_of: impl Fn(usize) -> f64) -> f64 {
    let (mut sum, mut n) = (0.0, 0);
    for point in points {
        let rays = point.iter().map(|&(camera, y)| {
            let y = y * (1.0 + k_of(camera) * y.norm_squared());
            (lines[camera].center_m, lines[camera].world(y).normalize())
        });
        let rays: Vec<(Vector3<f64>, Vector3<f64>)> = rays.collect();
        for gap_m in gaps_m(&rays) {
            // Parallel lines of sight never meet: they cost one.
            let squared = (gap_m * gap_m).min(FARTHEST_SQUARED_M);
            sum += squared / (squared + COST_M * COST_M);
            n += 1;
        }
    }
    sum / f64::from(n.max(1))
}

/// How far each line of sight passes the point that is nearest to them all, metres; infinite where they are parallel.
fn gaps_m(rays: &[(Vector3<f64>, Vector3<f64>)]) -> Vec<f64> {
    let mut gaps_m = vec![0.0; rays.len()];
    for _ in 0..=ROUNDS {
        let (mut matrix, mut vector) = (Matrix3::zeros(), Vector3::zeros());
        for ((origin_m, unit), gap_m) in rays.iter().zip(&gaps_m) {
            let off: f64 = gap_m / WEIGHT_M;
            let weight = 1.0 / ((1.0 + off * off) * (1.0 + off * off));
            let across = weight * (Matrix3::identity() - unit * unit.transpose());
            matrix += across;
            vector += across * origin_m;
        }
        let Some(place_m) = matrix.try_inverse().map(|inverse| inverse * vector) else {
            return vec![f64::INFINITY; rays.len()];
        };
        for ((origin_m, unit), gap_m) in rays.iter().zip(&mut gaps_m) {
            let to_m = place_m - origin_m;
            *gap_m = (to_m - unit * unit.dot(&to_m)).norm();
        }
    }
    gaps_m
}
