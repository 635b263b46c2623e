//! Requirements on the project's own motion clips: a person on a floor, with correct left and
//! right.

use std::path::Path;

use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector3;

use super::CLIPS;
use crate::motion::{Clip, Posture};

/// Frame rate of the clips.
const RATE_HZ: f64 = 60.0;
/// Largest size of a clip that is embedded and parsed.
const MAX_CLIP_BYTES: usize = 100_000;
/// Stature of the body for which the clips were keyed, centimetres, as the rig's sum of segments.
const STATURE_CM: f64 = 175.0;
const STATURE_TOLERANCE_CM: f64 = 2.0;
/// How far feet may briefly go below the floor, statures (2 cm): a toe in the swing phase.
const UNDER_FLOOR: f64 = 0.02 / 1.75;
/// Largest motion of a standing point per frame, statures (0.5 mm).
const STILL: f64 = 0.0005 / 1.75;
/// Fastest point of a person who is no athlete, statures per second (15 m/s).
const FASTEST_S: f64 = 15.0 / 1.75;

fn clips() -> Vec<(&'static str, Clip)> {
    let load =
        |&(name, text): &(&'static str, &str)| (name, Clip::parse(text, Path::new(name)).unwrap());
    CLIPS.iter().map(load).collect()
}

fn clip(wanted: &str) -> Clip {
    let found = clips().into_iter().find(|(name, _)| *name == wanted);
    found.expect("an embedded clip").1
}

fn frames(clip: &Clip) -> Vec<Posture> {
    let n = (clip.duration_s() * RATE_HZ).round() as usize;
    (0..=n).map(|i| clip.posture(i as f64 / RATE_HZ)).collect()
}

/// The points of a foot that touch the floor.
const FEET: [[Joint; 2]; 2] = [
    [Joint::LeftHeel, Joint::LeftToe],
    [Joint::RightHeel, Joint::RightToe],
];

/// Whether a foot stands on its heel or on its toes from one frame to the next.
fn stands(before: &Posture, after: &Posture, foot: [Joint; 2]) -> bool {
    foot.iter()
        .any(|&point| (after.at(point) - before.at(point)).norm() < STILL)
}

#[test]
fn every_clip_is_small_and_has_the_keyed_stature() {
    for (name, text) in CLIPS {
        assert!(text.len() < MAX_CLIP_BYTES, "{name}: {} bytes", text.len());
    }
    for (name, clip) in clips() {
        let stature = clip.stature_units();
        assert!(
            (stature - STATURE_CM).abs() < STATURE_TOLERANCE_CM,
            "{name}: {stature} cm"
        );
        assert!((clip.frame_time_s() * RATE_HZ - 1.0).abs() < 1e-6, "{name}");
    }
}

#[test]
fn clips_start_and_end_upright_with_left_on_the_left() {
    for (name, clip) in clips() {
        for posture in [clip.posture(0.0), clip.posture(clip.duration_s())] {
            assert!(posture.at(Joint::Head).z > 0.80, "{name}");
            let heading = posture.facing_rad();
            let forward = Vector3::new(heading.cos(), heading.sin(), 0.0);
            let left = Vector3::z().cross(&forward);
            for (l, r) in [
                (Joint::LeftHip, Joint::RightHip),
                (Joint::LeftShoulder, Joint::RightShoulder),
                (Joint::LeftEar, Joint::RightEar),
            ] {
                let across = (posture.at(l) - posture.at(r)).dot(&left);
                assert!(across > 0.0, "{name}: {l:?} is on the right");
            }
            let ahead =
                |[heel, toe]: [Joint; 2]| (posture.at(toe) - posture.at(heel)).dot(&forward);
            assert!(FEET.into_iter().any(|foot| ahead(foot) > 0.1), "{name}");
        }
    }
}

#[test]
fn clips_stay_above_the_floor_and_below_the_speed_limit() {
    for (name, clip) in clips() {
        let all = frames(&clip);
        for (i, posture) in all.iter().enumerate() {
            let lowest = posture.joints.iter().map(|j| j.z).fold(f64::MAX, f64::min);
            assert!(
                lowest > -UNDER_FLOOR,
                "{name}, frame {i}: {lowest} statures"
            );
        }
        for (i, pair) in all.windows(2).enumerate() {
            for joint in Joint::ALL {
                let way = (pair[1].at(joint) - pair[0].at(joint)).norm();
                assert!(way * RATE_HZ < FASTEST_S, "{name}, frame {i}: {joint:?}");
            }
        }
    }
}

#[test]
fn a_standing_foot_does_not_move() {
    // Minimum share of the time with a standing foot: run and jump have flight, a cartwheel stands
    // on its hands.
    for (name, least) in [
        ("walk", 0.99),
        ("jog", 0.5),
        ("run", 0.4),
        ("sprint", 0.12),
        ("idle", 1.0),
        ("turn", 0.99),
        ("wave", 1.0),
        ("kick", 0.99),
        ("jump", 0.7),
        ("lift", 1.0),
        ("punch", 1.0),
        ("guard", 1.0),
        ("cartwheel", 0.7),
    ] {
        let all = frames(&clip(name));
        let standing = all.windows(2);
        let standing = standing.filter(|p| FEET.iter().any(|&foot| stands(&p[0], &p[1], foot)));
        let share = standing.count() as f64 / (all.len() - 1) as f64;
        assert!(
            share >= least,
            "{name}: some foot stands {share:.3} of the time"
        );
    }
}

#[test]
fn gaits_are_closed_and_have_constant_speed() {
    for (name, speed_m_s) in [("walk", 1.31), ("jog", 2.5), ("run", 3.5), ("sprint", 7.8)] {
        let clip = clip(name);
        let (first, last) = (clip.posture(0.0), clip.posture(clip.duration_s()));
        let way = last.at(Joint::Pelvis) - first.at(Joint::Pelvis);
        let speed = way.norm() * clip.stature_units() / 100.0 / clip.duration_s();
        assert!((speed - speed_m_s).abs() < 0.02, "{name}: {speed} m/s");
        for joint in Joint::ALL {
            let gap = (last.at(joint) - first.at(joint) - way).norm();
            assert!(gap < 1e-3, "{name}: {joint:?} is off by {gap} statures");
        }
    }
}
