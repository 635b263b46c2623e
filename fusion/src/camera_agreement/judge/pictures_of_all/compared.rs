//! How well lines of sight meet with the keypoints of all cameras changed alike, and which change makes them meet best.

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::order_statistics::upper_median;
use nalgebra::{Vector2, Vector3};

use super::super::super::JudgedCamera;
use super::super::super::geometry::{SightLines, meeting};
use super::super::super::pairs::{EXTENT_M, HALF_COST_M, SAME_PERSON_COST};
use super::super::super::samples::SeenBody;
use super::change::{Change, Deed, tried};

/// Of the keypoints every so many are, at first.
const EVERY_KEYPOINTS: usize = 3;
/// Where the cost of a distance reaches one half while a change is looked for, metres, from coarse to fine.
const COARSE_M: f64 = 0.4;
const FINER_M: [f64; 3] = [0.3, 0.12, HALF_COST_M];
/// So many of the best of each deed are refined, with this first step, in so many rounds at each distance, each with a shorter one.
const REFINED: usize = 2;
const FIRST_STEP: f64 = 0.06;
const ROUNDS: usize = 5;
const SHORTER: f64 = 0.8;

/// Whom a camera shows in a pass.
pub(super) type Bodies<'a> = Vec<&'a SeenBody>;

/// Their lines of sight by keypoint, zero where it is not seen, and how far they extend one metre away, metres.
type BodyRays = (Vec<Vector3<f64>>, f64);

/// What is compared.
pub(super) struct Compared<'a> {
    pub(super) cameras: &'a [JudgedCamera],
    pub(super) models: &'a [&'a CameraModel],
    pub(super) keypoints: &'a KeypointSet,
    pub(super) pairs: Vec<(usize, usize)>,
    /// Per pass and camera.
    pub(super) passes: Vec<Vec<Bodies<'a>>>,
}

/// How closely sightings are compared.
#[derive(Clone, Copy)]
pub(super) struct Closeness {
    /// Where the cost of a distance reaches one half, metres.
    half_m: f64,
    /// Of the keypoints every so many are compared.
    every: usize,
    /// Whether lenses distort what is changed.
    through_lenses: bool,
}

impl Closeness {
    const COARSE: Self = Self {
        half_m: COARSE_M,
        every: EVERY_KEYPOINTS,
        through_lenses: false,
    };

    pub(super) fn of(half_m: f64) -> Self {
        Self {
            half_m,
            every: 1,
            through_lenses: true,
        }
    }
}

impl Compared<'_> {
    /// The change with which lines of sight meet best, and their cost.
    pub(super) fn best(&self) -> Option<(Change, f64)> {
        let tried = tried(&self.cameras[self.pairs.first()?.0].lines);
        let weighed = tried.into_iter().filter_map(|change| {
            let cost = self.mean_cost(&change, Closeness::COARSE)?;
            Some((cost, change))
        });
        let mut weighed: Vec<(f64, Change)> = weighed.collect();
        weighed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let of_deed = |deed: Deed| {
            let own = weighed.iter().filter(move |(_, it)| it.deed == deed);
            own.take(REFINED).map(|(_, change)| *change)
        };
        let refined = Deed::ALL.into_iter().flat_map(of_deed);
        let refined = refined.filter_map(|change| self.refined(change));
        let upright = refined.filter(|(change, _)| self.are_upright(change));
        upright.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Whether those of whom shoulders and ankles are seen do not stand on their heads, most of them.
    fn are_upright(&self, change: &Change) -> bool {
        let (mut upright, mut all) = (0, 0);
        for pass in &self.passes {
            let rays = self.rays(pass, (change, Closeness::COARSE));
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

    /// Whom two cameras show, and where these are, world, metres: each sighting of the one with the one of the other that fits it.
    fn met(&self, change: &Change) -> Vec<([&Vector3<f64>; 2], [BodyRays; 2])> {
        let closeness = Closeness::of(HALF_COST_M);
        let mut all = Vec::new();
        for pass in &self.passes {
            let rays = self.rays(pass, (change, closeness));
            for &(a, b) in &self.pairs {
                let centers_m = [a, b].map(|camera| &self.cameras[camera].lines.center_m);
                for one in &rays[a] {
                    let others = rays[b].iter().filter_map(|other| {
                        Some((cost_of(centers_m, [one, other], closeness)?, other))
                    });
                    let best = others.min_by(|p, q| p.0.total_cmp(&q.0));
                    let best = best.filter(|(cost, _)| *cost < SAME_PERSON_COST);
                    all.extend(best.map(|(_, other)| (centers_m, [one.clone(), other.clone()])));
                }
            }
        }
        all
    }

    /// With as much of its deed as leaves the least.
    fn refined(&self, mut change: Change) -> Option<(Change, f64)> {
        let mut cost = f64::INFINITY;
        let mut step = FIRST_STEP;
        for half_m in FINER_M {
            cost = self.mean_cost(&change, Closeness::of(half_m))?;
            for _ in 0..ROUNDS {
                for axis in change.deed.axes() {
                    for by in [step, -step] {
                        let tried = change.with(axis, by);
                        let of_tried = self.mean_cost(&tried, Closeness::of(half_m))?;
                        if of_tried < cost {
                            (change, cost) = (tried, of_tried);
                        }
                    }
                }
                step *= SHORTER;
            }
        }
        Some((change, cost))
    }

    /// What lines of sight cost with keypoints changed so, 0 to 1: of each sighting with the one that fits it best. `None` where
    /// nobody can be compared.
    pub(super) fn mean_cost(&self, change: &Change, closeness: Closeness) -> Option<f64> {
        let (mut sum, mut n) = (0.0, 0);
        for pass in &self.passes {
            let rays = self.rays(pass, (change, closeness));
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
                        .filter_map(|other| cost_of(centers_m, [one, other], closeness));
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
        (change, closeness): (&Change, Closeness),
    ) -> Vec<Vec<BodyRays>> {
        let of_camera = |(camera, bodies): (usize, &Bodies<'_>)| {
            let by = (&self.cameras[camera].lines, self.models[camera]);
            let rays = bodies.iter();
            rays.map(|body| body_rays(body, by, (change, closeness)))
                .collect()
        };
        pass.iter().enumerate().map(of_camera).collect()
    }

    /// How far people extend, by every two cameras that show them, metres.
    pub(super) fn extents_m(&self, change: &Change) -> Vec<f64> {
        let met = self.met(change);
        let extents = met
            .iter()
            .filter_map(|(centers_m, [one, other])| extent_m(*centers_m, [one, other]));
        extents.collect()
    }
}

/// Where a keypoint is meant that is shown at an undistorted pixel: what is changed is the picture, lens and all; `None` where the
/// lens has nothing there.
pub(super) fn meant(
    pixel: [f64; 2],
    (model, size_px): (&CameraModel, &Vector2<f64>),
    change: &Change,
) -> Option<[f32; 2]> {
    let shown = model.distort(Pixel::new(pixel[0], pixel[1]))?;
    let [x, y] = change.of([shown.x(), shown.y()], size_px).map(f64::from);
    let meant = model.undistort(Pixel::new(x, y))?;
    Some([meant.x() as f32, meant.y() as f32])
}

fn body_rays(
    body: &SeenBody,
    (lines, model): (&SightLines, &CameraModel),
    (change, closeness): (&Change, Closeness),
) -> BodyRays {
    let size_px = lines.size_px();
    let place = |pixel: [f64; 2]| {
        if closeness.through_lenses {
            meant(pixel, (model, &size_px), change)
        } else {
            Some(change.of(pixel, &size_px))
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

/// How far somebody extends whom two cameras show, metres: the mean of what both say.
fn extent_m(centers_m: [&Vector3<f64>; 2], [a, b]: [&BodyRays; 2]) -> Option<f64> {
    let met = a.0.iter().zip(&b.0);
    let met = met.filter_map(|(p, q)| meeting((centers_m[0], p), (centers_m[1], q)));
    let extents = met.map(|met| 0.5 * (met.depths_m[0] * a.1 + met.depths_m[1] * b.1));
    upper_median(extents.collect()).filter(|extent_m| *extent_m > 0.0)
}

/// What two sightings cost that are of one person; `None` where too few keypoints are in both.
fn cost_of(
    centers_m: [&Vector3<f64>; 2],
    [a, b]: [&BodyRays; 2],
    closeness: Closeness,
) -> Option<f64> {
    let half_m = closeness.half_m;
    let both = a.0.iter().zip(&b.0).step_by(closeness.every);
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
