//! Where keypoints are seen by cameras of three viewpoints or more, and how well the lines of sight meet through other
//! lenses: `distortion` of one camera or of all, `focal_lengths` of all, lenses of the other `kind`.

mod blur;
pub(super) mod distortion;
pub(super) mod focal_lengths;
pub(super) mod kind;

use std::collections::BTreeMap;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::order_statistics::reached_by;
use nalgebra::{Matrix3, Vector2, Vector3};

use self::blur::blur_m;
use super::explain::resection::{LEAST_DEPTH_M, Observed};
use super::geometry::SightLines;
use super::samples::{Burst, PosedTick, Samples, SeenBody, middle_m};

/// Of the ticks of a burst every so many are looked at.
const EVERY_TICKS: usize = 4;
/// Keypoints that are looked at, spread over all.
const MAX_POINTS: usize = 1200;
/// Of these so many of one camera are held to the others.
const MAX_OBSERVED: usize = 500;
/// Least keypoints that tell.
const MIN_POINTS: usize = 150;
/// Viewpoints that must show a keypoint: two lines of sight meet through many lenses, and those of one viewpoint say the
/// same.
const MIN_VIEWPOINTS: usize = 3;
/// How far somebody must have moved: of who stays at one place networks err always alike, which looks like another lens (a k
/// of 0.5 on a treadmill, all of whose cameras are right).
const MOVED_M: f64 = 1.2;
/// Share of a person's places on each side that do not count.
const FARTHEST_SHARE: f64 = 0.05;
/// Keypoints that tell whose a sighting is, and at which distance one costs a half, metres: a camera that was turned by two
/// degrees shows people as far beside where they are.
const MIN_COMMON: usize = 5;
const NEAR_M: f64 = 0.3;
/// What the sighting that fits next must cost more.
const CLEARLY: f64 = 1.5;
/// Rounds of weighting.
const ROUNDS: usize = 3;
/// Distances at which a line of sight weighs a quarter, and costs one half, metres.
const WEIGHT_M: f64 = 0.04;
const COST_M: f64 = 0.03;
/// Squared distance beyond which it makes no difference, square metres.
const FARTHEST_SQUARED_M: f64 = 1e6;

/// A keypoint at a tick: per camera that shows it the normalised, undistorted place.
type Point = Vec<(usize, Vector2<f64>)>;

/// Rounds in which the changes beside the best are tried, nearer and nearer.
const REFINEMENTS: usize = 4;

/// Keypoints that tell of lenses.
#[derive(Debug)]
pub(super) struct LensPoints {
    points: Vec<Point>,
    /// Which keypoint of the network each of them is.
    keypoints: Vec<usize>,
    lines: Vec<SightLines>,
    viewpoints: Vec<ViewpointIndex>,
    /// The cameras that show enough of them, fisheyes left out: these have other lenses.
    known: Vec<usize>,
    /// How far people go between the pictures of a tick, metres.
    blur_m: f64,
    has_moved: bool,
}

impl LensPoints {
    /// Those of `bursts` and of the detection passes of `samples`; `None` if they are too few.
    pub(super) fn of(
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

    /// What `camera` shows of them, beside where the cameras of other viewpoints that are `right` say it is.
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
            let place_m = in_camera_m.filter(|m| is_met && m.z >= LEAST_DEPTH_M)?;
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

    /// How far people go in the median between the pictures that cameras take of a tick, metres: so much less than it is the
    /// distance must be, beside all else, for a change to be told.
    pub(super) fn blur_m(&self) -> f64 {
        self.blur_m
    }

    /// The cameras whose lenses they tell of.
    pub(super) fn known(&self) -> &[usize] {
        &self.known
    }

    /// The lines of sight of every point, as they are calibrated.
    fn lines_of_sight(&self) -> Vec<Vec<Ray>> {
        let ray = |&(camera, y): &(usize, Vector2<f64>)| self.ray(camera, y);
        let of = |point: &Point| point.iter().map(ray).collect();
        self.points.iter().map(of).collect()
    }

    fn ray(&self, camera: usize, y: Vector2<f64>) -> Ray {
        let lines = &self.lines[camera];
        (lines.center_m, lines.world(y).normalize())
    }

    /// How many of them a camera shows.
    fn count(&self, camera: usize) -> usize {
        let own = |point: &&Point| point.iter().any(|(of, _)| *of == camera);
        self.points.iter().filter(own).count()
    }

    /// What the lines of sight cost, 0 to 1, where a place `y` in the picture of a camera is by another lens at
    /// `changed(camera, y)`; `None` where it has the one that is calibrated, whose lines of sight these are.
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

/// A line of sight: where it begins, world, metres, and its direction, of length 1.
type Ray = (Vector3<f64>, Vector3<f64>);

/// Whether three viewpoints show it.
fn is_seen_widely(point: &Point, viewpoints: &[ViewpointIndex]) -> bool {
    let mut shown: Vec<_> = point
        .iter()
        .map(|(camera, _)| viewpoints[*camera])
        .collect();
    shown.sort_unstable();
    shown.dedup();
    shown.len() >= MIN_VIEWPOINTS
}

/// What it costs that a line of sight passes a keypoint so far away, 0 to 1. Parallel lines of sight never meet: they cost one.
fn cost(gap_m: f64) -> f64 {
    let squared = (gap_m * gap_m).min(FARTHEST_SQUARED_M);
    squared / (squared + COST_M * COST_M)
}

/// Where `cost` is least, and that, begun with those that are `tried`; at 0 it is `before`.
fn least(tried: &[f64], cost: impl Fn(f64) -> f64, before: f64) -> (f64, f64) {
    let mut best = (0.0, before);
    let take = |best: &mut (f64, f64), change: f64| {
        let own = cost(change);
        if own < best.1 {
            *best = (change, own);
        }
    };
    for &change in tried {
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

/// How far who moved most got, metres: the diagonal of the places where the middle of a body was, but for the few that lie
/// farthest out. Of somebody whom few views show a pose may be a metre off now and then.
fn farthest_moved_m(samples: &Samples) -> f64 {
    let mut places: BTreeMap<u32, [Vec<f64>; 3]> = BTreeMap::new();
    for (person, body) in samples.poses.iter().flat_map(|posed| &posed.people) {
        let of_person = places.entry(*person).or_default();
        for (along, m) in of_person.iter_mut().zip(&middle_m(body)) {
            along.push(f64::from(*m));
        }
    }
    let reach_m = |along: &Vec<f64>| {
        let high = reached_by(along.iter().copied(), FARTHEST_SHARE);
        let low = reached_by(along.iter().map(|m| -m), FARTHEST_SHARE);
        high.zip(low).map_or(0.0, |(high, low)| high + low)
    };
    let ways = places.values().map(|axes| {
        let [x, y, z] = axes.each_ref().map(reach_m);
        Vector3::new(x, y, z).norm()
    });
    ways.fold(0.0, f64::max)
}

fn points(bursts: &[&Burst], lines: &[SightLines]) -> Vec<(usize, Point)> {
    let mut all: Vec<(usize, Point)> = Vec::new();
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
                all.extend(of_tick.into_iter().enumerate());
            }
        }
    }
    all
}

/// Those of detection passes: whose a sighting is is told by where people were.
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
    let mut known: Vec<(f64, &SeenBody)> = bodies.iter().filter_map(cost_of).collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (best, body) = *known.first()?;
    let is_clear = known.get(1).is_none_or(|(next, _)| *next > CLEARLY * best);
    is_clear.then_some(body)
}

/// How far each line of sight passes the point that is nearest to them all, metres; infinite where they are parallel.
/// `counted(ray, place_m, gap_m)` is what the distance to that point, world, counts as.
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

    /// Once the track of a man on a treadmill flew off, live, between the few ticks that edges worked on. So he had "moved" by
    /// four metres, and right cameras were said to be turned.
    #[test]
    fn who_coasts_away_or_is_seen_badly_at_times_has_not_moved() {
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
