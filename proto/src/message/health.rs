//! How a node is, beyond its work: its clock, its keys, whom it follows, and what a person should know.

use serde::{Deserialize, Serialize};

use super::live::MAX_EDGES;
use crate::id::SessionId;
use crate::wire::MAX_REASON_BYTES;

/// Most that a system's clock may be ahead of the node's, either way, microseconds: a machine that was never told the time
/// is in 1970.
pub const MAX_AHEAD_US: i64 = 100 * 365 * 86_400 * 1_000_000;
/// Most notices of one status.
pub const MAX_NOTICES: usize = 16;

/// How a node is.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct NodeHealth {
    /// What the system says of its clock; `None` where it says nothing.
    pub system_clock: Option<SystemClock>,
    /// When the node's certificate ends, Unix time in seconds; `None` without keys.
    pub certificate_ends_s: Option<u64>,
    /// The session of fusion that an edge follows; of fusion its own.
    pub follows: Option<SessionId>,
    /// Of fusion: what is known of its links beside [`LiveStatus::edges`](super::live::LiveStatus::edges), in the same
    /// order.
    pub links: Vec<LinkHealth>,
    /// What is not as it should be, in words, the worst first; at most [`MAX_NOTICES`], each at most
    /// [`crate::wire::MAX_REASON_BYTES`] long.
    pub notices: Vec<String>,
}

/// The clock of a node's system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SystemClock {
    /// Whether something (NTP, PTP) keeps it right, as the system says.
    pub synchronised: bool,
    /// By how much it may be wrong at most, microseconds, where the system says that.
    pub max_error_us: Option<u32>,
    /// Its time less that of the clock by which the node goes, microseconds. The latter never jumps: where somebody sets
    /// the system's clock, this says by how much.
    pub ahead_us: i64,
}

/// What fusion knows of its link to one edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct LinkHealth {
    /// How far the measured offset of the edge's clock may be from the true one, microseconds.
    pub clock_uncertainty_us: Option<u32>,
    /// The correction that the edge is told, microseconds.
    pub clock_correction_us: Option<i32>,
    /// Messages of the edge that found no place or came faster than any edge may send, since the start.
    pub dropped: u64,
}

impl NodeHealth {
    /// Adds a notice, cut to what may be sent; one too many is left out.
    pub fn notice(&mut self, text: String) {
        if self.notices.len() < MAX_NOTICES {
            self.notices.push(crate::wire::cut_reason(text));
        }
    }

    /// Checks counts and lengths.
    ///
    /// # Errors
    /// What is wrong, in a few words.
    pub(super) fn check(&self) -> Result<(), &'static str> {
        if self.links.len() > MAX_EDGES {
            return Err("more edges than a venue may have");
        }
        let ahead_us = self.system_clock.map_or(0, |clock| clock.ahead_us);
        if ahead_us.unsigned_abs() > MAX_AHEAD_US.unsigned_abs() {
            return Err("a clock that is ahead of any time");
        }
        if self.notices.len() > MAX_NOTICES {
            return Err("more notices than a status may have");
        }
        if self
            .notices
            .iter()
            .any(|text| text.len() > MAX_REASON_BYTES)
        {
            return Err("a text that is too long");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_ahead_of_any_time_is_refused() {
        for (ahead_us, is_ok) in [
            (MAX_AHEAD_US, true),
            (-MAX_AHEAD_US, true),
            (MAX_AHEAD_US + 1, false),
            (i64::MIN, false),
        ] {
            let health = NodeHealth {
                system_clock: Some(SystemClock {
                    ahead_us,
                    ..SystemClock::default()
                }),
                ..NodeHealth::default()
            };
            assert_eq!(health.check().is_ok(), is_ok, "{ahead_us}");
        }
    }

    #[test]
    fn whatever_is_noticed_can_be_sent() {
        let mut health = NodeHealth::default();
        for _ in 0..=MAX_NOTICES {
            health.notice("\u{2026}".repeat(MAX_REASON_BYTES));
        }
        assert_eq!(health.notices.len(), MAX_NOTICES);
        health.check().unwrap();
    }
}
