//! Planted faults: mistakes of users are reported, and such calibrations fail.

use nalgebra::Vector3;

use super::*;
use crate::alignment::{Known, KnownDistance, KnownMark, Marks};
use crate::report::Cause;

/// Short, so that many can be tried.
const SHORT: Walk = Walk {
    seconds: 16.0,
    ..USUAL
};

fn six() -> Vec<CameraState> {
    cameras(&Field {
        cameras: 6,
        ..SMALL
    })
}

/// Whether the report has an error with `cause` about `camera` ("": all cameras).
fn has_error(found: &PointCalibration, camera: &str, cause: Cause) -> bool {
    let mut findings = found.report.findings.iter();
    findings.any(|it| {
        it.is_wrong() && it.cause == cause && it.camera.as_deref().unwrap_or("") == camera
    })
}

#[test]
fn a_good_calibration_passes_with_correct_floor_and_scale() {
    let truth = six();
    let found = quiet(&request(&SMALL, &truth, &SHORT)).unwrap();
    print_report(&found);
    assert!(found.report.passes(), "{:?}", found.report.findings);
    for (found, truth) in found.cameras.iter().zip(&truth) {
        let off_m = found.state.center_w.z - truth.center_w.z;
        println!("{}: {off_m:.3} m too high", found.name);
        assert!(off_m.abs() < 0.06, "{off_m}");
    }
    let scale = |a: usize, b: usize| {
        let here = (found.cameras[a].state.center_w - found.cameras[b].state.center_w).norm();
        here / (truth[a].center_w - truth[b].center_w).norm()
    };
    println!("scale {:.4} {:.4}", scale(0, 3), scale(1, 4));
    assert!((scale(0, 3) - 1.0).abs() < 0.03);
}

#[test]
fn a_known_distance_gives_the_scale() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    request.stature_m = None;
    let distance_m = (truth[0].center_w - truth[3].center_w).norm();
    request.anchors.distances = vec![KnownDistance {
        first: "c0".to_owned(),
        second: "c3".to_owned(),
        distance_m,
    }];
    let found = quiet(&request).unwrap();
    assert!(found.report.passes(), "{:?}", found.report.findings);
    let here_m = (found.cameras[1].state.center_w - found.cameras[4].state.center_w).norm();
    let true_m = (truth[1].center_w - truth[4].center_w).norm();
    assert!((here_m / true_m - 1.0).abs() < 0.002, "{here_m} {true_m}");
}

#[test]
fn a_calibration_without_scale_fails() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    request.stature_m = None;
    let found = quiet(&request).unwrap();
    assert!(has_error(&found, "", Cause::NoScale));
}

#[test]
fn a_straight_walk_is_reported() {
    let truth = six();
    let walk = Walk {
        people: 1,
        extent: [0.01, 1.0],
        ..SHORT
    };
    match quiet(&request(&SMALL, &truth, &walk)) {
        Ok(found) => {
            print_report(&found);
            assert!(has_error(&found, "", Cause::Walk));
        }
        // It is also correct that there is no result.
        Err(error) => assert!(
            matches!(error, PeopleError::NothingAgrees { .. }),
            "{error}"
        ),
    }
}

#[test]
fn a_mirrored_video_is_reported() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    let width = f64::from(request.cameras[2].size_px[0]);
    for frame in &mut request.cameras[2].frames {
        for body in &mut frame.bodies {
            // In a mirrored picture networks exchange left and right.
            for pair in body.keypoints[1..].chunks_exact_mut(2) {
                pair.swap(0, 1);
            }
            for keypoint in body.keypoints.iter_mut().flatten() {
                keypoint.px[0] = width - keypoint.px[0];
            }
        }
    }
    let found = quiet(&request).unwrap();
    print_report(&found);
    assert!(has_error(&found, "c2", Cause::Handedness));
}

#[test]
fn a_camera_without_shared_people_is_reported() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    // It was started after all others had been stopped.
    for frame in &mut request.cameras[4].frames {
        frame.frame += 1000.0;
    }
    let found = quiet(&request).unwrap();
    print_report(&found);
    assert!(has_error(&found, "c4", Cause::NotConnected));
}

#[test]
fn a_late_camera_fails() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    for frame in &mut request.cameras[1].frames {
        frame.frame += 8.0;
    }
    let found = quiet(&request).unwrap();
    print_report(&found);
    let mut own = found.report.findings.iter();
    assert!(own.any(|it| it.is_wrong() && it.camera.as_deref() == Some("c1")));
}

#[test]
fn a_camera_that_was_knocked_half_way_is_reported() {
    // By two degrees and by half a degree.
    for by_px in [38.0, 9.6] {
        knocked_half_way(by_px);
    }
}

fn knocked_half_way(by_px: f64) {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    for frame in request.cameras[3]
        .frames
        .iter_mut()
        .filter(|it| it.frame >= 80.0)
    {
        let seen = frame
            .bodies
            .iter_mut()
            .flat_map(|it| it.keypoints.iter_mut());
        for keypoint in seen.flatten() {
            keypoint.px[0] += by_px;
        }
    }
    let found = quiet(&request).unwrap();
    print_report(&found);
    let mut own = found.report.findings.iter();
    assert!(own.any(|it| it.is_wrong() && it.camera.as_deref() == Some("c3")));
}

#[test]
fn a_wrong_focal_length_fails() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    request.cameras[0].intrinsics.fx_px *= 1.25;
    request.cameras[0].intrinsics.fy_px *= 1.25;
    let found = quiet(&request).unwrap();
    print_report(&found);
    let mut own = found.report.findings.iter();
    assert!(own.any(|it| it.is_wrong() && it.camera.as_deref() == Some("c0")));
}

#[test]
fn exchanged_places_fail() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    request.anchors.centers_m = (0..6)
        .map(|i| {
            let at = if i == 0 {
                1
            } else if i == 1 {
                0
            } else {
                i
            };
            (format!("c{i}"), truth[at].center_w.into())
        })
        .collect();
    let passes = quiet(&request).is_ok_and(|found| found.report.passes());
    assert!(!passes);
}

#[test]
fn places_that_put_cameras_under_the_floor_fail() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    let lowered = |state: &CameraState| state.center_w - Vector3::z() * 4.0;
    request.anchors.centers_m = truth
        .iter()
        .enumerate()
        .map(|(i, state)| (format!("c{i}"), lowered(state).into()))
        .collect();
    let found = quiet(&request).unwrap();
    print_report(&found);
    assert!(has_error(&found, "c0", Cause::UnderFloor));
    assert!(has_error(&found, "", Cause::Anchors));
}

/// Calibrates with the known places of all cameras changed by `moved`.
fn with_places(moved: fn(Vector3<f64>) -> Vector3<f64>) -> PointCalibration {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    let places = truth.iter().enumerate();
    request.anchors.centers_m = places
        .map(|(i, state)| (format!("c{i}"), moved(state.center_w).into()))
        .collect();
    let found = quiet(&request).unwrap();
    print_report(&found);
    found
}

#[test]
fn true_places_pass_and_tilted_raised_or_wrong_ones_fail() {
    let sound = with_places(|at| at);
    assert!(sound.report.passes());
    // Four degrees about x.
    let leaning =
        with_places(|at| nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), 0.07) * at);
    assert!(has_error(&leaning, "", Cause::Anchors));
    let raised = with_places(|at| at + Vector3::z() * 0.35);
    assert!(has_error(&raised, "", Cause::Anchors));
    // One number of one camera is wrong by a metre.
    let off = with_places(|at| {
        let by = if at.x > 3.0 && at.y > 0.0 { 1.0 } else { 0.0 };
        at + Vector3::x() * by
    });
    assert!(has_error(&off, "", Cause::Anchors));
}

/// A grid of marks on the floor, each clicked in all cameras, whose known places are changed by `moved`.
fn floor_marks(truth: &[CameraState], moved: fn(usize, Vector3<f64>) -> Vector3<f64>) -> Marks {
    let known = (0..12).map(|index| {
        let at_m = Vector3::new(
            1.5 * f64::from(index as u32 % 3) - 1.5,
            1.5 * f64::from(index as u32 / 3) - 2.2,
            0.0,
        );
        let clicks = truth.iter().enumerate().filter_map(|(camera, state)| {
            let px = state.project(&at_m, state.fold_radius())?;
            Some((format!("c{camera}"), px.into()))
        });
        KnownMark {
            name: format!("m{index}"),
            known: Known::Place(moved(index, at_m).into()),
            clicks: clicks.collect(),
        }
    });
    Marks {
        court: None,
        known: known.collect(),
        floor: Vec::new(),
        lengths: Vec::new(),
        click_sigma_px: 4.0,
        place_sigma_m: 0.02,
    }
}

#[test]
fn marks_that_contradict_each_other_fail() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    request.anchors.marks = Some(floor_marks(&truth, |_, at| at));
    let sound = quiet(&request).unwrap();
    print_report(&sound);
    assert!(sound.report.passes());
    let spoilt = |index: usize, at: Vector3<f64>| {
        let aside = [0.9, -1.3, 1.7][index % 3];
        let by = if index.is_multiple_of(3) { aside } else { 0.0 };
        at + Vector3::new(by, -0.5 * by * (index % 2) as f64, 0.0)
    };
    request.anchors.marks = Some(floor_marks(&truth, spoilt));
    let found = quiet(&request).unwrap();
    print_report(&found);
    assert!(has_error(&found, "", Cause::Anchors));
}

#[test]
fn two_cameras_alone_fail() {
    let truth = cameras(&Field {
        cameras: 8,
        ..SMALL
    });
    let two = request(&SMALL, &truth[..2], &SHORT);
    let found = quiet(&two).unwrap();
    print_report(&found);
    assert!(has_error(&found, "", Cause::HalvesUnchecked));
}

#[test]
fn huge_offsets_slow_cameras_and_huge_frames_are_refused() {
    type Spoil = fn(&mut PeopleRequest);
    let truth = six();
    let walk = Walk {
        seconds: 2.0,
        ..SHORT
    };
    let mut sound = request(&SMALL, &truth, &walk);
    sound.timing = Timing::Clocks;
    for camera in &mut sound.cameras {
        camera.offset_s = Some(0.0);
    }
    let cases: [(&str, Spoil); 3] = [
        ("camera `c1`: found an offset of", |it| {
            it.cameras[1].offset_s = Some(1e18);
        }),
        ("camera `c2`: found 2 frames per second", |it| {
            it.cameras[2].rate_hz = Some(2.0);
        }),
        ("camera `c3`: found frame", |it| {
            it.cameras[3].frames.last_mut().unwrap().frame = 1e20;
        }),
    ];
    for (expected, spoil) in cases {
        let mut request = sound.clone();
        spoil(&mut request);
        let message = quiet(&request).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn keypoints_that_were_not_seen_can_have_any_position() {
    let truth = six();
    let mut request = request(&SMALL, &truth, &SHORT);
    for frame in &mut request.cameras[0].frames {
        for body in &mut frame.bodies {
            for keypoint in &mut body.keypoints[1..5] {
                *keypoint = Some(Keypoint {
                    px: [-100.0, -100.0],
                    score: 0.0,
                });
            }
        }
    }
    assert!(quiet(&request).is_ok());
}

#[test]
fn a_few_seconds_are_not_enough() {
    let truth = six();
    let walk = Walk {
        people: 1,
        seconds: 6.0,
        ..SHORT
    };
    match quiet(&request(&SMALL, &truth, &walk)) {
        Ok(found) => {
            print_report(&found);
            assert!(has_error(&found, "", Cause::TooFewPeople));
        }
        Err(error) => assert!(
            matches!(
                error,
                PeopleError::TooFewBodies { .. } | PeopleError::NothingAgrees { .. }
            ),
            "{error}"
        ),
    }
}

#[test]
fn unusable_requests_are_refused_with_the_reason() {
    type Spoil = fn(&mut PeopleRequest);
    let truth = six();
    let walk = Walk {
        seconds: 2.0,
        ..SHORT
    };
    let sound = request(&SMALL, &truth, &walk);
    let cases: [(&str, Spoil); 10] = [
        ("expected whole frames", |it| {
            it.cameras[1].frames[3].frame += 0.25;
        }),
        ("found 1 cameras", |it| it.cameras.truncate(1)),
        ("two cameras are called `c0`", |it| {
            it.cameras[1].name = "c0".to_owned();
        }),
        ("`stature_m`: found 170", |it| it.stature_m = Some(170.0)),
        ("`rate_hz`: found NaN", |it| it.rate_hz = f64::NAN),
        ("lack `left_ankle`", |it| {
            let names = farfield_proto::keypoints::COCO17[..15].iter();
            let names = names.map(|name| (*name).to_owned());
            it.keypoints = farfield_proto::keypoints::KeypointSet::new(names.collect());
        }),
        ("frame 0: found a body of 3 keypoints", |it| {
            it.cameras[0].frames[0].bodies[0].keypoints.truncate(3);
        }),
        ("found frame 0 after 0", |it| {
            it.cameras[0].frames[1].frame = 0.0;
        }),
        ("outside of its 640x480 picture", |it| {
            it.cameras[0].size_px = [640, 480];
        }),
        ("give three places, or a distance", |it| {
            it.anchors.centers_m = vec![("c0".to_owned(), [0.0, 1.0, 1.0])];
        }),
    ];
    for (expected, spoil) in cases {
        let mut request = sound.clone();
        spoil(&mut request);
        let message = quiet(&request).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let mut empty = sound;
    for camera in &mut empty.cameras {
        camera.frames.clear();
    }
    let error = quiet(&empty).unwrap_err();
    assert!(
        matches!(error, PeopleError::TooFewBodies { found: 0, .. }),
        "{error}"
    );
}

#[test]
fn the_same_request_gives_the_same_bits() {
    let truth = six();
    let walk = Walk {
        seconds: 12.0,
        ..SHORT
    };
    let request = request(&SMALL, &truth, &walk);
    let once = quiet(&request).unwrap();
    let again = quiet(&request).unwrap();
    assert_eq!(once.toml().unwrap(), again.toml().unwrap());
}
