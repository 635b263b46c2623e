//! Halls whose cameras are of two worlds, or of one that is too short along an axis.

use super::super::super::fixture::{Hall, Mistake, names};
use super::super::super::report::{DisagreementCause, FloorAxis};
use super::told_by_feet;
use crate::sightings::fixture::hall;

/// What is said of the hall where each camera stands so far from where it is calibrated, by where that is, metres.
fn told(moved_m: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<(Vec<String>, DisagreementCause)> {
    let cameras = hall().cameras;
    let mut hall = Hall {
        bursts: 4,
        ..Hall::default()
    };
    for ((_, mistake), (_, model)) in hall.shows.iter_mut().zip(&cameras) {
        let center_m = model.center().coordinates_m();
        mistake.moved_m = moved_m([center_m.x, center_m.y, center_m.z]);
    }
    hall.causes()
}

#[test]
fn a_direction_that_was_measured_too_short_is_named_with_how_much() {
    for (x, y) in [(0.9, 1.0), (1.0, 0.9), (1.0, 0.95), (1.05, 1.0)] {
        let told = told(|[at_x, at_y, _]| [at_x * (1.0 / x - 1.0), at_y * (1.0 / y - 1.0), 0.0]);
        let [(cameras, DisagreementCause::AxisScale { x_over_y, axis })] = &told[..] else {
            panic!("{x} {y}: {told:?}");
        };
        assert!(cameras.is_empty());
        assert!((x_over_y - x / y).abs() < 0.015, "{x} {y}: {told:?}");
        // By cameras 2.5 m high feet are 0.25 m off where a tenth is mended along the wrong axis, and half of it where it is a twentieth.
        let expected = if (x - 1.0_f64).abs() > 0.0 {
            FloorAxis::X
        } else {
            FloorAxis::Y
        };
        let is_tenth = x.min(y) < 0.91;
        assert!(axis.is_some() || !is_tenth, "{x} {y}: {told:?}");
        assert!(axis.is_none_or(|it| it == expected), "{x} {y}: {told:?}");
    }
}

#[test]
fn the_axis_is_wrong_with_which_feet_are_on_the_floor() {
    assert_eq!(told_by_feet(0.02, 0.15), Some(FloorAxis::X));
    assert_eq!(told_by_feet(-0.3, -0.08), Some(FloorAxis::Y));
    for of_nobody in [(0.05, -0.12), (0.0, 0.0), (0.3, 0.6), (0.25, -0.2)] {
        assert_eq!(
            told_by_feet(of_nobody.0, of_nobody.1),
            None,
            "{of_nobody:?}"
        );
    }
}

#[test]
fn half_of_the_cameras_with_another_origin_are_named_with_how_far_it_is() {
    for (by_m, apart_m) in [
        ([0.1, 0.0, 0.0], 0.1),
        ([0.06, -0.06, 0.0], 0.085),
        ([0.0, 0.0, 0.15], 0.15),
    ] {
        // Those of the one long side.
        let told = told(|[_, y, _]| if y > 0.0 { by_m } else { [0.0; 3] });
        let [(cameras, DisagreementCause::TwoOrigins { apart_m: found_m })] = &told[..] else {
            panic!("{by_m:?}: {told:?}");
        };
        assert_eq!(cameras, &of_far_side(), "{told:?}");
        assert!((found_m - apart_m).abs() < 0.02, "{by_m:?}: {told:?}");
    }
}

/// The cameras on the far side of the hall.
fn of_far_side() -> Vec<String> {
    let cameras = hall().cameras.into_iter().enumerate();
    let far = cameras.filter(|(_, (_, model))| model.center().coordinates_m().y > 0.0);
    names(&far.map(|(camera, _)| camera).collect::<Vec<usize>>())
}

#[test]
fn one_camera_that_was_moved_or_is_late_is_no_other_world() {
    let mistakes = [
        Mistake {
            moved_m: [0.15, 0.0, 0.0],
            ..Mistake::default()
        },
        Mistake {
            late_ticks: 12,
            ..Mistake::default()
        },
    ];
    for mistake in mistakes {
        let causes = Hall::with(1, mistake).causes();
        assert_eq!(causes.len(), 1, "{causes:?}");
        assert_eq!(causes[0].0, names(&[1]), "{causes:?}");
    }
    assert_eq!(told(|_| [0.0; 3]), []);
    // All that is larger or elsewhere alike is nothing that lines of sight tell.
    assert_eq!(told(|at_m| at_m.map(|m| 0.02 * m)), []);
}

#[test]
fn whichever_camera_was_moved_along_whichever_axis_nothing_is_told_of_all() {
    for camera in 0..hall().cameras.len() {
        for axis in 0..3 {
            let mut mistake = Mistake::default();
            mistake.moved_m[axis] = 0.15;
            let causes = Hall::with(camera, mistake).causes();
            let is_of_several =
                |(cameras, _): &(Vec<String>, DisagreementCause)| cameras.len() != 1;
            assert!(
                !causes.iter().any(is_of_several),
                "{camera} {axis}: {causes:?}"
            );
            assert!(!causes.is_empty(), "{camera} {axis}");
        }
    }
}
