//! Observations of people who stand still, so that every change is a fault.

use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::body::skeleton::{Joint, Kinematics, Pose, Proportions, Skeleton};
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Point;
use farfield_proto::keypoints::COCO17;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::crowd::Subject;
use super::observe::{CameraFaults, ImagedPerson, KeypointPeaks, MapObservation};
use super::*;
use crate::body::Build;
use crate::embedded;
use crate::fault_profile::{Bias, FaultProfile, Jitter, Leak, MirrorFault};
use crate::look_at::look_at;
use crate::scene::PersonTruth;

const RATE_HZ: f64 = 60.0;
const STATURE_M: f64 = 1.75;
/// COCO indices of the keypoints in these tests.
pub(super) const NOSE: usize = 0;
const LEFT_WRIST: usize = 9;
const RIGHT_WRIST: usize = 10;
pub(super) const LEFT_KNEE: usize = 13;

/// A camera at hip height that looks along the x axis; a person at 6 m is about 340 pixels high.
pub(super) fn camera() -> CameraModel {
    let intrinsics = Intrinsics {
        fx_px: 1200.0,
        fy_px: 1200.0,
        cx_px: 639.5,
        cy_px: 399.5,
    };
    let distortion = Distortion {
        k1: -0.1,
        ..Distortion::default()
    };
    let pose = look_at(Vector3::new(-6.0, 0.0, 1.0), Vector3::new(0.0, 0.0, 1.0));
    CameraModel::new("c", [1280, 800], intrinsics, distortion, pose).unwrap()
}

/// A person at (x, y) with hanging arms who looks at the camera.
pub(super) fn standing(x: f64, y: f64) -> Subject {
    let mut body = Kinematics::default();
    let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::PI);
    let root_m = Vector3::new(x, y, 0.53 * STATURE_M);
    let skeleton = Skeleton::new(&Proportions::from_stature(STATURE_M));
    skeleton.forward(&Pose::neutral(root_m, turned), &mut body);
    let joints_m: Joints = body.joints_m;
    let site = |name| joints_m[Joint::from_name(name).unwrap().index()];
    let build = Build::from_seed(STATURE_M, 3);
    let truth = PersonTruth {
        joints_m,
        sites_m: COCO17.map(site),
    };
    Subject::new(&truth, &build)
}

/// All of these as present people.
pub(super) fn all<const N: usize>(subjects: [Subject; N]) -> Vec<Option<Subject>> {
    subjects.map(Some).to_vec()
}

pub(super) fn faults(profile: &FaultProfile, n_people: usize) -> CameraFaults {
    CameraFaults::new(camera(), 1, n_people, profile.clone(), 5, RATE_HZ)
}

/// The standard profile without noise, so that maps contain only peaks.
fn without_noise() -> FaultProfile {
    FaultProfile {
        noise: None,
        ..FaultProfile::standard()
    }
}

/// The observations of the first of `subjects` over `ticks` ticks.
fn watched(profile: &FaultProfile, subjects: &[Option<Subject>], ticks: u64) -> Vec<ImagedPerson> {
    let mut faults = faults(profile, subjects.len());
    (0..ticks)
        .map(|tick| faults.observe(tick, subjects).people[0].clone())
        .collect()
}

pub(super) fn projected(p_m: &Vector3<f64>) -> Vector2<f64> {
    let px = camera().project(Point::new((*p_m).into())).unwrap();
    px.vector_px()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / n
}

/// RMS distance of own peaks from the true position, metres at the person's depth of 6 m.
fn rms_m(seen: &[ImagedPerson], subject: &Subject, keypoint: usize) -> f64 {
    let truth_px = projected(&subject.sites_m[keypoint]);
    let peaks = seen.iter().filter_map(|s| s.keypoints[keypoint].own);
    mean(peaks.map(|p| (p.at_px - truth_px).norm_squared())).sqrt() * 6.0 / 1200.0
}

pub(super) fn assert_near(what: &str, got: f64, expected: f64, tolerance: f64) {
    assert!(
        (got - expected).abs() < tolerance,
        "{what}: {got}, expected {expected} to {tolerance}"
    );
}

#[test]
fn without_faults_every_keypoint_is_one_peak_of_height_1_in_its_place() {
    let subject = standing(0.0, 0.0);
    let sites_m = subject.sites_m;
    let seen = &watched(&FaultProfile::none(), &all([subject]), 1)[0];
    for (evidence, site_m) in seen.keypoints.iter().zip(&sites_m) {
        let own = evidence.own.unwrap();
        assert!((own.at_px - projected(site_m)).norm() < 1e-9);
        assert!((own.height - 1.0).abs() < 1e-12);
        assert_eq!((evidence.mirrored, evidence.leaked), (None, None));
    }
}

#[test]
fn errors_have_their_rms_in_metres_at_the_persons_depth() {
    let subject = standing(0.0, 0.0);
    let subjects = all([subject.clone()]);
    let only_jitter = FaultProfile {
        jitter: Some(Jitter::default()),
        ..FaultProfile::none()
    };
    let seen = watched(&only_jitter, &subjects, 4000);
    for (keypoint, sigma) in [(NOSE, 0.026), (LEFT_WRIST, 0.062), (11, 0.107), (16, 0.089)] {
        let rms = rms_m(&seen, &subject, keypoint);
        let expected = 0.1 * sigma * 0.71;
        assert_near("jitter", rms / expected, 1.0, 0.03);
    }
    // A bias of 2 s needs long runs, so keypoints and runs are averaged.
    let only_bias = FaultProfile {
        bias: Some(Bias::default()),
        ..FaultProfile::none()
    };
    let seen = watched(&only_bias, &subjects, 40_000);
    let shares = [
        (NOSE, 0.026),
        (5, 0.079),
        (6, 0.079),
        (LEFT_KNEE, 0.087),
        (14, 0.087),
    ];
    let ratio = mean(shares.into_iter().map(|(keypoint, sigma)| {
        let expected = 0.4 * sigma * 0.71;
        (rms_m(&seen, &subject, keypoint) / expected).powi(2)
    }));
    assert_near("bias", ratio, 1.0, 0.1);
}

#[test]
fn covered_keypoints_have_larger_errors() {
    let behind = standing(0.0, 0.0);
    let subjects = all([behind.clone(), standing(-1.0, 0.05)]);
    let profile = FaultProfile {
        leak: None,
        missing: None,
        mirror: None,
        jitter: None,
        ..without_noise()
    };
    let seen = watched(&profile, &subjects, 20_000);
    let keypoint = 12;
    assert!(!seen[0].keypoints[keypoint].in_the_open);
    let heights: Vec<f64> = seen
        .iter()
        .filter_map(|s| Some(s.keypoints[keypoint].own?.height))
        .collect();
    assert!(heights.iter().all(|h| (0.3..0.8).contains(h)));
    assert_near("height", mean(heights.iter().copied()), 0.55, 0.03);
    let gone = 1.0 - heights.len() as f64 / seen.len() as f64;
    assert_near("no peak", gone, 0.2, 0.05);
    let expected = 2.0 * 0.4 * 0.107 * 0.71;
    assert_near(
        "bias",
        rms_m(&seen, &behind, keypoint) / expected,
        1.0,
        0.15,
    );
}

#[test]
fn the_own_body_hides_a_keypoint_and_leaks_nothing() {
    // Seen from behind, so that the head hides the nose.
    let mut away = standing(0.0, 0.0);
    let pelvis_m = away.torso_m;
    let half_turn = |p: &mut Vector3<f64>| {
        p.x = 2.0 * pelvis_m.x - p.x;
        p.y = 2.0 * pelvis_m.y - p.y;
    };
    away.sites_m.iter_mut().for_each(half_turn);
    let facing = watched(&without_noise(), &all([standing(0.0, 0.0)]), 600);
    let turned = watched(&without_noise(), &all([away]), 600);
    let low = |seen: &[ImagedPerson]| {
        let low = |s: &&ImagedPerson| s.keypoints[NOSE].own.is_none_or(|p| p.height < 0.9);
        seen.iter().filter(low).count()
    };
    assert!(low(&facing) < 40, "{}", low(&facing));
    assert_eq!(low(&turned), 600);
    let leaks = |s: &ImagedPerson| s.keypoints.iter().any(|e| e.leaked.is_some());
    assert!(!turned.iter().any(leaks));
    assert!(turned[0].keypoints[NOSE].in_the_open);
}

#[test]
fn the_keypoint_of_the_person_in_front_leaks_in() {
    let other = standing(-1.0, 0.05);
    let keypoint = 12;
    let other_px = projected(&other.sites_m[keypoint]);
    let subjects = all([standing(0.0, 0.0), other]);
    let profile = FaultProfile {
        leak: Some(Leak::default()),
        ..FaultProfile::none()
    };
    let seen = watched(&profile, &subjects, 20_000);
    let mut leaked = 0;
    for s in &seen {
        let KeypointPeaks {
            own, leaked: peak, ..
        } = s.keypoints[keypoint];
        assert!((own.unwrap().height - 0.5).abs() < 1e-12);
        if let Some(peak) = peak {
            leaked += 1;
            assert!((peak.height - 0.8).abs() < 1e-12);
            assert!((peak.at_px - other_px).norm() < 1e-9);
        }
    }
    assert_near("leaks", f64::from(leaked) / seen.len() as f64, 0.5, 0.06);
    // The person in front is not affected.
    let mut faults = faults(&profile, 2);
    let before = &faults.observe(0, &subjects).people[1];
    assert!(before.keypoints.iter().all(|e| e.leaked.is_none()));
}

#[test]
fn a_mirrored_peak_is_at_the_opposite_limbs_own_peak() {
    let subjects = all([standing(0.0, 0.0)]);
    let always = FaultProfile {
        mirror: Some(MirrorFault {
            share: 1.0,
            ..MirrorFault::default()
        }),
        ..without_noise()
    };
    let mut compared = 0;
    for s in watched(&always, &subjects, 300) {
        for (k, other) in [(LEFT_WRIST, RIGHT_WRIST), (RIGHT_WRIST, LEFT_WRIST)] {
            let (here, there) = (s.keypoints[k], s.keypoints[other]);
            let (Some(own), Some(mirrored)) = (here.own, here.mirrored) else {
                assert!(here.own.is_none());
                continue;
            };
            let share = mirrored.height / own.height;
            assert!((0.3..1.1).contains(&share));
            if let Some(there) = there.own {
                assert!((mirrored.at_px - there.at_px).norm() < 1e-9);
                compared += 1;
            }
        }
        assert_eq!(s.keypoints[NOSE].mirrored, None);
    }
    assert!(compared > 500);
}

#[test]
fn keypoints_outside_the_image_have_no_peak() {
    // The image shows 3.3 m to either side at 6 m.
    let mut subjects = all([standing(0.0, 3.3), standing(0.0, 5.0), standing(-12.0, 0.0)]);
    subjects.push(None);
    let mut faults = faults(&FaultProfile::none(), 4);
    let observation = faults.observe(0, &subjects);
    assert_eq!(observation.people.len(), 1);
    let inside = |k: usize| observation.people[0].keypoints[k].own.is_some();
    assert!(inside(5) && !inside(6), "one shoulder is in the image");
}

#[test]
fn observations_do_not_depend_on_the_order_of_calls() {
    let subjects = [Some(standing(0.0, 0.0)), None, Some(standing(-1.0, 0.05))];
    let profile = FaultProfile::standard();
    let mut in_order = faults(&profile, 3);
    let all: Vec<MapObservation> = (0..90).map(|t| in_order.observe(t, &subjects)).collect();
    let mut any_order = faults(&profile, 3);
    for tick in [70, 3, 3, 89, 0, 41] {
        let again = any_order.observe(tick, &subjects);
        let expected = &all[tick as usize];
        assert_eq!(again.noise_key, expected.noise_key);
        assert_eq!(again.people.len(), expected.people.len());
        for (a, b) in again.people.iter().zip(&expected.people) {
            assert_eq!((a.person, a.keypoints), (b.person, b.keypoints));
        }
    }
    // The result does not depend on earlier people either.
    let mut late = faults(&profile, 3);
    late.observe(10, &[None, None, None]);
    let seen = &late.observe(41, &subjects).people[1];
    assert_eq!(seen.keypoints, all[41].people[1].keypoints);
}

#[test]
fn a_free_running_camera_has_an_offset_of_its_own_within_half_a_frame() {
    let free = FaultProfile {
        free_running: true,
        ..FaultProfile::none()
    };
    let offset = |profile: &FaultProfile, index| {
        let faults = CameraFaults::new(camera(), index, 0, profile.clone(), 5, RATE_HZ);
        faults.capture_offset_us()
    };
    let offsets: Vec<i32> = (0..400).map(|index| offset(&free, index)).collect();
    assert!(offsets.iter().all(|us| us.abs() <= 8333));
    let spread = mean(offsets.iter().map(|&us| f64::from(us).powi(2))).sqrt();
    assert_near(
        "RMS of a uniform offset",
        spread,
        8333.0 / 3f64.sqrt(),
        400.0,
    );
    assert_eq!(offset(&FaultProfile::standard(), 7), 0);
    assert_eq!(offset(&free, 7), offset(&free, 7));
}

/// All peaks of an observation, by person and keypoint.
fn evidence(observation: &MapObservation) -> Vec<(usize, [KeypointPeaks; 17])> {
    let people = observation.people.iter();
    people.map(|seen| (seen.person, seen.keypoints)).collect()
}

#[test]
fn cameras_that_share_a_crowd_observe_the_same_as_alone() {
    let scene = Arc::new(embedded::scene("five").unwrap());
    let crowd = Arc::new(SceneCrowd::new(Arc::clone(&scene)));
    for camera in [0, 5] {
        let mut sharing = MapFaults::with_crowd(Arc::clone(&crowd), camera);
        let mut alone = MapFaults::new(Arc::clone(&scene), camera);
        for tick in [0, 30, 10] {
            let [a, b] = [&mut sharing, &mut alone].map(|maps| maps.observe(Tick(tick)));
            assert!(a.people.len() > 1);
            assert_eq!(evidence(&a), evidence(&b));
        }
    }
}

#[test]
fn a_free_running_camera_observes_the_moment_of_its_capture() {
    let profile = FaultProfile {
        free_running: true,
        ..FaultProfile::none()
    };
    let scene = Arc::new(embedded::scene("one").unwrap().with_faults(profile));
    for camera in 0..scene.cameras().len() {
        let model = &scene.cameras()[camera];
        let observation = MapFaults::new(Arc::clone(&scene), camera).observe(Tick(60));
        let offset_us = observation.capture_offset_us();
        assert_ne!(offset_us, 0);
        let captured_s = Tick(60).seconds(scene.rate_hz()) + f64::from(offset_us) * 1e-6;
        let truth = scene.person_at(0, captured_s).unwrap();
        let mut compared = 0;
        for seen in &observation.people {
            for (evidence, site_m) in seen.keypoints.iter().zip(&truth.sites_m) {
                let Some(own) = evidence.own else { continue };
                let expected = model.project(Point::new((*site_m).into())).unwrap();
                assert!((own.at_px - expected.vector_px()).norm() < 1e-9);
                compared += 1;
            }
        }
        assert!(compared > 0 || observation.people.is_empty());
    }
}
