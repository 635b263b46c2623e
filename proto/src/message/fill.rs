//! Filling holes: how fusion gets the sets of an outage from an edge's ring. It asks for a range of ticks, gets a
//! bounded answer, and asks again for the rest.

use serde::{Deserialize, Serialize};

use crate::id::SessionId;
use crate::tick::Tick;
use crate::wire::{MAX_MESSAGE_BYTES, Message};

/// Most bytes of stored messages in one answer: far less than a message may have, so that an answer never delays the
/// patches of a tick for long.
pub const MAX_ANSWER_BYTES: u32 = 64 * 1024;
/// Most stored messages in one answer.
pub const MAX_STORED: usize = 4096;
/// Most ticks in one question.
pub const MAX_TICKS: i64 = 1 << 20;

/// Fusion to edge, as the payload of a query: which sets are stored of these ticks?
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FillRequest {
    /// The session of fusion whose sets are meant.
    pub session: SessionId,
    /// First tick.
    pub from: Tick,
    /// The tick after the last.
    pub to: Tick,
    /// Most bytes of stored messages that fusion wants at once; the first tick's come whatever they take.
    pub max_bytes: u32,
}

/// Edge to fusion, as the reply: what was stored of the ticks from the question's first up to `to`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Filled {
    /// The tick after the last that the answer covers: of ticks before it, the edge has stored nothing else. Equal to
    /// the request's first tick when the edge has no room on its link now.
    pub to: Tick,
    /// The messages, as they were sent or would have been.
    pub stored: Vec<StoredSet>,
}

/// One stored message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredSet {
    /// Which kind of set it is, and so its key.
    pub kind: SetKind,
    /// The message as it travels.
    pub bytes: Vec<u8>,
}

/// What an edge stores.
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
            return Err("no tick is asked for");
        }
        if self.to - self.from > MAX_TICKS {
            return Err("more ticks than one question may be about");
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
    fn a_question_is_about_some_ticks_and_not_about_all() {
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
        fn every_answer_comes_back(
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
        fn no_bytes_bring_the_reader_down(bytes in any::<Vec<u8>>()) {
            let bytes = [&[VERSION], &bytes[..]].concat();
            drop((decode::<FillRequest>(&bytes), decode::<Filled>(&bytes)));
        }
    }
}
