//! Requirements on every clip of the shared data, for any skeleton. Without the data these tests
//! print a notice and pass.

use std::fs;
use std::path::PathBuf;

use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector3;

use super::*;

/// An adult's stature, metres, to give speeds in metres per second.
const STATURE_M: f64 = 1.75;

/// Fastest hand or foot of a person.
const FASTEST_M_S: f64 = 15.0;

/// Clips in which the recording itself loses a limb for some frames, each with the maximum number
/// of steps from one frame to the next in which a joint is faster than [`FASTEST_M_S`]. In
/// `cmu_iclone_005_06` the right leg swivels between two solutions while hip and ankle stay. In the
/// couple's first dancers, one has spinning feet in a deep lunge, and the other is lost completely
/// for some frames of close contact. These faults stay in the truth, because the intended posture
/// is unknown.
const LOST_LIMBS: [(&str, usize); 3] = [
    ("cmu_iclone_005_06", 19),
    ("cmu_pair_60_01", 5),
    ("cmu_pair_60_10", 203),
];

/// The clips of `$FARFIELD_DATA/data/motion`, else `../shared/data/motion`, by name.
fn clips() -> Vec<(String, Clip)> {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let root = std::env::var_os("FARFIELD_DATA").map_or(shared, PathBuf::from);
    let folder = root.join("data/motion");
    let Ok(entries) = fs::read_dir(&folder) else {
        println!(
            "SKIPPED: {} is not there (set FARFIELD_DATA to the folder that holds it)",
            folder.display()
        );
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|e| e == "bvh"));
    paths.sort();
    let load = |path: &PathBuf| {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        (name, Clip::load(path).unwrap())
    };
    paths.iter().map(load).collect()
}

fn postures(clip: &Clip) -> Vec<Posture> {
    let n = (clip.duration_s() / clip.frame_time_s()).round() as usize;
    let at = |i: usize| clip.posture(i as f64 * clip.frame_time_s());
    (0..=n).map(at).collect()
}

/// Forward, left and up of the pelvis.
fn pelvis(posture: &Posture) -> [Vector3<f64>; 3] {
    let axes = posture.pelvis_axes();
    [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axes * axis)
}

fn lowest(posture: &Posture) -> f64 {
    posture.joints.iter().map(|p| p.z).fold(1.0, f64::min)
}

fn distance(posture: &Posture, a: Joint, b: Joint) -> f64 {
    (posture.at(a) - posture.at(b)).norm()
}

/// Speed of every joint from every frame to the next, metres per second.
fn speeds_m_s(clip: &Clip) -> Vec<(f64, Joint)> {
    let all = postures(clip);
    let step = |pair: &[Posture], joint: Joint| {
        let way = (pair[1].at(joint) - pair[0].at(joint)).norm();
        (STATURE_M * way / clip.frame_time_s(), joint)
    };
    let steps = all.windows(2);
    steps
        .flat_map(|pair| Joint::ALL.map(|joint| step(pair, joint)))
        .collect()
}

/// Mean speed along the heading, metres per second.
fn ahead_m_s(clip: &Clip) -> f64 {
    let all = postures(clip);
    let ahead = |pair: &[Posture]| {
        let way = pair[1].at(Joint::Pelvis) - pair[0].at(Joint::Pelvis);
        let (sin, cos) = pair[0].facing_rad().sin_cos();
        way.dot(&Vector3::new(cos, sin, 0.0))
    };
    STATURE_M * all.windows(2).map(ahead).sum::<f64>() / clip.duration_s()
}

fn share(postures: &[Posture], test: impl Fn(&Posture) -> bool) -> f64 {
    postures.iter().filter(|p| test(p)).count() as f64 / postures.len() as f64
}

#[test]
fn all_clips_load_and_are_listed() {
    println!(
        "{:23}{:>9}{:>7}{:>5}{:>9}{:>8}{:>14}{:>7}{:>7}{:>15}{:>8}{:>9}{:>9}",
        "clip",
        "family",
        "s",
        "Hz",
        "stature",
        "floor",
        "pelvis",
        "thigh",
        "shank",
        "lowest, median",
        "ahead",
        "fastest",
        "of"
    );
    for (name, clip) in clips() {
        let all = postures(&clip);
        let mut heights: Vec<f64> = all.iter().map(|p| p.at(Joint::Pelvis).z).collect();
        let mut lows: Vec<f64> = all.iter().map(lowest).collect();
        heights.sort_by(f64::total_cmp);
        lows.sort_by(f64::total_cmp);
        let speeds = speeds_m_s(&clip);
        let fastest = speeds.iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let lengths = clip.mean_lengths();
        println!(
            "{name:23}{:>9}{:7.2}{:5.0}{:9.3}{:8.3}{:7.3}{:7.3}{:7.3}{:7.3}{:8.3}{:7.3}{:8.2}{:9.2} {}",
            format!("{:?}", clip.family()),
            clip.duration_s(),
            1.0 / clip.frame_time_s(),
            clip.stature_units(),
            clip.floor_units(),
            heights[0],
            heights[heights.len() - 1],
            lengths[Joint::LeftKnee.index()],
            lengths[Joint::LeftAnkle.index()],
            lows[0],
            lows[lows.len() / 2],
            ahead_m_s(&clip),
            fastest.0,
            fastest.1.name(),
        );
    }
}

#[test]
fn left_and_forward_are_correct() {
    for (name, clip) in clips() {
        let all = postures(&clip);
        let ahead = |from: Joint, to: Joint| {
            share(&all, |p| (p.at(to) - p.at(from)).dot(&pelvis(p)[0]) > 0.0)
        };
        assert!(ahead(Joint::Head, Joint::Nose) > 0.9, "{name}");
        // The feet of an upright person point forward; bent over, the pelvis faces the floor.
        let toes_ahead = |p: &Posture| {
            let (sin, cos) = p.facing_rad().sin_cos();
            let toes = p.at(Joint::LeftToe) + p.at(Joint::RightToe);
            let heels = p.at(Joint::LeftHeel) + p.at(Joint::RightHeel);
            (toes - heels).dot(&Vector3::new(cos, sin, 0.0)) > 0.0
        };
        let upright: Vec<Posture> = all
            .iter()
            .filter(|p| pelvis(p)[2].z > 0.8)
            .cloned()
            .collect();
        assert!(
            upright.is_empty() || share(&upright, toes_ahead) > 0.9,
            "{name}"
        );
        // A pirouette twists the shoulders, so not in every frame.
        for (left, right) in [
            (Joint::LeftShoulder, Joint::RightShoulder),
            (Joint::LeftEar, Joint::RightEar),
        ] {
            let apart = share(&all, |p| {
                (p.at(left) - p.at(right)).dot(&pelvis(p)[1]) > 0.0
            });
            assert!(apart > 0.9, "{name}: {apart}");
        }
    }
}

#[test]
fn legs_have_constant_plausible_lengths() {
    for (name, clip) in clips() {
        let mean = clip.mean_lengths();
        for (above, joint) in [
            (Joint::LeftHip, Joint::LeftKnee),
            (Joint::RightHip, Joint::RightKnee),
            (Joint::LeftKnee, Joint::LeftAnkle),
            (Joint::RightKnee, Joint::RightAnkle),
        ] {
            let length = mean[joint.index()];
            assert!((0.21..0.29).contains(&length), "{name}: {length}");
            for posture in postures(&clip) {
                assert!((distance(&posture, above, joint) - length).abs() < 1e-6);
            }
        }
        for (joint, range) in [
            (Joint::LeftElbow, 0.12..0.20),
            (Joint::LeftWrist, 0.12..0.19),
            (Joint::Neck, 0.17..0.30),
            (Joint::Head, 0.05..0.13),
            (Joint::LeftHip, 0.04..0.07),
            (Joint::LeftToe, 0.11..0.13),
        ] {
            let length = mean[joint.index()];
            let found = joint.name();
            assert!(range.contains(&length), "{name}: {found} {length}");
        }
    }
}

#[test]
fn a_standing_person_has_feet_on_the_floor_and_hips_at_half_height() {
    for (name, clip) in clips() {
        let mut all = postures(&clip);
        assert!(share(&all, |p| lowest(p) > -0.05) > 0.98, "{name}");
        // Straight legs under an upright pelvis, and a foot near the floor.
        all.retain(|p| {
            let leg = |hip, knee, ankle| {
                distance(p, hip, ankle) > 0.97 * (distance(p, hip, knee) + distance(p, knee, ankle))
            };
            leg(Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle)
                && leg(Joint::RightHip, Joint::RightKnee, Joint::RightAnkle)
                && pelvis(p)[2].z > 0.95
                && lowest(p) < 0.03
        });
        for posture in &all {
            let height = posture.at(Joint::Pelvis).z;
            assert!((0.4..0.6).contains(&height), "{name}: {height}");
        }
    }
}

#[test]
fn speeds_are_plausible_except_for_lost_limbs() {
    for (name, clip) in clips() {
        let fast = speeds_m_s(&clip)
            .iter()
            .filter(|s| s.0 > FASTEST_M_S)
            .count();
        let lost = LOST_LIMBS.iter().find(|lost| lost.0 == name);
        let most = lost.map_or(0, |lost| lost.1);
        assert!(fast <= most, "{name}: {fast} steps");
    }
}

#[test]
fn walking_and_running_people_face_forward() {
    for (name, clip) in clips() {
        let expected_m_s = match name.as_str() {
            "cmu_iclone_002_01" | "cmu_iclone_007_01" => 0.8..2.0,
            "cmu_iclone_002_03" | "deepmimic_run" => 2.2..4.5,
            _ => continue,
        };
        let found_m_s = ahead_m_s(&clip);
        assert!(expected_m_s.contains(&found_m_s), "{name}: {found_m_s}");
    }
}

#[test]
fn a_couple_stays_in_one_coordinate_frame() {
    let clips = clips();
    let named = |name: &str| clips.iter().find(|(n, _)| n == name).map(|(_, clip)| clip);
    for take in ["01", "10"] {
        let first = named(&format!("cmu_pair_60_{take}"));
        let second = named(&format!("cmu_pair_61_{take}"));
        let (Some(first), Some(second)) = (first, second) else {
            continue;
        };
        assert_eq!(first.duration_s().to_bits(), second.duration_s().to_bits());
        let n = (first.duration_s() * 30.0) as usize;
        let apart = |i: usize| {
            let time_s = i as f64 / 30.0;
            let (a, b) = (
                first.posture(time_s),
                second.posture_relative_to(time_s, first),
            );
            let between = (a.at(Joint::Pelvis) - b.at(Joint::Pelvis)).xy().norm();
            let hands = [Joint::LeftHand, Joint::RightHand];
            let held = hands
                .iter()
                .flat_map(|h| hands.map(|g| (a.at(*h) - b.at(g)).norm()))
                .fold(1.0, f64::min);
            (STATURE_M * between, STATURE_M * held)
        };
        let apart: Vec<(f64, f64)> = (0..n).map(apart).collect();
        let nearest = apart.iter().map(|a| a.0).fold(9.0, f64::min);
        assert!((0.1..0.5).contains(&nearest), "{take}: {nearest}");
        let holding = apart.iter().filter(|a| a.1 < 0.3).count() as f64 / n as f64;
        assert!(holding > 0.2, "{take}: hands near for {holding}");
        let heads = first.posture(1.0).at(Joint::Head).z
            - second.posture_relative_to(1.0, first).at(Joint::Head).z;
        assert!(heads.abs() < 0.1, "{take}: {heads}");
    }
}
