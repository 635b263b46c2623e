//! Selects the sets that are recorded on arrival: each message once, and only for ticks near the current one.
//!
//! An edge that sends old sets again, by a wrong clock or on purpose, would fill the recording's disk. Sets delayed longer by an
//! outage come from the edge's ring.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::message::fill::SetKind;
use farfield_proto::tick::Tick;
use farfield_proto::wire::MAX_PARTS;

/// Largest distance of a set from the current tick, seconds: links deliver queued messages within that time after an outage, and
/// clocks that are further off are refused.
const REACH_S: f64 = 10.0;

const WORD_BITS: usize = u64::BITS as usize;

/// The messages of one kind of set of a tick, one bit each.
type Parts = [u64; (MAX_PARTS as usize).div_ceil(WORD_BITS)];

/// Received messages of one viewpoint: per tick the parts of both kinds of set.
type PartsByTick = BTreeMap<Tick, [Parts; 2]>;

/// A message of a set.
#[derive(Debug, Clone, Copy)]
pub(super) struct SetMessage {
    pub(super) session: SessionId,
    pub(super) viewpoint: ViewpointIndex,
    pub(super) tick: Tick,
    pub(super) kind: SetKind,
    pub(super) part: u16,
}

/// Received messages of each viewpoint.
#[derive(Debug)]
pub(super) struct RecordedSets {
    reach: i64,
    /// The session and the current tick; `None` before the first.
    current: Mutex<Option<(SessionId, Tick)>>,
    of_viewpoint: Box<[Mutex<PartsByTick>]>,
}

impl RecordedSets {
    pub(super) fn new(n_viewpoints: usize, rate_hz: f64) -> Self {
        Self {
            reach: (REACH_S * rate_hz).ceil() as i64,
            current: Mutex::default(),
            of_viewpoint: (0..n_viewpoints).map(|_| Mutex::default()).collect(),
        }
    }

    /// Sets the current `tick` of `session`.
    pub(super) fn worked_on(&self, session: SessionId, tick: Tick) {
        *lock(&self.current) = Some((session, tick));
    }

    /// Whether the message belongs to the run and comes for the first time. Before the first tick all do.
    pub(super) fn is_new(&self, message: &SetMessage) -> bool {
        let Some((session, tick)) = *lock(&self.current) else {
            return true;
        };
        let index = usize::from(message.viewpoint.0);
        let Some(seen) = self.of_viewpoint.get(index) else {
            return false;
        };
        let ticks = tick + -self.reach..tick + self.reach;
        if message.session != session || !ticks.contains(&message.tick) {
            return false;
        }
        let mut seen = lock(seen);
        while seen
            .first_key_value()
            .is_some_and(|(&old, _)| old < ticks.start)
        {
            seen.pop_first();
        }
        let kind = usize::from(message.kind == SetKind::Sightings);
        let parts = &mut seen.entry(message.tick).or_default()[kind];
        let (word, bit) = (
            usize::from(message.part) / WORD_BITS,
            usize::from(message.part) % WORD_BITS,
        );
        let Some(word) = parts.get_mut(word) else {
            return false;
        };
        let is_new = *word >> bit & 1 == 0;
        *word |= 1 << bit;
        is_new
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(tick: i64, part: u16) -> SetMessage {
        SetMessage {
            session: SessionId(7),
            viewpoint: ViewpointIndex(1),
            tick: Tick(tick),
            kind: SetKind::Patches,
            part,
        }
    }

    #[test]
    fn a_set_near_the_current_tick_is_recorded_once() {
        let sets = RecordedSets::new(2, 60.0);
        assert!(sets.is_new(&message(5, 0)), "nothing is worked on yet");
        sets.worked_on(SessionId(7), Tick(10_000));
        let again = [
            (10_001, 0),
            (10_001, 1),
            (10_001, 0),
            (9_700, 0),
            (9_700, 0),
        ];
        let new = again.map(|(tick, part)| sets.is_new(&message(tick, part)));
        assert_eq!(new, [true, true, false, true, false]);
        let sightings = SetMessage {
            kind: SetKind::Sightings,
            ..message(10_001, 0)
        };
        assert!(sets.is_new(&sightings));
        for tick in [9_399, 10_600, i64::MIN, i64::MAX] {
            assert!(!sets.is_new(&message(tick, 0)), "{tick}");
        }
        let of_another = SetMessage {
            session: SessionId(8),
            ..message(10_002, 0)
        };
        assert!(!sets.is_new(&of_another));
    }

    #[test]
    fn the_memory_per_viewpoint_is_bounded() {
        let sets = RecordedSets::new(2, 60.0);
        for tick in 0..100_000 {
            sets.worked_on(SessionId(7), Tick(tick));
            assert!(sets.is_new(&message(tick, 0)));
        }
        assert!(lock(&sets.of_viewpoint[1]).len() <= 601);
        assert!(size_of::<[Parts; 2]>() <= 256);
    }
}
