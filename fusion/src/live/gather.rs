//! Gathers patch and sighting sets of all open ticks from all viewpoints.
//!
//! The live variant of [`crate::align`]: several ticks are open at once, and the caller takes the
//! first of them whether it is complete or not. Duplicates and any order of arrival are harmless. A
//! set that comes after its tick was taken is late, and is returned once.

use std::collections::VecDeque;

use farfield_proto::id::{PersonId, SessionId, ViewpointIndex};
use farfield_proto::message::{MAX_PERSONS, PatchSet, SightingSet};
use farfield_proto::tick::Tick;

use crate::align::{Gather, Refused, TickGroup};

/// Most payload of one viewpoint that waits for its ticks, bytes: far above what any link carries
/// while ticks are open.
const MAX_WAITING_BYTES: u64 = 16 << 20;

/// Most late patches that are returned between two ticks: each costs the smoother as much as a
/// timely one.
const MAX_LATE_PATCHES: usize = 1024;

/// Result of adding a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Taken<T> {
    /// It waits for its tick.
    Open,
    /// Its tick is over; this is its first arrival.
    Late(T),
    /// It is not accepted.
    Refused(Refused),
}

/// One open tick.
#[derive(Debug, Clone)]
struct Opened {
    gather: Gather,
    /// Payload by viewpoint.
    bytes: Vec<u64>,
}

/// One tick that is over, with the sets that came.
#[derive(Debug, Clone, Default)]
struct Closed {
    patches: Vec<(ViewpointIndex, u16)>,
    sightings: Vec<(ViewpointIndex, u16)>,
    persons: Vec<(ViewpointIndex, PersonId)>,
}

impl Closed {
    fn clear(&mut self) {
        self.patches.clear();
        self.sightings.clear();
        self.persons.clear();
    }

    /// Records a late set.
    fn note_patches(&mut self, set: &PatchSet) -> Result<(), Refused> {
        let key = (set.viewpoint, set.part);
        if set.part >= set.parts || self.patches.contains(&key) {
            return Err(Refused::RepeatedPart);
        }
        let before = self.persons.len();
        let own = self.persons.iter().filter(|(of, _)| *of == set.viewpoint);
        if own.count() + set.persons.len() > MAX_PERSONS {
            return Err(Refused::TooMany);
        }
        for patch in &set.persons {
            let person = (set.viewpoint, patch.person);
            if self.persons.contains(&person) {
                self.persons.truncate(before);
                return Err(Refused::RepeatedPerson);
            }
            self.persons.push(person);
        }
        self.patches.push(key);
        Ok(())
    }
}

/// Gathers the messages of the ticks from the next one on.
#[derive(Debug, Clone)]
pub struct LiveGather {
    session: SessionId,
    n_viewpoints: usize,
    next: Tick,
    /// From `next` on; `None` before the first message.
    open: VecDeque<Option<Opened>>,
    /// Payload of `open` by viewpoint.
    waiting_bytes: Vec<u64>,
    /// How many ticks from `next` on are open.
    ahead: usize,
    /// The newest ticks that are over, the last one first.
    closed: VecDeque<Closed>,
    /// For how many ticks late messages are distinguished from repeated ones.
    behind: usize,
    /// Late patches that were returned since the last tick was taken.
    late_patches: usize,
}

impl LiveGather {
    /// Starts with `next`, for the viewpoints `0..n_viewpoints`. `ahead` ticks are open at once.
    /// For `behind` more ticks messages are late, then they are refused.
    pub fn new(
        session: SessionId,
        next: Tick,
        n_viewpoints: usize,
        [behind, ahead]: [usize; 2],
    ) -> Self {
        Self {
            session,
            n_viewpoints,
            next,
            open: VecDeque::new(),
            waiting_bytes: vec![0; n_viewpoints],
            ahead: ahead.max(1),
            closed: VecDeque::new(),
            behind,
            late_patches: 0,
        }
    }

    /// The next tick to take.
    pub fn next(&self) -> Tick {
        self.next
    }

    /// Adds a patch set of `bytes`.
    pub fn add_patches(&mut self, set: PatchSet, bytes: u64) -> Taken<PatchSet> {
        let late_patches = self.late_patches + set.persons.len();
        match self.place(set.session, set.tick, set.viewpoint, bytes) {
            Err(refused) => Taken::Refused(refused),
            Ok(TickSlot::Closed(_)) if late_patches > MAX_LATE_PATCHES => {
                Taken::Refused(Refused::TooMany)
            }
            Ok(TickSlot::Closed(closed)) => match closed.note_patches(&set) {
                Ok(()) => {
                    self.late_patches = late_patches;
                    Taken::Late(set)
                }
                Err(refused) => Taken::Refused(refused),
            },
            Ok(TickSlot::Open(open)) => {
                let index = usize::from(set.viewpoint.0);
                match open.gather.add_patches(set) {
                    Ok(()) => {
                        open.bytes[index] += bytes;
                        self.waiting_bytes[index] += bytes;
                        Taken::Open
                    }
                    Err(refused) => Taken::Refused(refused),
                }
            }
        }
    }

    /// Adds a sighting set of `bytes`.
    pub fn add_sightings(&mut self, set: SightingSet, bytes: u64) -> Taken<SightingSet> {
        let key = (set.viewpoint, set.part);
        match self.place(set.session, set.tick, set.viewpoint, bytes) {
            Err(refused) => Taken::Refused(refused),
            Ok(TickSlot::Closed(closed)) => {
                if note(&mut closed.sightings, key) {
                    Taken::Late(set)
                } else {
                    Taken::Refused(Refused::RepeatedPart)
                }
            }
            Ok(TickSlot::Open(open)) => {
                let index = usize::from(set.viewpoint.0);
                match open.gather.add_sightings(set) {
                    Ok(()) => {
                        open.bytes[index] += bytes;
                        self.waiting_bytes[index] += bytes;
                        Taken::Open
                    }
                    Err(refused) => Taken::Refused(refused),
                }
            }
        }
    }

    /// Whether `viewpoint` has sent all announced parts for `tick`.
    pub fn has_all(&self, tick: Tick, viewpoint: ViewpointIndex) -> bool {
        self.opened(tick)
            .is_some_and(|gather| gather.is_complete_of(viewpoint))
    }

    /// Whether all sightings of `viewpoint` have come for `tick`.
    pub fn has_sightings(&self, tick: Tick, viewpoint: ViewpointIndex) -> bool {
        self.opened(tick)
            .is_some_and(|gather| gather.has_sightings_of(viewpoint))
    }

    /// Whether any message came from `viewpoint` for `tick`, which is open or recently was.
    pub fn has_any(&self, tick: Tick, viewpoint: ViewpointIndex) -> bool {
        let of = |key: &(ViewpointIndex, u16)| key.0 == viewpoint;
        match usize::try_from((self.next - tick).saturating_sub(1)) {
            Ok(age) => self
                .closed
                .get(age)
                .is_some_and(|closed| closed.patches.iter().any(of)),
            Err(_) => self.opened(tick).is_some_and(|gather| {
                let mut sets = gather.group().patch_sets.iter();
                sets.any(|set| set.viewpoint == viewpoint)
            }),
        }
    }

    /// Returns the messages of the next tick, and advances.
    pub fn take(&mut self) -> TickGroup {
        let group = match self.open.pop_front().flatten() {
            Some(Opened { gather, bytes }) => {
                let waiting = self.waiting_bytes.iter_mut();
                waiting.zip(bytes).for_each(|(all, own)| *all -= own);
                gather.into_group()
            }
            None => TickGroup {
                tick: self.next,
                ..TickGroup::default()
            },
        };
        let mut closed = if self.closed.len() >= self.behind {
            self.closed.pop_back().unwrap_or_default()
        } else {
            Closed::default()
        };
        closed.clear();
        self.late_patches = 0;
        for set in &group.patch_sets {
            let persons = set.persons.iter();
            closed
                .persons
                .extend(persons.map(|patch| (set.viewpoint, patch.person)));
        }
        let patches = group.patch_sets.iter();
        closed
            .patches
            .extend(patches.map(|s| (s.viewpoint, s.part)));
        let sightings = group.sighting_sets.iter();
        closed
            .sightings
            .extend(sightings.map(|s| (s.viewpoint, s.part)));
        if self.behind > 0 {
            self.closed.push_front(closed);
        }
        self.next = self.next + 1;
        group
    }

    fn opened(&self, tick: Tick) -> Option<&Gather> {
        let at = usize::try_from(tick - self.next).ok()?;
        Some(&self.open.get(at)?.as_ref()?.gather)
    }

    fn place(
        &mut self,
        session: SessionId,
        tick: Tick,
        viewpoint: ViewpointIndex,
        bytes: u64,
    ) -> Result<TickSlot<'_>, Refused> {
        if session != self.session {
            return Err(Refused::OtherSession);
        }
        let index = usize::from(viewpoint.0);
        if index >= self.n_viewpoints {
            return Err(Refused::UnknownViewpoint);
        }
        let Ok(at) = usize::try_from(tick - self.next) else {
            let age = usize::try_from(self.next - tick - 1).map_err(|_| Refused::Late)?;
            let closed = self.closed.get_mut(age).ok_or(Refused::Late)?;
            return Ok(TickSlot::Closed(closed));
        };
        if at >= self.ahead {
            return Err(Refused::Early);
        }
        if self.waiting_bytes[index] + bytes > MAX_WAITING_BYTES {
            return Err(Refused::TooMany);
        }
        if self.open.len() <= at {
            self.open.resize_with(at + 1, || None);
        }
        let (session, n) = (self.session, self.n_viewpoints);
        let open = self.open[at].get_or_insert_with(|| Opened {
            gather: Gather::new(session, tick, n),
            bytes: vec![0; n],
        });
        Ok(TickSlot::Open(open))
    }
}

enum TickSlot<'a> {
    Open(&'a mut Opened),
    Closed(&'a mut Closed),
}

/// Adds `key`; false if it was present.
fn note(keys: &mut Vec<(ViewpointIndex, u16)>, key: (ViewpointIndex, u16)) -> bool {
    let is_new = !keys.contains(&key);
    if is_new {
        keys.push(key);
    }
    is_new
}

#[cfg(test)]
#[path = "gather_tests.rs"]
mod tests;
