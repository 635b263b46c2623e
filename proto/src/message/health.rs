//! The health of a node beyond its work: clock, keys, followed session, and warnings.

use serde::{Deserialize, Serialize};

use super::live::MAX_EDGES;
use crate::id::SessionId;
use crate::wire::MAX_REASON_BYTES;

/// Largest difference between a system's clock and the node's, either way, microseconds: a machine
/// whose clock was never set is in 1970.
pub const MAX_AHEAD_US: i64 = 100 * 365 * 86_400 * 1_000_000;
/// Most notices of one status.
pub const MAX_NOTICES: usize = 16;

/// The health of a node.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct NodeHealth {
    /// The state of the system's clock; `None` if unknown.
    pub system_clock: Option<SystemClock>,
    /// End of the node's certificate, Unix time in seconds; `None` without keys.
    pub certificate_ends_s: Option<u64>,
    /// The session of fusion that an edge follows; fusion's own session for fusion.
    pub follows: Option<SessionId>,
    /// For fusion: its links, in the order of
    /// [`LiveStatus::edges`](super::live::LiveStatus::edges), with additional values.
    pub links: Vec<LinkHealth>,
    /// Warnings in plain text, the most severe first; at most [`MAX_NOTICES`], each at most
    /// [`crate::wire::MAX_REASON_BYTES`] long.
    pub notices: Vec<String>,
}

/// The clock of a node's system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SystemClock {
    /// Whether the system reports that NTP or PTP synchronises it.
    pub synchronised: bool,
    /// Its maximum error, microseconds, if the system reports one.
    pub max_error_us: Option<u32>,
    /// Its time minus the time of the node's clock, microseconds. The node's clock never jumps, so
    /// this is the size of a jump when the system's clock is set.
    pub ahead_us: i64,
}

/// Fusion's data about its link to one edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct LinkHealth {
    /// Maximum error of the measured clock offset of the edge, microseconds.
    pub clock_uncertainty_us: Option<u32>,
    /// The correction that fusion sends to the edge, microseconds.
    pub clock_correction_us: Option<i32>,
    /// Messages of the edge that found no room, or that came faster than any edge may send, since
    /// the start.
    pub dropped: u64,
}

impl NodeHealth {
    /// Adds a notice, cut to the allowed length; ignored if there are already too many.
    pub fn notice(&mut self, text: String) {
        if self.notices.len() < MAX_NOTICES {
            self.notices.push(crate::wire::cut_reason(text));
        }
    }

    /// Checks counts and lengths.
    ///
    /// # Errors
    /// A short description of the problem.
    pub(super) fn check(&self) -> Result<(), &'static str> {
        if self.links.len() > MAX_EDGES {
            return Err("more edges than a venue may have");
        }
        let ahead_us = self.system_clock.map_or(0, |clock| clock.ahead_us);
        if ahead_us.unsigned_abs() > MAX_AHEAD_US.unsigned_abs() {
            return Err("a clock offset out of range");
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
    fn every_notice_can_be_sent() {
        let mut health = NodeHealth::default();
        for _ in 0..=MAX_NOTICES {
            health.notice("\u{2026}".repeat(MAX_REASON_BYTES));
        }
        assert_eq!(health.notices.len(), MAX_NOTICES);
        health.check().unwrap();
    }
}
