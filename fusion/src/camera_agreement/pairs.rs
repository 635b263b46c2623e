//! How well two cameras agree on whom detection passes found, whatever their pictures are taken for.
//!
//! Of two sightings the lines of sight of each keypoint pass each other at some distance. A person that both cameras
//! show passes near itself; who is who is not known, so each sighting is compared with the one that fits it best. Where
//! none does, it counts only when one of the two cameras sees nearly all places where the other's person may be, by the
//! size that it has: cameras that look at different parts of a field say nothing of each other.
//! Distances count by a saturating cost (Geman and `McClure`'s): one wrong keypoint is one wrong keypoint, however far
//! off it is.

use std::ops::Range;

use farfield_proto::order_statistics::upper_median;
use nalgebra::{Vector2, Vector3};

use super::geometry::{Meeting, SightLines, meeting};
use super::samples::{COMPARED, MAX_BODIES, PassSample, SeenBody};

/// Where the cost of a distance reaches one half, metres.
pub(super) const HALF_COST_M: f64 = 0.06;
/// Share of the places where a person may be that a camera must see to speak against it.
const IN_VIEW: f64 = 0.8;
/// From the highest to the lowest keypoint of somebody who stands, metres.
pub(super) const EXTENT_M: f64 = 1.5;
/// Depths at which somebody may be, as factors of the one at which the keypoints are so far apart.
const DEPTHS: Range<f64> = 0.5..1.4;
/// Mean cost below which two sightings are taken to be of one person, whatever else there is.
pub(super) const SAME_PERSON_COST: f64 = 0.5;
/// Least keypoints that two sightings must have in common.
const MIN_COMMON: usize = 5;
/// What a distance between two lines of sight costs, 0 to 1.
pub(super) fn cost(gap_m: f64) -> f64 {
    if gap_m.is_finite() {
        let squared = gap_m * gap_m;
        squared / (squared + HALF_COST_M * HALF_COST_M)
    } else {
        1.0
    }
}

/// What the pictures of a camera may be taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PictureChange {
    AsItIs,
    /// Left and right are exchanged, of the people too.
    Mirrored,
    HalfTurned,
}

/// The lines of sight of the sightings of one camera: per pass and sighting, by keypoint; zero where it is not seen.
pub(super) struct CameraRays {
    lines: SightLines,
    pub(super) of_pass: Vec<Vec<Vec<Vector3<f64>>>>,
}

/// Two keypoints that are each other's mirror image: for every keypoint its partner, itself without one.
pub(super) type Partners = Vec<usize>;

impl CameraRays {
    /// The sightings of `camera`, whose pictures are changed so and seen through `lines`. `size_px` is the picture's.
    pub(super) fn of(
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

    /// The same with the keypoints in another order: per keypoint the one that is in its place.
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

    /// The same where another lens has what is at a place, normalised, at the place `lens` of it; unseen where it has it nowhere.
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

    /// Where the camera is, world, metres.
    pub(super) fn center_m(&self) -> &Vector3<f64> {
        &self.lines.center_m
    }
}

/// How two cameras agree.
#[derive(Debug, Clone, Default)]
pub(super) struct PairAgreement {
    cost_sum: f64,
    /// Of every keypoint that both show.
    meetings: Vec<Meeting>,
}

impl PairAgreement {
    /// Of all sightings, each with the one that fits it best.
    pub(super) fn of(a: &CameraRays, b: &CameraRays) -> Self {
        Self::where_it_counts(a, b, |_, _| true)
    }

    /// Of those sightings that fit, or that the other camera would have to show.
    pub(super) fn of_common(a: &CameraRays, b: &CameraRays) -> Self {
        Self::where_it_counts(a, b, |(one, by), (other, other_by)| {
            must_be_seen((one, by), other_by) || must_be_seen((other, other_by), by)
        })
    }

    /// The mean of what each of these others costs beside one camera, of those that have enough keypoints in common with it.
    pub(super) fn mean_cost_of<'r>(
        own: &CameraRays,
        others: impl Iterator<Item = &'r CameraRays>,
        min_keypoints: usize,
    ) -> Option<f64> {
        let pairs = others.map(|other| Self::of(own, other));
        let costs = pairs.filter(|pair| pair.len() >= min_keypoints);
        let costs: Vec<f64> = costs.map(|pair| pair.mean_cost()).collect();
        (!costs.is_empty()).then(|| costs.iter().sum::<f64>() / costs.len() as f64)
    }

    fn where_it_counts(
        a: &CameraRays,
        b: &CameraRays,
        counts: impl Fn((&[Vector3<f64>], &SightLines), (&[Vector3<f64>], &SightLines)) -> bool,
    ) -> Self {
        let mut all = Self::default();
        for (of_a, of_b) in a.of_pass.iter().zip(&b.of_pass) {
            // Each of those of whom there are fewer has one among the others.
            let a_has_fewer = of_a.len() <= of_b.len();
            let (few, many) = if a_has_fewer {
                (of_a, of_b)
            } else {
                (of_b, of_a)
            };
            let (few_by, many_by) = if a_has_fewer { (a, b) } else { (b, a) };
            // Of more than are kept nobody knows who is missing.
            let is_whole = many.len() < MAX_BODIES;
            for one in few.iter().take(COMPARED) {
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

    /// How many keypoints were compared.
    pub(super) fn len(&self) -> usize {
        self.meetings.len()
    }

    /// 0 where all lines of sight meet, 1 where none do.
    pub(super) fn mean_cost(&self) -> f64 {
        self.cost_sum / self.len().max(1) as f64
    }

    /// Median distance between the lines of sight, metres; infinite where most meet behind a camera.
    pub(super) fn median_m(&self) -> Option<f64> {
        upper_median(self.meetings.iter().map(|met| met.gap_m).collect())
    }

    /// Width of a pixel where the lines of sight meet, metres: of the camera in which it is wider.
    pub(super) fn pixel_m(&self, focal_px: [f64; 2]) -> f64 {
        let of = |side: usize| {
            let widths_m = self
                .meetings
                .iter()
                .map(|met| met.depths_m[side].abs() / focal_px[side]);
            upper_median(widths_m.collect()).unwrap_or(0.0)
        };
        of(0).max(of(1))
    }

    /// [`Self::median_m`] in pixels of the first and the second camera, whose focal lengths are these.
    pub(super) fn median_px(&self, focal_px: [f64; 2]) -> Option<[f64; 2]> {
        let of = |side: usize| {
            let px = |met: &Meeting| met.gap_m / met.depths_m[side] * focal_px[side];
            upper_median(self.meetings.iter().map(px).collect())
        };
        Some([of(0)?, of(1)?])
    }
}

/// Where the lines of sight meet of what two cameras show of somebody.
fn meetings<'a>(
    (a, b): (&'a CameraRays, &'a CameraRays),
    [of_a, of_b]: [&'a Vec<Vector3<f64>>; 2],
) -> impl Iterator<Item = Meeting> + 'a {
    let (a_m, b_m) = (&a.lines.center_m, &b.lines.center_m);
    let rays = of_a.iter().zip(of_b);
    rays.filter_map(move |(p, q)| meeting((a_m, p), (b_m, q)))
}

/// Whether a camera sees nearly all places where `body`, which another shows, may be, by the size that it has.
fn must_be_seen((body, by): (&[Vector3<f64>], &SightLines), other: &SightLines) -> bool {
    let seen = || {
        body.iter()
            .filter(|direction| direction.norm_squared() > 0.0)
    };
    let apart = |p: &Vector3<f64>| seen().map(|q| (p - q).norm()).fold(0.0, f64::max);
    let extent = seen().map(apart).fold(0.0, f64::max);
    let depth_m = EXTENT_M / extent.max(f64::MIN_POSITIVE);
    let middle = seen().sum::<Vector3<f64>>() / seen().count().max(1) as f64;
    let depths_m = DEPTHS.start * depth_m..DEPTHS.end * depth_m;
    other.share_in_view((&by.center_m, &middle), depths_m) >= IN_VIEW
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

    /// What a camera shows of people on a grid, in this order.
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

    /// How many keypoints of `n` people count, of whom the first camera shows the first of `kept`, and the second the last.
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
            let lines = SightLines::of(&cameras[of].1);
            let change = (PictureChange::AsItIs, &partners);
            CameraRays::of(&[&pass], (camera, [1920, 1200]), &lines, change)
        };
        PairAgreement::of_common(&rays(0, 0), &rays(1, 1)).len()
    }

    #[test]
    fn of_more_people_than_are_kept_those_who_are_missing_speak_against_nobody() {
        // Nobody is shown by both: of a few people that is a contradiction, of a crowd it may be chance.
        assert!(counted(6, 3) >= 3 * MIN_COMMON);
        assert!(counted(2 * MAX_BODIES, MAX_BODIES) < COMPARED * MIN_COMMON);
        // Those who are shown by both count all the same.
        assert!(counted(MAX_BODIES, MAX_BODIES) >= COMPARED * MIN_COMMON);
    }
}
