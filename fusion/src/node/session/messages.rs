//! What passes between the wire and the loop.

use farfield_proto::message::{PatchSet, SightingSet, Status};
use farfield_proto::wire::WireError;

/// What the network tells the loop.
#[derive(Debug)]
pub(in crate::node) enum FusionIncoming {
    /// Patches.
    Patches(PatchSet, Arrival),
    /// Sightings.
    Sightings(SightingSet, Arrival),
    /// A node says how it is.
    Status(Box<Status>),
    /// A node has joined or left.
    Alive(String, Liveliness),
    /// A message that cannot be read, by its key, and why.
    Unreadable(String, WireError),
}

/// How a message came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::node) struct Arrival {
    /// The bytes it took.
    pub(in crate::node) bytes: u64,
    /// When, microseconds since 1970.
    pub(in crate::node) at_us: i64,
}

/// Whether a node is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::node) enum Liveliness {
    /// Its liveliness token is there.
    There,
    /// Its token went away with its session.
    Gone,
}

/// What fusion says, and to whom.
#[derive(Debug)]
pub(in crate::node) enum FusionOutgoing {
    /// Boxes for the viewpoint of this index.
    Boxes(usize, Vec<u8>),
    /// The persons of a tick.
    Poses(Vec<u8>),
    /// The persons of a tick, as the fixed-lag smoother sees them.
    Smooth(Vec<u8>),
    /// What was used for a tick, for whoever records elsewhere.
    Decision(Vec<u8>),
    /// What changed who is who at a tick.
    Events(Vec<u8>),
    /// Who was compared with the venue's subjects at a tick.
    Namings(Vec<u8>),
    /// How fusion is.
    Status(Box<Status>),
}
