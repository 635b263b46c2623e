//! Tests of the schedule of detection passes.

use farfield_proto::frames::{Pixel, Transform};
use nalgebra::Isometry3;
use proptest::prelude::*;

use super::*;
use crate::body::fixture::{Noise, standing};
use crate::sightings::fixture::hall;
use crate::sightings::rays::witnesses;

const RATE_HZ: f64 = 10.0;

fn field() -> Field {
    Field {
        min_m: [-4.0, -3.0, -0.3],
        max_m: [4.0, 3.0, 2.6],
        floor_m: 0.0,
    }
}

/// The defaults, but with as many ticks of repeated passes as at 60 Hz.
fn births() -> BirthParameters {
    BirthParameters {
        look_again_s: 5.0 / RATE_HZ,
        ..BirthParameters::default()
    }
}

/// The hall's four cameras.
fn scheduler(births: &BirthParameters) -> DetectionScheduler {
    let mut scheduler = DetectionScheduler::new(hall().cameras, field(), births, RATE_HZ);
    scheduler.begin(Tick(0));
    scheduler
}

/// A person in the middle, seen by camera 0 alone.
fn seen_by_one(x: f64) -> Vec<SightedBody> {
    let (hall, mut noise) = (hall(), Noise(1));
    let body = standing(x, 0.0, 1.75, &mut noise);
    let sighting = hall.sighting(0, &body, 1.0, &mut noise);
    witnesses(&[sighting], &hall.cameras, 17, 0.3)
}

/// The ticks of the next `n` at which camera `camera` runs the detector, while each pass shows
/// `unexplained`.
fn passes(
    scheduler: &mut DetectionScheduler,
    n: i64,
    camera: usize,
    unexplained: &[SightedBody],
) -> Vec<i64> {
    let mut at = Vec::new();
    for tick in 0..n {
        if tick > 0 {
            scheduler.plan(Tick(tick));
        }
        if scheduler.runs_at(Tick(tick))[camera] {
            at.push(tick);
        }
        if scheduler.runs_at(Tick(tick))[0] {
            scheduler.record_unexplained(Tick(tick), unexplained.iter());
        }
    }
    at
}

#[test]
fn all_cameras_run_once_a_second_without_unexplained_sightings() {
    let mut scheduler = scheduler(&births());
    for camera in 0..4 {
        scheduler.begin(Tick(0));
        assert_eq!(passes(&mut scheduler, 31, camera, &[]), [0, 10, 20, 30]);
    }
}

#[test]
fn cameras_that_could_see_an_unexplained_sighting_run_five_ticks() {
    let births = births();
    let unexplained = seen_by_one(0.0);
    for camera in 0..4 {
        let at = passes(&mut scheduler(&births), 10, camera, &unexplained);
        assert_eq!(at, [0, 1, 2, 3, 4, 5], "camera {camera}");
    }
}

#[test]
fn cameras_that_cannot_see_a_sighting_get_no_request() {
    let mut cameras = hall().cameras;
    // A camera high above that points at the sky.
    let (_, model) = &cameras[2];
    let elsewhere = CameraModel::new(
        "sky",
        model.size_px(),
        *model.intrinsics(),
        *model.lens(),
        Transform::new(Isometry3::translation(0.0, 0.0, -1000.0)),
    )
    .unwrap();
    cameras.push((ViewpointIndex(4), elsewhere));
    let mut scheduler = DetectionScheduler::new(cameras, field(), &births(), RATE_HZ);
    scheduler.record_unexplained(Tick(3), seen_by_one(0.0).iter());
    scheduler.plan(Tick(4));
    assert_eq!(scheduler.runs_at(Tick(4)), [true, true, true, true, false]);
}

#[test]
fn an_unexplained_sighting_causes_fewer_and_fewer_requests() {
    let births = BirthParameters {
        look_share: 1.0,
        ..births()
    };
    let at = passes(&mut scheduler(&births), 200, 1, &seen_by_one(0.0));
    let bursts: Vec<i64> = at
        .windows(2)
        .filter(|pair| pair[1] == pair[0] + 1 && pair[0] % 10 == 0)
        .map(|pair| pair[0])
        .collect();
    assert_eq!(bursts, [0, 10, 30, 70, 150]);
}

#[test]
fn a_new_sighting_causes_a_request_at_once() {
    let mut scheduler = scheduler(&births());
    let (one, other) = (seen_by_one(0.0), seen_by_one(1.5));
    let _known = passes(&mut scheduler, 10, 0, &one);
    scheduler.plan(Tick(10));
    scheduler.record_unexplained(Tick(10), one.iter().chain(&other));
    scheduler.plan(Tick(11));
    assert!(scheduler.is_pass(Tick(11)));
}

#[test]
fn passes_are_planned_as_far_ahead_as_boxes() {
    let mut scheduler = scheduler(&births());
    scheduler.plan_ahead(6);
    let mut at = Vec::new();
    for tick in 1..40 {
        scheduler.plan(Tick(tick));
        let ahead = Tick(tick + 5);
        let planned = scheduler.detecting(&[CameraIndex(1)], ahead).len();
        assert_eq!(planned == 1, scheduler.is_pass(ahead));
        assert!(scheduler.runs_at(ahead + 1).is_empty(), "nothing beyond");
        if scheduler.is_pass(Tick(tick)) {
            at.push(tick);
        }
        if tick == 12 {
            scheduler.record_unexplained(Tick(tick), seen_by_one(0.0).iter());
        }
    }
    assert_eq!(at, [10, 18, 19, 20, 21, 22, 30], "requested at 12");
}

#[test]
fn cameras_in_sight_search_newcomers_and_lost_people() {
    let births = births();
    let body = standing(0.0, 0.0, 1.75, &mut Noise(2));
    let mut for_newcomer = scheduler(&births);
    for_newcomer.plan(Tick(1));
    assert!(!for_newcomer.is_pass(Tick(1)));
    for_newcomer.request_for_tentative(Tick(1), &body);
    for_newcomer.plan(Tick(2));
    assert_eq!(for_newcomer.runs_at(Tick(2))[..4], [true; 4]);
    let mut for_lost = scheduler(&births);
    for_lost.request_for_lost(Tick(5), Vector3::new(0.0, 0.0, 0.9), 0.5);
    for_lost.plan(Tick(6));
    assert_eq!(for_lost.runs_at(Tick(6))[..4], [true; 4]);
    for_lost.plan(Tick(7));
    assert!(!for_lost.is_pass(Tick(7)));
    let own = [CameraIndex(1), CameraIndex(2)];
    assert!(for_lost.detecting(&own, Tick(7)).is_empty());
}

proptest! {
    #[test]
    fn passes_stay_within_their_share(
        share in 0.0f64..1.0, again in 0u32..20, from in 1i64..50, xs in prop::collection::vec(-3.0f64..3.0, 1..6),
    ) {
        let births = BirthParameters { look_share: share, look_again_s: f64::from(again) / RATE_HZ, ..births() };
        let mut scheduler = scheduler(&births);
        let unexplained: Vec<SightedBody> = xs.iter().flat_map(|&x| seen_by_one(x)).collect();
        let n = 60;
        let mut requested = 0;
        for tick in 1..from + n {
            scheduler.plan(Tick(tick));
            requested += i32::from(tick >= from && scheduler.runs_at(Tick(tick))[1] && tick % 10 != 0);
            scheduler.record_unexplained(Tick(tick), unexplained.iter());
            scheduler.request_for_lost(Tick(tick), Vector3::new(0.0, 0.0, 0.9), 1.0);
        }
        let most = f64::from(again.max(1)) + share * n as f64;
        prop_assert!(f64::from(requested) <= most + 1e-6, "{requested} of {most}");
    }
}

#[test]
fn a_ray_that_leaves_the_field_causes_no_request() {
    let mut scheduler = scheduler(&births());
    let mut up = seen_by_one(0.0);
    for ray in up[0].rays.iter_mut().flatten() {
        ray.direction = Vector3::z();
        ray.pixel = Pixel::new(0.0, 0.0);
    }
    scheduler.record_unexplained(Tick(0), up.iter());
    scheduler.plan(Tick(1));
    assert!(!scheduler.is_pass(Tick(1)));
}
