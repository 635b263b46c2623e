//! Compatible with the real-time protocol of Qualisys Track Manager (QTM), versions 1.8 to 1.25, little endian.
//!
//! Source: *QTM Real-time Server Protocol Documentation*, <https://docs.qualisys.com/qtm-rt-protocol/>. What its text
//! leaves open is as Qualisys' published client libraries read it.
//!
//! A person is a set of labelled markers (`<name>_<joint>`), a rigid body (the pelvis) and a skeleton (20 segments with
//! names as of Qualisys' own skeletons, in a T-pose with identity rotations). Millimetres, z up, right-handed.
//!
//! Clients read the list of labels, bodies and skeletons once and count through it afterwards. So a client is sent data in
//! the order of the list that it read last; who is not there any more is sent as missing; when people come or go for good
//! the client is told by an event, as QTM does when a measurement changes, and reads the lists again.
//!
//! What commands QTM and not the stream (`TakeControl`, `Start`, settings) is refused with an error packet.

mod command;
mod components;
mod layout;
mod parameters;
mod server;
mod session;
mod wire;

pub use command::{Command, Component, Components, Rate, Topic};
pub use components::data_packet;
pub use layout::Layout;
pub use parameters::parameters;
pub(crate) use server::serve;
pub use session::{Answer, Session};
pub use wire::{Incoming, Packet, PacketKind, TooLong};

/// A version of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// 1 in all there are.
    pub major: u8,
    /// The second number.
    pub minor: u8,
}

impl Version {
    /// The oldest one that is spoken: before it, positions were doubles.
    pub const OLDEST: Self = Self { major: 1, minor: 8 };
    /// The newest one that is spoken.
    pub const NEWEST: Self = Self {
        major: 1,
        minor: 25,
    };

    /// Whether rigid bodies and skeletons are described as since version 1.21: nested, with transforms.
    pub const fn nests_segments(self) -> bool {
        self.minor > 20
    }
}

/// Names of the segments: Qualisys' own skeletons have those of Mixamo's, without their prefix.
pub(crate) fn segment_name(bone: farfield_export::skeleton::Bone) -> &'static str {
    let name = farfield_export::skeleton::BoneNames::Mixamo.name(bone);
    name.strip_prefix("mixamorig:").unwrap_or(name)
}
