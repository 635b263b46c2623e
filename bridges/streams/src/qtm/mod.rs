//! Compatible with the real-time protocol of Qualisys Track Manager (QTM), versions 1.8 to 1.25,
//! little endian.
//!
//! Source: *QTM Real-time Server Protocol Documentation*,
//! <https://docs.qualisys.com/qtm-rt-protocol/>. Where it is ambiguous, Qualisys' published client
//! libraries are followed.
//!
//! A person is a set of labelled markers (`<name>_<joint>`), a rigid body (the pelvis) and a
//! skeleton (20 segments named as in Qualisys' own skeletons, in a T-pose with identity rotations).
//! Millimetres, z up, right-handed.
//!
//! Clients read the lists of labels, bodies and skeletons once, and rely on their order afterwards.
//! So data is sent in the order of the list that the client last read, with missing people marked
//! as missing. When the roster changes, the client receives an event, as with QTM when a
//! measurement changes, and reads the lists again.
//!
//! Commands that control QTM rather than the stream (`TakeControl`, `Start`, settings) are refused
//! with an error packet.

mod command;
mod components;
mod parameters;
mod server;
mod session;
mod wire;

pub use command::{Command, Component, Components, Rate, Topic};
pub use components::data_packet;
pub use parameters::parameters;
pub(crate) use server::serve;
pub use session::{Answer, Layout, Session};
pub use wire::{Incoming, Packet, PacketKind, TooLong};

/// A version of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// Always 1.
    pub major: u8,
    /// The minor version.
    pub minor: u8,
}

impl Version {
    /// The oldest supported version; before it, positions were doubles.
    pub const OLDEST: Self = Self { major: 1, minor: 8 };
    /// The newest supported version.
    pub const NEWEST: Self = Self {
        major: 1,
        minor: 25,
    };

    /// Whether rigid bodies and skeletons are nested with transforms, as since version 1.21.
    pub const fn nests_segments(self) -> bool {
        self.minor > 20
    }
}

/// Segment names: Qualisys' skeletons use Mixamo's names without the prefix.
pub(crate) fn segment_name(bone: farfield_export::skeleton::Bone) -> &'static str {
    let name = farfield_export::skeleton::BoneNames::Mixamo.name(bone);
    name.strip_prefix("mixamorig:").unwrap_or(name)
}
