//! ROS 2 messages as bytes: transforms of all bones, and markers that draw them.
//!
//! Sources: the message definitions of `tf2_msgs` and `visualization_msgs` (identical from Humble
//! to Kilted), and REP 103 for units and axes, which match ours: metres, z up, right-handed.
//!
//! Encoding: CDR, little endian, numbers aligned to their own size. Source: OMG, *Common Object
//! Request Broker Architecture*, part 2, 9.3 (CDR transfer syntax), with the encapsulation of *The
//! Real-time Publish-Subscribe Protocol* (DDSI-RTPS), 10.5: `CDR_LE`.
//!
//! Frames are children of [`WORLD`]: `person_3/pelvis`, `person_3/left_knee`, ... are bones of the
//! export skeleton, named by their first joint, rotated relative to the T-pose.

use farfield_export::skeleton::{Bone, BoneNames};
use farfield_fusion::body::skeleton::Joint;
use farfield_proto::id::PersonId;
use nalgebra::{UnitQuaternion, Vector3};

use crate::frame::{Frame, PersonFrame};

/// The frame of the venue's world.
pub const WORLD: &str = "map";
/// The type name of a message on the wire, and the hash of its definition.
pub const TF_TYPE: (&str, &str) = (
    "tf2_msgs::msg::dds_::TFMessage_",
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
);
/// Like [`TF_TYPE`], for [`marker_array`].
pub const MARKERS_TYPE: (&str, &str) = (
    "visualization_msgs::msg::dds_::MarkerArray_",
    "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
);

/// Lifetime of a marker that is not sent again, nanoseconds.
const LIFETIME_NS: u32 = 500_000_000;
/// Line width, metres.
const LINE_M: f64 = 0.03;
/// Text height, and half its distance above the head, metres.
const TEXT_M: f64 = 0.15;
const LINE_LIST: i32 = 5;
const TEXT_VIEW_FACING: i32 = 9;
/// First id of the name markers.
const NAMES: i32 = 1 << 30;

/// ROS time since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// Whole seconds.
    pub secs: i32,
    /// Nanoseconds, below 10^9.
    pub nanos: u32,
}

/// `tf2_msgs/msg/TFMessage`: every bone of every person relative to its parent; the parent of the
/// hips is [`WORLD`].
pub fn tf_message(frame: &Frame, stamp: Stamp) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.count(frame.confirmed().count() * Bone::ALL.len());
    for person in frame.confirmed() {
        for bone in Bone::ALL {
            let i = bone.index();
            let (parent, at_m) = match bone.parent() {
                None => (WORLD.to_owned(), person.motion.root_m),
                Some(parent) => (frame_id(person.id, parent), person.rig.offset_m[i]),
            };
            header(&mut cdr, stamp, &parent);
            cdr.text(&frame_id(person.id, bone));
            pose(&mut cdr, &at_m, &person.motion.rotations[i]);
        }
    }
    cdr.finish()
}

/// `visualization_msgs/msg/MarkerArray`: lines between joints, and the name above the head.
pub fn marker_array(frame: &Frame, stamp: Stamp) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.count(2 * frame.confirmed().count());
    for person in frame.confirmed() {
        let lines = Joint::ALL.iter().filter_map(|joint| {
            let parent = joint.parent()?;
            Some([parent, *joint].map(|end| person.joints_m[end.index()]))
        });
        let points: Vec<_> = lines.flatten().collect();
        let id = person.id.0.cast_signed() & (NAMES - 1);
        let marker = Marker {
            id,
            kind: LINE_LIST,
            at_m: Vector3::zeros(),
            scale_m: LINE_M,
            points: &points,
            text: "",
        };
        marker.put(&mut cdr, stamp);
        let marker = Marker {
            id: id | NAMES,
            kind: TEXT_VIEW_FACING,
            at_m: above_head_m(person),
            scale_m: TEXT_M,
            points: &[],
            text: &person.name,
        };
        marker.put(&mut cdr, stamp);
    }
    cdr.finish()
}

fn frame_id(person: PersonId, bone: Bone) -> String {
    // Not the name, which may contain any character.
    format!("person_{person}/{}", BoneNames::Farfield.name(bone))
}

fn above_head_m(person: &PersonFrame) -> Vector3<f64> {
    person.joints_m[Joint::Head.index()] + Vector3::z() * (2.0 * TEXT_M)
}

fn header(cdr: &mut Cdr, stamp: Stamp, frame_id: &str) {
    cdr.i32(stamp.secs);
    cdr.u32(stamp.nanos);
    cdr.text(frame_id);
}

fn pose(cdr: &mut Cdr, at_m: &Vector3<f64>, turned: &UnitQuaternion<f64>) {
    cdr.f64s(at_m.as_slice());
    // Stored as x, y, z, w.
    cdr.f64s(turned.coords.as_slice());
}

struct Marker<'a> {
    id: i32,
    kind: i32,
    at_m: Vector3<f64>,
    scale_m: f64,
    points: &'a [Vector3<f64>],
    text: &'a str,
}

impl Marker<'_> {
    fn put(&self, cdr: &mut Cdr, stamp: Stamp) {
        header(cdr, stamp, WORLD);
        cdr.text("farfield");
        cdr.i32(self.id);
        cdr.i32(self.kind);
        // Action: add or modify.
        cdr.i32(0);
        pose(cdr, &self.at_m, &UnitQuaternion::identity());
        cdr.f64s(&[self.scale_m; 3]);
        cdr.f32s(&[0.1, 0.6, 1.0, 1.0]);
        cdr.i32(0);
        cdr.u32(LIFETIME_NS);
        // Not locked to a frame.
        cdr.byte(0);
        cdr.count(self.points.len());
        for point in self.points {
            cdr.f64s(point.as_slice());
        }
        // Colours of points.
        cdr.count(0);
        cdr.text("");
        // Texture: header, format, data, coordinates.
        header(cdr, Stamp { secs: 0, nanos: 0 }, "");
        cdr.text("");
        cdr.count(0);
        cdr.count(0);
        cdr.text(self.text);
        // Mesh: resource, file name, data, materials.
        cdr.text("");
        cdr.text("");
        cdr.count(0);
        cdr.byte(0);
    }
}

/// Length of the encapsulation header; alignment counts from its end.
const HEAD: usize = 4;

/// A message under construction.
#[derive(Debug)]
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn finish(self) -> Vec<u8> {
        self.0
    }

    fn align(&mut self, to: usize) {
        while !(self.0.len() - HEAD).is_multiple_of(to) {
            self.0.push(0);
        }
    }

    fn byte(&mut self, value: u8) {
        self.0.push(value);
    }

    fn i32(&mut self, value: i32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn f32s(&mut self, values: &[f32]) {
        self.align(4);
        for value in values {
            self.0.extend_from_slice(&value.to_le_bytes());
        }
    }

    fn f64s(&mut self, values: &[f64]) {
        self.align(8);
        for value in values {
            self.0.extend_from_slice(&value.to_le_bytes());
        }
    }

    /// Number of following elements.
    fn count(&mut self, n: usize) {
        self.u32(u32::try_from(n).unwrap_or(u32::MAX));
    }

    /// Length including the final zero, the bytes, and the zero.
    fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    const STAMP: Stamp = Stamp { secs: 3, nanos: 4 };

    #[test]
    fn the_first_transform_is_the_pelvis_in_the_world() {
        let frame = synthetic::frame(9);
        let bytes = tf_message(&frame, STAMP);
        assert_eq!(bytes[..8], [0, 1, 0, 0, 40, 0, 0, 0]);
        assert_eq!(
            bytes[8..24],
            [3, 0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, b'm', b'a', b'p', 0]
        );
        assert_eq!(bytes[24..28], 16u32.to_le_bytes());
        assert_eq!(&bytes[28..44], b"person_1/pelvis\0");
        let x = f64::from_le_bytes(bytes[44..52].try_into().unwrap());
        assert!((x - frame.persons[0].motion.root_m.x).abs() < 1e-12);
    }

    #[test]
    fn a_frame_without_people_gives_an_empty_list() {
        let mut frame = Frame::clone(&synthetic::frame(9));
        frame.persons.clear();
        assert_eq!(tf_message(&frame, STAMP), [0, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(marker_array(&frame, STAMP), [0, 1, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn numbers_are_aligned_from_the_end_of_the_header() {
        let mut cdr = Cdr::new();
        cdr.text("ab");
        cdr.f64s(&[1.0]);
        cdr.byte(7);
        cdr.u32(5);
        let mut expected = vec![0, 1, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0];
        // "ab" ends 7 bytes after the header, so the double is at 8.
        expected.extend_from_slice(&1.0f64.to_le_bytes());
        expected.extend_from_slice(&[7, 0, 0, 0, 5, 0, 0, 0]);
        assert_eq!(cdr.finish(), expected);
    }
}
