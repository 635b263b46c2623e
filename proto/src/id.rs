//! Identities: persons, viewpoints, cameras, sessions.

use std::fmt;

use serde::{Deserialize, Serialize};

/// One tracked human. Stays the same for as long as the person is in the venue; counted from 1 in every
/// [`SessionId`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct PersonId(pub u32);

impl fmt::Display for PersonId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A viewpoint, as its position in the venue file. Both sides hold the same file: a difference is
/// refused at start by its [`crate::venue::VenueHash`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ViewpointIndex(pub u16);

/// A camera, as its position among all cameras of the venue file, counted through the viewpoints
/// in file order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct CameraIndex(pub u16);

/// One run of the fusion node, from start to end. Person ids of different sessions are unrelated, so every message that
/// names a person names the session too.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
pub struct SessionId(pub u64);
