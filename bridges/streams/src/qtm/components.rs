//! Frames as data packets.
//!
//! ```text
//! packet     size u32 | 3 u32 | time µs i64 | frame u32 | components u32 | component...
//! component  size u32 | kind u32 | content
//! markers    count u32 | 2D dropped i16 | 2D out of sync i16 | (x y z f32 | [residual f32])...
//! bodies     as markers, of (x y z f32 | matrix 9 f32, column by column, or 3 angles f32, degrees | [residual f32])...
//! skeletons  count u32 | (segments u32 | (id u32 | x y z f32 | quaternion x y z w f32)...)...
//! ```
//!
//! Angles are roll, pitch and yaw of `R = Rx(roll) Ry(pitch) Rz(yaw)`, Qualisys' standard. Missing
//! values are NaN; a missing skeleton has no segments.

use farfield_export::skeleton::Bone;
use farfield_fusion::body::skeleton::Joint;
use nalgebra::{Matrix3, Vector3};

use super::Layout;
use super::command::Component;
use super::wire::{PacketKind, packet};
use crate::frame::{Frame, PersonFrame, Roster};

const MM: f64 = 1000.0;

/// The data packet of a frame with these components, in the client's order of people.
pub fn data_packet(frame: &Frame, components: &[Component], layout: &Layout) -> Vec<u8> {
    let mut payload = Vec::with_capacity(1024);
    // Microseconds as i64 last 292,000 years.
    payload.extend_from_slice(&frame.elapsed_us().to_le_bytes());
    // Frame numbers are unsigned with 32 bits: ticks modulo 2^32.
    payload.extend_from_slice(&(frame.tick.0 as u32).to_le_bytes());
    put_u32(&mut payload, components.len());
    for component in components {
        let (kind, content) = match *component {
            Component::Markers { residual } => (
                if residual { 9 } else { 1 },
                markers(frame, layout.markers(frame), residual),
            ),
            Component::Unlabelled { residual } => (if residual { 10 } else { 2 }, counted(0)),
            Component::Bodies { euler, residual } => (
                match (euler, residual) {
                    (false, false) => 5,
                    (true, false) => 6,
                    (false, true) => 11,
                    (true, true) => 12,
                },
                bodies(frame, layout.bodies(frame), euler, residual),
            ),
            Component::Skeletons { global } => {
                (18, skeletons(frame, layout.skeletons(frame), global))
            }
        };
        put_u32(&mut payload, content.len() + 8);
        put_u32(&mut payload, kind);
        payload.extend_from_slice(&content);
    }
    packet(PacketKind::Data, &payload)
}

/// The header of markers and bodies: their number, and drop rates of 2D data, which are 0.
fn counted(n: usize) -> Vec<u8> {
    let mut content = Vec::new();
    put_u32(&mut content, n);
    put_u32(&mut content, 0);
    content
}

fn markers(frame: &Frame, roster: &Roster, residual: bool) -> Vec<u8> {
    let mut content = counted(roster.people.len() * Joint::ALL.len());
    for entry in &roster.people {
        let person = frame.find(entry.id);
        for joint in Joint::ALL {
            let at_m = person.map(|person| person.joints_m[joint.index()]);
            put_point(&mut content, at_m);
            if residual {
                put_f32(&mut content, MM * sigma_m(person, joint));
            }
        }
    }
    content
}

/// Standard deviation of a joint, metres; 0 means unknown in the protocol.
fn sigma_m(person: Option<&PersonFrame>, joint: Joint) -> f64 {
    let sigma_m = person.and_then(|person| person.sigma_m);
    sigma_m.map_or(0.0, |all| all[joint.index()])
}

fn bodies(frame: &Frame, roster: &Roster, euler: bool, residual: bool) -> Vec<u8> {
    let mut content = counted(roster.people.len());
    for entry in &roster.people {
        let person = frame.find(entry.id);
        put_point(&mut content, person.map(|person| person.motion.root_m));
        let turned = person.map(|person| {
            let hips = person.motion.rotations[Bone::Hips.index()];
            hips.to_rotation_matrix().into_inner()
        });
        match (turned, euler) {
            (None, true) => put_all(&mut content, &[f64::NAN; 3]),
            (None, false) => put_all(&mut content, &[f64::NAN; 9]),
            (Some(turned), true) => put_all(&mut content, &roll_pitch_yaw_deg(&turned)),
            (Some(turned), false) => put_all(&mut content, turned.as_slice()),
        }
        if residual {
            put_f32(&mut content, MM * sigma_m(person, Joint::Pelvis));
        }
    }
    content
}

/// Angles of R = Rx(a) Ry(b) Rz(c), degrees: a and c within ±180, b within ±90. At the pole of b,
/// only a ± c is defined, and c is 0.
fn roll_pitch_yaw_deg(r: &Matrix3<f64>) -> [f64; 3] {
    /// Cosine of b below which a and c cannot be separated.
    const POLE: f64 = 1e-9;
    let cos_b = libm::hypot(r[(0, 0)], r[(0, 1)]);
    let b = libm::atan2(r[(0, 2)], cos_b);
    let [a, c] = if cos_b < POLE {
        [libm::atan2(r[(2, 1)], r[(1, 1)]), 0.0]
    } else {
        [
            libm::atan2(-r[(1, 2)], r[(2, 2)]),
            libm::atan2(-r[(0, 1)], r[(0, 0)]),
        ]
    };
    [a, b, c].map(f64::to_degrees)
}

fn skeletons(frame: &Frame, roster: &Roster, global: bool) -> Vec<u8> {
    let mut content = Vec::new();
    put_u32(&mut content, roster.people.len());
    for entry in &roster.people {
        match frame.find(entry.id) {
            None => put_u32(&mut content, 0),
            Some(person) => skeleton(&mut content, person, global),
        }
    }
    content
}

fn skeleton(content: &mut Vec<u8>, person: &PersonFrame, global: bool) {
    put_u32(content, Bone::ALL.len());
    let heads_m = person.motion.heads_m(&person.rig);
    let mut world_from_bone = person.motion.rotations;
    for bone in Bone::ALL {
        let i = bone.index();
        if let Some(parent) = bone.parent() {
            world_from_bone[i] = world_from_bone[parent.index()] * person.motion.rotations[i];
        }
        let (at_m, turned) = match bone.parent() {
            _ if global => (heads_m[i], world_from_bone[i]),
            None => (person.motion.root_m, person.motion.rotations[i]),
            Some(_) => (person.rig.offset_m[i], person.motion.rotations[i]),
        };
        put_u32(content, i + 1);
        put_point(content, Some(at_m));
        // Stored as x, y, z, w.
        put_all(content, turned.coords.as_slice());
    }
}

fn put_u32(into: &mut Vec<u8>, value: usize) {
    into.extend_from_slice(&(value as u32).to_le_bytes());
}

fn put_f32(into: &mut Vec<u8>, value: f64) {
    into.extend_from_slice(&(value as f32).to_le_bytes());
}

fn put_all(into: &mut Vec<u8>, values: &[f64]) {
    for value in values {
        put_f32(into, *value);
    }
}

/// A point in metres, as millimetres.
fn put_point(into: &mut Vec<u8>, at_m: Option<Vector3<f64>>) {
    let at_m = at_m.unwrap_or_else(|| Vector3::repeat(f64::NAN));
    put_all(into, (at_m * MM).as_slice());
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;
    use crate::synthetic;

    fn f32_at(bytes: &[u8], at: usize) -> f64 {
        f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
    }

    fn u32_at(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn markers_are_the_joints_in_millimetres() {
        let frame = synthetic::frame(100);
        let bytes = data_packet(
            &frame,
            &[Component::Markers { residual: true }],
            &Layout::default(),
        );
        assert_eq!(u32_at(&bytes, 0) as usize, bytes.len());
        // One second after the first tick of the session.
        assert_eq!(
            u64::from_le_bytes(bytes[8..16].try_into().unwrap()),
            1_000_000
        );
        assert_eq!([16, 20, 28].map(|at| u32_at(&bytes, at)), [100, 1, 9]);
        assert_eq!(u32_at(&bytes, 32), 58);
        for (p, person) in frame.persons.iter().enumerate() {
            for (j, joint_m) in person.joints_m.iter().enumerate() {
                let at = 40 + 16 * (29 * p + j);
                for (axis, expected_m) in joint_m.iter().enumerate() {
                    let found_mm = f32_at(&bytes, at + 4 * axis);
                    assert!((found_mm - 1000.0 * expected_m).abs() < 1e-3);
                }
                assert!((f32_at(&bytes, at + 12) - 12.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn people_missing_from_the_frame_are_sent_as_missing() {
        let frame = synthetic::frame(100);
        let mut alone = Frame::clone(&frame);
        alone.persons.remove(0);
        let all = [
            Component::Markers { residual: false },
            Component::Bodies {
                euler: true,
                residual: false,
            },
            Component::Skeletons { global: false },
        ];
        let bytes = data_packet(&alone, &all, &Layout::default());
        assert!(f32_at(&bytes, 40).is_nan());
        let bodies = 24 + u32_at(&bytes, 24) as usize;
        assert_eq!([4, 8].map(|at| u32_at(&bytes, bodies + at)), [6, 2]);
        assert!((0..6).all(|i| f32_at(&bytes, bodies + 16 + 4 * i).is_nan()));
        let skeletons = bodies + u32_at(&bytes, bodies) as usize;
        assert_eq!(
            [4, 8, 12, 16].map(|at| u32_at(&bytes, skeletons + at)),
            [18, 2, 0, 20]
        );
    }

    proptest! {
        #[test]
        fn roll_pitch_and_yaw_turn_about_x_y_and_z(turn in prop::array::uniform3(-3.0f64..3.0)) {
            let r = Rotation3::from_scaled_axis(Vector3::from(turn)).into_inner();
            let [a, b, c] = roll_pitch_yaw_deg(&r).map(f64::to_radians);
            let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
            let again = about(Vector3::x_axis(), a) * about(Vector3::y_axis(), b) * about(Vector3::z_axis(), c);
            prop_assert!((again.into_inner() - r).norm() < 1e-9);
        }
    }
}
