//! Tests of the fixed scenes, where they are available: people move as people can. Without the data
//! these tests print a notice and pass.

use std::fs;
use std::path::PathBuf;

use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector2;

use super::range_of_motion::range_of_motion_excess;
use super::*;
use crate::fault_profile::Definition;

/// Fastest pelvis of any clip, metres per second: a runner's 8, plus spikes of a recording.
const FASTEST_M_S: f64 = 12.0;
/// Allowed shortfall of the minimum distance.
const SLACK_M: f64 = 0.01;
/// How far beyond their edge people may go while they turn back.
const OVERSHOOT_M: f64 = 0.05;

/// The scenes of `$FARFIELD_DATA/scenes`, else `../shared/scenes`, by name.
fn scenes(only: &[&str]) -> Vec<(String, Scene)> {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let root = std::env::var_os("FARFIELD_DATA").map_or(shared, PathBuf::from);
    let folder = root.join("scenes");
    let Ok(entries) = fs::read_dir(&folder) else {
        println!("SKIPPED: no scenes in {}", folder.display());
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|e| e == "toml"));
    paths.sort();
    let name = |path: &PathBuf| path.file_stem().unwrap().to_string_lossy().into_owned();
    paths.retain(|path| only.is_empty() || only.contains(&name(path).as_str()));
    paths
        .iter()
        .map(|path| (name(path), Scene::load(path).unwrap()))
        .collect()
}

fn are_a_group(scene: &Scene, a: usize, b: usize) -> bool {
    let group = &scene.people()[a].group;
    group.is_some() && *group == scene.people()[b].group
}

/// The pelvis of every person at every tick.
fn pelvises(scene: &Scene) -> Vec<Vec<Option<Vector2<f64>>>> {
    let at = |person: usize, tick: i64| {
        let truth = scene.person_at(person, scene.time_s(Tick(tick)))?;
        Some(truth.joint_m(Joint::Pelvis).xy())
    };
    let ticks = scene.ticks().start.0..scene.ticks().end.0;
    let people = 0..scene.people().len();
    people
        .map(|p| ticks.clone().map(|tick| at(p, tick)).collect())
        .collect()
}

#[test]
fn people_never_jump() {
    for (name, scene) in scenes(&[]) {
        for (person, track) in pelvises(&scene).iter().enumerate() {
            let fastest_m_s = track
                .windows(2)
                .filter_map(|w| Some((w[1]? - w[0]?).norm() * scene.rate_hz()))
                .fold(0.0, f64::max);
            assert!(
                fastest_m_s < FASTEST_M_S,
                "{name}, {person}: {fastest_m_s} m/s"
            );
        }
    }
}

#[test]
fn people_keep_their_distance_outside_groups() {
    for (name, scene) in scenes(&[]) {
        let tracks = pelvises(&scene);
        for a in 0..tracks.len() {
            for b in (0..a).filter(|&b| !are_a_group(&scene, a, b)) {
                for (tick, (p, q)) in tracks[a].iter().zip(&tracks[b]).enumerate() {
                    let (Some(p), Some(q)) = (p, q) else { continue };
                    let apart_m = (p - q).norm();
                    assert!(
                        apart_m > KEEP_M - SLACK_M,
                        "{name}, {a} and {b} at {tick}: {apart_m} m"
                    );
                }
            }
        }
    }
}

#[test]
fn people_stay_in_the_field_once_they_are_inside() {
    for (name, scene) in scenes(&["a", "b", "c", "d", "e", "f", "g", "h", "hug"]) {
        let reach_m = Vector2::from(scene.size_m()) / 2.0 - Vector2::repeat(EDGE_M);
        for (person, track) in pelvises(&scene).iter().enumerate() {
            let beyond = |at: &Vector2<f64>| (at.abs() - reach_m).max();
            let there = track.iter().flatten();
            let beyond_m = there
                .skip_while(|at| beyond(at) > 0.0)
                .map(beyond)
                .fold(f64::MIN, f64::max);
            assert!(beyond_m < OVERSHOOT_M, "{name}, {person}: {beyond_m} m");
        }
    }
}

#[test]
fn the_first_tick_matches_the_file() {
    for (name, scene) in scenes(&["a", "b", "c", "d", "f", "futsal"]) {
        let track = pelvises(&scene);
        let expected = match name.as_str() {
            "a" => [0.0, 0.0],
            "b" => [-1.0, 0.0],
            "c" => [-0.6, 0.0],
            "d" => [1.5, 1.0],
            "f" => [1.2, -0.6],
            _ => [-9.0, -5.0],
        };
        assert!(
            (track[0][0].unwrap() - Vector2::from(expected)).norm() < 1e-6,
            "{name}"
        );
    }
}

#[test]
fn a_sprinter_never_slows_down() {
    for (_, scene) in scenes(&["sprint"]) {
        for w in pelvises(&scene)[0].windows(2) {
            let speed_m_s = (w[1].unwrap() - w[0].unwrap()).norm() * scene.rate_hz();
            assert!((speed_m_s - 8.0).abs() < 1e-6, "{speed_m_s}");
        }
    }
}

#[test]
fn people_are_present_from_their_entry() {
    for (_, scene) in scenes(&["enter"]) {
        let third = &scene.people()[2];
        assert!(scene.person_at(2, third.enter_s - 1e-6).is_none());
        assert!(scene.person_at(2, third.enter_s).is_some());
        assert!(scene.person_at(2, scene.seconds()).is_some());
        assert!(scene.person_at(99, 0.0).is_none());
    }
}

#[test]
fn truth_between_ticks_moves_as_evenly_as_at_them() {
    const FINE_S: f64 = 1.0 / 960.0;
    for (name, scene) in scenes(&["a", "cross"]) {
        for i in 0..9600 {
            let at = |i: i32| scene.person_at(0, f64::from(i) * FINE_S).unwrap();
            let moved_m = (at(i + 1).joint_m(Joint::Pelvis) - at(i).joint_m(Joint::Pelvis)).norm();
            assert!(moved_m < FASTEST_M_S * FINE_S, "{name}: {moved_m} m at {i}");
        }
    }
}

#[test]
fn truth_does_not_depend_on_the_rate() {
    let (first, again) = (scenes(&["c"]), scenes(&["c"]));
    for ((_, first), (_, again)) in first.into_iter().zip(again) {
        let again = again.with_rate(30.0).shortened(5.0);
        assert_eq!(again.ticks(), Tick(0)..Tick(150));
        for time_s in [0.0, 1.234, 4.9] {
            assert_eq!(first.person_at(1, time_s), again.person_at(1, time_s));
        }
    }
}

#[test]
fn the_fault_definition_moves_hips_and_knees_only() {
    for (_, scene) in scenes(&["c"]) {
        let scene = scene.with_faults(FaultProfile {
            definition: Some(Definition { offset_m: 0.03 }),
            ..FaultProfile::none()
        });
        let truth = scene.person_at(0, 3.0).unwrap();
        for (joint, site_m) in SITE_JOINTS.into_iter().zip(truth.sites_m) {
            let off_m = (site_m - truth.joint_m(joint)).norm();
            let moved = joint.name().contains("hip") || joint.name().contains("knee");
            assert!((off_m - if moved { 0.03 } else { 0.0 }).abs() < 1e-9);
        }
    }
}

#[test]
fn motion_outside_the_clinical_range_is_counted() {
    for (name, scene) in scenes(&["b"]) {
        let excess = range_of_motion_excess(&scene.shortened(4.0));
        let (samples, outside) = excess.total();
        assert!(
            samples == 24 && outside > 0,
            "{name}: {outside} of {samples}"
        );
    }
}
