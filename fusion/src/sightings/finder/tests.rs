//! Tests of finding new people in sightings.

use std::ops::Range;

use farfield_proto::id::CameraIndex;
use farfield_proto::keypoints::KeypointSet;
use nalgebra::{Point3, Rotation3};
use proptest::prelude::*;

use super::*;
use crate::body::fixture::{Noise, standing};
use crate::sightings::fixture::{TestHall, hall, hall_of_sixteen, looking_at_the_middle};

/// Mean error of a keypoint that 2 to 4 cameras see with 5 px of noise at 5 to 9 m (27 to 45 mm per
/// view and axis), metres.
const FOUND_WITHIN_M: f64 = 0.06;

/// Noise of keypoints with which no detection pass misses a person, standard deviations in pixels.
/// Above 4.4 px some passes miss a person at the field's ends.
const NOISE_PX: Range<f64> = 2.0..4.0;

type BodyPoints = Vec<Vector3<f64>>;

fn mean_error_m(person: &SightedPerson, body: &BodyPoints) -> f64 {
    let pairs = person.keypoints_m.iter().zip(body);
    let errors: Vec<f64> = pairs
        .filter_map(|(k, b)| Some((k.as_ref()?.position_m - b).norm()))
        .collect();
    assert!(errors.len() >= 12, "{} keypoints", errors.len());
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// Every body once, and no other.
fn check(found: &[SightedPerson], bodies: &[BodyPoints]) -> Result<(), TestCaseError> {
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

fn find(
    hall: &TestHall,
    bodies: &[BodyPoints],
    noise_px: f64,
    noise: &mut Noise,
) -> Vec<SightedPerson> {
    hall.finder()
        .find(&hall.sightings(bodies, noise_px, noise), &[])
}

/// A person in each quarter of the field, at least a metre from the others.
fn four(noise: &mut Noise) -> Vec<BodyPoints> {
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
    fn one_person_is_found_anywhere_in_the_field(
        seed in any::<u64>(), x in -2.5f64..2.5, y in -1.8f64..1.8, noise_px in NOISE_PX,
    ) {
        let mut noise = Noise(seed);
        let bodies = [standing(x, y, 1.75, &mut noise)];
        check(&find(&hall(), &bodies, noise_px, &mut noise), &bodies)?;
    }

    #[test]
    fn four_persons_are_found_and_no_ghost(seed in any::<u64>(), noise_px in NOISE_PX) {
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
    fn all_of_many_viewpoints_see_each_person(seed in any::<u64>(), heading in 0.0f64..6.3) {
        let mut noise = Noise(seed);
        let hall = hall_of_sixteen();
        let (dx, dy) = (0.3 * heading.cos(), 0.3 * heading.sin());
        let side_by_side = [standing(dx, dy, 1.8, &mut noise), standing(-dx, -dy, 1.7, &mut noise)];
        for bodies in [four(&mut noise), side_by_side.to_vec()] {
            let found = find(&hall, &bodies, 2.0, &mut noise);
            check(&found, &bodies)?;
            prop_assert!(found.iter().all(|person| person.views >= 14), "{:?}", found.iter().map(|p| p.views).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_person_in_any_orientation_is_found(seed in any::<u64>(), turn in prop::array::uniform3(-2.0f64..2.0)) {
        let mut noise = Noise(seed);
        let turn = Rotation3::new(Vector3::from(turn));
        let middle = Vector3::new(0.0, 0.0, 1.0);
        let upright = standing(0.0, 0.0, 1.75, &mut noise);
        let bodies = [upright.iter().map(|p| turn * (p - middle) + middle).collect()];
        check(&find(&hall(), &bodies, 2.0, &mut noise), &bodies)?;
    }
}

#[test]
fn with_5_px_of_noise_few_passes_miss_a_person() {
    const PASSES: u64 = 2000;
    let hall = hall();
    let missed = (0..PASSES).filter(|&seed| {
        let mut noise = Noise(seed);
        let bodies = four(&mut noise);
        check(&find(&hall, &bodies, 5.0, &mut noise), &bodies).is_err()
    });
    let missed = missed.count();
    assert!(missed <= 10, "{missed} of {PASSES}");
}

#[test]
fn a_bystander_in_one_view_is_no_person() {
    let mut noise = Noise(1);
    let hall = hall();
    let bodies = four(&mut noise);
    let mut sightings = hall.sightings(&bodies, 2.0, &mut noise);
    sightings.push(hall.sighting(0, &standing(3.5, 0.0, 1.8, &mut noise), 2.0, &mut noise));
    check(&hall.finder().find(&sightings, &[]), &bodies).unwrap();
}

#[test]
fn a_newcomer_next_to_a_tracked_person_is_found_alone() {
    let mut noise = Noise(2);
    let hall = hall();
    let old = standing(0.0, 0.0, 1.8, &mut noise);
    let new = standing(0.6, 0.2, 1.7, &mut noise);
    let sightings = hall.sightings(&[old.clone(), new.clone()], 3.0, &mut noise);
    // The track is a little behind.
    let behind = Vector3::new(0.08, -0.05, 0.0);
    let tracked = [KnownBody {
        keypoints_m: old.iter().map(|p| p + behind).collect(),
    }];
    check(
        &hall.finder().find(&sightings, &tracked),
        std::slice::from_ref(&new),
    )
    .unwrap();
    let unexplained = |bodies: &[KnownBody]| {
        let finder = hall.finder();
        let pass = finder.detection_pass(&sightings, vec![true; 4]);
        let explanation = finder.explain(&pass, bodies.to_vec());
        finder.unexplained(&pass, &explanation).count()
    };
    assert_eq!(unexplained(&tracked), 4);
    let both = [tracked[0].clone(), KnownBody { keypoints_m: new }];
    assert_eq!(unexplained(&both), 0);
    assert!(hall.finder().find(&sightings, &both).is_empty());
}

#[test]
fn two_cameras_of_one_viewpoint_are_one_witness() {
    let mut noise = Noise(3);
    let mut hall = hall();
    // A second camera in corner 0, a hand's breadth from the first.
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
fn a_person_outside_the_field_is_ignored() {
    let mut noise = Noise(4);
    let hall = hall();
    let outside = standing(0.0, 3.4, 1.75, &mut noise);
    assert!(find(&hall, &[outside], 0.0, &mut noise).is_empty());
}

#[test]
fn half_a_body_is_found_with_both_hips_but_not_with_one() {
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
fn sightings_that_do_not_fit_the_venue_are_ignored() {
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

#[test]
fn people_at_the_border_of_the_field_are_found() {
    let mut noise = Noise(8);
    for [x, y] in [[3.95, 0.0], [-3.95, 1.0], [0.0, 2.95], [1.0, -2.95]] {
        let bodies = [standing(x, y, 1.75, &mut noise)];
        check(&find(&hall(), &bodies, 2.0, &mut noise), &bodies).unwrap();
    }
}

#[test]
fn half_a_body_above_is_found_by_two_viewpoints() {
    let mut noise = Noise(9);
    let hall = hall();
    let body = standing(0.3, 0.2, 1.75, &mut noise);
    let mut sightings = hall.sightings(&[body], 1.0, &mut noise);
    sightings.retain(|sighting| sighting.camera.0 < 2);
    for sighting in &mut sightings {
        // From the hips down it is hidden.
        sighting.keypoints[11..].fill(None);
    }
    let found = hall.finder().find(&sightings, &[]);
    assert_eq!((found.len(), found[0].views), (1, 2));
}

#[test]
fn cameras_without_a_pass_do_not_contradict() {
    let mut noise = Noise(10);
    let hall = hall();
    let body = standing(0.5, 0.5, 1.75, &mut noise);
    let other = standing(-2.5, 1.5, 1.75, &mut noise);
    let mut sightings = hall.sightings(&[body, other], 1.0, &mut noise);
    // Corners 2 and 3 see only the other person.
    let of_body = |s: &Sighting| {
        let x = |camera: u16| sightings_middle(&hall, camera, [0.5, 0.5]);
        let nose = s.keypoints[0].unwrap().position_px;
        (f64::from(nose[0]) - x(s.camera.0)).abs() < 100.0
    };
    sightings.retain(|s| s.camera.0 < 2 || !of_body(s));
    let found = |detected: Vec<bool>| {
        let mut finder = hall.finder();
        let pass = finder.detection_pass(&sightings, detected);
        let none = finder.explain(&pass, Vec::new());
        finder.find_in(&pass, &none, 0).len()
    };
    assert_eq!(found(vec![true; 4]), 1, "two see it and two do not");
    assert_eq!(found(vec![true, true, false, false]), 2);
}

#[test]
fn a_body_in_half_of_the_views_is_always_refused() {
    let mut noise = Noise(12);
    let hall = hall();
    let [person, picture] =
        [(0.5, 0.5), (-2.5, 1.5)].map(|(x, y)| standing(x, y, 1.75, &mut noise));
    let [seen, mirrored] =
        [&person, &picture].map(|body| hall.sightings(std::slice::from_ref(body), 1.0, &mut noise));
    // Two of the corners see the mirror image.
    let mirrored = mirrored.into_iter().filter(|s| s.camera.0 < 2);
    let sightings: Vec<Sighting> = seen.into_iter().chain(mirrored).collect();
    let mut finder = hall.finder();
    for pass in 0..20 {
        assert_eq!(finder.find(&sightings, &[]).len(), 1, "pass {pass}");
    }
}

#[test]
fn verdicts_count_viewpoints_that_see_and_miss_a_body() {
    let mut noise = Noise(11);
    let hall = hall();
    let body = standing(0.0, 0.0, 1.75, &mut noise);
    let false_body = standing(2.5, -1.0, 1.75, &mut noise);
    let sightings = hall.sightings(std::slice::from_ref(&body), 1.0, &mut noise);
    let pass = hall.finder().detection_pass(&sightings, vec![true; 4]);
    let verdict =
        |keypoints_m: BodyPoints| hall.finder().verdicts(&pass, &KnownBody { keypoints_m });
    assert_eq!(verdict(body), (4, 0.0));
    let (seen, missed) = verdict(false_body);
    assert!(seen == 0 && missed >= 2.0, "{seen} {missed}");
}

/// Where camera `camera` sees a head above (`x`, `y`), pixels.
fn sightings_middle(hall: &TestHall, camera: u16, [x, y]: [f64; 2]) -> f64 {
    let head = Point3::new(x, y, 1.6);
    let model = &hall.cameras[usize::from(camera)].1;
    let pixel = model.project(farfield_proto::frames::Point::new(head));
    pixel.unwrap().x()
}

#[test]
fn people_outside_the_field_make_no_body_inside() {
    // Rays of two of them cross in the field, and so two of four viewpoints see a body there.
    let (hall, mut noise) = (hall(), Noise(3));
    for _ in 0..50 {
        let mut waiting = |i: u32| {
            let along = 2.0 * noise.uniform() - 1.0;
            let (x, y) = (4.6 + noise.uniform(), 0.8 * f64::from(i) - 1.6 + along);
            standing(x, y, 1.75, &mut noise)
        };
        let bodies: Vec<BodyPoints> = (0..5).map(&mut waiting).collect();
        assert_eq!(find(&hall, &bodies, 2.0, &mut noise), []);
    }
}

#[test]
fn a_person_in_three_views_is_found_despite_a_crowd() {
    let (hall, mut noise) = (hall(), Noise(5));
    for _ in 0..50 {
        let waiting = [[5.2, -1.2], [5.4, 0.1], [5.1, 1.3]];
        let waiting = waiting.map(|[x, y]| standing(x, y, 1.75, &mut noise));
        let body = standing(2.0, 2.0 * noise.uniform() - 1.0, 1.7, &mut noise);
        let mut sightings = hall.sightings(&waiting, 2.0, &mut noise);
        for camera in [0, 2, 3] {
            sightings.push(hall.sighting(camera, &body, 2.0, &mut noise));
        }
        check(&hall.finder().find(&sightings, &[]), &[body]).unwrap();
    }
}
