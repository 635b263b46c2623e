//! Shelf (Belagiannis et al. 2014): five cameras around up to four people for 15 s, `OpenPose` candidates; against the
//! published calibration, and half against half.

use std::fs;
use std::path::{Path, PathBuf};

use farfield_proto::calibration::Calibration;
use nalgebra::Vector3;

use super::*;
use crate::alignment::Similarity;
use crate::geometry::triangulate;

/// People of unknown stature; the scale is taken out of all that is compared.
const STATURE_M: f64 = 1.75;

fn folder() -> Option<PathBuf> {
    let data = std::env::var_os("FARFIELD_DATA").map(PathBuf::from);
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let shelf = data.unwrap_or(beside).join("shelf");
    if shelf.is_dir() {
        return Some(shelf);
    }
    println!("skipped: no recording at {}", shelf.display());
    None
}

fn frames(path: &Path, ticks: &std::ops::Range<u64>) -> Vec<DetectedFrame> {
    let text = fs::read_to_string(path).unwrap();
    let lines = text
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let own = lines.filter(|it| ticks.contains(&it["tick"].as_u64().unwrap()));
    own.map(|it| DetectedFrame {
        frame: it["tick"].as_f64().unwrap(),
        bodies: it["persons"]
            .as_array()
            .unwrap()
            .iter()
            .map(detection)
            .collect(),
    })
    .collect()
}

fn detection(person: &serde_json::Value) -> Detection {
    let keypoints = person["keypoints"].as_array().unwrap().iter().map(|it| {
        let numbers = it.as_array()?;
        let number = |i: usize| numbers[i].as_f64().unwrap();
        Some(Keypoint {
            px: [number(0), number(1)],
            score: number(2),
        })
    });
    Detection {
        keypoints: keypoints.collect(),
    }
}

fn published(folder: &Path) -> Calibration {
    let path = folder.join("calibration.toml");
    Calibration::parse(&fs::read_to_string(&path).unwrap(), &path).unwrap()
}

fn request(folder: &Path, ticks: &std::ops::Range<u64>) -> PeopleRequest {
    let cameras = published(folder)
        .cameras
        .into_iter()
        .map(|(name, model)| PeopleCamera {
            frames: frames(&folder.join(format!("{name}.jsonl")), ticks),
            size_px: model.size_px(),
            intrinsics: *model.intrinsics(),
            distortion: *model.distortion(),
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

#[test]
fn shelf_is_found_from_people_alone() {
    let Some(folder) = folder() else { return };
    let all = quiet(&request(&folder, &(300..601))).unwrap();
    say(&all);
    let truth: Vec<CameraState> = published(&folder)
        .cameras
        .values()
        .map(CameraState::of_model)
        .collect();
    println!(
        "against the published one: {:?}",
        apart(&found_states(&all), &truth)
    );
    for c in &all.cameras {
        println!("{} {:?}", c.name, c.state.center_w);
    }
    let first = quiet(&request(&folder, &(300..450))).unwrap();
    let second = quiet(&request(&folder, &(450..601))).unwrap();
    say(&first);
    say(&second);
    println!(
        "halves: {:?}",
        apart(&found_states(&first), &found_states(&second))
    );
}
