//! What is said of a camera that was moved, turned or zoomed a little, or has the lens of another in the calibration.

use nalgebra::Vector3;

use super::super::fixture::{Hall, Mistake, names};
use super::super::samples::PassSample;
use super::AgreementVerdict::{Agrees, Unknown};
use super::*;

#[test]
fn a_camera_that_was_moved_by_some_centimetres_is_told_to_a_third() {
    // Straight ahead it is a zoom or a bend as well.
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
fn a_camera_that_was_moved_by_a_hand_s_breadth_has_no_other_lens() {
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
fn crops_that_show_somebody_else_turn_no_camera_whose_sightings_meet_those_of_the_others() {
    let mistake = Mistake {
        crops_of_the_other: true,
        ..Mistake::default()
    };
    for camera in 0..4 {
        let causes = Hall::with(camera, mistake).causes();
        assert!(causes.is_empty(), "camera {camera}: {causes:?}");
    }
}

/// A hall in which nobody moves, of whose second camera crops and sightings say this.
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
fn where_nobody_moves_a_zoom_that_only_crops_show_is_not_told() {
    let zoomed = Mistake {
        focal_factor: 0.8,
        ..Mistake::default()
    };
    let both = still(zoomed, zoomed).disagreements;
    assert!(
        matches!(&both[..], [told] if matches!(told.cause, DisagreementCause::FocalLength { .. })),
        "{both:?}"
    );
    assert_eq!(still(zoomed, Mistake::default()).disagreements, []);
}

#[test]
fn a_camera_that_shows_somebody_else_is_told_of_unless_all_is_of_one_moment() {
    let mut hall = Hall {
        still: true,
        ..Hall::default()
    };
    for (camera, (_, mistake)) in hall.shows.iter_mut().enumerate() {
        mistake.sees_only = Some(usize::from(camera == 2));
    }
    let mut samples = hall.samples();
    let told = samples.report().disagreements;
    assert!(
        matches!(&told[..], [told] if told.cameras == names(&[2])),
        "{told:?}"
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
fn a_camera_that_was_knocked_is_told_by_both() {
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
        let is_told = matches!(
            cause,
            DisagreementCause::Moved { .. } | DisagreementCause::Turned { .. }
        );
        assert!(is_told, "camera {camera}: {cause:?}");
    }
}

#[test]
fn a_roll_of_three_degrees_is_told() {
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
fn a_zoom_of_a_twentieth_is_no_move_and_a_late_camera_has_not_moved() {
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
fn all_cameras_that_were_moved_are_not_each_told_of() {
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
