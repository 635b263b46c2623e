//! How well lines of sight meet with one change of the keypoints of all cameras, and the change with which they meet best.

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::order_statistics::upper_median;
use nalgebra::{Vector2, Vector3};

use super::super::super::JudgedCamera;
use super::super::super::geometry::{SightLines, meeting};
use super::super::super::pairs::{EXTENT_M, HALF_COST_M, SAME_PERSON_COST};
use super::super::super::samples::SeenBody;
use super::change::{Change, Transform, candidates};
use crate::body::segment::nose_ahead;

/// The coarse search compares every third keypoint.
const COARSE_KEYPOINT_STEP: usize = 3;
/// Distances that cost one half in the coarse search and in the refinements, metres.
const COARSE_HALF_COST_M: f64 = 0.4;
const FINE_HALF_COSTS_M: [f64; 3] = [0.3, 0.12, HALF_COST_M];
/// The best candidates of each transform are refined: how many of each, with which first step, in how many rounds per
/// distance, and the factor of the step after each round.
const REFINED_PER_TRANSFORM: usize = 2;
const FIRST_STEP: f64 = 0.06;
const ROUNDS: usize = 5;
const STEP_FACTOR: f64 = 0.8;

/// Least noses ahead of the shoulders in a reflected picture, and how many times as many as are behind.
const MIN_NOSES: usize = 3;
const MIN_NOSES_RATIO: usize = 2;

/// The sightings of a camera in a pass.
pub(super) type Bodies<'a> = Vec<&'a SeenBody>;

/// The lines of sight of a sighting by keypoint, zero if it is not seen, and its extent at a depth of one metre, metres.
type BodyRays = (Vec<Vector3<f64>>, f64);

/// The sightings that are compared.
pub(super) struct Compared<'a> {
    pub(super) cameras: &'a [JudgedCamera],
    pub(super) models: &'a [&'a CameraModel],
    pub(super) keypoints: &'a KeypointSet,
    pub(super) pairs: Vec<(usize, usize)>,
    /// Per pass and camera.
    pub(super) passes: Vec<Vec<Bodies<'a>>>,
}

/// How finely sightings are compared.
#[derive(Clone, Copy)]
pub(super) struct Precision {
    /// Distance that costs one half, metres.
    half_m: f64,
    keypoint_step: usize,
    /// Whether the change is applied to distorted pixels.
    through_lenses: bool,
}

impl Precision {
    const COARSE: Self = Self {
        half_m: COARSE_HALF_COST_M,
        keypoint_step: COARSE_KEYPOINT_STEP,
        through_lenses: false,
    };

    pub(super) fn fine(half_m: f64) -> Self {
        Self {
            half_m,
            keypoint_step: 1,
            through_lenses: true,
        }
    }
}

impl Compared<'_> {
    /// The change with which lines of sight meet best, and their cost.
    pub(super) fn best(&self) -> Option<(Change, f64)> {
        let candidates = candidates(&self.cameras[self.pairs.first()?.0].lines);
        let weighed = candidates.into_iter().filter_map(|change| {
            let cost = self.mean_cost(&change, Precision::COARSE)?;
            Some((cost, change))
        });
        let mut weighed: Vec<(f64, Change)> = weighed.collect();
        weighed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let best_of = |transform: Transform| {
            let own = weighed.iter();
            let own = own.filter(move |(_, it)| it.transform == transform);
            own.take(REFINED_PER_TRANSFORM).map(|(_, change)| *change)
        };
        let refined = Transform::ALL.into_iter().flat_map(best_of);
        let refined = refined.filter_map(|change| self.refined(change));
        let are_people = |(change, _): &(Change, f64)| {
            self.are_upright(change) && (!change.is_reflection() || self.have_noses_ahead(change))
        };
        refined
            .filter(are_people)
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Whether most people with visible shoulders and ankles are upright.
    fn are_upright(&self, change: &Change) -> bool {
        let (mut upright, mut all) = (0, 0);
        for pass in &self.passes {
            let rays = self.rays(pass, (change, Precision::COARSE));
            for (rays, _) in rays.iter().flatten() {
                let middle = |names: [&str; 2]| {
                    let known = names.into_iter().filter_map(|name| {
                        let ray = rays.get(self.keypoints.index_of(name)?)?;
                        Some(ray.try_normalize(0.0)?.z)
                    });
                    let known: Vec<f64> = known.collect();
                    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
                };
                let shoulders = middle(["left_shoulder", "right_shoulder"]);
                let ankles = middle(["left_ankle", "right_ankle"]);
                if let (Some(shoulders), Some(ankles)) = (shoulders, ankles) {
                    all += 1;
                    upright += usize::from(shoulders > ankles);
                }
            }
        }
        2 * upright >= all
    }

    /// Whether the noses of most people are ahead of their shoulders. Two cameras with exchanged sources show a mirrored world,
    /// too, if all stand symmetrically; there the noses are behind.
    fn have_noses_ahead(&self, change: &Change) -> bool {
        let (mut ahead, mut behind) = (0, 0);
        for (centers_m, bodies) in self.met(change) {
            let place_m = |name: &str| {
                let keypoint = self.keypoints.index_of(name)?;
                let [p, q] = bodies.each_ref().map(|(rays, _)| rays[keypoint]);
                let [near_m, far_m] = meeting((centers_m[0], &p), (centers_m[1], &q))?.depths_m;
                Some(0.5 * (centers_m[0] + p * near_m + centers_m[1] + q * far_m))
            };
            let both = |left: &str, right: &str| Some([place_m(left)?, place_m(right)?]);
            let part = || {
                let shoulders_m = both("left_shoulder", "right_shoulder")?;
                let hips_m = both("left_hip", "right_hip")?;
                nose_ahead(place_m("nose")?, shoulders_m, hips_m)
            };
            match part() {
                Some(part) if part > 0.0 => ahead += 1,
                Some(_) => behind += 1,
                None => {}
            }
        }
        ahead >= MIN_NOSES.max(MIN_NOSES_RATIO * behind)
    }

    /// People in two cameras: each sighting of one with the best fitting one of the other, and the camera centers, world,
    /// metres.
    fn met(&self, change: &Change) -> Vec<([&Vector3<f64>; 2], [BodyRays; 2])> {
        let precision = Precision::fine(HALF_COST_M);
        let mut all = Vec::new();
        for pass in &self.passes {
            let rays = self.rays(pass, (change, precision));
            for &(a, b) in &self.pairs {
                let centers_m = [a, b].map(|camera| &self.cameras[camera].lines.center_m);
                for one in &rays[a] {
                    let others = rays[b].iter().filter_map(|other| {
                        Some((cost_of(centers_m, [one, other], precision)?, other))
                    });
                    let best = others.min_by(|p, q| p.0.total_cmp(&q.0));
                    let best = best.filter(|(cost, _)| *cost < SAME_PERSON_COST);
                    all.extend(best.map(|(_, other)| (centers_m, [one.clone(), other.clone()])));
                }
            }
        }
        all
    }

    /// Refines a change along the axes of its transform. Also returns its cost.
    fn refined(&self, mut change: Change) -> Option<(Change, f64)> {
        let mut cost = f64::INFINITY;
        let mut step = FIRST_STEP;
        for half_m in FINE_HALF_COSTS_M {
            cost = self.mean_cost(&change, Precision::fine(half_m))?;
            for _ in 0..ROUNDS {
                for axis in change.transform.axes() {
                    for by in [step, -step] {
                        let stepped = change.stepped(axis, by);
                        let stepped_cost = self.mean_cost(&stepped, Precision::fine(half_m))?;
                        if stepped_cost < cost {
                            (change, cost) = (stepped, stepped_cost);
                        }
                    }
                }
                step *= STEP_FACTOR;
            }
        }
        Some((change, cost))
    }

    /// Mean cost of lines of sight with this change, 0 to 1, of each sighting with the one that fits it best. `None` if
    /// no sightings can be compared.
    pub(super) fn mean_cost(&self, change: &Change, precision: Precision) -> Option<f64> {
        let (mut sum, mut n) = (0.0, 0);
        for pass in &self.passes {
            let rays = self.rays(pass, (change, precision));
            for &(a, b) in &self.pairs {
                let (few, many) = if rays[a].len() <= rays[b].len() {
                    (a, b)
                } else {
                    (b, a)
                };
                let centers_m = [few, many].map(|camera| &self.cameras[camera].lines.center_m);
                for one in &rays[few] {
                    let costs = rays[many]
                        .iter()
                        .filter_map(|other| cost_of(centers_m, [one, other], precision));
                    if let Some(least) = costs.min_by(f64::total_cmp) {
                        sum += least;
                        n += 1;
                    }
                }
            }
        }
        (n > 0).then(|| sum / f64::from(n))
    }

    fn rays(
        &self,
        pass: &[Bodies<'_>],
        (change, precision): (&Change, Precision),
    ) -> Vec<Vec<BodyRays>> {
        let of_camera = |(camera, bodies): (usize, &Bodies<'_>)| {
            let by = (&self.cameras[camera].lines, self.models[camera]);
            let rays = bodies.iter();
            rays.map(|body| body_rays(body, by, (change, precision)))
                .collect()
        };
        pass.iter().enumerate().map(of_camera).collect()
    }

    /// Extents of people, by each pair of cameras that shows them, metres.
    pub(super) fn extents_m(&self, change: &Change) -> Vec<f64> {
        let met = self.met(change);
        let extents = met
            .iter()
            .filter_map(|(centers_m, [one, other])| extent_m(*centers_m, [one, other]));
        extents.collect()
    }
}

/// The true place of a keypoint that is shown at an undistorted pixel. The change applies to the distorted picture.
/// `None` if the lens shows nothing there.
pub(super) fn corrected(
    pixel: [f64; 2],
    model: &CameraModel,
    size_px: &Vector2<f64>,
    change: &Change,
) -> Option<[f32; 2]> {
    let shown = model.distort(Pixel::new(pixel[0], pixel[1]))?;
    let [x, y] = change.apply([shown.x(), shown.y()], size_px).map(f64::from);
    let corrected = model.undistort(Pixel::new(x, y))?;
    Some([corrected.x() as f32, corrected.y() as f32])
}

fn body_rays(
    body: &SeenBody,
    (lines, model): (&SightLines, &CameraModel),
    (change, precision): (&Change, Precision),
) -> BodyRays {
    let size_px = lines.size_px();
    let place = |pixel: [f64; 2]| {
        if precision.through_lenses {
            corrected(pixel, model, &size_px, change)
        } else {
            Some(change.apply(pixel, &size_px))
        }
    };
    let places = body.iter().map(|seen| {
        let place = place(seen.as_ref()?.pixel.map(f64::from))?;
        Some(lines.normalised(place))
    });
    let places: Vec<Option<Vector2<f64>>> = places.collect();
    let known = || places.iter().flatten();
    let apart = |p: &Vector2<f64>| known().map(|q| (p - q).norm()).fold(0.0, f64::max);
    let extent = known().map(apart).fold(0.0, f64::max);
    let world =
        |place: &Option<Vector2<f64>>| place.map_or_else(Vector3::zeros, |at| lines.world(at));
    (places.iter().map(world).collect(), extent)
}

/// Extent of a person by two cameras, metres: the mean of both.
fn extent_m(centers_m: [&Vector3<f64>; 2], [a, b]: [&BodyRays; 2]) -> Option<f64> {
    let met = a.0.iter().zip(&b.0);
    let met = met.filter_map(|(p, q)| meeting((centers_m[0], p), (centers_m[1], q)));
    let extents = met.map(|met| 0.5 * (met.depths_m[0] * a.1 + met.depths_m[1] * b.1));
    upper_median(extents.collect()).filter(|extent_m| *extent_m > 0.0)
}

/// Mean cost of two sightings if they are of one person; `None` if they have too few keypoints in common.
fn cost_of(
    centers_m: [&Vector3<f64>; 2],
    [a, b]: [&BodyRays; 2],
    precision: Precision,
) -> Option<f64> {
    let half_m = precision.half_m;
    let both = a.0.iter().zip(&b.0).step_by(precision.keypoint_step);
    let (mut sum, mut n) = (0.0, 0);
    for (p, q) in both {
        let Some(met) = meeting((centers_m[0], p), (centers_m[1], q)) else {
            continue;
        };
        let extent_m = 0.5 * (met.depths_m[0] * a.1 + met.depths_m[1] * b.1);
        let gap_m = met.gap_m * EXTENT_M / extent_m.max(f64::MIN_POSITIVE);
        sum += if gap_m.is_finite() {
            gap_m * gap_m / (gap_m * gap_m + half_m * half_m)
        } else {
            1.0
        };
        n += 1;
    }
    (n >= 3).then(|| sum / f64::from(n))
}
