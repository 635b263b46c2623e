//! New persons: bodies that several viewpoints see and that nobody tracks yet.

use std::collections::BTreeSet;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Pixel, Point, Undistorted};
use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::Sighting;
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;
use nalgebra::{Vector2, Vector3};

use super::association::{Gates, associate};
use super::observed::ObservedJoints;
use super::plausibility::is_plausible;
use super::reconstruct::Reconstruction;
pub use super::reconstruct::SightedKeypoint;
use super::witness::{Witness, median, witnesses};
use crate::skeleton::Joint;

/// How far outside the field a body's middle may be, metres: its keypoints are a few centimetres off.
const FIELD_SLACK_M: f64 = 0.1;

/// Least share of a body's keypoints inside a camera's image for the camera to have missed it.
const SEEN_SHARE: f64 = 0.8;

/// Least share of a body's keypoints inside a sighting's outline to be hidden by it, or to be it.
const HIDDEN_SHARE: f64 = 0.5;

/// How much a sighting's outline is grown on each side, as a share of its size: bodies are wider than
/// their joints.
const OUTLINE_GROWTH: f64 = 0.15;

/// Least keypoints that a witness shares with a tracked body to be explained by it.
const EXPLAINED_KEYPOINTS: usize = 3;

/// A person that is tracked already, at the tick of the sightings.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedBody {
    /// Where the keypoints of the network are expected, world metres, in the network's order.
    pub keypoints_m: Vec<Vector3<f64>>,
}

/// A person that at least two viewpoints see.
#[derive(Debug, Clone, PartialEq)]
pub struct SightedPerson {
    /// Per keypoint of the network, where at least two viewpoints agree on it.
    pub keypoints_m: Vec<Option<SightedKeypoint>>,
    /// How many viewpoints see the person.
    pub views: u16,
}

/// Finds persons among the sightings of one tick.
#[derive(Debug, Clone)]
pub struct BirthFinder {
    cameras: Vec<(ViewpointIndex, CameraModel)>,
    keypoints: KeypointSet,
    gates: Gates,
    min_score: f64,
    explained_m: f64,
}

impl BirthFinder {
    /// `cameras` are those of the venue, in the order of their indices.
    pub fn new(
        cameras: Vec<(ViewpointIndex, CameraModel)>,
        keypoints: KeypointSet,
        field: &Field,
        parameters: &BirthParameters,
    ) -> Self {
        let gates = Gates {
            ray_distance_m: parameters.ray_distance_m,
            min_keypoints: parameters.min_keypoints as usize,
            field_min_m: Vector3::from(field.min_m),
            field_max_m: Vector3::from(field.max_m),
        };
        Self {
            cameras,
            keypoints,
            gates,
            min_score: parameters.min_score,
            explained_m: parameters.explained_m,
        }
    }

    /// The persons that `sightings` of one tick show and that `tracked` does not hold, the best
    /// supported first.
    pub fn find(&self, sightings: &[Sighting], tracked: &[TrackedBody]) -> Vec<SightedPerson> {
        let all = witnesses(
            sightings,
            &self.cameras,
            self.keypoints.len(),
            self.min_score,
        );
        let explained = explained(&all, tracked, self.explained_m);
        let free: Vec<usize> = (0..all.len()).filter(|&w| !explained[w]).collect();
        let groups = associate(&all, &free, &self.gates, |group| {
            self.is_person(group, &all)
        });
        let is_new = |group: &Reconstruction| {
            !tracked
                .iter()
                .any(|body| body_distance_m(group, body).is_some_and(|d| d < self.explained_m))
        };
        groups
            .into_iter()
            .filter(is_new)
            .map(SightedPerson::from)
            .collect()
    }

    /// Whether somebody is seen well by a viewpoint, but is none of `bodies`.
    pub fn leaves_unexplained(&self, sightings: &[Sighting], bodies: &[TrackedBody]) -> bool {
        let all = witnesses(
            sightings,
            &self.cameras,
            self.keypoints.len(),
            self.min_score,
        );
        let explained = explained(&all, bodies, self.explained_m);
        let seen_well = |w: &Witness| w.rays.iter().flatten().count() >= self.gates.min_keypoints;
        all.iter()
            .zip(explained)
            .any(|(witness, explained)| !explained && seen_well(witness))
    }

    /// Whether a group is a body inside the field that no other viewpoint contradicts; takes
    /// keypoints out of it that do not fit the body.
    fn is_person(&self, group: &mut Reconstruction, all: &[Witness]) -> bool {
        let mut body = self.observed(&group.keypoints_m);
        let cut_before = body.count();
        if !is_plausible(&mut body) {
            return false;
        }
        if body.count() < cut_before {
            self.keep_only(&body, &mut group.keypoints_m);
        }
        let points: Vec<Vector3<f64>> = group
            .keypoints_m
            .iter()
            .flatten()
            .map(|k| k.position_m)
            .collect();
        if points.len() < self.gates.min_keypoints {
            return false;
        }
        let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        self.gates.inside(&middle, FIELD_SLACK_M)
            && self.contradictions(group, &points, all) < group.members.len()
    }

    fn observed(&self, keypoints_m: &[Option<SightedKeypoint>]) -> ObservedJoints {
        let mut body = ObservedJoints::default();
        for (name, point) in self.keypoints.names().iter().zip(keypoints_m) {
            if let (Some(joint), Some(point)) = (Joint::from_name(name), point) {
                body.set(joint, point.position_m, point.score);
            }
        }
        body
    }

    fn keep_only(&self, body: &ObservedJoints, keypoints_m: &mut [Option<SightedKeypoint>]) {
        for (name, point) in self.keypoints.names().iter().zip(keypoints_m) {
            if Joint::from_name(name).is_some_and(|joint| body.point(joint).is_none()) {
                *point = None;
            }
        }
    }

    /// How many other viewpoints should see the body and see nobody there. A viewpoint that sees
    /// nobody at all does not count: it may be down.
    fn contradictions(
        &self,
        group: &Reconstruction,
        points: &[Vector3<f64>],
        all: &[Witness],
    ) -> usize {
        let member = |v: ViewpointIndex| group.members.iter().any(|&m| all[m].viewpoint == v);
        let mut others: Vec<ViewpointIndex> = all
            .iter()
            .map(|w| w.viewpoint)
            .filter(|&v| !member(v))
            .collect();
        others.sort_unstable();
        others.dedup();
        others
            .into_iter()
            .filter(|&viewpoint| self.misses(viewpoint, points, all))
            .count()
    }

    /// Whether a camera of `viewpoint` has the body well in its image, and none of its sightings
    /// lies over it.
    fn misses(&self, viewpoint: ViewpointIndex, points: &[Vector3<f64>], all: &[Witness]) -> bool {
        let mut in_view = false;
        for (index, (_, model)) in self
            .cameras
            .iter()
            .enumerate()
            .filter(|(_, camera)| camera.0 == viewpoint)
        {
            let pixels: Vec<Pixel<Undistorted>> = points
                .iter()
                .filter_map(|&p| model.project(Point::new(p.into())))
                .collect();
            let share = |count: usize| count as f64 / points.len() as f64;
            if share(pixels.iter().filter(|&&pixel| model.sees(pixel)).count()) < SEEN_SHARE {
                continue;
            }
            in_view = true;
            let mut outlines = all
                .iter()
                .filter(|w| w.camera == index)
                .filter_map(Outline::around);
            if outlines.any(|outline| {
                share(pixels.iter().filter(|pixel| outline.holds(pixel)).count()) >= HIDDEN_SHARE
            }) {
                return false;
            }
        }
        in_view
    }
}

impl From<Reconstruction> for SightedPerson {
    fn from(group: Reconstruction) -> Self {
        Self {
            keypoints_m: group.keypoints_m,
            views: group.members.len() as u16,
        }
    }
}

/// The upright rectangle that a sighted body covers in an image, undistorted pixels.
struct Outline {
    low: Vector2<f64>,
    high: Vector2<f64>,
}

impl Outline {
    fn around(witness: &Witness) -> Option<Self> {
        let mut pixels = witness
            .rays
            .iter()
            .flatten()
            .map(|ray| ray.pixel.vector_px());
        let first = pixels.next()?;
        let (low, high) = pixels.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        let growth = (high - low) * OUTLINE_GROWTH;
        Some(Self {
            low: low - growth,
            high: high + growth,
        })
    }

    fn holds(&self, pixel: &Pixel<Undistorted>) -> bool {
        let p = pixel.vector_px();
        p >= self.low && p <= self.high
    }
}

/// Which of `witnesses` see a tracked body. In one viewpoint each body explains one witness, the
/// nearest: somebody new who stands close to a tracked person is not mistaken for it.
fn explained(witnesses: &[Witness], tracked: &[TrackedBody], explained_m: f64) -> Vec<bool> {
    let mut pairs = Vec::new();
    for (t, body) in tracked.iter().enumerate() {
        for (w, witness) in witnesses.iter().enumerate() {
            let distance = witness_distance_m(witness, body).filter(|&d| d < explained_m);
            pairs.extend(distance.map(|d| (d, t, w)));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut explained = vec![false; witnesses.len()];
    let mut used = BTreeSet::new();
    for (_, t, w) in pairs {
        if !explained[w] && used.insert((t, witnesses[w].viewpoint)) {
            explained[w] = true;
        }
    }
    explained
}

/// Median distance of the rays of a witness from the keypoints of a tracked body, metres.
fn witness_distance_m(witness: &Witness, body: &TrackedBody) -> Option<f64> {
    let rays = witness.rays.iter().zip(&body.keypoints_m);
    let distances: Vec<f64> = rays
        .filter_map(|(ray, point)| Some(ray.as_ref()?.distance_m(point)))
        .collect();
    if distances.len() < EXPLAINED_KEYPOINTS {
        None
    } else {
        median(distances)
    }
}

/// Mean distance of the keypoints of a group from those of a tracked body, metres.
fn body_distance_m(group: &Reconstruction, body: &TrackedBody) -> Option<f64> {
    let pairs = group.keypoints_m.iter().zip(&body.keypoints_m);
    let distances: Vec<f64> = pairs
        .filter_map(|(point, tracked)| Some((point.as_ref()?.position_m - tracked).norm()))
        .collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::CameraIndex;
    use nalgebra::{Point3, Rotation3};
    use proptest::prelude::*;

    use super::super::scene::{Hall, Noise, hall, looking_at_the_middle, standing};
    use super::*;

    /// Mean error of a keypoint that 2 to 4 cameras see with 5 px of noise at 5 to 9 m (27 to 45 mm
    /// per view and axis), metres.
    const FOUND_WITHIN_M: f64 = 0.06;

    type Body = Vec<Vector3<f64>>;

    fn mean_error_m(person: &SightedPerson, body: &Body) -> f64 {
        let pairs = person.keypoints_m.iter().zip(body);
        let errors: Vec<f64> = pairs
            .filter_map(|(k, b)| Some((k.as_ref()?.position_m - b).norm()))
            .collect();
        assert!(errors.len() >= 12, "{} keypoints", errors.len());
        errors.iter().sum::<f64>() / errors.len() as f64
    }

    /// Every body once, and nobody else.
    fn check(found: &[SightedPerson], bodies: &[Body]) -> Result<(), TestCaseError> {
        prop_assert_eq!(found.len(), bodies.len());
        for body in bodies {
            let near = found
                .iter()
                .filter(|person| mean_error_m(person, body) < FOUND_WITHIN_M)
                .count();
            prop_assert_eq!(near, 1);
        }
        Ok(())
    }

    fn find(hall: &Hall, bodies: &[Body], noise_px: f64, noise: &mut Noise) -> Vec<SightedPerson> {
        hall.finder()
            .find(&hall.sightings(bodies, noise_px, noise), &[])
    }

    /// Someone in each quarter of the field, at least a metre from the others.
    fn four(noise: &mut Noise) -> Vec<Body> {
        let quarters = [[-1.6, -1.3], [1.6, -1.3], [1.6, 1.3], [-1.6, 1.3]];
        let mut bodies = Vec::new();
        for [x, y] in quarters {
            let (dx, dy) = (2.0 * noise.uniform() - 1.0, 1.6 * noise.uniform() - 0.8);
            let stature_m = 1.5 + 0.5 * noise.uniform();
            bodies.push(standing(x + dx, y + dy, stature_m, noise));
        }
        bodies
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]

        #[test]
        fn one_person_is_found_wherever_it_stands(
            seed in any::<u64>(), x in -2.5f64..2.5, y in -1.8f64..1.8, noise_px in 2.0f64..5.0,
        ) {
            let mut noise = Noise(seed);
            let bodies = [standing(x, y, 1.75, &mut noise)];
            check(&find(&hall(), &bodies, noise_px, &mut noise), &bodies)?;
        }

        #[test]
        fn four_persons_are_found_and_no_ghost(seed in any::<u64>(), noise_px in 2.0f64..5.0) {
            let mut noise = Noise(seed);
            let bodies = four(&mut noise);
            check(&find(&hall(), &bodies, noise_px, &mut noise), &bodies)?;
        }

        #[test]
        fn two_persons_side_by_side_are_two(seed in any::<u64>(), heading in 0.0f64..6.3) {
            let mut noise = Noise(seed);
            let (dx, dy) = (0.3 * heading.cos(), 0.3 * heading.sin());
            let bodies = [standing(dx, dy, 1.8, &mut noise), standing(-dx, -dy, 1.7, &mut noise)];
            check(&find(&hall(), &bodies, 2.0, &mut noise), &bodies)?;
        }

        #[test]
        fn whichever_way_up_a_person_is(seed in any::<u64>(), turn in prop::array::uniform3(-2.0f64..2.0)) {
            let mut noise = Noise(seed);
            let turn = Rotation3::new(Vector3::from(turn));
            let middle = Vector3::new(0.0, 0.0, 1.0);
            let upright = standing(0.0, 0.0, 1.75, &mut noise);
            let bodies = [upright.iter().map(|p| turn * (p - middle) + middle).collect()];
            check(&find(&hall(), &bodies, 2.0, &mut noise), &bodies)?;
        }
    }

    #[test]
    fn a_bystander_whom_one_viewpoint_sees_is_nobody() {
        let mut noise = Noise(1);
        let hall = hall();
        let bodies = four(&mut noise);
        let mut sightings = hall.sightings(&bodies, 2.0, &mut noise);
        sightings.push(hall.sighting(0, &standing(3.5, 0.0, 1.8, &mut noise), 2.0, &mut noise));
        check(&hall.finder().find(&sightings, &[]), &bodies).unwrap();
    }

    #[test]
    fn who_is_tracked_is_not_born_again_but_the_newcomer_beside_is() {
        let mut noise = Noise(2);
        let hall = hall();
        let old = standing(0.0, 0.0, 1.8, &mut noise);
        let new = standing(0.6, 0.2, 1.7, &mut noise);
        let sightings = hall.sightings(&[old.clone(), new.clone()], 3.0, &mut noise);
        // The track is a little behind.
        let behind = Vector3::new(0.08, -0.05, 0.0);
        let tracked = [TrackedBody {
            keypoints_m: old.iter().map(|p| p + behind).collect(),
        }];
        check(
            &hall.finder().find(&sightings, &tracked),
            std::slice::from_ref(&new),
        )
        .unwrap();
        assert!(hall.finder().leaves_unexplained(&sightings, &tracked));
        let both = [tracked[0].clone(), TrackedBody { keypoints_m: new }];
        assert!(!hall.finder().leaves_unexplained(&sightings, &both));
        assert!(hall.finder().find(&sightings, &both).is_empty());
    }

    #[test]
    fn two_cameras_of_one_viewpoint_are_one_witness() {
        let mut noise = Noise(3);
        let mut hall = hall();
        // A second camera in corner 0, a hand's breadth beside the first.
        hall.cameras.push((
            ViewpointIndex(0),
            looking_at_the_middle("second", Point3::new(-5.0, -3.8, 2.5)),
        ));
        let body = standing(0.5, 0.5, 1.75, &mut noise);
        let sightings = hall.sightings(std::slice::from_ref(&body), 2.0, &mut noise);
        assert_eq!(sightings.len(), 5);
        let found = hall.finder().find(&sightings, &[]);
        check(&found, &[body]).unwrap();
        assert_eq!(found[0].views, 4);

        let of_corner_0: Vec<Sighting> = sightings
            .into_iter()
            .filter(|s| [0, 4].contains(&s.camera.0))
            .collect();
        assert!(hall.finder().find(&of_corner_0, &[]).is_empty());
    }

    #[test]
    fn a_person_outside_the_field_is_nobody() {
        let mut noise = Noise(4);
        let hall = hall();
        let outside = standing(0.0, 3.4, 1.75, &mut noise);
        assert!(find(&hall, &[outside], 0.0, &mut noise).is_empty());
    }

    #[test]
    fn half_a_body_is_born_with_both_hips_and_not_with_one() {
        let mut noise = Noise(5);
        let hall = hall();
        let body = standing(0.0, 0.0, 1.75, &mut noise);
        let mut legs = hall.sightings(&[body], 1.0, &mut noise);
        let names = KeypointSet::coco17();
        let hide = |sightings: &mut [Sighting], hidden: &dyn Fn(&str) -> bool| {
            for sighting in sightings {
                for (name, keypoint) in names.names().iter().zip(&mut sighting.keypoints) {
                    if hidden(name) {
                        *keypoint = None;
                    }
                }
            }
        };
        let is_leg = |name: &str| {
            ["hip", "knee", "ankle"]
                .iter()
                .any(|part| name.contains(part))
        };
        hide(&mut legs, &|name| !is_leg(name));
        assert_eq!(hall.finder().find(&legs, &[]).len(), 1);
        hide(&mut legs, &|name| name == "left_hip");
        assert!(hall.finder().find(&legs, &[]).is_empty());
    }

    #[test]
    fn sightings_that_do_not_fit_the_venue_are_left_out() {
        let mut noise = Noise(6);
        let hall = hall();
        let body = standing(0.0, 0.0, 1.75, &mut noise);
        let good = hall.sightings(std::slice::from_ref(&body), 1.0, &mut noise);
        let mut sightings = good.clone();
        sightings.push(Sighting {
            camera: CameraIndex(99),
            ..good[0].clone()
        });
        sightings.push(Sighting {
            keypoints: good[1].keypoints[..5].to_vec(),
            ..good[1].clone()
        });
        let mut broken = good[2].clone();
        for peak in broken.keypoints.iter_mut().flatten() {
            peak.position_px = [f32::NAN, f32::INFINITY];
        }
        sightings.push(broken);
        check(&hall.finder().find(&sightings, &[]), &[body]).unwrap();
        assert!(hall.finder().find(&[], &[]).is_empty());
    }
}
