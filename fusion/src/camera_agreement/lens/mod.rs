//! Keypoints that cameras of three viewpoints or more show, and how well their lines of sight meet with other lenses:
//! another `distortion` of one camera or of all, other `focal_lengths` of all, lenses of another `kind`.

pub(super) mod distortion;
pub(super) mod focal_lengths;
pub(super) mod kind;

use std::collections::BTreeMap;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::order_statistics::{reached_by, upper_median};
use nalgebra::{Matrix3, Vector2, Vector3};

use super::explain::resection::{MIN_DEPTH_M, Observed};
use super::geometry::SightLines;
use super::samples::{Burst, PosedTick, Samples, SeenBody, middle_m};

/// Every fourth tick of a burst is used.
const TICK_STEP: usize = 4;
/// Most keypoints, spread over all.
const MAX_POINTS: usize = 1200;
/// Most keypoints of one camera that are compared with the others.
const MAX_OBSERVED: usize = 500;
/// Fewest keypoints for a result.
const MIN_POINTS: usize = 150;
/// Fewest viewpoints that must show a keypoint: two lines of sight meet with many lenses, and cameras of one viewpoint
/// add nothing.
const MIN_VIEWPOINTS: usize = 3;
/// Smallest distance that a person must have moved, metres. If people stay at one place, the errors of a network are
/// constant, which looks like another lens (a k of 0.5 on a treadmill with valid cameras).
const MOVED_M: f64 = 1.2;
/// Share of a person's places on each side that count as outliers.
const OUTLIER_SHARE: f64 = 0.05;
/// Fewest common keypoints to assign a sighting to a person, and the distance that costs one half, metres: a camera
/// that was turned by two degrees shows people as far off.
const MIN_COMMON: usize = 5;
const NEAR_M: f64 = 0.3;
/// The next best sighting must cost so many times as much.
const MIN_MARGIN: f64 = 1.5;
/// Rounds of weighting.
const ROUNDS: usize = 3;
/// Distances at which the weight of a line of sight is a quarter, and its cost one half, metres.
const WEIGHT_M: f64 = 0.04;
const COST_M: f64 = 0.03;
/// Largest squared distance that is distinguished, square metres.
const MAX_SQUARED_M2: f64 = 1e6;

/// A keypoint at a tick: per camera that shows it the normalised, undistorted place.
type Point = Vec<(usize, Vector2<f64>)>;

/// Rounds of the search around the best change, with smaller and smaller steps.
const REFINEMENTS: usize = 4;

/// Keypoints to compare lenses with.
#[derive(Debug)]
pub(super) struct LensPoints {
    points: Vec<Point>,
    /// The index of each in the network.
    keypoints: Vec<usize>,
    lines: Vec<SightLines>,
    viewpoints: Vec<ViewpointIndex>,
    /// The cameras that show enough of them, without fisheyes, which have another lens model.
    known: Vec<usize>,
    /// Median distance that people move between the pictures of a tick, metres.
    blur_m: f64,
    has_moved: bool,
}

impl LensPoints {
    /// The keypoints of `bursts` and of the detection passes of `samples`; `None` if they are too few.
    pub(super) fn from_samples(
        bursts: &[&Burst],
        samples: &Samples,
        lines: &[SightLines],
        viewpoints: Vec<ViewpointIndex>,
    ) -> Option<Self> {
        let mut all = points(bursts, lines);
        all.extend(sighted_points(samples, lines));
        all.retain(|(_, point)| is_seen_widely(point, &viewpoints));
        let step = all.len().div_ceil(MAX_POINTS).max(1);
        let (keypoints, points): (Vec<usize>, Vec<Point>) = all.into_iter().step_by(step).unzip();
        if points.len() < MIN_POINTS {
            return None;
        }
        let enough = |camera: usize| {
            let shown = points
                .iter()
                .filter(|p| p.iter().any(|(of, _)| *of == camera));
            shown.count() >= MIN_POINTS
        };
        let known = (0..lines.len())
            .filter(|&camera| !lines[camera].is_fisheye() && enough(camera))
            .collect();
        Some(Self {
            points,
            keypoints,
            lines: lines.to_vec(),
            viewpoints,
            known,
            blur_m: blur_m(bursts, samples),
            has_moved: farthest_moved_m(samples) >= MOVED_M,
        })
    }

    /// The keypoints that `camera` shows, with their places by the `right` cameras of other viewpoints.
    pub(super) fn observed(&self, camera: usize, right: &[usize]) -> Vec<Observed> {
        let lines = &self.lines[camera];
        let (mut rays, mut gaps_m): (Vec<Ray>, Vec<f64>) = (Vec::new(), Vec::new());
        let all = self.points.iter().zip(&self.keypoints);
        let observed = all.filter_map(|(point, &keypoint)| {
            let (_, shown) = point.iter().find(|(of, _)| *of == camera)?;
            let others = point.iter().filter(|(of, _)| {
                right.contains(of) && self.viewpoints[*of] != self.viewpoints[camera]
            });
            rays.clear();
            rays.extend(others.map(|&(of, y)| self.ray(of, y)));
            let mut in_camera_m = None;
            find_gaps_m(&rays, &mut gaps_m, |_, place_m, gap_m| {
                in_camera_m = Some(lines.in_camera(place_m));
                gap_m
            });
            let is_met = rays.len() >= 2 && gaps_m.iter().all(|gap_m| gap_m.is_finite());
            let place_m = in_camera_m.filter(|m| is_met && m.z >= MIN_DEPTH_M)?;
            Some(Observed {
                place_m,
                shown: *shown,
                keypoint,
            })
        });
        let observed: Vec<Observed> = observed.collect();
        let step = observed.len().div_ceil(MAX_OBSERVED).max(1);
        observed.into_iter().step_by(step).collect()
    }

    /// Whether a person moved far enough for small changes of a camera to be sure.
    pub(super) fn has_moved(&self) -> bool {
        self.has_moved
    }

    /// Median distance that people move between the pictures of a tick, metres. To be reported, a change must improve
    /// distances by this in addition to other limits.
    pub(super) fn blur_m(&self) -> f64 {
        self.blur_m
    }

    /// The cameras whose lenses can be judged.
    pub(super) fn known(&self) -> &[usize] {
        &self.known
    }

    /// The calibrated lines of sight of every point.
    fn lines_of_sight(&self) -> Vec<Vec<Ray>> {
        let ray = |&(camera, y): &(usize, Vector2<f64>)| self.ray(camera, y);
        let rays = |point: &Point| point.iter().map(ray).collect();
        self.points.iter().map(rays).collect()
    }

    fn ray(&self, camera: usize, y: Vector2<f64>) -> Ray {
        let lines = &self.lines[camera];
        (lines.center_m, lines.world(y).normalize())
    }

    /// Number of points that a camera shows.
    fn count(&self, camera: usize) -> usize {
        let own = |point: &&Point| point.iter().any(|(of, _)| *of == camera);
        self.points.iter().filter(own).count()
    }

    /// Mean cost of the lines of sight, 0 to 1. Another lens moves the place `y` of a camera to `changed(camera, y)`;
    /// `None` keeps the `calibrated` line of sight.
    fn mean_cost(
        &self,
        calibrated: &[Vec<Ray>],
        changed: impl Fn(usize, Vector2<f64>) -> Option<Vector2<f64>>,
    ) -> f64 {
        let (mut sum, mut n) = (0.0, 0);
        let (mut rays, mut gaps_m): (Vec<Ray>, Vec<f64>) = (Vec::new(), Vec::new());
        for (point, calibrated) in self.points.iter().zip(calibrated) {
            rays.clear();
            rays.extend(point.iter().zip(calibrated).map(|(&(camera, y), known)| {
                changed(camera, y).map_or(*known, |place| self.ray(camera, place))
            }));
            find_gaps_m(&rays, &mut gaps_m, |_, _, gap_m| gap_m);
            for &gap_m in &gaps_m {
                sum += cost(gap_m);
                n += 1;
            }
        }
        sum / f64::from(n.max(1))
    }
}

/// A line of sight: its origin, world, metres, and its unit direction.
type Ray = (Vector3<f64>, Vector3<f64>);

fn is_seen_widely(point: &Point, viewpoints: &[ViewpointIndex]) -> bool {
    let mut shown: Vec<_> = point
        .iter()
        .map(|(camera, _)| viewpoints[*camera])
        .collect();
    shown.sort_unstable();
    shown.dedup();
    shown.len() >= MIN_VIEWPOINTS
}

/// Cost of the distance of a line of sight from a keypoint, 0 to 1. Parallel lines of sight never meet, so they cost one.
fn cost(gap_m: f64) -> f64 {
    let squared = (gap_m * gap_m).min(MAX_SQUARED_M2);
    squared / (squared + COST_M * COST_M)
}

/// The change with the least `cost`, and this cost. The search starts from the `candidates`; the cost of no change is
/// `before`.
fn minimum(candidates: &[f64], cost: impl Fn(f64) -> f64, before: f64) -> (f64, f64) {
    let mut best = (0.0, before);
    let take = |best: &mut (f64, f64), change: f64| {
        let own = cost(change);
        if own < best.1 {
            *best = (change, own);
        }
    };
    for &change in candidates {
        take(&mut best, change);
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

/// Distance that the most moving person covered, metres: the diagonal of the places of the middle of the body, without
/// outliers. If few views show a person, a pose can be wrong by a metre at times.
fn farthest_moved_m(samples: &Samples) -> f64 {
    let mut places: BTreeMap<u32, [Vec<f64>; 3]> = BTreeMap::new();
    for (person, body) in samples.poses.iter().flat_map(|posed| &posed.people) {
        let of_person = places.entry(*person).or_default();
        for (along, m) in of_person.iter_mut().zip(&middle_m(body)) {
            along.push(f64::from(*m));
        }
    }
    let reach_m = |along: &Vec<f64>| {
        let high = reached_by(along.iter().copied(), OUTLIER_SHARE);
        let low = reached_by(along.iter().map(|m| -m), OUTLIER_SHARE);
        high.zip(low).map_or(0.0, |(high, low)| high + low)
    };
    let diagonals_m = places.values().map(|axes| {
        let [x, y, z] = axes.each_ref().map(reach_m);
        Vector3::new(x, y, z).norm()
    });
    diagonals_m.fold(0.0, f64::max)
}

/// Median distance that people move between the first and the last picture of a tick, metres: free-running cameras take
/// them at different instants.
fn blur_m(bursts: &[&Burst], samples: &Samples) -> f64 {
    let mut late: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for trail in bursts.iter().flat_map(|burst| &burst.trails) {
        let own = (0..trail.len()).filter_map(|tick| Some(trail.at(tick)?.0));
        late.entry(trail.camera).or_default().extend(own);
    }
    let usual = late.into_values().filter_map(upper_median);
    let (first, last) = usual.fold((f64::INFINITY, f64::NEG_INFINITY), |(first, last), late| {
        (first.min(late), last.max(late))
    });
    (last - first).max(0.0) * moved_per_tick_m(samples)
}

/// Median distance that people move in a tick, metres.
fn moved_per_tick_m(samples: &Samples) -> f64 {
    let pairs = samples.poses.iter().zip(samples.poses.iter().skip(1));
    let moved_m = pairs.flat_map(|(before, after)| {
        let ticks = (after.tick - before.tick).max(1) as f64;
        after.people.iter().filter_map(move |(person, now)| {
            let (_, then) = before.people.iter().find(|(other, _)| other == person)?;
            Some(f64::from((middle_m(now) - middle_m(then)).norm()) / ticks)
        })
    });
    upper_median(moved_m.collect()).unwrap_or(0.0)
}

fn points(bursts: &[&Burst], lines: &[SightLines]) -> Vec<(usize, Point)> {
    let mut all: Vec<(usize, Point)> = Vec::new();
    for burst in bursts {
        let mut people: Vec<u32> = burst.trails.iter().map(|trail| trail.person).collect();
        people.sort_unstable();
        people.dedup();
        for person in people {
            let trails = burst.trails.iter();
            let trails: Vec<_> = trails.filter(|trail| trail.person == person).collect();
            let ticks = trails.iter().map(|trail| trail.len()).max().unwrap_or(0);
            for tick in (0..ticks).step_by(TICK_STEP) {
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
                all.extend(of_tick.into_iter().enumerate());
            }
        }
    }
    all
}

/// Keypoints of detection passes. Sightings are assigned to people by their poses.
fn sighted_points(samples: &Samples, lines: &[SightLines]) -> Vec<(usize, Point)> {
    let mut all: Vec<(usize, Point)> = Vec::new();
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
            all.extend(of_person.into_iter().enumerate());
        }
    }
    all
}

/// The sighting of a person, if one fits clearly best.
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
    let mut known: Vec<(f64, &SeenBody)> = bodies.iter().filter_map(cost_of).collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (best, body) = *known.first()?;
    let is_clear = known
        .get(1)
        .is_none_or(|(next, _)| *next > MIN_MARGIN * best);
    is_clear.then_some(body)
}

/// Distance of each line of sight from the point nearest to all, metres; infinite if they are parallel.
/// `counted(ray, place_m, gap_m)` may replace the distance to that point, world.
fn gaps_m(rays: &[Ray], counted: impl FnMut(usize, &Vector3<f64>, f64) -> f64) -> Vec<f64> {
    let mut gaps_m = Vec::new();
    find_gaps_m(rays, &mut gaps_m, counted);
    gaps_m
}

/// The same into `gaps_m`, which is overwritten.
fn find_gaps_m(
    rays: &[Ray],
    gaps_m: &mut Vec<f64>,
    mut counted: impl FnMut(usize, &Vector3<f64>, f64) -> f64,
) {
    gaps_m.clear();
    gaps_m.resize(rays.len(), 0.0);
    for _ in 0..=ROUNDS {
        let (mut matrix, mut vector) = (Matrix3::zeros(), Vector3::zeros());
        for ((origin_m, unit), gap_m) in rays.iter().zip(gaps_m.iter()) {
            let off: f64 = gap_m / WEIGHT_M;
            let weight = 1.0 / ((1.0 + off * off) * (1.0 + off * off));
            let across = weight * (Matrix3::identity() - unit * unit.transpose());
            matrix += across;
            vector += across * origin_m;
        }
        let Some(place_m) = matrix.try_inverse().map(|inverse| inverse * vector) else {
            gaps_m.fill(f64::INFINITY);
            return;
        };
        for (index, ((origin_m, unit), gap_m)) in rays.iter().zip(gaps_m.iter_mut()).enumerate() {
            let to_m = place_m - origin_m;
            let off_m = (to_m - unit * unit.dot(&to_m)).norm();
            *gap_m = counted(index, &place_m, off_m);
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::{PersonId, SessionId};
    use farfield_proto::message::{PersonPose, PersonState, PoseSet};
    use farfield_proto::tick::Tick;

    use super::*;

    fn pose_set(tick: i64, x_m: f32, state: PersonState) -> PoseSet {
        let person = PersonPose {
            person: PersonId(1),
            state,
            joints_m: Vec::new(),
            keypoints_m: vec![[x_m, 0.0, 1.0]; 17],
            sigma_m: Vec::new(),
            angles: Vec::new(),
            unobserved: 0,
            views: 0,
        };
        PoseSet {
            session: SessionId(1),
            tick: Tick(tick),
            persons: vec![person],
        }
    }

    /// Once, live, the track of a man on a treadmill drifted away between the few ticks on which edges worked. He
    /// seemed to have moved by four metres, and valid cameras were reported as turned.
    #[test]
    fn coasting_and_outlier_poses_do_not_count_as_moving() {
        let mut samples = Samples::new(15.0, 2);
        for tick in 0..400 {
            let (x_m, state) = match tick % 4 {
                3 if tick % 100 == 3 => (-3.0, PersonState::Tracked),
                3 => (0.002 * tick as f32, PersonState::Tracked),
                ahead => (4.0 * ahead as f32, PersonState::Coasting),
            };
            samples.note_poses(&pose_set(tick, x_m, state));
        }
        assert_eq!(samples.poses.len(), 100);
        let moved_m = farthest_moved_m(&samples);
        assert!((0.7..0.8).contains(&moved_m), "{moved_m} m");
    }
}
