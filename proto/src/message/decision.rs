//! The sets that fusion used for a tick. With them and all messages, the tick can be recomputed.

use serde::{Deserialize, Serialize};

use crate::id::{SessionId, ViewpointIndex};
use crate::message::live::MAX_EDGES;
use crate::tick::Tick;
use crate::wire::{MAX_PARTS, Message};

/// Fusion to all: the sets from which the poses of a tick were computed. Only the timely arrival of
/// sets depends on a clock; everything else follows from the messages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// Fusion's session.
    pub session: SessionId,
    /// The tick of the session's first boxes.
    pub first: Tick,
    /// The tick that was computed.
    pub tick: Tick,
    /// Prediction horizon of the boxes that followed, ticks, by viewpoint; empty in lock-step.
    pub horizons_ticks: Vec<f64>,
    /// The patch sets that had arrived, by viewpoint and part.
    pub patches: Vec<UsedSet>,
    /// The sighting sets that had arrived, by viewpoint and part.
    pub sightings: Vec<UsedSet>,
}

/// One message of the tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct UsedSet {
    /// The sender.
    pub viewpoint: ViewpointIndex,
    /// Its part number within the tick.
    pub part: u16,
}

impl Message for Decision {
    fn check(&self) -> Result<(), &'static str> {
        if self.horizons_ticks.len() > MAX_EDGES {
            return Err("more horizons than a venue may have viewpoints");
        }
        if !self.horizons_ticks.iter().all(|ticks| ticks.is_finite()) {
            return Err("a horizon that is not finite");
        }
        for sets in [&self.patches, &self.sightings] {
            if sets.iter().any(|set| set.part >= MAX_PARTS) {
                return Err("a part past the last one");
            }
            if !sets.is_sorted_by(|a, b| a < b) {
                return Err("sets out of order or twice");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::wire::{WireError, decode, encode};

    fn used(sets: &[(u16, u16)]) -> Vec<UsedSet> {
        let set = |&(viewpoint, part)| UsedSet {
            viewpoint: ViewpointIndex(viewpoint),
            part,
        };
        sets.iter().map(set).collect()
    }

    fn decision(patches: &[(u16, u16)]) -> Decision {
        Decision {
            session: SessionId(1 << 63),
            first: Tick(100_000_000_000),
            tick: Tick(100_000_000_007),
            horizons_ticks: vec![1.0, 4.5],
            patches: used(patches),
            sightings: used(&[(1, 0)]),
        }
    }

    #[test]
    fn unordered_or_duplicate_sets_are_refused() {
        decode::<Decision>(&encode(&decision(&[(0, 0), (0, 1), (2, 0)]))).unwrap();
        for wrong in [[(0, 0), (0, 0)], [(1, 0), (0, 0)]] {
            let read = decode::<Decision>(&encode(&decision(&wrong)));
            assert!(matches!(read, Err(WireError::Invalid(_))), "{wrong:?}");
        }
        let endless = Decision {
            horizons_ticks: vec![f64::NAN],
            ..decision(&[])
        };
        assert!(decode::<Decision>(&encode(&endless)).is_err());
    }

    proptest! {
        #[test]
        fn every_decision_is_read_back(
            sets in prop::collection::btree_set((any::<u16>(), 0..MAX_PARTS), 0..40),
            ticks in any::<(i64, i64)>(),
            horizons_ticks in prop::collection::vec(-1e6..1e6, 0..8),
        ) {
            let sets: Vec<(u16, u16)> = sets.into_iter().collect();
            let decision = Decision {
                first: Tick(ticks.0),
                tick: Tick(ticks.1),
                horizons_ticks,
                ..decision(&sets)
            };
            prop_assert_eq!(decode::<Decision>(&encode(&decision)), Ok(decision));
        }

        #[test]
        fn arbitrary_bytes_cause_no_panic(bytes in any::<Vec<u8>>()) {
            drop(decode::<Decision>(&[&[crate::wire::VERSION], &bytes[..]].concat()));
        }
    }
}
