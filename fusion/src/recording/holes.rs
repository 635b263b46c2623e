//! Which ticks of which viewpoints a recording lacks.
//!
//! A tick that a viewpoint has not sent whole some time after it was worked on is a hole, once the viewpoint
//! was heard of. Who fills holes asks for the oldest first: an edge's ring
//! gives up its oldest, too.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::fill::{MAX_TICKS, SetKind};
use farfield_proto::id::SessionId;
use farfield_proto::message::{PatchSet, SightingSet};
use farfield_proto::tick::Tick;

/// Most holes of one viewpoint; of more, the oldest stay holes.
const MAX_HOLES: usize = 4096;
/// Most ticks of one viewpoint that are neither whole nor holes yet.
const MAX_OPEN: usize = 4096;

/// The holes of a recording under way.
#[derive(Debug)]
pub struct Holes {
    session: SessionId,
    /// How many ticks a set may take until it is missed.
    settle: i64,
    tracks: Vec<Track>,
    /// The first tick that was worked on.
    first: Option<Tick>,
    /// The last tick that was worked on.
    last: Option<Tick>,
}

/// What is known of one viewpoint.
#[derive(Debug, Default)]
struct Track {
    /// Ticks before are whole or holes; `None`: nothing was heard.
    settled: Option<Tick>,
    newest: Option<Tick>,
    /// Where the ticks before `settled` begin of which nothing came and that are no hole yet.
    gap: Option<Tick>,
    open: BTreeMap<Tick, Seen>,
    /// First tick and the tick after the last.
    holes: BTreeMap<Tick, Tick>,
    given_up: u64,
    /// The edge works on every so manieth tick: shorter gaps are no holes.
    every_nth: i64,
}

/// What has come of a tick.
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
    /// Nothing is missing yet of `n_viewpoints`; a set is missed `settle` ticks after its own.
    pub fn new(session: SessionId, n_viewpoints: usize, settle: i64) -> Self {
        let mut tracks = Vec::new();
        tracks.resize_with(n_viewpoints, Track::default);
        Self {
            session,
            settle,
            tracks,
            first: None,
            last: None,
        }
    }

    /// A patch set was recorded.
    pub fn patches(&mut self, set: &PatchSet) {
        if set.session != self.session {
            return;
        }
        let one = set.parts == 1 && set.sighting_parts == 0;
        if let Some(seen) = self.seen(usize::from(set.viewpoint.0), set.tick, one) {
            seen.parts = Some(set.parts);
            seen.sighting_parts = Some(set.sighting_parts);
            seen.arrived.insert((SetKind::Patches, set.part));
        }
    }

    /// A sighting set was recorded.
    pub fn sightings(&mut self, set: &SightingSet) {
        if set.session != self.session {
            return;
        }
        if let Some(seen) = self.seen(usize::from(set.viewpoint.0), set.tick, false) {
            seen.arrived.insert((SetKind::Sightings, set.part));
        }
    }

    /// The edge of a viewpoint works on every `nth` tick now.
    pub fn works_on_every(&mut self, viewpoint: usize, nth: u16) {
        if let Some(track) = self.tracks.get_mut(viewpoint) {
            track.every_nth = nth.into();
        }
    }

    /// A tick was worked on: what should have been there long before is missing now.
    pub fn worked_on(&mut self, tick: Tick) {
        self.first = self.first.or(Some(tick));
        self.last = self.last.max(Some(tick));
        self.settle_until(tick + -self.settle);
    }

    /// The run is over: whatever is not there of its ticks is missing.
    pub fn over(&mut self) {
        if let Some(last) = self.last {
            self.settle_until(last + 1);
        }
    }

    /// The oldest ticks that are missing of a viewpoint which is heard; the first and the tick after the
    /// last.
    pub fn oldest(&self, viewpoint: usize) -> Option<[Tick; 2]> {
        let track = self.tracks.get(viewpoint)?;
        let is_heard = track.newest? + self.settle >= self.last?;
        let (&from, &to) = track.holes.first_key_value().filter(|_| is_heard)?;
        Some([from, to.min(from + MAX_TICKS)])
    }

    /// The edge has delivered what it had of these ticks, half-open.
    pub fn answered(&mut self, viewpoint: usize, [from, to]: [Tick; 2]) {
        if let Some(track) = self.tracks.get_mut(viewpoint) {
            track.cut(from, to);
        }
    }

    /// Number of viewpoints.
    pub fn viewpoints(&self) -> usize {
        self.tracks.len()
    }

    /// Ticks that are missing, summed over the viewpoints.
    pub fn left(&self) -> u64 {
        let of = |track: &Track| {
            let holes = track.holes.iter();
            holes
                .map(|(&from, &to)| (to - from).unsigned_abs())
                .sum::<u64>()
                + track.given_up
        };
        self.tracks.iter().map(of).sum()
    }

    fn settle_until(&mut self, until: Tick) {
        for track in &mut self.tracks {
            track.settle_until(until);
        }
    }

    /// Where a set of `tick` is noted; `None` when that has no use any more. `one`: it is all that its
    /// tick has.
    fn seen(&mut self, viewpoint: usize, tick: Tick, one: bool) -> Option<&mut Seen> {
        let far = self
            .last
            .is_some_and(|last| tick - last > MAX_OPEN.cast_signed() as i64);
        let track = self.tracks.get_mut(viewpoint).filter(|_| !far)?;
        track.newest = track.newest.max(Some(tick));
        let first = self.first.map_or(tick, |first| first.min(tick));
        let settled = *track.settled.get_or_insert(first);
        if tick < settled {
            if one {
                track.cut(tick, tick + 1);
            }
            return None;
        }
        if track.open.len() >= MAX_OPEN && !track.open.contains_key(&tick) {
            return None;
        }
        Some(track.open.entry(tick).or_default())
    }
}

impl Track {
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
            }
        }
        if self.add(from, until) {
            from = until;
        }
        self.gap = Some(from);
        self.settled = Some(until);
    }

    /// Whether `from..to` is long enough for a hole, and is one now.
    fn add(&mut self, from: Tick, to: Tick) -> bool {
        if to - from < self.every_nth.max(1) {
            return false;
        }
        if let Some(mut last) = self.holes.last_entry()
            && *last.get() == from
        {
            last.insert(to);
            return true;
        }
        self.holes.insert(from, to);
        if self.holes.len() > MAX_HOLES
            && let Some((from, to)) = self.holes.pop_first()
        {
            self.given_up += (to - from).unsigned_abs();
        }
        true
    }

    /// Takes `from..to` out of the holes.
    fn cut(&mut self, from: Tick, to: Tick) {
        let touched: Vec<(Tick, Tick)> = self
            .holes
            .range(..to)
            .rev()
            .take_while(|(_, end)| **end > from)
            .map(|(&start, &end)| (start, end))
            .collect();
        for (start, end) in touched {
            self.holes.remove(&start);
            if start < from {
                self.holes.insert(start, from);
            }
            if to < end {
                self.holes.insert(to, end);
            }
        }
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
        let track = &holes.tracks[0];
        track.holes.iter().map(|(a, b)| [a.0, b.0]).collect()
    }

    #[test]
    fn what_does_not_come_in_time_is_a_hole() {
        let mut holes = Holes::new(SESSION, 2, 10);
        for tick in (100..120).chain(150..170) {
            holes.patches(&patches(tick, 0, 1, 0));
            holes.worked_on(Tick(tick));
        }
        assert_eq!(holes_of(&holes), [[120, 150]]);
        assert_eq!(holes.oldest(0), Some([Tick(120), Tick(150)]));
        assert_eq!(holes.oldest(1), None, "it was never heard");
        holes.answered(0, [Tick(120), Tick(130)]);
        assert_eq!(holes.left(), 20);
        holes.answered(0, [Tick(130), Tick(150)]);
        assert_eq!(holes.left(), 0);
        holes.worked_on(Tick(172));
        holes.over();
        assert_eq!(holes_of(&holes), [[170, 173]]);
    }

    #[test]
    fn a_tick_is_whole_when_all_of_its_parts_are_there() {
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
    fn a_late_set_closes_its_hole_and_a_silent_edge_is_not_asked() {
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
    fn ticks_that_an_edge_leaves_out_are_no_holes() {
        let mut holes = Holes::new(SESSION, 1, 2);
        holes.works_on_every(0, 3);
        for tick in 0..40 {
            if tick % 3 == 0 && tick != 12 {
                holes.patches(&patches(tick, 0, 1, 0));
            }
            holes.worked_on(Tick(tick));
        }
        assert_eq!(holes_of(&holes), [[10, 13]]);
    }

    #[test]
    fn strangers_leave_no_trace() {
        let mut holes = Holes::new(SESSION, 1, 2);
        holes.patches(&patches(10, 0, 1, 0));
        holes.worked_on(Tick(10));
        let of_another = PatchSet {
            session: SessionId(8),
            ..patches(11, 0, 1, 0)
        };
        holes.patches(&of_another);
        holes.patches(&patches(i64::MAX, 0, 1, 0));
        let of_nobody = PatchSet {
            viewpoint: ViewpointIndex(9),
            ..patches(11, 0, 1, 0)
        };
        holes.patches(&of_nobody);
        holes.worked_on(Tick(14));
        assert_eq!(holes_of(&holes), [[11, 12]]);
    }

    proptest! {
        #[test]
        fn the_holes_are_the_ticks_that_did_not_come(
            came in prop::collection::btree_set(0i64..200, 1..150),
            answers in prop::collection::vec((0i64..200, 1i64..50), 0..20),
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
            for (from, len) in answers {
                holes.answered(0, [Tick(from), Tick(from + len)]);
                missing.retain(|t| !(from..from + len).contains(t));
                prop_assert_eq!(holes.left(), missing.len() as u64);
            }
        }
    }
}
