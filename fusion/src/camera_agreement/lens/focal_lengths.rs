//! Whether lines of sight meet better if the focal lengths of all cameras change by one factor: another mode of the
//! sensor, or pictures that were cropped or scaled.
//!
//! ```text
//!   y' = y / f             y: normalised, by the calibration; f: true focal length as a factor of the calibrated one
//!   r = f z |p - y'|       p: the place where lines of sight meet, in the picture; z: its depth with f = 1, metres
//! ```
//!
//! A factor scales everything around the place at which all cameras point, or its depth if they stand side by side.
//! Lines of sight meet there as well as before. So the cost uses distances in the pictures, in metres at the depth of
//! people without the factor. These neither shrink nor grow with a scale that cannot be observed.

use nalgebra::{Vector2, Vector3};

use super::{LensPoints, MIN_POINTS, Point, Ray, cost, gaps_m, is_seen_widely, minimum};

/// Logarithms of the factors from which the search starts.
const LOG_CANDIDATES: [f64; 8] = [-0.7, -0.45, -0.22, -0.1, 0.1, 0.22, 0.45, 0.7];
/// Smallest change that is reported, as a share, and the largest share of the cost that it may leave. On the Shelf, the
/// sample and simulated scenes the best factor left 0.999 or more with valid cameras, and 0.92 or less if all focal
/// lengths were 0.05 off.
const MIN_CHANGE: f64 = 0.04;
const MAX_COST_RATIO: f64 = 0.95;
/// Largest share that it may leave to be reported instead of single cameras: on the Shelf 0.74 was left in such a case.
const MAX_SURE_COST_RATIO: f64 = 0.8;
/// How many times as much as a change of any single camera it must explain.
const MIN_MARGIN: f64 = 1.5;

/// Other focal lengths of all cameras whose lenses can be judged.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::camera_agreement) struct FocalLengths {
    pub(in crate::camera_agreement) cameras: Vec<usize>,
    /// True lengths as a factor of the calibrated ones.
    pub(in crate::camera_agreement) factor: f64,
    /// Share of the cost that it leaves.
    pub(in crate::camera_agreement) ratio: f64,
}

impl FocalLengths {
    /// Whether it explains why single cameras seem wrong.
    pub(in crate::camera_agreement) fn is_sure(&self) -> bool {
        self.ratio < MAX_SURE_COST_RATIO
    }
}

/// The focal lengths with which lines of sight meet best, if they surely differ from the calibrated ones.
pub(in crate::camera_agreement) fn focal_lengths(points: &LensPoints) -> Option<FocalLengths> {
    let known = points.known();
    let seen: Vec<Seen> = points.seen_by_known().collect();
    if seen.len() < MIN_POINTS {
        return None;
    }
    let fit = |cameras: &[usize]| {
        let cost = |change: f64| {
            let factor = libm::exp(change);
            points.mean_cost_of(&seen, |camera| {
                if cameras.contains(&camera) {
                    factor
                } else {
                    1.0
                }
            })
        };
        let before = cost(0.0).max(f64::MIN_POSITIVE);
        let (change, least) = minimum(&LOG_CANDIDATES, cost, before);
        (libm::exp(change), least / before)
    };
    let (factor, ratio) = fit(known);
    if (factor - 1.0).abs() < MIN_CHANGE || ratio >= MAX_COST_RATIO {
        return None;
    }
    let is_clear = known
        .iter()
        .all(|&camera| 1.0 - ratio > MIN_MARGIN * (1.0 - fit(&[camera]).1));
    is_clear.then(|| FocalLengths {
        cameras: known.to_vec(),
        factor: (1000.0 * factor).round() / 1000.0,
        ratio,
    })
}

/// A keypoint, with its calibrated depth for each camera, metres.
type Seen = (Point, Vec<f64>);

impl LensPoints {
    /// The points that three viewpoints of `known` cameras show, by these cameras.
    fn seen_by_known(&self) -> impl Iterator<Item = Seen> {
        self.points.iter().filter_map(|point| {
            let own = point
                .iter()
                .filter(|(camera, _)| self.known.contains(camera));
            let own: Point = own.copied().collect();
            if !is_seen_widely(&own, &self.viewpoints) {
                return None;
            }
            let mut depths_m = vec![0.0; own.len()];
            let gaps_m = gaps_m(&self.rays(&own, |_| 1.0), |ray, place_m, gap_m| {
                depths_m[ray] = self.lines[own[ray].0].in_camera(place_m).z;
                gap_m
            });
            let is_met = gaps_m.iter().all(|gap_m| gap_m.is_finite());
            let is_before_all = depths_m.iter().all(|&depth_m| depth_m > 0.0);
            (is_met && is_before_all).then_some((own, depths_m))
        })
    }

    fn rays(&self, point: &Point, factor_of: impl Fn(usize) -> f64) -> Vec<Ray> {
        let ray = |&(camera, y): &(usize, Vector2<f64>)| {
            let lines = &self.lines[camera];
            let world = lines.world(y / factor_of(camera));
            (lines.center_m, world.normalize())
        };
        point.iter().map(ray).collect()
    }

    /// Mean cost of the lines of sight, 0 to 1, with the focal lengths of cameras changed by these factors.
    fn mean_cost_of(&self, seen: &[Seen], factor_of: impl Fn(usize) -> f64) -> f64 {
        let (mut sum, mut n) = (0.0, 0);
        for (point, depths_m) in seen {
            let off_m = |ray: usize, place_m: &Vector3<f64>, _gap_m: f64| {
                let (camera, y) = point[ray];
                let (factor, at_m) = (factor_of(camera), self.lines[camera].in_camera(place_m));
                if at_m.z <= 0.0 {
                    return f64::INFINITY;
                }
                (at_m.xy() / at_m.z * factor - y).norm() * depths_m[ray]
            };
            for gap_m in gaps_m(&self.rays(point, &factor_of), off_m) {
                sum += cost(gap_m);
                n += 1;
            }
        }
        sum / f64::from(n.max(1))
    }
}
