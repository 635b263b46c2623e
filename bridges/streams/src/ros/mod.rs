//! Messages of ROS 2, as bytes: transforms of all bones, and markers that draw them.
//!
//! Sources: the message definitions of `tf2_msgs` and `visualization_msgs` (the same from Humble to Kilted), and REP 103 for
//! units and axes, which are ours: metres, z up, right-handed.
//!
//! Frames hang from [`WORLD`]: `person_3/pelvis`, `person_3/left_knee`, ... are bones of the export skeleton by the joints
//! that they begin at, turned against the T-pose.

mod cdr;

use cdr::Cdr;
use farfield_export::skeleton::{Bone, BoneNames};
use farfield_fusion::body::skeleton::Joint;
use farfield_proto::id::PersonId;
use nalgebra::{UnitQuaternion, Vector3};

use crate::frame::{Frame, PersonFrame};

/// The frame of the venue's world.
pub const WORLD: &str = "map";
/// A message's type as ROS 2 names it on the wire, with the hash of its definition.
pub const TF_TYPE: (&str, &str) = (
    "tf2_msgs::msg::dds_::TFMessage_",
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
);
/// As [`TF_TYPE`], of [`marker_array`].
pub const MARKERS_TYPE: (&str, &str) = (
    "visualization_msgs::msg::dds_::MarkerArray_",
    "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
);

/// A marker that is not sent again is gone after so many nanoseconds.
const LIFETIME_NS: u32 = 500_000_000;
/// How thick lines are drawn, metres.
const LINE_M: f64 = 0.03;
/// How high letters are, and how far they float above the head, metres.
const TEXT_M: f64 = 0.15;
const LINE_LIST: i32 = 5;
const TEXT_VIEW_FACING: i32 = 9;
/// Ids of the markers with names begin here.
const NAMES: i32 = 1 << 30;

/// A time of ROS: since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// Whole seconds.
    pub secs: i32,
    /// And nanoseconds, below 10^9.
    pub nanos: u32,
}

/// `tf2_msgs/msg/TFMessage`: where every bone of everybody is against its parent, that of the hips being [`WORLD`].
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

/// `visualization_msgs/msg/MarkerArray`: lines from joint to joint, and the name above the head.
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
    // Not the name, which may hold anything.
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
        // Add, or change.
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
        // A texture: header, format, data; its coordinates.
        header(cdr, Stamp { secs: 0, nanos: 0 }, "");
        cdr.text("");
        cdr.count(0);
        cdr.count(0);
        cdr.text(self.text);
        // A mesh: resource, file name, data, materials.
        cdr.text("");
        cdr.text("");
        cdr.count(0);
        cdr.byte(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    const STAMP: Stamp = Stamp { secs: 3, nanos: 4 };

    #[test]
    fn the_first_transform_is_that_of_the_pelvis_in_the_world() {
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
    fn nobody_is_an_empty_list() {
        let mut frame = Frame::clone(&synthetic::frame(9));
        frame.persons.clear();
        assert_eq!(tf_message(&frame, STAMP), [0, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(marker_array(&frame, STAMP), [0, 1, 0, 0, 0, 0, 0, 0]);
    }
}
