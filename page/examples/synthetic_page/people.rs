//! People who walk and run in circles: a pure function of the tick.

use std::f64::consts::TAU;

use farfield_proto::id::PersonId;
use farfield_proto::keypoints::COCO17;
use farfield_proto::message::{PersonPose, PersonState};
use farfield_proto::tick::Tick;
use nalgebra::{Point3, Vector3};

use super::venue::{ANGLES, HALF_FIELD_M, JOINTS, RATE_HZ};

/// Period in which a person is lost for [`LOST_S`], seconds, times 1/4.
const LOSING_S: f64 = 15.0;
const LOST_S: f64 = 3.0;

/// Position and phase of a walking person.
struct Walk {
    at: Point3<f64>,
    forward: Vector3<f64>,
    left: Vector3<f64>,
    phase_rad: f64,
    /// Amplitude of the limbs, radians.
    swing_rad: f64,
    size: f64,
}

impl Walk {
    fn at_time(person: u32, s: f64) -> Self {
        let n = f64::from(person);
        let lane = (n * 0.618_034).fract();
        let radius = 0.25 + 0.7 * lane;
        let [x, y] = [radius * HALF_FIELD_M[0], radius * HALF_FIELD_M[1]];
        let speed_mps = 1.2 + 3.0 * (n * 0.414_214).fract();
        let sense = if person.is_multiple_of(2) { 1.0 } else { -1.0 };
        let round_rad = sense * speed_mps * s / (0.5 * (x + y)) + n * 2.4;
        let (sin, cos) = (libm::sin(round_rad), libm::cos(round_rad));
        let forward = (sense * Vector3::new(-x * sin, y * cos, 0.0)).normalize();
        Self {
            at: Point3::new(x * cos, y * sin, 0.0),
            left: Vector3::z().cross(&forward),
            forward,
            phase_rad: TAU * (0.7 + 0.35 * speed_mps) * s + n,
            swing_rad: 0.3 + 0.1 * speed_mps,
            size: 0.92 + 0.16 * (n * 0.732_051).fract(),
        }
    }

    /// A point of the body: forward, left, up from the floor, metres for a person of average size.
    fn point(&self, [x, y, z]: [f64; 3]) -> [f32; 3] {
        let p = self.at + self.size * (x * self.forward + y * self.left + z * Vector3::z());
        [p.x as f32, p.y as f32, p.z as f32]
    }
}

/// Angles of one side, radians: hip, knee, shoulder, elbow.
fn side(walk: &Walk, is_left: bool) -> [f64; 4] {
    let phase = walk.phase_rad + if is_left { 0.0 } else { 0.5 * TAU };
    let hip = walk.swing_rad * libm::sin(phase);
    let knee = 0.1 + 1.1 * walk.swing_rad * (1.0 + libm::sin(phase + 1.3)).max(0.0);
    let shoulder = -0.8 * walk.swing_rad * libm::sin(phase);
    let elbow = 0.3 + walk.swing_rad * (1.0 + 0.5 * libm::sin(phase));
    [hip, knee, shoulder, elbow]
}

/// Joints that do not swing: forward, left, up from the floor, metres.
const TRUNK_AND_HEAD: [(&str, [f64; 3]); 11] = [
    ("pelvis", [0.0, 0.0, 0.95]),
    ("spine", [0.0, 0.0, 1.08]),
    ("neck", [0.02, 0.0, 1.48]),
    ("head", [0.03, 0.0, 1.63]),
    ("nose", [0.13, 0.0, 1.62]),
    ("left_eye", [0.11, 0.03, 1.65]),
    ("right_eye", [0.11, -0.03, 1.65]),
    ("left_ear", [0.03, 0.08, 1.63]),
    ("right_ear", [0.03, -0.08, 1.63]),
    ("left_scapula", [-0.03, 0.04, 1.42]),
    ("right_scapula", [-0.03, -0.04, 1.42]),
];

/// Pose of a person at a tick; person ids start at 1.
pub(crate) fn pose(person: u32, tick: Tick) -> PersonPose {
    let s = tick.seconds(RATE_HZ);
    let walk = Walk::at_time(person, s);
    let is_lost = is_lost(person, s);
    let mut joints = vec![[0.0; 3]; JOINTS.len()];
    let mut set = |name: &str, at: [f64; 3]| {
        if let Some(index) = JOINTS.iter().position(|(known, _)| *known == name) {
            joints[index] = walk.point(at);
        }
    };
    let bob = 0.02 * libm::cos(2.0 * walk.phase_rad);
    for (name, at) in TRUNK_AND_HEAD {
        set(name, [at[0], at[1], at[2] + bob]);
    }
    let mut angles = vec![0.0f32; ANGLES.len()];
    for (word, y, first_leg, first_arm) in [("left", 1.0, 33, 32), ("right", -1.0, 19, 18)] {
        let [hip, knee, shoulder, elbow] = side(&walk, word == "left");
        let along = |from: [f64; 3], angle: f64, length: f64| {
            [
                from[0] + length * libm::sin(angle),
                from[1],
                from[2] - length * libm::cos(angle),
            ]
        };
        let hip_at = [0.0, 0.09 * y, 0.91 + bob];
        let knee_at = along(hip_at, hip, 0.42);
        let ankle_at = along(knee_at, hip - knee, 0.42);
        let shoulder_at = [0.0, 0.18 * y, 1.42 + bob];
        let elbow_at = along(shoulder_at, shoulder, 0.3);
        let wrist_at = along(elbow_at, shoulder + elbow, 0.26);
        for (part, at) in [
            ("hip", hip_at),
            ("knee", knee_at),
            ("ankle", ankle_at),
            ("heel", along(ankle_at, hip - knee - 0.6, 0.07)),
            ("toe", along(ankle_at, hip - knee + 1.25, 0.19)),
            ("shoulder", shoulder_at),
            ("elbow", elbow_at),
            ("wrist", wrist_at),
            ("hand", along(wrist_at, shoulder + elbow, 0.09)),
        ] {
            set(&format!("{word}_{part}"), at);
        }
        angles[first_leg] = hip as f32;
        angles[first_leg + 3] = knee as f32;
        angles[first_arm] = elbow as f32;
        angles[first_arm - 3] = shoulder as f32;
    }
    for (index, value) in [walk.at.y, 0.95 * walk.size, walk.at.x]
        .into_iter()
        .enumerate()
    {
        angles[3 + index] = value as f32;
    }
    let far = joints.iter().enumerate().map(|(index, _)| {
        let base = 0.008 + 0.004 * (index % 5) as f32;
        if is_lost { base + 0.08 } else { base }
    });
    PersonPose {
        person: PersonId(person),
        state: match (is_lost, s < 0.5) {
            (true, _) => PersonState::Coasting,
            (_, true) => PersonState::Tentative,
            _ => PersonState::Tracked,
        },
        keypoints_m: keypoints(&joints),
        sigma_m: far.collect(),
        angles,
        unobserved: if is_lost { (1 << 40) - 1 } else { FEET },
        views: if is_lost { 0 } else { 3 + (person % 2) as u16 },
        joints_m: joints,
    }
}

/// The three angles of each foot, which 17 keypoints do not determine.
const FEET: u64 = 0b111 << 23 | 0b111 << 37;

/// Whether a person is seen by no camera at a time; people are lost one after another.
pub(crate) fn is_lost(person: u32, s: f64) -> bool {
    s > 1.0 && (s + 1.7 * f64::from(person)).rem_euclid(LOSING_S * 4.0) < LOST_S
}

fn keypoints(joints: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let index_of = |name: &&str| JOINTS.iter().position(|(known, _)| known == name);
    let found = COCO17
        .iter()
        .map(|name| index_of(name).and_then(|index| joints.get(index)));
    found
        .map(|joint| joint.copied().unwrap_or_default())
        .collect()
}
