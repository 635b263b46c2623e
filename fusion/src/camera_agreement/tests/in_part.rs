//! Cameras that show another time for a part of the time.

use super::super::fixture::{Hall, Mistake};
use super::*;

/// Four bursts of ten seconds, of which the second camera is late in the middle two.
fn late_in_the_middle() -> Hall {
    let mistake = Mistake {
        late_ticks: 12,
        in_bursts: Some([1, 2]),
        ..Mistake::default()
    };
    let mut hall = Hall::with(1, mistake);
    hall.bursts = 4;
    hall
}

fn assert_told(hall: &Hall) {
    let report = hall.report();
    let [told] = &report.disagreements[..] else {
        panic!("{:?}", report.disagreements);
    };
    assert_eq!(told.cameras, ["cam1"]);
    assert!(
        matches!(told.cause, DisagreementCause::Late { ticks } if (ticks - 12.0).abs() < 0.6),
        "{told:?}"
    );
    let [from, to] = told.part_ticks.unwrap();
    assert!((90..=600).contains(&from), "{from}");
    assert!((1290..=1800).contains(&to), "{to}");
    assert!(
        told.found.starts_with("between about ticks"),
        "{}",
        told.found
    );
}

#[test]
fn a_camera_that_lost_frames_before_all_others_did_is_named_with_both_moments() {
    assert_told(&late_in_the_middle());
}

#[test]
fn sightings_alone_tell_it_too() {
    let mut hall = late_in_the_middle();
    // Too short together to tell anything.
    hall.burst_ticks = 10;
    assert_told(&hall);
}
