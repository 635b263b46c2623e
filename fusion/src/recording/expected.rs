//! The people that a session expects from the previous one. Fusion's own recording stores them once
//! before its first tick, so that a replay expects them, too.

use farfield_proto::id::SessionId;
use serde::{Deserialize, Serialize};

use crate::identity::known::KnownPeople;

/// People that a session expects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExpectedPeople {
    /// The session.
    pub session: SessionId,
    /// The people.
    pub known: KnownPeople,
}

impl ExpectedPeople {
    /// Returns `self` if the people are plausible.
    pub(super) fn checked(self) -> Option<Self> {
        let known = self.known.checked().ok()?;
        Some(Self { known, ..self })
    }
}
