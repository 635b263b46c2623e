//! Whether lines of sight would meet better if all cameras had other focal lengths, all by the same factor: another mode of
//! the sensor, or a picture that was cut or scaled.
//!
//! ```text
//!   y' = y / f             y: normalised, by the calibration; f: true focal length as a factor of the calibrated one
//!   r = f z |p - y'|       p: where the place at which lines meet is in the picture; z: how deep it is with f = 1, metres
//! ```
//!
//! A factor makes everything larger about the place at which all cameras look, and deeper where they look side by side; lines
//! of sight meet as before there. So what counts is how far beside its place pictures show a keypoint, in metres where people
//! are without the factor: it neither shrinks nor grows with what nobody can see.

use nalgebra::{Vector2, Vector3};

use super::{LensPoints, MIN_POINTS, Point, Ray, cost, gaps_m, is_seen_widely, least};

/// The factors that are tried first, natural logarithms.
const TRIED: [f64; 8] = [-0.7, -0.45, -0.22, -0.1, 0.1, 0.22, 0.45, 0.7];
/// Least change that is told of, as a share, and what it leaves of the cost. On the Shelf, the sample and simulated scenes the
/// best factor of cameras that are right leaves 0.999 or more, and 0.92 or less where all focal lengths are 0.05 off.
const LEAST_CHANGE: f64 = 0.04;
const TOLD: f64 = 0.95;
/// What it leaves where it is told instead of cameras that agree with nobody: on the Shelf 0.74 was left of such.
const SURE: f64 = 0.8;
/// How many times as much as that of any camera alone it must explain.
const STANDS_OUT: f64 = 1.5;

/// Other focal lengths of all cameras that tell.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::camera_agreement) struct FocalLengths {
    /// The cameras.
    pub(in crate::camera_agreement) cameras: Vec<usize>,
    /// True lengths as a factor of the calibrated ones.
    pub(in crate::camera_agreement) factor: f64,
    /// What it leaves of the cost.
    pub(in crate::camera_agreement) ratio: f64,
}

impl FocalLengths {
    /// Whether it explains why cameras agree with nobody.
    pub(in crate::camera_agreement) fn is_sure(&self) -> bool {
        self.ratio < SURE
    }
}

/// The focal lengths with which lines of sight meet best, where they are surely others.
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
        let (change, least) = least(&TRIED, cost, before);
        (libm::exp(change), least / before)
    };
    let (factor, ratio) = fit(known);
    if (factor - 1.0).abs() < LEAST_CHANGE || ratio >= TOLD {
        return None;
    }
    let stands_out = known
        .iter()
        .all(|&camera| 1.0 - ratio > STANDS_OUT * (1.0 - fit(&[camera]).1));
    stands_out.then(|| FocalLengths {
        cameras: known.to_vec(),
        factor: (1000.0 * factor).round() / 1000.0,
        ratio,
    })
}

/// A keypoint, with how deep it is for each camera by the calibration, metres.
type Seen = (Point, Vec<f64>);

impl LensPoints {
    /// Those that three viewpoints of known cameras show, as these do.
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

    /// What the lines of sight cost, 0 to 1, with the focal lengths of cameras changed by these factors.
    fn mean_cost_of(&self, seen: &[Seen], factor_of: impl Fn(usize) -> f64) -> f64 {
        let (mut sum, mut n) = (0.0, 0);
        for (point, depths_m) in seen {
            let beside_m = |ray: usize, place_m: &Vector3<f64>, _gap_m: f64| {
                let (camera, y) = point[ray];
                let (factor, at_m) = (factor_of(camera), self.lines[camera].in_camera(place_m));
                if at_m.z <= 0.0 {
                    return f64::INFINITY;
                }
                (at_m.xy() / at_m.z * factor - y).norm() * depths_m[ray]
            };
            for beside_m in gaps_m(&self.rays(point, &factor_of), beside_m) {
                sum += cost(beside_m);
                n += 1;
            }
        }
        sum / f64::from(n.max(1))
    }
}
