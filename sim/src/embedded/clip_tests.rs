//! What a motion clip of the project's own must be: a person on a floor, left and right in place.

use std::path::Path;

use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector3;

use super::CLIPS;
use crate::motion::{Clip, Posture};

/// Frame rate of the clips, and what one frame lasts.
const RATE_HZ: f64 = 60.0;
/// A clip is small enough to be embedded and read.
const MAX_CLIP_BYTES: usize = 100_000;
/// Stature of the body that the clips were keyed on, centimetres, by the rig's own sum of segments.
const STATURE_CM: f64 = 175.0;
const STATURE_TOLERANCE_CM: f64 = 2.0;
/// Feet may dip this far below the floor for a moment, statures (2 cm): a toe that swings through.
const UNDER_FLOOR: f64 = 0.02 / 1.75;
/// What a point moves at most in a frame while it stands, statures (0.5 mm).
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

/// Which points of a foot touch the floor.
const FEET: [[Joint; 2]; 2] = [
    [Joint::LeftHeel, Joint::LeftToe],
    [Joint::RightHeel, Joint::RightToe],
];

/// Whether a foot stands still on its heel or on its toes from one frame to the next.
fn stands(before: &Posture, after: &Posture, foot: [Joint; 2]) -> bool {
    foot.iter()
        .any(|&point| (after.at(point) - before.at(point)).norm() < STILL)
}

#[test]
fn every_clip_is_small_and_its_body_has_the_stature_it_was_keyed_on() {
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
fn everybody_starts_and_ends_upright_with_the_left_side_on_the_left() {
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
fn nobody_sinks_into_the_floor_or_moves_as_no_person_can() {
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
fn a_foot_that_stands_stays_where_it_is() {
    // The least share of the time in which some foot stands; run and jump fly, a cartwheel stands
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
fn gaits_close_on_themselves_and_keep_their_speed() {
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
