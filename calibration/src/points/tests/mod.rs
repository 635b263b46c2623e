//! Calibration from a moving point on simulated fields.

mod board;
mod faults;
mod pictures;
mod real;
pub(crate) mod simulated;

use farfield_proto::camera::{Intrinsics, LensModel};
use farfield_proto::court::Court;

use self::simulated::{Errors, Field, HALL, PITCH, SMALL, USUAL, cameras, request, worst};
use super::*;
use crate::adjustment::CameraState;
use crate::alignment::{Known, KnownDistance, KnownMark, Marks};

fn quiet(request: &PointRequest) -> Result<PointCalibration, CalibrationError> {
    calibrate(request, &mut |_| ())
}

fn at_rate(field: &Field, rate_hz: f64) -> Vec<CameraState> {
    let mut states = cameras(field);
    for state in &mut states {
        state.period_s = 1.0 / rate_hz;
    }
    states
}

/// Adds the true distance of the first two cameras, and the true positions of all.
fn with_scale(mut request: PointRequest, truth: &[CameraState]) -> PointRequest {
    request.anchors.distances = vec![KnownDistance {
        first: "c0".to_owned(),
        second: "c1".to_owned(),
        distance_m: (truth[0].center_w - truth[1].center_w).norm(),
    }];
    let named = request.cameras.iter().zip(truth);
    request.anchors.centers_m = named
        .map(|(camera, state)| (camera.name.clone(), state.center_w.into()))
        .collect();
    request
}

fn found_states(found: &PointCalibration) -> Vec<CameraState> {
    found.cameras.iter().map(|c| c.state).collect()
}

/// Largest accepted errors of a camera, metres and degrees.
const BARS: [(Field, f64, f64); 3] = [
    (SMALL, 0.0015, 0.006),
    (HALL, 0.004, 0.008),
    (PITCH, 0.040, 0.015),
];

#[test]
fn fields_of_three_sizes_are_calibrated_without_a_start() {
    for (field, bar_m, bar_deg) in BARS {
        for lenses in [Lenses::Given, Lenses::Focal] {
            let truth = at_rate(&field, 10.0);
            let mut request = with_scale(
                request(&field, &truth, &USUAL, Timing::Synchronised),
                &truth,
            );
            request.lenses = lenses;
            let found = quiet(&request).unwrap();
            let (off_m, off_deg) = worst(&found_states(&found), &truth);
            println!(
                "{:?} {lenses:?}: {off_m:.5} m {off_deg:.5} deg",
                field.size_m
            );
            for finding in &found.report.findings {
                println!("  {finding}");
            }
            assert!(off_m < bar_m && off_deg < bar_deg);
            assert!(found.report.passes(), "{:?}", found.report.findings);
        }
    }
}

#[test]
fn clicked_marks_align_the_cameras_and_a_wrong_one_is_reported() {
    let truth = at_rate(&HALL, 10.0);
    let mut request = request(&HALL, &truth, &USUAL, Timing::Synchronised);
    let court = Court::of("volleyball", None).unwrap();
    let mut known: Vec<KnownMark> = Vec::new();
    for mark in &court.marks {
        let seen = request
            .cameras
            .iter()
            .zip(&truth)
            .filter_map(|(camera, state)| {
                let px = state.project(&mark.position_m.into(), state.fold_radius())?;
                let is_inside = (0.0..1920.0).contains(&px.x) && (0.0..1200.0).contains(&px.y);
                is_inside.then(|| (camera.name.clone(), [px.x.round(), px.y.round()]))
            });
        known.push(KnownMark {
            name: mark.name.clone(),
            known: Known::Place(mark.position_m),
            clicks: seen.collect(),
        });
    }
    known[3].clicks[2].1[1] += 60.0;
    let (name, camera) = (known[3].name.clone(), known[3].clicks[2].0.clone());
    request.anchors.marks = Some(Marks {
        court: None,
        known,
        floor: Vec::new(),
        lengths: Vec::new(),
        click_sigma_px: 1.0,
        place_sigma_m: 0.005,
    });
    let found = quiet(&request).unwrap();
    for (camera, state) in found.cameras.iter().zip(&truth) {
        let off_m = (camera.state.center_w - state.center_w).norm();
        assert!(off_m < 0.01, "{}: {off_m}", camera.name);
    }
    assert!(found.report.passes(), "{:?}", found.report.findings);
    let findings: Vec<String> = found
        .report
        .findings
        .iter()
        .map(ToString::to_string)
        .collect();
    let expected = format!("`{name}` in camera `{camera}`");
    assert!(
        findings.iter().any(|it| it.contains(&expected)),
        "{findings:?}"
    );
}

#[test]
fn a_camera_with_few_sights_does_not_reduce_the_accuracy() {
    let truth = at_rate(&HALL, 10.0);
    let errors = Errors {
        last_camera_share: 0.2,
        ..USUAL
    };
    let request = request(&HALL, &truth, &errors, Timing::Synchronised);
    let found = quiet(&request).unwrap();
    let (off_m, off_deg) = worst(&found_states(&found), &truth);
    println!("a fifth: {off_m:.5} m {off_deg:.5} deg");
    assert!(off_m < 0.006 && off_deg < 0.012, "{off_m} {off_deg}");
}

#[test]
fn cameras_with_unknown_clocks_are_calibrated() {
    let mut truth = at_rate(&HALL, 25.0);
    for (i, state) in truth.iter_mut().enumerate() {
        state.pivot_s = 1.3 * (i as f64) - 5.0 + 0.013 * (i * i) as f64;
        state.period_s *= 1.0 + 2e-5 * (i as f64 - 3.0);
    }
    truth.truncate(5);
    let mut request = request(&HALL, &truth, &USUAL, Timing::Unknown);
    for camera in &mut request.cameras {
        camera.rate_hz = Some(25.0);
        camera.offset_s = None;
    }
    let found = quiet(&request).unwrap();
    let states = found_states(&found);
    let (off_m, off_deg) = worst(&states, &truth);
    println!("unknown clocks: {off_m:.5} m {off_deg:.5} deg");
    // Relative to the first camera, whose clock is as good as any.
    let behind_s = |states: &[CameraState], i: usize| {
        (states[i].time_s(1000.0) - states[0].time_s(1000.0)) * 25.0
    };
    for i in 1..truth.len() {
        let frames_off = behind_s(&states, i) - behind_s(&truth, i);
        assert!(
            frames_off.abs() < 0.01,
            "camera {i} is off by {frames_off} frames"
        );
    }
    assert!(off_m < 0.006 && off_deg < 0.012, "{off_m} {off_deg}");
}

#[test]
fn the_same_request_gives_the_same_bits() {
    let truth = at_rate(&SMALL, 5.0);
    let request = request(&SMALL, &truth, &USUAL, Timing::Synchronised);
    assert_eq!(
        quiet(&request).unwrap().toml().unwrap(),
        quiet(&request).unwrap().toml().unwrap()
    );
}

#[test]
fn unusable_requests_are_refused_before_any_search() {
    type Spoil = fn(&mut PointRequest);
    let truth = at_rate(&SMALL, 5.0);
    let sound = request(&SMALL, &truth, &USUAL, Timing::Synchronised);
    let cases: [(&str, Spoil); 8] = [
        ("`gate_px`: found NaN", |it| it.gate_px = f64::NAN),
        ("`gate_px`: found -1", |it| it.gate_px = -1.0),
        ("`gate_px`: found inf", |it| it.gate_px = f64::INFINITY),
        ("expected whole frames", |it| {
            it.cameras[1].sightings[3].frame += 0.25;
        }),
        ("known place of `c0`", |it| {
            it.anchors.centers_m = vec![("c0".to_owned(), [0.0, f64::NAN, 1.0])];
        }),
        ("give three places, or a distance", |it| {
            it.anchors.centers_m = vec![("c0".to_owned(), [0.0, 1.0, 1.0])];
        }),
        ("`c0` to itself", |it| {
            it.anchors.distances = vec![distance("c0", "c0", 1.0)];
        }),
        ("expected a finite number above 0", |it| {
            it.anchors.distances = vec![distance("c0", "c1", f64::INFINITY)];
        }),
    ];
    for (expected, spoil) in cases {
        let mut spoiled = sound.clone();
        spoil(&mut spoiled);
        let error = quiet(&spoiled).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

fn distance(first: &str, second: &str, distance_m: f64) -> KnownDistance {
    KnownDistance {
        first: first.to_owned(),
        second: second.to_owned(),
        distance_m,
    }
}

/// Gives every second camera a fisheye that sees 150 degrees across its picture.
pub(crate) fn with_fisheyes(states: &mut [CameraState]) {
    for state in states.iter_mut().step_by(2) {
        let wide = CameraState::at_origin(
            Intrinsics {
                fx_px: 730.0,
                fy_px: 730.0,
                ..state.intrinsics
            },
            LensModel::KannalaBrandt([-0.02, 0.005, -0.002, 0.0003]),
        );
        state.intrinsics = wide.intrinsics;
        (state.distortion, state.is_fisheye) = (wide.distortion, wide.is_fisheye);
    }
}

#[test]
fn fisheyes_among_others_are_calibrated_without_a_start() {
    let mut truth = at_rate(&SMALL, 10.0);
    with_fisheyes(&mut truth);
    let seen = request(&SMALL, &truth, &USUAL, Timing::Synchronised);
    for lenses in [Lenses::Given, Lenses::Focal, Lenses::All] {
        let mut request = with_scale(seen.clone(), &truth);
        request.lenses = lenses;
        if lenses == Lenses::All {
            // Given to one percent.
            for camera in &mut request.cameras {
                camera.intrinsics.fx_px *= 1.01;
                camera.intrinsics.fy_px *= 1.01;
                if let LensModel::KannalaBrandt(k) = &mut camera.lens {
                    k[0] += 0.01;
                }
            }
        }
        let found = quiet(&request).unwrap();
        let (off_m, off_deg) = worst(&found_states(&found), &truth);
        println!("fisheyes, {lenses:?}: {off_m:.5} m {off_deg:.5} deg");
        // The bars of other lenses, doubled: a pixel of these is 1.5 times as wide. If the principal point is free too, the
        // camera turns with it: one pixel of it is 0.08 degrees.
        let most_deg = if lenses == Lenses::All {
            0.1
        } else {
            2.0 * BARS[0].2
        };
        assert!(off_m < 2.0 * BARS[0].1 && off_deg < most_deg, "{lenses:?}");
        assert!(found.report.passes(), "{:?}", found.report.findings);
        let written = found.toml().unwrap();
        assert_eq!(written.matches("fisheye = true").count(), 4, "{written}");
    }
}
