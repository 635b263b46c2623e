//! Whom a session expects from the one before it: noted once by fusion's own recording, before its first tick, so that a
//! replay expects them, too.

use farfield_proto::id::SessionId;
use serde::{Deserialize, Serialize};

use crate::identity::known::KnownPeople;

/// Whom a session expects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExpectedPeople {
    /// Which session.
    pub session: SessionId,
    /// Whom.
    pub known: KnownPeople,
}

impl ExpectedPeople {
    /// The same, if the people are possible.
    pub(super) fn checked(self) -> Option<Self> {
        let known = self.known.checked().ok()?;
        Some(Self { known, ..self })
    }
}
