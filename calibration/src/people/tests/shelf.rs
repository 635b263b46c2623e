//! Shelf (Belagiannis et al. 2014): five cameras around up to four people for 15 s, with `OpenPose` candidates. The results are
//! compared with the published calibration, and one half with the other.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use farfield_proto::calibration::Calibration;
use nalgebra::Vector2;

use super::super::associate::persons;
use super::super::view::{Clock, Joint, Tracks, View};
use super::*;
use crate::alignment::{KnownDistance, Similarity};
use crate::geometry::{Sight, triangulate};
use crate::report::Cause;

/// The stature of the people is unknown; comparisons ignore the scale.
const STATURE_M: f64 = 1.75;

/// `data/shelf` below `$FARFIELD_DATA`, otherwise below `shared` in the repository's root.
fn folder() -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let root = std::env::var_os("FARFIELD_DATA").map_or(default, PathBuf::from);
    let shelf = root.join("data/shelf");
    if shelf.is_dir() {
        return Some(shelf);
    }
    println!(
        "shelf skipped: {} is not there (set FARFIELD_DATA to the folder that holds it)",
        shelf.display()
    );
    None
}

fn frames(path: &Path, ticks: &std::ops::Range<i64>) -> Vec<DetectedFrame> {
    let text = fs::read_to_string(path).unwrap();
    let mut frames = parse(&text, path, 17).unwrap();
    frames.retain(|it| ticks.contains(&(it.frame as i64)));
    frames
}

fn published(folder: &Path) -> Calibration {
    let path = folder.join("calibration.toml");
    Calibration::parse(&fs::read_to_string(&path).unwrap(), &path).unwrap()
}

fn request(folder: &Path, ticks: &std::ops::Range<i64>) -> PeopleRequest {
    let cameras = published(folder)
        .cameras
        .into_iter()
        .map(|(name, model)| PeopleCamera {
            frames: frames(&folder.join(format!("{name}.jsonl")), ticks),
            size_px: model.size_px(),
            intrinsics: *model.intrinsics(),
            lens: *model.lens(),
            rate_hz: None,
            offset_s: None,
            name,
        });
    PeopleRequest {
        stature_m: Some(STATURE_M),
        ..PeopleRequest::new(cameras.collect(), 20.0)
    }
}

/// Per camera: metres and degrees between two calibrations after a similarity, in metres of the second.
fn apart(found: &[CameraState], other: &[CameraState]) -> Vec<(f64, f64)> {
    let centers = |states: &[CameraState]| states.iter().map(|s| s.center_w).collect::<Vec<_>>();
    let similarity = Similarity::between(&centers(found), &centers(other)).unwrap();
    let each = found.iter().zip(other).map(|(found, other)| {
        let moved = similarity.apply_to_camera(found);
        let turn = moved.camera_from_world.angle_to(&other.camera_from_world);
        ((moved.center_w - other.center_w).norm(), turn.to_degrees())
    });
    each.collect()
}

/// Residuals of keypoints in each camera relative to the point triangulated from the others, pixels, sorted; for the bodies
/// that `judge` matches.
fn held_out_px(
    request: &PeopleRequest,
    judge: &[CameraState],
    cameras: &[CameraState],
) -> Vec<f64> {
    let clock = Clock {
        rate_hz: 20.0,
        processed_hz: 20.0,
        offset_s: 0.0,
        ticks_hz: None,
    };
    let views: Vec<View> = request
        .cameras
        .iter()
        .map(|camera| Tracks::new(camera, 17, 20.0).unwrap().view(&clock))
        .collect();
    let judge: Vec<Option<CameraState>> = judge.iter().copied().map(Some).collect();
    let ticks: BTreeSet<i64> = views.iter().flat_map(|v| v.ticks.keys().copied()).collect();
    let mut residuals = Vec::new();
    for person in ticks.iter().flat_map(|t| persons(&views, &judge, *t, 4.0)) {
        for k in 0..17 {
            let seen: Vec<(usize, Joint)> = person
                .members
                .iter()
                .filter_map(|(c, i)| Some((*c, views[*c].ticks[&person.tick][*i].joints[k]?)))
                .collect();
            for (held, joint) in &seen {
                let others = seen.iter().filter(|(c, _)| c != held);
                let sights: Vec<Sight> = others
                    .map(|(c, joint)| {
                        let back = cameras[*c].camera_from_world.inverse();
                        (cameras[*c].center_w, back * joint.bearing)
                    })
                    .collect();
                // A point from two others could be wrong in both.
                if sights.len() < 2 {
                    continue;
                }
                let Some((point, agreeing)) = triangulate(&sights, 0.02) else {
                    continue;
                };
                let drawn = cameras[*held].project(&point, 1e6);
                if let Some(px) = drawn.filter(|_| agreeing.len() == sights.len()) {
                    residuals.push((px - Vector2::from(joint.px)).norm());
                }
            }
        }
    }
    residuals.sort_by(f64::total_cmp);
    residuals
}

/// The bars are values measured when this test was written, plus a third: no published result is comparable.
#[test]
fn shelf_is_calibrated_from_people_alone() {
    let Some(folder) = folder() else { return };
    let truth: Vec<CameraState> = published(&folder)
        .cameras
        .values()
        .map(CameraState::of_model)
        .collect();
    let all = quiet(&request(&folder, &(300..601))).unwrap();
    print_report(&all);
    let off = apart(&found_states(&all), &truth);
    println!("against the published one, m and degrees: {off:.4?}");
    let (early, late) = (request(&folder, &(300..450)), request(&folder, &(450..601)));
    let (first, second) = (quiet(&early).unwrap(), quiet(&late).unwrap());
    let (first, second) = (found_states(&first), found_states(&second));
    let halves = apart(&first, &second);
    println!("half against half, each from nothing: {halves:.4?}");
    for (name, data, own) in [("second", &late, &first), ("first", &early, &second)] {
        let ours = held_out_px(data, &truth, own);
        let theirs = held_out_px(data, &truth, &truth);
        let median = |it: &[f64]| it[it.len() / 2];
        let ninth = |it: &[f64]| it[it.len() * 9 / 10];
        println!(
            "held-out views of the {name} half, calibrated on the other: median {:.2} px, 90 % {:.2} px of {}; published \
             {:.2} px, {:.2} px of {}",
            median(&ours),
            ninth(&ours),
            ours.len(),
            median(&theirs),
            ninth(&theirs),
            theirs.len()
        );
    }
    assert_eq!(all.cameras.len(), 5);
    assert!(off.iter().all(|(m, degrees)| *m < 0.040 && *degrees < 0.6));
    assert!(
        halves
            .iter()
            .all(|(m, degrees)| *m < 0.045 && *degrees < 1.1)
    );
}

/// A request with all frames and a known distance, changed by `spoil`.
fn spoilt(folder: &Path, spoil: impl Fn(&mut PeopleRequest)) -> PeopleRequest {
    let mut request = request(folder, &(300..601));
    request.stature_m = None;
    request.anchors.distances = vec![KnownDistance {
        first: "cam0".to_owned(),
        second: "cam3".to_owned(),
        distance_m: 6.09,
    }];
    spoil(&mut request);
    request
}

/// The findings about clocks and focal lengths, with their cameras.
fn suspects(found: &PointCalibration) -> Vec<(&str, Cause)> {
    let findings = found.report.findings.iter();
    let suspects = findings.filter(|it| matches!(it.cause, Cause::Clock | Cause::Focal));
    suspects
        .map(|it| (it.camera.as_deref().unwrap_or(""), it.cause))
        .collect()
}

fn late_by(request: &mut PeopleRequest, frames: f64) {
    for frame in &mut request.cameras[2].frames {
        frame.frame += frames;
    }
}

/// Symptom: a camera that was 100 ms late, and one with a focal length 5 % too long, passed without a warning.
#[test]
fn a_late_camera_and_a_wrong_focal_length_are_reported() {
    let Some(folder) = folder() else { return };
    let longer = |by: f64| {
        move |it: &mut PeopleRequest| {
            it.cameras[2].intrinsics.fx_px *= by;
            it.cameras[2].intrinsics.fy_px *= by;
        }
    };
    let right = quiet(&spoilt(&folder, |_| ())).unwrap();
    print_report(&right);
    assert_eq!(suspects(&right), []);
    let people = right.report.people.unwrap();
    assert!((1.6..1.9).contains(&people.stature_m), "{people:?}");
    for frames in [2.0, -1.0, -3.0] {
        let late = quiet(&spoilt(&folder, |it| late_by(it, frames))).unwrap();
        println!("late by {frames}");
        print_report(&late);
        assert_eq!(suspects(&late), [("cam2", Cause::Clock)], "{frames}");
        let mut findings = late.report.findings.iter();
        let finding = findings.find(|it| it.cause == Cause::Clock).unwrap();
        let mut found = finding
            .found
            .split(['(', ' '])
            .filter_map(|it| it.parse().ok());
        let frames_found = found.next_back().unwrap_or(0.0_f64);
        assert!((frames_found / frames.abs() - 1.0).abs() < 0.3, "{finding}");
        assert_eq!(finding.is_wrong(), frames.abs() > 1.5, "{finding}");
    }
    // A focal length 5 % too short is below the gain of correct ones.
    let lens = quiet(&spoilt(&folder, longer(1.05))).unwrap();
    println!("focal length 5 % too long");
    print_report(&lens);
    assert_eq!(suspects(&lens), [("cam2", Cause::Focal)]);
    assert!(!lens.report.passes());
    // The remedy for a late camera, unknown clocks, removes the delay.
    let mut unknown = spoilt(&folder, |it| late_by(it, 2.0));
    unknown.timing = Timing::Unknown;
    let found = quiet(&unknown).unwrap();
    println!("late, clocks unknown");
    print_report(&found);
    assert_eq!(suspects(&found), []);
}

/// Symptom: a distance that was a quarter too short gave people of 1.33 m without a warning.
#[test]
fn a_distance_that_makes_people_small_is_reported_with_its_factor() {
    let Some(folder) = folder() else { return };
    let short = spoilt(&folder, |it| it.anchors.distances[0].distance_m = 4.6);
    let found = quiet(&short).unwrap();
    let people = found.report.people.unwrap();
    println!("{people:?}");
    let mut findings = found.report.findings.iter();
    let finding = findings.find(|it| it.cause == Cause::Stature).unwrap();
    assert!(
        finding.found.contains("all distances times 1.2"),
        "{finding}"
    );
}
