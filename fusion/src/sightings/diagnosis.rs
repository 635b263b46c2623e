//! Why sightings gave no people: statistics of the bodies on which lines of sight met, anywhere.
//!
//! The finder accepts people inside the field with human proportions. This module reconstructs
//! every group of sightings whose rays meet, and counts the reasons against each.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::Sighting;
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::agreement::Gates;
use super::association::associate;
use super::plausibility::{STATURES_M, is_plausible};
use super::rays::witnesses;
use super::reconstruction::Reconstruction;
use crate::body::observed::ObservedJoints;
use crate::body::segment::{nose_ahead, stature_m};
use crate::body::skeleton::Joint;

/// How far below the floor the lowest point of a body may be, metres: an ankle is never that low.
const UNDER_FLOOR_M: f64 = 0.3;
/// Least distance of the nose ahead of the shoulders or behind them, as a share of their distance,
/// to count: networks err.
const CLEARLY: f64 = 0.1;
/// Search range, metres from the origin.
const ANYWHERE_M: f64 = 1.0e4;

/// Counts of the bodies on which the rays of several viewpoints met.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SightingDiagnosis {
    /// Bodies on which rays met.
    pub bodies: u64,
    /// Those that are people inside the field.
    pub people: u64,
    /// Those with human proportions outside the field.
    pub outside_field: u64,
    /// Mean of the middles of those outside, world, metres.
    pub outside_at_m: [f64; 3],
    /// Those that are under the floor.
    pub under_floor: u64,
    /// Those whose head is below their hips, inside or outside the field.
    pub upside_down: u64,
    /// Those that are smaller than people.
    pub too_small: u64,
    /// Those that are larger than people.
    pub too_large: u64,
    /// Sum of the statures of those that are too small or too large, metres.
    pub wrong_statures_m: f64,
    /// Those whose limbs do not fit each other.
    pub misshapen: u64,
    /// Upright ones whose nose is ahead of the shoulders, of any size. If it is behind, left and
    /// right are swapped.
    #[serde(default)]
    pub noses_ahead: u64,
    /// See [`Self::noses_ahead`].
    #[serde(default)]
    pub noses_behind: u64,
    /// Detection passes with any of these.
    #[serde(default)]
    pub nose_passes: u64,
}

/// The inputs of a diagnosis.
pub(crate) struct Diagnosed<'a> {
    pub(crate) cameras: &'a [(ViewpointIndex, CameraModel)],
    pub(crate) keypoints: &'a KeypointSet,
    pub(crate) field: &'a Field,
    pub(crate) parameters: &'a BirthParameters,
}

impl Diagnosed<'_> {
    /// The bodies on which rays of `sightings` of one tick meet.
    pub(crate) fn bodies(&self, sightings: &[Sighting]) -> Vec<Reconstruction> {
        let n_keypoints = self.keypoints.len();
        let all = witnesses(
            sightings,
            self.cameras,
            n_keypoints,
            self.parameters.min_score,
        );
        let free: Vec<usize> = (0..all.len()).collect();
        let gates = Gates {
            ray_distance_m: self.parameters.ray_distance_m,
            min_keypoints: self.parameters.min_keypoints as usize,
            field_min_m: Vector3::repeat(-ANYWHERE_M),
            field_max_m: Vector3::repeat(ANYWHERE_M),
        };
        associate(&all, &free, &gates, |_| true)
    }

    /// Counts `bodies` of one tick into `counts`, and passes each to `with`.
    pub(crate) fn count(
        &self,
        bodies: &[Reconstruction],
        counts: &mut SightingDiagnosis,
        mut with: impl FnMut(&ObservedJoints),
    ) {
        let before = counts.noses_ahead + counts.noses_behind;
        for body in bodies {
            self.judge(body, counts, &mut with);
        }
        counts.nose_passes += u64::from(counts.noses_ahead + counts.noses_behind > before);
    }

    fn judge(
        &self,
        group: &Reconstruction,
        counts: &mut SightingDiagnosis,
        with: &mut impl FnMut(&ObservedJoints),
    ) {
        let mut body = ObservedJoints::default();
        for (name, point) in self.keypoints.names().iter().zip(&group.keypoints_m) {
            if let (Some(joint), Some(point)) = (Joint::from_name(name), point) {
                body.set(joint, point.position_m, point.score);
            }
        }
        let points: Vec<Vector3<f64>> = body.iter().map(|(_, point)| point.position_m).collect();
        let (Some(stature), false) = (stature_m([&body]), points.is_empty()) else {
            return;
        };
        counts.bodies += 1;
        with(&body);
        match has_the_nose_ahead(&body) {
            Some(true) => counts.noses_ahead += 1,
            Some(false) => counts.noses_behind += 1,
            None => {}
        }
        if !STATURES_M.contains(&stature) {
            counts.wrong_statures_m += stature;
            if stature < *STATURES_M.start() {
                counts.too_small += 1;
            } else {
                counts.too_large += 1;
            }
            return;
        }
        let is_upside_down = head_is_below_hips(&body);
        counts.upside_down += u64::from(is_upside_down);
        let lowest_m = points.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        let inside =
            (0..3).all(|i| (self.field.min_m[i]..=self.field.max_m[i]).contains(&middle[i]));
        if !is_plausible(&mut body) {
            counts.misshapen += 1;
        } else if lowest_m < self.field.floor_m - UNDER_FLOOR_M {
            // A mirror image in a floor counts as upside down only.
            counts.under_floor += u64::from(!is_upside_down);
        } else if inside {
            counts.people += 1;
        } else {
            counts.outside_field += 1;
            for (sum, value) in counts.outside_at_m.iter_mut().zip(middle.iter()) {
                // Running mean.
                *sum += (value - *sum) / counts.outside_field as f64;
            }
        }
    }
}

/// Whether the nose is ahead of the shoulders; `None` if unclear, or if the trunk is not upright.
fn has_the_nose_ahead(body: &ObservedJoints) -> Option<bool> {
    let at_m = |joint: Joint| body.position_m(joint);
    let shoulders_m = [at_m(Joint::LeftShoulder)?, at_m(Joint::RightShoulder)?];
    let hips_m = [at_m(Joint::LeftHip)?, at_m(Joint::RightHip)?];
    let ahead = nose_ahead(at_m(Joint::Nose)?, shoulders_m, hips_m)?;
    (ahead.abs() >= CLEARLY).then_some(ahead > 0.0)
}

fn head_is_below_hips(body: &ObservedJoints) -> bool {
    let mean_z = |joints: [Joint; 2]| {
        let places = joints.map(|joint| body.position_m(joint));
        Some(0.5 * (places[0]?.z + places[1]?.z))
    };
    let shoulders = mean_z([Joint::LeftShoulder, Joint::RightShoulder]);
    let hips = mean_z([Joint::LeftHip, Joint::RightHip]);
    shoulders
        .zip(hips)
        .is_some_and(|(shoulders, hips)| shoulders < hips)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::sightings::fixture::{TestHall, hall};

    fn diagnosis(hall: &TestHall, field: Field, body: &[Vector3<f64>]) -> SightingDiagnosis {
        let mut noise = Noise(3);
        let sightings = hall.sightings(&[body.to_vec()], 1.0, &mut noise);
        let mut counts = SightingDiagnosis::default();
        let diagnosed = Diagnosed {
            cameras: &hall.cameras,
            keypoints: &KeypointSet::coco17(),
            field: &field,
            parameters: &hall.parameters,
        };
        diagnosed.count(&diagnosed.bodies(&sightings), &mut counts, |_| {});
        counts
    }

    fn field() -> Field {
        Field {
            min_m: [-4.0, -3.0, -0.3],
            max_m: [4.0, 3.0, 2.6],
            floor_m: 0.0,
        }
    }

    #[test]
    fn a_person_in_the_field_is_a_person() {
        let counts = diagnosis(&hall(), field(), &standing(0.5, 0.2, 1.7, &mut Noise(1)));
        assert_eq!((counts.bodies, counts.people), (1, 1), "{counts:?}");
    }

    #[test]
    fn a_person_outside_the_field_is_reported_with_its_place() {
        let field = Field {
            max_m: [-1.0, 3.0, 2.6],
            ..field()
        };
        let counts = diagnosis(&hall(), field, &standing(0.5, 0.2, 1.7, &mut Noise(1)));
        assert_eq!(counts.outside_field, 1, "{counts:?}");
        assert!((counts.outside_at_m[0] - 0.5).abs() < 0.1, "{counts:?}");
    }

    #[test]
    fn wrong_sizes_differ_from_wrong_places() {
        let body = standing(0.0, 0.0, 1.7, &mut Noise(1));
        let small: Vec<_> = body.iter().map(|p| p * 0.4).collect();
        assert_eq!(diagnosis(&hall(), field(), &small).too_small, 1);
        let sunk: Vec<_> = body.iter().map(|p| p - Vector3::z() * 1.2).collect();
        assert_eq!(diagnosis(&hall(), field(), &sunk).under_floor, 1);
        let turned: Vec<_> = body
            .iter()
            .map(|p| Vector3::new(p.x, -p.y, 1.8 - p.z))
            .collect();
        assert_eq!(diagnosis(&hall(), field(), &turned).upside_down, 1);
    }
}
