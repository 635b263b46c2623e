//! Calibration from people on simulated fields and on recordings.

mod faults;
mod measured;
mod planted;
mod shelf;
mod simulated;

use self::simulated::{Field, HALL, PITCH, SMALL, USUAL, Walk, cameras, request, worst};
use super::*;
use crate::adjustment::CameraState;
use crate::points::{PointCalibration, Timing};

fn quiet(request: &PeopleRequest) -> Result<PointCalibration, PeopleError> {
    calibrate(request, &mut |_| ())
}

fn found_states(found: &PointCalibration) -> Vec<CameraState> {
    found.cameras.iter().map(|c| c.state).collect()
}

fn print_report(found: &PointCalibration) {
    for c in &found.report.cameras {
        println!(
            "  {}: {} sights, {:.0} % used, rms {:.2} px, noise {:.2} px, sigma {:.4} m {:.4} deg, halves {:.4} m {:.4} deg, {:.2} px {:.4} m; {:.0} % empty",
            c.name,
            c.sights,
            100.0 * c.used_share,
            c.rms_px,
            c.noise_px,
            c.position_sigma_m,
            c.rotation_sigma_deg,
            c.halves_m,
            c.halves_deg,
            c.halves_px,
            c.halves_across_m,
            100.0 * c.coverage.empty_share(),
        );
    }
    for finding in &found.report.findings {
        println!(
            "  {} {finding}",
            if finding.is_wrong() { "WRONG" } else { "-" }
        );
    }
}

fn run(field: &Field, walk: &Walk) -> (f64, f64) {
    let truth = cameras(field);
    let found = quiet(&request(field, &truth, walk)).unwrap();
    print_report(&found);
    let (off_m, off_deg) = worst(&found_states(&found), &truth);
    println!("{:?}: {off_m:.4} m {off_deg:.4} deg", field.size_m);
    (off_m, off_deg)
}

#[test]
fn a_small_field_is_calibrated_from_people_alone() {
    let walk = Walk {
        seconds: 20.0,
        ..USUAL
    };
    let (off_m, off_deg) = run(&SMALL, &walk);
    // The bars are for two minutes, six times as long.
    assert!(off_m < 0.016 && off_deg < 0.08);
}

#[test]
fn a_small_field_with_some_fisheyes_is_calibrated_from_people_alone() {
    let walk = Walk {
        seconds: 20.0,
        ..USUAL
    };
    let mut truth = cameras(&SMALL);
    crate::points::tests::with_fisheyes(&mut truth);
    let found = quiet(&request(&SMALL, &truth, &walk)).unwrap();
    let (off_m, off_deg) = worst(&found_states(&found), &truth);
    println!("fisheyes: {off_m:.4} m {off_deg:.4} deg");
    assert!(off_m < 0.02 && off_deg < 0.1);
}

/// Required accuracy after two minutes, metres and degrees; that of the last field is only printed.
const BARS: [(Field, f64, f64); 3] = [
    (SMALL, 0.008, 0.04),
    (HALL, 0.015, 0.03),
    (PITCH, f64::INFINITY, f64::INFINITY),
];

/// `FARFIELD_MEASURE=1 cargo test -p farfield-calibration --lib two_minutes -- --nocapture`
#[test]
fn two_minutes_of_four_people_on_fields_of_three_sizes() {
    if std::env::var_os("FARFIELD_MEASURE").is_none() {
        println!("skipped: takes minutes; FARFIELD_MEASURE=1 runs it");
        return;
    }
    for (field, bar_m, bar_deg) in BARS {
        // In the second run errors are correlated over many frames, as those of networks are.
        for held_share in [0.0, 0.8] {
            let walk = Walk {
                seconds: 120.0,
                held_share,
                ..USUAL
            };
            println!(
                "{:.0} % of the noise stays for a second",
                100.0 * held_share
            );
            let (off_m, off_deg) = run(&field, &walk);
            assert!(off_m < bar_m && off_deg < bar_deg);
        }
    }
}

/// As with videos: networks process one of several frames, which keep their numbers.
#[test]
fn manually_started_videos_are_calibrated_from_every_fourth_frame() {
    let mut truth = cameras(&Field {
        cameras: 4,
        ..SMALL
    });
    for (i, state) in truth.iter_mut().enumerate() {
        state.pivot_s = 1.37 * i as f64 - 2.0;
        state.period_s = 1.0 / 20.0;
    }
    let walk = Walk {
        seconds: 40.0,
        ..USUAL
    };
    let mut request = request(&SMALL, &truth, &walk);
    request.timing = Timing::Unknown;
    for camera in &mut request.cameras {
        camera.rate_hz = Some(20.0);
        // And one stray frame, as in a file that was put together by hand.
        camera
            .frames
            .retain(|it| it.frame as i64 % 4 == 0 || it.frame as i64 == 401);
    }
    let found = quiet(&request).unwrap();
    print_report(&found);
    let states = found_states(&found);
    assert_eq!(states.len(), truth.len());
    let (off_m, off_deg) = worst(&states, &truth);
    println!("one frame of four: {off_m:.4} m {off_deg:.4} deg");
    assert!(off_m < 0.016 && off_deg < 0.1, "{off_m} {off_deg}");

    for camera in &mut request.cameras {
        camera.frames.retain(|it| it.frame as i64 % 8 == 0);
    }
    let message = quiet(&request).unwrap_err().to_string();
    assert!(message.contains("found 2.5 frames per second"), "{message}");
}

#[test]
fn manually_started_cameras_are_calibrated_with_their_clocks() {
    let mut truth = cameras(&Field {
        cameras: 5,
        ..SMALL
    });
    for (i, state) in truth.iter_mut().enumerate() {
        state.pivot_s = 1.37 * i as f64 - 2.0;
        state.period_s = if i == 2 { 1.0 / 25.0 } else { 1.0 / 20.0 };
    }
    let walk = Walk {
        seconds: 25.0,
        ..USUAL
    };
    let mut request = request(&SMALL, &truth, &walk);
    request.timing = Timing::Unknown;
    for (camera, state) in request.cameras.iter_mut().zip(&truth) {
        camera.rate_hz = Some(1.0 / state.period_s);
    }
    let found = quiet(&request).unwrap();
    print_report(&found);
    let states = found_states(&found);
    assert_eq!(states.len(), truth.len());
    let behind_s = |states: &[CameraState], i: usize| {
        let time_s = |i: usize| {
            let state = &states[i];
            state.time_s(10.0 / truth[i].period_s)
        };
        time_s(i) - time_s(0)
    };
    for i in 1..truth.len() {
        let off_s = behind_s(&states, i) - behind_s(&truth, i);
        println!("c{i}: its clock is off by {:.2} ms", 1000.0 * off_s);
        assert!(off_s.abs() < 0.010, "{off_s}");
    }
    let (off_m, off_deg) = worst(&states, &truth);
    println!("unknown clocks: {off_m:.4} m {off_deg:.4} deg");
    assert!(off_m < 0.016 && off_deg < 0.1);
}
