//! Identifiers of people, viewpoints, cameras and sessions.

use std::fmt;

use serde::{Deserialize, Serialize};

/// One tracked human. It stays the same while the person is in the venue; ids start at 1 in every
/// [`SessionId`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct PersonId(pub u32);

impl fmt::Display for PersonId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A viewpoint, as its index in the venue file. Both sides have the same file: a different
/// [`crate::venue::VenueHash`] is refused at start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ViewpointIndex(pub u16);

/// A camera, as its index among all cameras of the venue file, in file order over the viewpoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct CameraIndex(pub u16);

/// One run of the fusion node, from start to end. Person ids of different sessions are unrelated,
/// so every message with a person id also contains the session.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
pub struct SessionId(pub u64);
