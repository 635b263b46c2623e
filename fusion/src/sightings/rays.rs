//! Sightings as rays: one person as one viewpoint sees it.
//!
//! Pixels of different cameras are not comparable, so everything after this file compares rays in
//! the world. Sightings come from the network: this file removes what does not fit the venue, so
//! that later code can trust every index and number.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Pixel, Undistorted};
use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::Sighting;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Sightings of two cameras of one viewpoint may show the same person if their rays differ by less
/// than this share of the body's angular size. The cameras stand some decimetres apart and a body
/// is about 1.7 m, so the same person differs by up to 0.15; two people side by side by 0.3.
const SAME_PERSON_SHARE: f64 = 0.2;

/// The same for two sightings of one camera: a body with two detector boxes has its keypoints twice
/// in the same place.
const SAME_SIGHTING_SHARE: f64 = 0.04;

/// Least common keypoints of two sightings of one viewpoint for a comparison.
const SAME_PERSON_KEYPOINTS: usize = 4;

/// Sightings, or witnesses, from which a pass is processed in parallel: fewer take less time than
/// waking threads.
pub(super) const PARALLEL_FROM: usize = 128;

/// Far above the rounding error of the cosine between two unit vectors.
pub(crate) const COSINE_ROUNDING: f64 = 1e-9;

/// A keypoint as one camera sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SightedRay {
    /// The pinhole, world metres.
    pub(crate) origin_m: Vector3<f64>,
    /// Unit direction in the world.
    pub(crate) direction: Vector3<f64>,
    /// Where the keypoint was seen.
    pub(crate) pixel: Pixel<Undistorted>,
    /// Height of the map's peak, 0 to 1.
    pub(crate) score: f64,
}

impl SightedRay {
    /// The point of the ray nearest to `point_m`, as a distance along it; negative behind the
    /// camera.
    pub(crate) fn depth_m(&self, point_m: &Vector3<f64>) -> f64 {
        (point_m - self.origin_m).dot(&self.direction)
    }

    /// Distance of `point_m` from the ray, metres; from the pinhole for points behind it.
    pub(crate) fn distance_m(&self, point_m: &Vector3<f64>) -> f64 {
        let depth = self.depth_m(point_m).max(0.0);
        (point_m - self.origin_m - self.direction * depth).norm()
    }
}

/// One person as one viewpoint sees it.
#[derive(Debug, Clone)]
pub(crate) struct SightedBody {
    pub(crate) viewpoint: ViewpointIndex,
    /// Index among the venue's cameras.
    pub(crate) camera: usize,
    /// Per keypoint of the network; `None` if it is not seen well enough.
    pub(crate) rays: Vec<Option<SightedRay>>,
    /// Contains all rays; `None` without rays.
    pub(crate) cone: Option<RayCone>,
}

/// A cone around the rays of a camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RayCone {
    /// The pinhole, world metres.
    pub(crate) origin_m: Vector3<f64>,
    /// Unit direction in the world.
    pub(crate) axis: Vector3<f64>,
    /// Sine and cosine of the angle between the axis and the farthest ray.
    pub(crate) sine_cosine: [f64; 2],
}

impl RayCone {
    fn around(rays: &[Option<SightedRay>]) -> Option<Self> {
        let rays = rays.iter().flatten();
        let origin_m = rays.clone().next()?.origin_m;
        let sum: Vector3<f64> = rays.clone().map(|ray| ray.direction).sum();
        let axis = sum.try_normalize(f64::MIN_POSITIVE)?;
        let cosines = rays.map(|ray| ray.direction.dot(&axis));
        let cosine = cosines.fold(1.0, f64::min);
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        Some(Self {
            origin_m,
            axis,
            sine_cosine: [sine, cosine],
        })
    }
}

impl SightedBody {
    /// `None` if the venue lacks the sighting's camera, or it does not have `n_keypoints`.
    fn new(
        sighting: &Sighting,
        cameras: &[(ViewpointIndex, CameraModel)],
        n_keypoints: usize,
        min_score: f64,
    ) -> Option<Self> {
        let camera = usize::from(sighting.camera.0);
        let (viewpoint, model) = cameras.get(camera)?;
        if sighting.keypoints.len() != n_keypoints {
            return None;
        }
        let rays = sighting.keypoints.iter().map(|peak| {
            let peak = peak.as_ref()?;
            let score = f64::from(peak.score);
            let [x, y] = peak.position_px.map(f64::from);
            // Written so that a NaN score is refused too.
            let usable = score >= min_score && x.is_finite() && y.is_finite();
            usable.then(|| sighted_ray(model, Pixel::new(x, y), score.min(1.0)))
        });
        let rays: Vec<Option<SightedRay>> = rays.collect();
        Some(Self {
            viewpoint: *viewpoint,
            camera,
            cone: RayCone::around(&rays),
            rays,
        })
    }

    /// Weight among several sightings of one person: the sum of the scores of its keypoints.
    fn worth(&self) -> f64 {
        self.rays.iter().flatten().map(|ray| ray.score).sum()
    }

    /// Pairs of rays of the keypoints that both see.
    pub(crate) fn in_common<'a>(
        &'a self,
        other: &'a Self,
    ) -> impl Iterator<Item = (&'a SightedRay, &'a SightedRay)> {
        self.rays
            .iter()
            .zip(&other.rays)
            .filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?)))
    }

    /// Twice the widest angle between the middle ray and the others: the body's angular size.
    fn angular_size_rad(&self) -> f64 {
        let rays = self.rays.iter().flatten();
        let sum: Vector3<f64> = rays.clone().map(|ray| ray.direction).sum();
        let length = sum.norm();
        // The widest angle has the least cosine.
        let cosine = |ray: &SightedRay| {
            let lengths = ray.direction.norm() * length;
            if lengths == 0.0 {
                1.0
            } else {
                ray.direction.dot(&sum) / lengths
            }
        };
        let least = rays.map(cosine).fold(1.0, f64::min);
        2.0 * libm::acos(least.clamp(-1.0, 1.0))
    }
}

fn sighted_ray(model: &CameraModel, pixel: Pixel<Undistorted>, score: f64) -> SightedRay {
    let ray = model.ray(pixel);
    SightedRay {
        origin_m: ray.origin.coordinates_m().coords,
        direction: ray.direction.into_inner(),
        pixel,
        score,
    }
}

/// The witnesses among `sightings`: one per viewpoint and person, the best of its sightings.
///
/// Keeps the order of `sightings`. Viewpoints are independent: many sightings are processed in
/// parallel.
pub(crate) fn witnesses(
    sightings: &[Sighting],
    cameras: &[(ViewpointIndex, CameraModel)],
    n_keypoints: usize,
    min_score: f64,
) -> Vec<SightedBody> {
    let mut of_viewpoint: BTreeMap<ViewpointIndex, Vec<usize>> = BTreeMap::new();
    for (index, sighting) in sightings.iter().enumerate() {
        if let Some((viewpoint, _)) = cameras.get(usize::from(sighting.camera.0)) {
            of_viewpoint.entry(*viewpoint).or_default().push(index);
        }
    }
    let best = |own: Vec<usize>| {
        let body = |&index: &usize| {
            let body = SightedBody::new(&sightings[index], cameras, n_keypoints, min_score);
            body.map(|body| (index, body))
        };
        best_of(own.iter().filter_map(body).collect())
    };
    let viewpoints: Vec<Vec<usize>> = of_viewpoint.into_values().collect();
    let mut all: Vec<(usize, SightedBody)> = if sightings.len() < PARALLEL_FROM {
        viewpoints.into_iter().flat_map(best).collect()
    } else {
        let viewpoints = viewpoints.into_par_iter();
        viewpoints.flat_map_iter(best).collect()
    };
    all.sort_by_key(|(index, _)| *index);
    all.into_iter().map(|(_, body)| body).collect()
}

/// The best sighting of each person of a viewpoint, with its number.
fn best_of(all: Vec<(usize, SightedBody)>) -> Vec<(usize, SightedBody)> {
    let mut same = same_person_pairs(&all);
    same.sort_by(|x, y| x.0.total_cmp(&y.0));
    // The body that each sighting shows. The surest pairs join first. Sightings of one camera that
    // are not copies of each other stay apart, so people behind one another stay two.
    let mut body_of: Vec<usize> = (0..all.len()).collect();
    for (share, a, b) in same {
        let (into, from) = (body_of[a], body_of[b]);
        let cameras_of = |body: usize| -> BTreeSet<usize> {
            let members = all.iter().zip(&body_of).filter(|&(_, &of)| of == body);
            members.map(|((_, witness), _)| witness.camera).collect()
        };
        let copies = all[a].1.camera == all[b].1.camera && share < SAME_SIGHTING_SHARE;
        if copies || cameras_of(into).is_disjoint(&cameras_of(from)) {
            for body in body_of.iter_mut().filter(|body| **body == from) {
                *body = into;
            }
        }
    }
    // Per body, the best sighting; of equal ones the first.
    let mut best: Vec<Option<(f64, usize)>> = vec![None; all.len()];
    for (w, (_, witness)) in all.iter().enumerate() {
        let (best, worth) = (&mut best[body_of[w]], witness.worth());
        if best.is_none_or(|(most, _)| worth.total_cmp(&most).is_gt()) {
            *best = Some((worth, w));
        }
    }
    let all = all.into_iter().enumerate();
    all.filter(|&(w, _)| best[body_of[w]].is_some_and(|(_, best)| best == w))
        .map(|(_, own)| own)
        .collect()
}

/// Pairs of sightings of one viewpoint that may show the same person, with their difference as a
/// share of the body's angular size.
fn same_person_pairs(all: &[(usize, SightedBody)]) -> Vec<(f64, usize, usize)> {
    let sizes_rad: Vec<f64> = all
        .iter()
        .map(|(_, body)| body.angular_size_rad())
        .collect();
    let (mut pairs, mut angles) = (Vec::new(), Vec::new());
    for (a, (_, first)) in all.iter().enumerate() {
        for (b, (_, second)) in all.iter().enumerate().skip(a + 1) {
            let limit = if first.camera == second.camera {
                SAME_SIGHTING_SHARE
            } else {
                SAME_PERSON_SHARE
            };
            let size_rad = sizes_rad[a].max(sizes_rad[b]);
            if are_apart(first, second, limit * size_rad) {
                continue;
            }
            let share = median_angle_rad(first, second, &mut angles).map(|angle| angle / size_rad);
            pairs.extend(share.filter(|&share| share < limit).map(|s| (s, a, b)));
        }
    }
    pairs
}

/// Whether the median angle between the rays of two sightings is certainly at least `limit_rad`;
/// false is not certain.
fn are_apart(a: &SightedBody, b: &SightedBody, limit_rad: f64) -> bool {
    // An angle is larger than the limit if its cosine is less than 1 - limit²/2, which is never
    // above the limit's cosine.
    let apart = 1.0 - 0.5 * limit_rad * limit_rad - COSINE_ROUNDING;
    let common = a.in_common(b).count();
    // The upper median is the one after the first half.
    let mut left = common - common / 2;
    let mut pairs = a.in_common(b);
    while left > 0 {
        let Some((p, q)) = pairs.next() else {
            return false;
        };
        left -= usize::from(p.direction.dot(&q.direction) < apart);
    }
    true
}

/// Median angle between the rays of two sightings of one viewpoint; `None` with too few common
/// keypoints. Overwrites `angles`.
fn median_angle_rad(a: &SightedBody, b: &SightedBody, angles: &mut Vec<f64>) -> Option<f64> {
    angles.clear();
    let common = a.in_common(b);
    angles.extend(common.map(|(p, q)| p.direction.angle(&q.direction)));
    angles.sort_by(f64::total_cmp);
    let is_compared = angles.len() >= SAME_PERSON_KEYPOINTS;
    is_compared.then(|| angles[angles.len() / 2])
}
