//! Filling gaps: how fusion gets the sets of an outage from an edge's ring. It requests a range of
//! ticks, gets a bounded answer, and requests the rest.

use serde::{Deserialize, Serialize};

use crate::id::SessionId;
use crate::tick::Tick;
use crate::wire::{MAX_MESSAGE_BYTES, Message};

/// Most bytes of stored messages in one answer. It is far below the limit of a message, so an
/// answer never delays the patches of a tick for long.
pub const MAX_ANSWER_BYTES: u32 = 64 * 1024;
/// Most stored messages in one answer.
pub const MAX_STORED: usize = 4096;
/// Most ticks in one request.
pub const MAX_TICKS: i64 = 1 << 20;

/// Fusion to edge, as a query payload: a request for the stored sets of these ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FillRequest {
    /// The session of fusion.
    pub session: SessionId,
    /// First tick.
    pub from: Tick,
    /// The tick after the last.
    pub to: Tick,
    /// Most bytes of stored messages in the answer; the first tick's messages are always included.
    pub max_bytes: u32,
}

/// Edge to fusion, as the reply: the stored sets from the first requested tick up to `to`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Filled {
    /// The tick after the last that the answer covers; the edge has stored nothing else before it.
    /// Equal to the request's first tick when the edge's link has no room now.
    pub to: Tick,
    /// The messages, as sent or as prepared for sending.
    pub stored: Vec<StoredSet>,
}

/// One stored message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredSet {
    /// The kind of set, which determines its key.
    pub kind: SetKind,
    /// The encoded message.
    pub bytes: Vec<u8>,
}

/// The kinds of stored sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SetKind {
    /// A [`crate::message::PatchSet`].
    Patches,
    /// A [`crate::message::SightingSet`].
    Sightings,
}

impl Message for FillRequest {
    fn check(&self) -> Result<(), &'static str> {
        if self.from >= self.to {
            return Err("no tick is requested");
        }
        if self.to - self.from > MAX_TICKS {
            return Err("more ticks than one request may cover");
        }
        if self.max_bytes > MAX_ANSWER_BYTES {
            return Err("more bytes than an answer may have");
        }
        Ok(())
    }
}

impl Message for Filled {
    fn check(&self) -> Result<(), &'static str> {
        if self.stored.len() > MAX_STORED {
            return Err("more messages than an answer may have");
        }
        if self
            .stored
            .iter()
            .any(|set| set.bytes.len() > MAX_MESSAGE_BYTES)
        {
            return Err("a message that is too long");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::wire::{VERSION, decode, encode};

    #[test]
    fn a_request_has_a_bounded_range_of_ticks() {
        let asked = |from, to, max_bytes| {
            let request = FillRequest {
                session: SessionId(7),
                from: Tick(from),
                to: Tick(to),
                max_bytes,
            };
            decode::<FillRequest>(&encode(&request)).is_ok()
        };
        assert!(asked(5, 6, 0) && asked(-5, 300, MAX_ANSWER_BYTES));
        assert!(!asked(5, 5, 100) && !asked(6, 5, 100));
        assert!(!asked(i64::MIN, i64::MAX, 100) && !asked(0, 10, MAX_ANSWER_BYTES + 1));
    }

    proptest! {
        #[test]
        fn every_answer_is_read_back(
            to in any::<i64>(),
            stored in prop::collection::vec((any::<bool>(), any::<Vec<u8>>()), 0..8),
        ) {
            let set = |(patches, bytes)| StoredSet {
                kind: if patches { SetKind::Patches } else { SetKind::Sightings },
                bytes,
            };
            let filled = Filled { to: Tick(to), stored: stored.into_iter().map(set).collect() };
            prop_assert_eq!(decode::<Filled>(&encode(&filled)), Ok(filled));
        }

        #[test]
        fn arbitrary_bytes_cause_no_panic(bytes in any::<Vec<u8>>()) {
            let bytes = [&[VERSION], &bytes[..]].concat();
            drop((decode::<FillRequest>(&bytes), decode::<Filled>(&bytes)));
        }
    }
}
