//! Planted faults: none may pass.

use nalgebra::Vector3;

use super::simulated::{HALL, USUAL, cameras, request};
use super::*;
use crate::adjustment::CameraState;
use crate::alignment::KnownDistance;

type Plant = fn(&mut PointRequest, &[CameraState]);

fn know_centers(
    request: &mut PointRequest,
    truth: &[CameraState],
    moved: fn(Vector3<f64>) -> Vector3<f64>,
) {
    let named = request.cameras.iter().zip(truth);
    request.anchors.centers_m = named
        .map(|(camera, state)| (camera.name.clone(), moved(state.center_w).into()))
        .collect();
}

fn mirror(camera: &mut PointCamera) {
    let width = f64::from(camera.size_px[0]);
    for sighting in &mut camera.sightings {
        sighting.px[0] = width - 1.0 - sighting.px[0];
    }
}

/// The fault, a word that its report must contain, and the change.
const FAULTS: [(&str, &str, Plant); 22] = [
    ("one video is mirrored", "c2", |request, _| {
        mirror(&mut request.cameras[2]);
    }),
    ("all videos are mirrored", "mirror", |request, truth| {
        request.cameras.iter_mut().for_each(mirror);
        know_centers(request, truth, |c| c);
    }),
    (
        "all videos are mirrored, and the known places lie in a plane",
        "mirror",
        |request, truth| {
            request.cameras.iter_mut().for_each(mirror);
            know_centers(request, truth, |c| Vector3::new(c.x, c.y, 4.0));
        },
    ),
    (
        "y is counted from below in all sightings, and the known places lie in a plane",
        "all cameras look up",
        |request, truth| {
            for camera in &mut request.cameras {
                let height = f64::from(camera.size_px[1]);
                let seen = camera.sightings.iter_mut();
                seen.for_each(|sighting| sighting.px[1] = height - 1.0 - sighting.px[1]);
            }
            know_centers(request, truth, |c| Vector3::new(c.x, c.y, 4.0));
        },
    ),
    (
        "x and y of the known places are exchanged",
        "mirror",
        |request, truth| {
            know_centers(request, truth, |c| Vector3::new(c.y, c.x, c.z));
        },
    ),
    (
        "z of the known places points down",
        "mirror",
        |request, truth| {
            know_centers(request, truth, |c| Vector3::new(c.x, c.y, -c.z));
        },
    ),
    (
        "known places are turned upside down",
        "under the floor",
        |request, truth| {
            know_centers(request, truth, |c| Vector3::new(c.x, -c.y, -c.z));
        },
    ),
    (
        "two cameras are swapped",
        "known places",
        |request, truth| {
            know_centers(request, truth, |c| c);
            let first = request.cameras[0].sightings.clone();
            request.cameras[0].sightings =
                std::mem::replace(&mut request.cameras[3].sightings, first);
        },
    ),
    ("a camera is knocked half-way", "c1", |request, _| {
        let seen = request.cameras[1].sightings.iter_mut();
        seen.filter(|s| s.frame > 250.0)
            .for_each(|s| s.px[0] += 12.0);
    }),
    ("a focal length is wrong by a fifth", "c1", |request, _| {
        request.cameras[1].intrinsics.fx_px *= 1.2;
        request.cameras[1].intrinsics.fy_px *= 1.2;
    }),
    (
        "a focal length is wrong by a tenth, and may move",
        "c1",
        |request, _| {
            request.lenses = Lenses::Focal;
            request.cameras[1].intrinsics.fx_px *= 1.1;
            request.cameras[1].intrinsics.fy_px *= 1.1;
        },
    ),
    ("a camera is late by a second", "c4", |request, _| {
        request.cameras[4]
            .sightings
            .iter_mut()
            .for_each(|s| s.frame += 5.0);
    }),
    (
        "sightings of another resolution",
        "another resolution",
        |request, _| {
            request.cameras[0].size_px = [960, 600];
        },
    ),
    ("sightings of half the resolution", "c0", |request, _| {
        request.cameras[0]
            .sightings
            .iter_mut()
            .for_each(|s| s.px = s.px.map(|v| 0.5 * v));
    }),
    (
        "a camera whose place is known shares no moment",
        "of camera `c3` does not count",
        |request, _| {
            request.cameras[3]
                .sightings
                .iter_mut()
                .for_each(|s| s.frame += 1000.0);
        },
    ),
    (
        "one of three cameras whose places are known does not join the others",
        "the length of a metre is unknown; what is known of camera `c3` does not count",
        |request, _| {
            request.anchors.distances.clear();
            let is_placed = |name: &str| ["c0", "c1", "c3"].contains(&name);
            request
                .anchors
                .centers_m
                .retain(|(name, _)| is_placed(name));
            request.cameras[3]
                .sightings
                .iter_mut()
                .for_each(|s| s.frame += 1000.0);
        },
    ),
    ("no length is known", "metre", |request, _| {
        request.anchors.distances.clear();
        request.anchors.centers_m.clear();
    }),
    (
        "two known distances contradict each other",
        "contradict",
        |request, truth| {
            request.anchors.distances.push(KnownDistance {
                first: "c0".to_owned(),
                second: "c2".to_owned(),
                distance_m: 100.0 * (truth[0].center_w - truth[2].center_w).norm(),
            });
        },
    ),
    (
        "only a distance is known",
        "three cameras or more",
        |request, _| request.anchors.centers_m.clear(),
    ),
    (
        "one known place is wrong by ten metres",
        "without `c2` the others fit",
        |request, _| request.anchors.centers_m[2].1[0] += 10.0,
    ),
    (
        "half of the sights of a camera are wrong",
        "c2",
        |request, _| {
            let seen = request.cameras[2].sightings.iter_mut().enumerate();
            seen.filter(|(i, _)| i % 2 == 0)
                .for_each(|(i, s)| s.px = [(i * 7 % 1900) as f64, (i * 13 % 1200) as f64]);
        },
    ),
    ("the point never moved", "agree", |request, _| {
        for camera in &mut request.cameras {
            let px = camera.sightings[0].px;
            camera.sightings.iter_mut().for_each(|s| s.px = px);
        }
    }),
];

#[test]
fn no_planted_fault_passes() {
    let mut truth = cameras(&HALL);
    truth.truncate(5);
    for state in &mut truth {
        state.period_s = 0.2;
    }
    let mut sound = request(&HALL, &truth, &USUAL, Timing::Synchronised);
    sound.anchors.distances = vec![KnownDistance {
        first: "c0".to_owned(),
        second: "c1".to_owned(),
        distance_m: (truth[0].center_w - truth[1].center_w).norm(),
    }];
    know_centers(&mut sound, &truth, |c| c);
    let passed = calibrate(&sound, &mut |_| ()).unwrap();
    assert!(passed.report.passes(), "{:?}", passed.report.findings);
    let mut missed = Vec::new();
    for (what, word, plant) in FAULTS {
        let mut request = sound.clone();
        plant(&mut request, &truth);
        let report = match calibrate(&request, &mut |_| ()) {
            Err(error) => error.to_string(),
            Ok(found) => {
                let wrong = found.report.findings.iter().filter(|f| f.is_wrong());
                let errors: Vec<String> = wrong.map(ToString::to_string).collect();
                errors.join(" | ")
            }
        };
        println!("{what}: {report}");
        if !report.contains(word) {
            missed.push(what);
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// The camera turns by 0.3, 1 or 2 degrees, early or late.
#[test]
fn a_camera_that_is_knocked_at_any_time_is_reported() {
    let mut truth = cameras(&HALL);
    truth.truncate(5);
    for state in &mut truth {
        state.period_s = 0.2;
    }
    let mut sound = request(&HALL, &truth, &USUAL, Timing::Synchronised);
    know_centers(&mut sound, &truth, |c| c);
    let mut missed = Vec::new();
    for percent in [20.0, 50.0, 70.0, 85.0] {
        for degrees in [0.3f64, 1.0, 2.0] {
            let mut request = sound.clone();
            // Near the axis a rotation is a shift in the picture.
            let by_px = HALL.focal_px * degrees.to_radians();
            let seen = request.cameras[1].sightings.iter_mut();
            seen.filter(|s| s.frame > 5.0 * percent)
                .for_each(|s| s.px[0] += by_px);
            let found = calibrate(&request, &mut |_| ());
            let report = match &found {
                Err(error) => error.to_string(),
                Ok(found) => {
                    let own = found.report.findings.iter().filter(|f| f.is_wrong());
                    own.map(ToString::to_string).collect::<Vec<_>>().join(" | ")
                }
            };
            println!("{percent} %, {degrees} degrees: {report}");
            if !report.contains("c1") {
                missed.push((percent, degrees));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn a_straight_walk_is_not_enough() {
    let mut truth = cameras(&HALL);
    truth.truncate(4);
    let mut sound = request(&HALL, &truth, &USUAL, Timing::Synchronised);
    for (camera, state) in sound.cameras.iter_mut().zip(&truth) {
        camera.sightings = (0..300)
            .map(|frame| {
                let along = 0.05 * f64::from(frame) - 7.5;
                let px = state.project(&Vector3::new(0.3 * along, along, 1.0), 10.0);
                let wobble = 0.3 * libm::sin(f64::from(frame * frame));
                let px = px.map_or([900.0, 600.0], |px| [px.x + wobble, px.y - wobble]);
                Sighting {
                    frame: f64::from(frame),
                    px,
                }
            })
            .collect();
    }
    sound.anchors.distances = vec![KnownDistance {
        first: "c0".to_owned(),
        second: "c1".to_owned(),
        distance_m: 10.0,
    }];
    match calibrate(&sound, &mut |_| ()) {
        Err(error) => println!("{error}"),
        Ok(found) => {
            for finding in &found.report.findings {
                println!("{finding}");
            }
            assert!(!found.report.passes());
        }
    }
}
