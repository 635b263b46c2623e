//! Holes of a recording: ticks of viewpoints that are missing.
//!
//! A tick that is incomplete some time after it was processed is a hole, if its viewpoint has sent
//! messages before. It stays one until all of its sets are written. An answer to a request only
//! ends the requests, because a ring may have lost the sets. The oldest holes are requested first:
//! an edge's ring also loses its oldest sets first.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::id::SessionId;
use farfield_proto::message::fill::{MAX_TICKS, SetKind};
use farfield_proto::message::{PatchSet, SightingSet};
use farfield_proto::tick::Tick;

use super::tick_ranges::TickRanges;

/// Most holes of one viewpoint; the oldest are then no longer requested.
const MAX_HOLES: usize = 4096;
/// Most ticks of one viewpoint that are neither complete nor holes yet.
const MAX_OPEN: usize = 4096;

/// The holes of a recording in progress.
#[derive(Debug)]
pub struct Holes {
    session: SessionId,
    /// Ticks after which a set is missing.
    settle: i64,
    tracks: Vec<ViewpointTicks>,
    /// The first processed tick.
    first: Option<Tick>,
    /// The last processed tick.
    last: Option<Tick>,
}

/// State of one viewpoint.
#[derive(Debug, Default)]
struct ViewpointTicks {
    /// Earlier ticks are complete or holes; `None` before the first message.
    settled: Option<Tick>,
    newest: Option<Tick>,
    /// Start of the ticks before `settled` without messages that are not a hole yet.
    gap: Option<Tick>,
    open: BTreeMap<Tick, Seen>,
    /// Sets of incomplete ticks before `settled`, or in the gap.
    partly: BTreeMap<Tick, Seen>,
    /// Incomplete ticks.
    holes: TickRanges,
    /// Holes without an answer yet.
    to_request: TickRanges,
    /// Ticks of holes that did not fit the memory.
    given_up: u64,
    /// The edge works on every n-th tick: shorter gaps are no holes.
    every_nth: i64,
}

/// Sets of a tick.
#[derive(Debug, Default)]
struct Seen {
    parts: Option<u16>,
    sighting_parts: Option<u16>,
    arrived: BTreeSet<(SetKind, u16)>,
}

impl Seen {
    fn is_whole(&self) -> bool {
        let parts = self.parts.zip(self.sighting_parts);
        parts.is_some_and(|(p, s)| self.arrived.len() >= usize::from(p) + usize::from(s))
    }
}

impl Holes {
    /// No holes for `n_viewpoints`; a set is missing `settle` ticks after its own.
    pub fn new(session: SessionId, n_viewpoints: usize, settle: i64) -> Self {
        let mut tracks = Vec::new();
        tracks.resize_with(n_viewpoints, ViewpointTicks::default);
        Self {
            session,
            settle,
            tracks,
            first: None,
            last: None,
        }
    }

    /// Records a written patch set, requested or not.
    pub fn patches(&mut self, set: &PatchSet) {
        if set.session != self.session {
            return;
        }
        self.note(usize::from(set.viewpoint.0), set.tick, |seen| {
            seen.parts = Some(set.parts);
            seen.sighting_parts = Some(set.sighting_parts);
            seen.arrived.insert((SetKind::Patches, set.part));
        });
    }

    /// Records a written sighting set, requested or not.
    pub fn sightings(&mut self, set: &SightingSet) {
        if set.session != self.session {
            return;
        }
        self.note(usize::from(set.viewpoint.0), set.tick, |seen| {
            seen.arrived.insert((SetKind::Sightings, set.part));
        });
    }

    /// Sets that the edge of a viewpoint works on every `nth` tick.
    pub fn works_on_every(&mut self, viewpoint: usize, nth: u16) {
        if let Some(track) = self.tracks.get_mut(viewpoint) {
            track.every_nth = nth.into();
        }
    }

    /// Records a processed tick: overdue sets are now missing.
    pub fn worked_on(&mut self, tick: Tick) {
        self.first = self.first.or(Some(tick));
        self.last = self.last.max(Some(tick));
        self.settle_until(tick + -self.settle);
    }

    /// Ends the run: all missing sets of its ticks are holes.
    pub fn over(&mut self) {
        if let Some(last) = self.last {
            self.settle_until(last + 1);
        }
    }

    /// The oldest ticks to request from a viewpoint that sends sets: the first, and the tick after
    /// the last.
    pub fn oldest(&self, viewpoint: usize) -> Option<[Tick; 2]> {
        let track = self.tracks.get(viewpoint)?;
        let is_heard = track.newest? + self.settle >= self.last?;
        let [from, to] = track.to_request.first().filter(|_| is_heard)?;
        Some([from, to.min(from + MAX_TICKS)])
    }

    /// Records the edge's answer about these ticks, half-open: they are not requested again. Sets
    /// that are not written in the end are missing.
    pub fn answered(&mut self, viewpoint: usize, ticks: [Tick; 2]) {
        if let Some(track) = self.tracks.get_mut(viewpoint) {
            track.to_request.cut(ticks);
        }
    }

    /// Number of viewpoints.
    pub fn viewpoints(&self) -> usize {
        self.tracks.len()
    }

    /// Missing ticks, summed over the viewpoints.
    pub fn left(&self) -> u64 {
        let of = |track: &ViewpointTicks| track.holes.ticks() + track.given_up;
        self.tracks.iter().map(of).sum()
    }

    fn settle_until(&mut self, until: Tick) {
        for track in &mut self.tracks {
            track.settle_until(until);
        }
    }

    /// Records a set of `tick` by `set`.
    fn note(&mut self, viewpoint: usize, tick: Tick, set: impl FnOnce(&mut Seen)) {
        let far = self
            .last
            .is_some_and(|last| tick - last > MAX_OPEN.cast_signed() as i64);
        let Some(track) = self.tracks.get_mut(viewpoint).filter(|_| !far) else {
            return;
        };
        track.newest = track.newest.max(Some(tick));
        let first = self.first.map_or(tick, |first| first.min(tick));
        let settled = *track.settled.get_or_insert(first);
        if tick < settled {
            track.note_late(tick, set);
        } else if track.open.len() < MAX_OPEN || track.open.contains_key(&tick) {
            set(track.open.entry(tick).or_default());
        }
    }
}

impl ViewpointTicks {
    fn settle_until(&mut self, until: Tick) {
        let Some(settled) = self.settled.filter(|&settled| settled < until) else {
            return;
        };
        let still_open = self.open.split_off(&until);
        let over = std::mem::replace(&mut self.open, still_open);
        let mut from = self.gap.unwrap_or(settled);
        for (tick, seen) in over {
            if seen.is_whole() {
                self.add(from, tick);
                from = tick + 1;
            } else {
                self.store_part(tick, seen);
            }
        }
        if self.add(from, until) {
            from = until;
        }
        self.gap = Some(from);
        self.settled = Some(until);
    }

    /// Records a set of a tick before `settled`.
    fn note_late(&mut self, tick: Tick, set: impl FnOnce(&mut Seen)) {
        let in_gap = self.gap.is_some_and(|gap| gap <= tick);
        if !in_gap && !self.holes.contains(tick) {
            return;
        }
        let mut seen = self.partly.remove(&tick).unwrap_or_default();
        set(&mut seen);
        if seen.is_whole() && !in_gap {
            self.fill(tick);
        } else {
            self.store_part(tick, seen);
        }
    }

    /// Stores the sets of a tick; the oldest are forgotten if there are too many.
    fn store_part(&mut self, tick: Tick, seen: Seen) {
        self.partly.insert(tick, seen);
        if self.partly.len() > MAX_OPEN {
            self.partly.pop_first();
        }
    }

    fn fill(&mut self, tick: Tick) {
        self.holes.cut([tick, tick + 1]);
        self.to_request.cut([tick, tick + 1]);
    }

    /// Whether `from..to` is long enough for a hole, and is one now.
    fn add(&mut self, from: Tick, to: Tick) -> bool {
        let least = self.every_nth.max(1);
        if to - from < least {
            return false;
        }
        self.holes.push([from, to], least);
        self.to_request.push([from, to], 1);
        // Sets that came before the hole was known.
        let late = self.partly.range(from..to);
        let whole = late.filter(|(_, seen)| seen.is_whole());
        let whole: Vec<Tick> = whole.map(|(&tick, _)| tick).collect();
        for tick in whole {
            self.partly.remove(&tick);
            self.fill(tick);
        }
        if self.holes.len() > MAX_HOLES
            && let Some([from, to]) = self.holes.first()
        {
            self.given_up += (to - from).unsigned_abs();
            self.holes.cut([from, to]);
            self.to_request.cut([from, to]);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::ViewpointIndex;
    use proptest::prelude::*;

    use super::*;

    const SESSION: SessionId = SessionId(7);

    fn patches(tick: i64, part: u16, parts: u16, sighting_parts: u16) -> PatchSet {
        PatchSet {
            session: SESSION,
            tick: Tick(tick),
            viewpoint: ViewpointIndex(0),
            part,
            parts,
            sighting_parts,
            timing: None,
            persons: Vec::new(),
        }
    }

    fn holes_of(holes: &Holes) -> Vec<[i64; 2]> {
        holes.tracks[0].holes.all()
    }

    #[test]
    fn an_overdue_set_is_a_hole() {
        let mut holes = Holes::new(SESSION, 2, 10);
        for tick in (100..120).chain(150..170) {
            holes.patches(&patches(tick, 0, 1, 0));
            holes.worked_on(Tick(tick));
        }
        assert_eq!(holes_of(&holes), [[120, 150]]);
        assert_eq!(holes.oldest(0), Some([Tick(120), Tick(150)]));
        assert_eq!(holes.oldest(1), None, "it never sent");
        holes.answered(0, [Tick(120), Tick(130)]);
        assert_eq!(holes.oldest(0), Some([Tick(130), Tick(150)]));
        for tick in 120..150 {
            holes.patches(&patches(tick, 0, 1, 0));
        }
        assert_eq!((holes.left(), holes.oldest(0)), (0, None));
        holes.worked_on(Tick(172));
        holes.over();
        assert_eq!(holes_of(&holes), [[170, 173]]);
    }

    #[test]
    fn a_tick_is_complete_with_all_its_parts() {
        let mut holes = Holes::new(SESSION, 1, 2);
        holes.patches(&patches(0, 0, 2, 0));
        holes.patches(&patches(0, 0, 2, 0));
        holes.patches(&patches(1, 0, 1, 1));
        holes.patches(&patches(2, 0, 1, 1));
        let sightings = SightingSet {
            session: SESSION,
            tick: Tick(2),
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            sightings: Vec::new(),
        };
        holes.sightings(&sightings);
        holes.worked_on(Tick(5));
        assert_eq!(holes_of(&holes), [[0, 2]]);
    }

    #[test]
    fn an_answer_ends_requests_and_only_a_written_set_fills() {
        let mut holes = Holes::new(SESSION, 1, 2);
        for tick in [0, 9] {
            holes.patches(&patches(tick, 0, 1, 0));
            holes.worked_on(Tick(tick));
        }
        assert_eq!(holes_of(&holes), [[1, 7]]);
        // A ring that was overwritten, created elsewhere or lost sets has none of them.
        holes.answered(0, [Tick(1), Tick(7)]);
        assert_eq!((holes.oldest(0), holes.left()), (None, 6));
        holes.patches(&patches(3, 0, 2, 0));
        assert_eq!(holes.left(), 6, "one part of two");
        holes.patches(&patches(3, 1, 2, 0));
        assert_eq!(holes_of(&holes), [[1, 3], [4, 7]]);
        assert_eq!((holes.oldest(0), holes.left()), (None, 5));
    }

    #[test]
    fn live_and_delivered_parts_complete_a_tick() {
        let mut holes = Holes::new(SESSION, 1, 2);
        holes.patches(&patches(0, 0, 1, 0));
        holes.patches(&patches(1, 0, 2, 0));
        holes.worked_on(Tick(6));
        assert_eq!(holes_of(&holes), [[1, 4]]);
        holes.patches(&patches(1, 1, 2, 0));
        assert_eq!(holes_of(&holes), [[2, 4]]);
    }

    #[test]
    fn late_sets_fill_holes_and_silent_edges_get_no_request() {
        let mut holes = Holes::new(SESSION, 1, 2);
        holes.patches(&patches(0, 0, 1, 0));
        holes.worked_on(Tick(6));
        assert_eq!(holes_of(&holes), [[1, 4]]);
        assert_eq!(holes.oldest(0), None, "it is silent");
        holes.patches(&patches(2, 0, 1, 0));
        assert_eq!(holes_of(&holes), [[1, 2], [3, 4]]);
        holes.patches(&patches(6, 0, 1, 0));
        assert_eq!(holes.oldest(0), Some([Tick(1), Tick(2)]));
    }

    #[test]
    fn ticks_that_an_edge_skips_are_no_holes() {
        let mut holes = Holes::new(SESSION, 1, 2);
        holes.works_on_every(0, 3);
        for tick in 0..40 {
            if tick % 3 == 0 && tick != 12 {
                holes.patches(&patches(tick, 0, 1, 0));
            }
            holes.worked_on(Tick(tick));
        }
        assert_eq!(holes_of(&holes), [[10, 13]]);
        holes.answered(0, [Tick(10), Tick(11)]);
        holes.patches(&patches(12, 0, 1, 0));
        assert_eq!(holes.left(), 0, "the others were never made");
    }

    #[test]
    fn foreign_sets_are_ignored() {
        let mut holes = Holes::new(SESSION, 1, 2);
        holes.patches(&patches(10, 0, 1, 0));
        holes.worked_on(Tick(10));
        let of_another = PatchSet {
            session: SessionId(8),
            ..patches(11, 0, 1, 0)
        };
        holes.patches(&of_another);
        holes.patches(&patches(i64::MAX, 0, 1, 0));
        let foreign = PatchSet {
            viewpoint: ViewpointIndex(9),
            ..patches(11, 0, 1, 0)
        };
        holes.patches(&foreign);
        holes.worked_on(Tick(14));
        assert_eq!(holes_of(&holes), [[11, 12]]);
    }

    proptest! {
        #[test]
        fn holes_are_the_missing_ticks(
            came in prop::collection::btree_set(0i64..200, 1..150),
            filled in prop::collection::vec((0i64..200, 1i64..50), 0..20),
        ) {
            let mut holes = Holes::new(SESSION, 1, 5);
            for tick in 0..200 {
                if came.contains(&tick) {
                    holes.patches(&patches(tick, 0, 1, 0));
                }
                holes.worked_on(Tick(tick));
            }
            holes.over();
            let mut missing: BTreeSet<i64> = (0..200).filter(|t| !came.contains(t)).collect();
            prop_assert_eq!(holes.left(), missing.len() as u64);
            for (from, len) in filled {
                holes.answered(0, [Tick(from), Tick(from + len)]);
                for tick in from..from + len {
                    holes.patches(&patches(tick, 0, 1, 0));
                }
                missing.retain(|t| !(from..from + len).contains(t));
                prop_assert_eq!(holes.left(), missing.len() as u64);
            }
        }
    }
}
