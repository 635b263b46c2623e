//! Messages between the links and the loop, and the two modes of a run.

use farfield_proto::message::{PatchSet, SightingSet, Status};
use farfield_proto::wire::WireError;

/// An event of the network.
#[derive(Debug)]
pub(crate) enum FusionIncoming {
    /// Patches.
    Patches(PatchSet, Arrival),
    /// Sightings.
    Sightings(SightingSet, Arrival),
    /// The status of a node.
    Status(Box<Status>),
    /// A node has joined or left.
    Alive(String, Liveliness),
    /// The key of an unreadable message, and the error.
    Unreadable(String, WireError),
}

/// The arrival of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Arrival {
    /// Its size in bytes.
    pub(crate) bytes: u64,
    /// Its time, microseconds since 1970.
    pub(crate) at_us: i64,
}

/// Whether a node is present.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Liveliness {
    /// Its liveliness token exists.
    There,
    /// Its token ended with its session.
    Gone,
}

/// A message of fusion.
#[derive(Debug)]
pub(crate) enum FusionOutgoing {
    /// Boxes for the viewpoint of this index.
    Boxes(usize, Vec<u8>),
    /// The persons of a tick.
    Poses(Vec<u8>),
    /// The persons of a tick, from the fixed-lag smoother.
    Smooth(Vec<u8>),
    /// The sets used for a tick, for recorders elsewhere.
    Decision(Vec<u8>),
    /// The identity events of a tick.
    Events(Vec<u8>),
    /// Comparisons of people with the venue's subjects at a tick.
    Namings(Vec<u8>),
    /// Fusion's status.
    Status(Box<Status>),
}

/// How a run treats time and messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RunMode {
    /// All messages arrive, in order, however long it takes.
    LockStep,
    /// The newest message counts; one that cannot be sent at once is dropped.
    Live,
}
