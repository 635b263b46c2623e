//! How well the sightings of two cameras agree, also after a change of their pictures.
//!
//! The lines of sight of one keypoint in two sightings pass each other at some distance. It is
//! small if both show the same person. The identities are unknown, so each sighting is compared
//! with the one that fits it best.
//!
//! A sighting that fits none counts only if one camera sees nearly all places where the person of
//! the other may be, by its size. Cameras that see different parts of a field are not comparable.
//!
//! Distances enter a saturating cost (Geman and `McClure`), so that outliers have bounded weight.

use std::ops::Range;

use farfield_proto::order_statistics::upper_median;
use nalgebra::{Vector2, Vector3};

use super::geometry::{Meeting, SightLines, meeting};
use super::samples::{MAX_BODIES, MAX_COMPARED, PassSample, SeenBody};

/// Distance with a cost of one half, metres.
pub(super) const HALF_COST_M: f64 = 0.06;
/// A camera must see this share of the places where a person may be to contradict a sighting.
const MIN_SHARE_IN_VIEW: f64 = 0.8;
/// From the highest to the lowest keypoint of a standing person, metres.
pub(super) const EXTENT_M: f64 = 1.5;
/// Possible depths of a person, over the depth at which the keypoints span `EXTENT_M`.
const DEPTH_FACTORS: Range<f64> = 0.5..1.4;
/// Two sightings with a lower mean cost always count as one person.
pub(super) const SAME_PERSON_COST: f64 = 0.5;
/// Least number of common keypoints of two sightings.
const MIN_COMMON: usize = 5;

/// The cost of the distance between two lines of sight, 0 to 1.
pub(super) fn cost(gap_m: f64) -> f64 {
    if gap_m.is_finite() {
        let squared = gap_m * gap_m;
        squared / (squared + HALF_COST_M * HALF_COST_M)
    } else {
        1.0
    }
}

/// A change of the pictures of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PictureChange {
    AsItIs,
    /// Left and right are exchanged, also in the keypoints.
    Mirrored,
    HalfTurned,
}

/// The lines of sight of the sightings of one camera, by pass, sighting and keypoint. Zero if a
/// keypoint is not seen.
pub(super) struct CameraRays {
    lines: SightLines,
    pub(super) of_pass: Vec<Vec<Vec<Vector3<f64>>>>,
}

/// For every keypoint its mirror image, or itself if it has none.
pub(super) type Partners = Vec<usize>;

impl CameraRays {
    /// The sightings of `camera` after `change` of its pictures of `size_px`, seen through `lines`.
    pub(super) fn new(
        passes: &[&PassSample],
        (camera, size_px): (usize, [u32; 2]),
        lines: &SightLines,
        (change, partners): (PictureChange, &Partners),
    ) -> Self {
        let [width, height] = size_px.map(|side| side as f32);
        let direction = |body: &SeenBody, keypoint: usize| {
            let from = match change {
                PictureChange::Mirrored => partners[keypoint],
                PictureChange::AsItIs | PictureChange::HalfTurned => keypoint,
            };
            let Some(seen) = &body[from] else {
                return Vector3::zeros();
            };
            let [x, y] = seen.pixel;
            lines.direction(match change {
                PictureChange::AsItIs => [x, y],
                PictureChange::Mirrored => [width - 1.0 - x, y],
                PictureChange::HalfTurned => [width - 1.0 - x, height - 1.0 - y],
            })
        };
        let rays = |body: &SeenBody| (0..body.len()).map(|k| direction(body, k)).collect();
        let of_pass = |pass: &&PassSample| pass.of_camera[camera].iter().map(rays).collect();
        Self {
            lines: lines.clone(),
            of_pass: passes.iter().map(of_pass).collect(),
        }
    }

    /// The same with the keypoints in another order. `order` has the source of each keypoint.
    pub(super) fn reordered(&self, order: &[usize]) -> Self {
        let at = |body: &Vec<Vector3<f64>>, place: usize| {
            body.get(place).copied().unwrap_or_else(Vector3::zeros)
        };
        let body = |body: &Vec<Vector3<f64>>| order.iter().map(|&place| at(body, place)).collect();
        Self {
            lines: self.lines.clone(),
            of_pass: self
                .of_pass
                .iter()
                .map(|bodies| bodies.iter().map(body).collect())
                .collect(),
        }
    }

    /// The same with the normalised coordinates mapped by `lens`; a keypoint without an image is
    /// unseen.
    pub(super) fn through(&self, lens: impl Fn(Vector2<f64>) -> Option<Vector2<f64>>) -> Self {
        let ray = |direction: &Vector3<f64>| {
            if direction.norm_squared() == 0.0 {
                return Vector3::zeros();
            }
            let m = self.lines.in_camera(&(self.lines.center_m + direction));
            lens(m.xy() / m.z).map_or_else(Vector3::zeros, |place| self.lines.world(place))
        };
        let body = |body: &Vec<Vector3<f64>>| body.iter().map(ray).collect();
        let of_pass = self.of_pass.iter();
        Self {
            lines: self.lines.clone(),
            of_pass: of_pass
                .map(|bodies| bodies.iter().map(body).collect())
                .collect(),
        }
    }

    /// The position of the camera, world, metres.
    pub(super) fn center_m(&self) -> &Vector3<f64> {
        &self.lines.center_m
    }
}

/// The agreement of two cameras.
#[derive(Debug, Clone, Default)]
pub(super) struct PairAgreement {
    cost_sum: f64,
    /// One per keypoint that both show.
    meetings: Vec<Meeting>,
}

impl PairAgreement {
    /// From all sightings, each with the one that fits it best.
    pub(super) fn of_all(a: &CameraRays, b: &CameraRays) -> Self {
        Self::from_sightings(a, b, |_, _| true)
    }

    /// From the sightings that fit, and those that the other camera should show.
    pub(super) fn of_common(a: &CameraRays, b: &CameraRays) -> Self {
        Self::from_sightings(a, b, |(one, by), (other, other_by)| {
            must_be_seen(one, by, other_by) || must_be_seen(other, other_by, by)
        })
    }

    /// The mean cost of one camera with those of the others that have enough common keypoints.
    pub(super) fn mean_cost_of<'r>(
        own: &CameraRays,
        others: impl Iterator<Item = &'r CameraRays>,
        min_keypoints: usize,
    ) -> Option<f64> {
        let pairs = others.map(|other| Self::of_all(own, other));
        let costs = pairs.filter(|pair| pair.len() >= min_keypoints);
        let costs: Vec<f64> = costs.map(|pair| pair.mean_cost()).collect();
        (!costs.is_empty()).then(|| costs.iter().sum::<f64>() / costs.len() as f64)
    }

    /// `counts` decides on pairs of sightings that do not fit.
    fn from_sightings(
        a: &CameraRays,
        b: &CameraRays,
        counts: impl Fn((&[Vector3<f64>], &SightLines), (&[Vector3<f64>], &SightLines)) -> bool,
    ) -> Self {
        let mut all = Self::default();
        for (of_a, of_b) in a.of_pass.iter().zip(&b.of_pass) {
            // Each sighting of the camera with fewer is matched with one of the other camera.
            let a_has_fewer = of_a.len() <= of_b.len();
            let (few, many) = if a_has_fewer {
                (of_a, of_b)
            } else {
                (of_b, of_a)
            };
            let (few_by, many_by) = if a_has_fewer { (a, b) } else { (b, a) };
            // Sightings beyond the maximum are not kept, so the matching one may be missing.
            let is_whole = many.len() < MAX_BODIES;
            for one in few.iter().take(MAX_COMPARED) {
                let in_order = |other| {
                    if a_has_fewer {
                        [one, other]
                    } else {
                        [other, one]
                    }
                };
                let fits = many.iter().filter_map(|other| {
                    let meetings = || meetings((a, b), in_order(other));
                    let (sum, n) = meetings().fold((0.0, 0), |(sum, n): (f64, usize), met| {
                        (sum + cost(met.gap_m), n + 1)
                    });
                    (n >= MIN_COMMON).then(|| (sum / n as f64, sum, other))
                });
                let best = fits.min_by(|p, q| p.0.total_cmp(&q.0));
                let counted = best.filter(|(mean, _, other)| {
                    *mean < SAME_PERSON_COST
                        || is_whole && counts((one, &few_by.lines), (other, &many_by.lines))
                });
                if let Some((_, sum, other)) = counted {
                    all.cost_sum += sum;
                    all.meetings.extend(meetings((a, b), in_order(other)));
                }
            }
        }
        all
    }

    /// Number of compared keypoints.
    pub(super) fn len(&self) -> usize {
        self.meetings.len()
    }

    /// 0 if all lines of sight meet, 1 if none do.
    pub(super) fn mean_cost(&self) -> f64 {
        self.cost_sum / self.len().max(1) as f64
    }

    /// Median distance between the lines of sight, metres; infinite if most meet behind a camera.
    pub(super) fn median_m(&self) -> Option<f64> {
        upper_median(self.meetings.iter().map(|met| met.gap_m).collect())
    }

    /// Width of a pixel at the meetings, metres, in the camera where it is larger.
    pub(super) fn pixel_m(&self, focal_px: [f64; 2]) -> f64 {
        let width_m = |side: usize| {
            let widths_m = self
                .meetings
                .iter()
                .map(|met| met.depths_m[side].abs() / focal_px[side]);
            upper_median(widths_m.collect()).unwrap_or(0.0)
        };
        width_m(0).max(width_m(1))
    }

    /// [`Self::median_m`] in pixels of the first and the second camera with these focal lengths.
    pub(super) fn median_px(&self, focal_px: [f64; 2]) -> Option<[f64; 2]> {
        let in_camera = |side: usize| {
            let px = |met: &Meeting| met.gap_m / met.depths_m[side] * focal_px[side];
            upper_median(self.meetings.iter().map(px).collect())
        };
        Some([in_camera(0)?, in_camera(1)?])
    }
}

/// The meetings of the lines of sight of one sighting in each camera.
fn meetings<'a>(
    (a, b): (&'a CameraRays, &'a CameraRays),
    [of_a, of_b]: [&'a Vec<Vector3<f64>>; 2],
) -> impl Iterator<Item = Meeting> + 'a {
    let (a_m, b_m) = (&a.lines.center_m, &b.lines.center_m);
    let rays = of_a.iter().zip(of_b);
    rays.filter_map(move |(p, q)| meeting((a_m, p), (b_m, q)))
}

/// Whether a camera sees nearly all places where `body` of another camera may be, by its size.
fn must_be_seen(body: &[Vector3<f64>], by: &SightLines, other: &SightLines) -> bool {
    let seen = || {
        body.iter()
            .filter(|direction| direction.norm_squared() > 0.0)
    };
    let apart = |p: &Vector3<f64>| seen().map(|q| (p - q).norm()).fold(0.0, f64::max);
    let extent = seen().map(apart).fold(0.0, f64::max);
    let depth_m = EXTENT_M / extent.max(f64::MIN_POSITIVE);
    let middle = seen().sum::<Vector3<f64>>() / seen().count().max(1) as f64;
    let depths_m = DEPTH_FACTORS.start * depth_m..DEPTH_FACTORS.end * depth_m;
    other.share_in_view(&by.center_m, &middle, depths_m) >= MIN_SHARE_IN_VIEW
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::CameraModel;
    use farfield_proto::frames::Point;
    use farfield_proto::tick::Tick;

    use super::super::samples::SeenKeypoint;
    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::sightings::fixture::hall;

    /// The sightings of people on a grid, in this order.
    fn shown(model: &CameraModel, order: impl Iterator<Item = usize>) -> Vec<SeenBody> {
        let person = |i: usize| {
            let at = [i % 6, i / 6].map(|cell| 0.9 * cell as f64 - 2.25);
            standing(at[0], at[1], 1.75, &mut Noise(3))
        };
        let seen = |place_m: &Vector3<f64>| {
            let pixel = model.project(Point::new((*place_m).into()))?;
            let pixel = [pixel.x() as f32, pixel.y() as f32];
            Some(SeenKeypoint { pixel, score: 0.8 })
        };
        order
            .map(|i| person(i).iter().map(seen).collect())
            .collect()
    }

    /// The number of compared keypoints of `n` people. The first camera shows the first `kept`, the
    /// second the last `kept`.
    fn counted(n: usize, kept: usize) -> usize {
        let cameras = hall().cameras;
        let pass = PassSample {
            tick: Tick(0),
            of_camera: vec![
                shown(&cameras[0].1, (0..n).take(kept)),
                shown(&cameras[1].1, (0..n).rev().take(kept)),
            ],
            unsure: vec![Vec::new(); 2],
        };
        let partners: Partners = (0..17).collect();
        let rays = |camera: usize, of: usize| {
            let lines = SightLines::from_camera(&cameras[of].1);
            let change = (PictureChange::AsItIs, &partners);
            CameraRays::new(&[&pass], (camera, [1920, 1200]), &lines, change)
        };
        PairAgreement::of_common(&rays(0, 0), &rays(1, 1)).len()
    }

    #[test]
    fn sightings_beyond_the_maximum_are_no_contradiction() {
        // No person is shown by both. With few people that is a contradiction, in a crowd chance.
        assert!(counted(6, 3) >= 3 * MIN_COMMON);
        assert!(counted(2 * MAX_BODIES, MAX_BODIES) < MAX_COMPARED * MIN_COMMON);
        // People who are shown by both still count.
        assert!(counted(MAX_BODIES, MAX_BODIES) >= MAX_COMPARED * MIN_COMMON);
    }
}
