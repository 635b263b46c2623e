//! People as a camera would show them, sightings, and how far the one is from the other.

use nalgebra::{Vector2, Vector3};

use super::super::super::geometry::SightLines;
use super::super::super::pairs::HALF_COST_M;
use super::super::super::samples::SeenBody;
use super::super::KeypointHalf;

/// Least keypoints of a sighting.
const MIN_KEYPOINTS: usize = 5;
/// Middles of bodies that are farther apart than this are not of one person, metres.
const MIDDLES_M: f64 = 1.5;

/// A person at a kept tick, in a camera.
pub(in crate::camera_agreement::time_shift) struct Projected {
    pub(in crate::camera_agreement::time_shift) person: u32,
    pub(in crate::camera_agreement::time_shift) middle_px: Vector2<f64>,
    /// Per keypoint; with the depth, metres. `None` behind the camera.
    pub(in crate::camera_agreement::time_shift) keypoints: Vec<Option<(Vector2<f64>, f64)>>,
    /// Depth over focal length of the first keypoint, metres per pixel.
    pub(in crate::camera_agreement::time_shift) pixel_m: f64,
}

impl Projected {
    pub(super) fn of(person: u32, body: &[[f32; 3]], lines: &SightLines) -> Option<Self> {
        let of = |m: &[f32; 3]| lines.project(&Vector3::from(m.map(f64::from)));
        let keypoints: Vec<Option<(Vector2<f64>, f64)>> = body.iter().map(of).collect();
        let seen = || keypoints.iter().flatten();
        let n = seen().count();
        let middle_px = seen().map(|(px, _)| px).sum::<Vector2<f64>>() / n.max(1) as f64;
        let (_, depth_m) = seen().next()?;
        let pixel_m = depth_m / lines.mean_focal_px();
        (n >= MIN_KEYPOINTS).then_some(Self {
            person,
            middle_px,
            keypoints,
            pixel_m,
        })
    }
}

/// A sighting, without what it does not show.
pub(in crate::camera_agreement::time_shift) struct Sighted {
    middle_px: Vector2<f64>,
    keypoints: Vec<(usize, Vector2<f64>)>,
}

impl Sighted {
    pub(in crate::camera_agreement::time_shift) fn of(
        body: &SeenBody,
        half: KeypointHalf,
    ) -> Option<Self> {
        let all = body.iter().enumerate().filter_map(|(k, seen)| {
            let pixel = seen.as_ref()?.pixel.map(f64::from);
            Some((k, Vector2::from(pixel)))
        });
        let all: Vec<(usize, Vector2<f64>)> = all.collect();
        if all.len() < MIN_KEYPOINTS {
            return None;
        }
        let middle_px = all.iter().map(|(_, px)| px).sum::<Vector2<f64>>() / all.len() as f64;
        let keypoints: Vec<_> = all.into_iter().filter(|(k, _)| half.has(*k)).collect();
        (keypoints.len() * 3 >= MIN_KEYPOINTS).then_some(Self {
            middle_px,
            keypoints,
        })
    }

    pub(super) fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// That of the person whom it fits best; 1 where nobody is near.
    pub(in crate::camera_agreement::time_shift) fn cost(
        &self,
        people: &[Projected],
        focal_px: f64,
    ) -> f64 {
        self.cost_near(people, focal_px).unwrap_or(1.0)
    }

    /// The same; `None` where nobody is near.
    pub(super) fn cost_near(&self, people: &[Projected], focal_px: f64) -> Option<f64> {
        let mut least = None;
        for person in people {
            let apart_m = (person.middle_px - self.middle_px).norm() * person.pixel_m;
            if apart_m <= MIDDLES_M {
                let most = least.unwrap_or(f64::INFINITY);
                least = Some(self.sum_up_to(most, person, focal_px));
            }
        }
        Some(least? / self.len() as f64)
    }

    /// The summed cost beside a person, where it is less than `most`, else that: most people are elsewhere.
    ///
    /// As [`crate::camera_agreement::pairs::cost`], without a root.
    fn sum_up_to(&self, most: f64, person: &Projected, focal_px: f64) -> f64 {
        let half2 = HALF_COST_M * HALF_COST_M * focal_px * focal_px;
        let mut sum = 0.0;
        for (k, seen) in &self.keypoints {
            sum += match person.keypoints.get(*k) {
                Some(Some((px, depth_m))) => {
                    let off2 = (px - seen).norm_squared() * depth_m * depth_m;
                    off2 / (off2 + half2)
                }
                _ => 1.0,
            };
            if sum >= most {
                return most;
            }
        }
        sum
    }
}
