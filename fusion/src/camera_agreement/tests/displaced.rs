//! Tests with a camera that was moved, turned or zoomed a little.

use nalgebra::Vector3;

use super::super::fixture::{Hall, Mistake, names};
use super::super::samples::PassSample;
use super::AgreementVerdict::{Agrees, Unknown};
use super::*;

#[test]
fn a_move_of_some_centimetres_is_reported_to_forty_percent() {
    // A move straight ahead also looks like a zoom or a distortion.
    for moved_m in [[0.1, 0.0, 0.0], [0.0, -0.08, 0.0]] {
        let mistake = Mistake {
            moved_m,
            ..Mistake::default()
        };
        let expected_m = Vector3::from(moved_m).norm();
        for camera in 0..4 {
            let causes = Hall::with(camera, mistake).causes();
            let [(cameras, cause)] = &causes[..] else {
                panic!("camera {camera} by {moved_m:?}: {causes:?}");
            };
            assert_eq!(*cameras, names(&[camera]), "{moved_m:?}: {cause:?}");
            let DisagreementCause::Moved { distance_m, .. } = cause else {
                panic!("camera {camera} by {moved_m:?}: {cause:?}");
            };
            assert!(
                (distance_m - expected_m).abs() < 0.4 * expected_m,
                "camera {camera} by {moved_m:?}: {distance_m}"
            );
        }
    }
}

#[test]
fn a_move_of_five_centimetres_is_not_reported_as_another_lens() {
    for moved_m in [[0.05, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, -0.05]] {
        let mistake = Mistake {
            moved_m,
            ..Mistake::default()
        };
        for camera in 0..4 {
            let causes = Hall::with(camera, mistake).causes();
            let [(cameras, cause)] = &causes[..] else {
                panic!("camera {camera} by {moved_m:?}: {causes:?}");
            };
            assert_eq!(*cameras, names(&[camera]), "{moved_m:?}: {cause:?}");
            let is_rigid = matches!(
                cause,
                DisagreementCause::Moved { .. } | DisagreementCause::Turned { .. }
            );
            assert!(is_rigid, "camera {camera} by {moved_m:?}: {cause:?}");
        }
    }
}

#[test]
fn crops_of_another_person_do_not_turn_a_camera_with_valid_sightings() {
    let mistake = Mistake {
        crops_of_the_other: true,
        ..Mistake::default()
    };
    for camera in 0..4 {
        let causes = Hall::with(camera, mistake).causes();
        assert!(causes.is_empty(), "camera {camera}: {causes:?}");
    }
}

/// The report on a hall with people who stand still. The second camera has one mistake in crops and another in sightings.
fn still(crops: Mistake, sightings: Mistake) -> AgreementReport {
    let samples = |mistake: Mistake| {
        let mut hall = Hall::with(1, mistake);
        hall.still = true;
        hall.samples()
    };
    let mut all = samples(crops);
    all.samples.passes = samples(sightings).samples.passes;
    all.report()
}

#[test]
fn a_zoom_in_crops_alone_is_not_reported_if_people_stand_still() {
    let zoomed = Mistake {
        focal_factor: 0.8,
        ..Mistake::default()
    };
    let both = still(zoomed, zoomed).disagreements;
    assert!(
        matches!(&both[..], [one] if matches!(one.cause, DisagreementCause::FocalLength { .. })),
        "{both:?}"
    );
    assert_eq!(still(zoomed, Mistake::default()).disagreements, []);
}

#[test]
fn a_camera_with_another_person_is_reported_unless_at_one_moment() {
    let mut hall = Hall {
        still: true,
        ..Hall::default()
    };
    for (camera, (_, mistake)) in hall.shows.iter_mut().enumerate() {
        mistake.sees_only = Some(usize::from(camera == 2));
    }
    let mut samples = hall.samples();
    let all = samples.report().disagreements;
    assert!(
        matches!(&all[..], [one] if one.cameras == names(&[2])),
        "{all:?}"
    );
    for (tick, pass) in (0..).zip(&mut samples.samples.passes) {
        *pass = Arc::new(PassSample {
            tick: Tick(tick),
            ..PassSample::clone(pass)
        });
    }
    let of_a_moment = samples.report();
    assert_eq!(of_a_moment.disagreements, []);
    let verdicts = of_a_moment.cameras.values().map(|of| of.verdict);
    assert_eq!(
        verdicts.collect::<Vec<_>>(),
        [Agrees, Agrees, Unknown, Agrees]
    );
}

#[test]
fn a_knocked_camera_is_reported_as_moved_or_turned() {
    let mistake = Mistake {
        moved_m: [0.06, -0.05, 0.02],
        turned_deg: [0.5, 1.0, 0.4],
        ..Mistake::default()
    };
    for camera in 0..4 {
        let causes = Hall::with(camera, mistake).causes();
        let [(cameras, cause)] = &causes[..] else {
            panic!("camera {camera}: {causes:?}");
        };
        assert_eq!(*cameras, names(&[camera]));
        let is_rigid = matches!(
            cause,
            DisagreementCause::Moved { .. } | DisagreementCause::Turned { .. }
        );
        assert!(is_rigid, "camera {camera}: {cause:?}");
    }
}

#[test]
fn a_roll_of_three_degrees_is_reported() {
    let mistake = Mistake {
        turned_deg: [0.0, 0.0, 3.0],
        ..Mistake::default()
    };
    for camera in 0..4 {
        let causes = Hall::with(camera, mistake).causes();
        let [(cameras, DisagreementCause::Turned { degrees })] = &causes[..] else {
            panic!("camera {camera}: {causes:?}");
        };
        assert_eq!(*cameras, names(&[camera]));
        assert!((degrees - 3.0).abs() < 0.3, "{degrees}");
    }
}

#[test]
fn a_small_zoom_and_a_delay_are_not_reported_as_a_move() {
    let zoomed = Mistake {
        focal_factor: 1.05,
        ..Mistake::default()
    };
    let late = Mistake {
        late_ticks: 3,
        ..Mistake::default()
    };
    for camera in 0..4 {
        let causes = Hall::with(camera, zoomed).causes();
        let [(cameras, DisagreementCause::FocalLength { factor })] = &causes[..] else {
            panic!("camera {camera}: {causes:?}");
        };
        assert_eq!(*cameras, names(&[camera]));
        assert!((factor - 1.05).abs() < 0.02, "{factor}");
        let causes = Hall::with(camera, late).causes();
        assert!(
            matches!(&causes[..], [(_, DisagreementCause::Late { .. })]),
            "camera {camera}: {causes:?}"
        );
    }
}

#[test]
fn moves_of_all_cameras_are_not_reported_one_by_one() {
    let mut hall = Hall::default();
    for (camera, (_, mistake)) in hall.shows.iter_mut().enumerate() {
        mistake.moved_m[camera % 2] = 0.1;
    }
    let of_moved = |(_, cause): &(Vec<String>, DisagreementCause)| {
        matches!(cause, DisagreementCause::Moved { .. })
    };
    let causes = hall.causes();
    assert!(
        causes.iter().filter(|it| of_moved(it)).count() <= 1,
        "{causes:?}"
    );
}

#[test]
fn a_zoom_or_a_turn_is_reported_if_people_stay_at_one_place() {
    let zoomed = Mistake {
        focal_factor: 0.8,
        ..Mistake::default()
    };
    let turned = Mistake {
        turned_deg: [0.0, 3.0, 0.0],
        ..Mistake::default()
    };
    for mistake in [zoomed, turned] {
        let hall = Hall {
            still: true,
            ..Hall::with(1, mistake)
        };
        let causes = hall.causes();
        let [(cameras, cause)] = &causes[..] else {
            panic!("{causes:?}");
        };
        assert_eq!(*cameras, names(&[1]));
        let is_reported = match cause {
            DisagreementCause::FocalLength { factor } => (factor - 0.8).abs() < 0.03,
            DisagreementCause::Turned { degrees } => (degrees - 3.0).abs() < 0.3,
            _ => false,
        };
        assert!(is_reported, "{cause:?}");
    }
}
