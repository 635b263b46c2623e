//! Gathers the patch and sighting sets of one tick from all viewpoints.
//!
//! Sans-I/O: the caller adds messages and checks whether the tick is complete. There is no clock:
//! deadlines are the caller's concern. A message that does not belong to the tick is refused with a
//! reason, so that the caller can count it.

use std::collections::BTreeSet;

use farfield_proto::id::{PersonId, SessionId, ViewpointIndex};
use farfield_proto::message::decision::{Decision, UsedSet};
use farfield_proto::message::{MAX_PERSONS, MAX_SIGHTINGS, PatchSet, SightingSet};
use farfield_proto::tick::Tick;

/// All messages of one tick, ordered by viewpoint and part in any order of arrival.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TickGroup {
    /// The tick.
    pub tick: Tick,
    /// Patches, by (viewpoint, part).
    pub patch_sets: Vec<PatchSet>,
    /// Sightings, by (viewpoint, part).
    pub sighting_sets: Vec<SightingSet>,
}

impl TickGroup {
    /// The list of its sets, for gathering it again; `first` is the tick of the session's first
    /// boxes.
    pub fn decision(&self, session: SessionId, first: Tick) -> Decision {
        let used = |viewpoint, part| UsedSet { viewpoint, part };
        Decision {
            session,
            first,
            tick: self.tick,
            horizons_ticks: Vec::new(),
            patches: self
                .patch_sets
                .iter()
                .map(|set| used(set.viewpoint, set.part))
                .collect(),
            sightings: self
                .sighting_sets
                .iter()
                .map(|set| used(set.viewpoint, set.part))
                .collect(),
        }
    }
}

/// Why a message was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// It belongs to another fusion session.
    #[error("of another session")]
    OtherSession,
    /// It belongs to a tick that is over.
    #[error("late")]
    Late,
    /// It belongs to a tick that has not begun.
    #[error("early")]
    Early,
    /// The venue has no such viewpoint.
    #[error("of an unknown viewpoint")]
    UnknownViewpoint,
    /// The part was already there, or contradicts earlier messages.
    #[error("a repeated or contradictory part")]
    RepeatedPart,
    /// The viewpoint would exceed [`MAX_PERSONS`] or [`MAX_SIGHTINGS`].
    #[error("of more persons or sightings than a viewpoint may send for one tick")]
    TooMany,
    /// The viewpoint has sent the person already.
    #[error("of a person that the viewpoint has sent already")]
    RepeatedPerson,
}

/// What one viewpoint has sent for the tick.
#[derive(Debug, Clone, Default)]
struct ViewpointProgress {
    parts: Option<u16>,
    /// From the first message of either kind.
    sighting_parts: Option<u16>,
    seen_parts: u16,
    seen_sighting_parts: u16,
    persons: BTreeSet<PersonId>,
    n_sightings: usize,
}

impl ViewpointProgress {
    fn is_complete(&self) -> bool {
        self.parts.is_some_and(|parts| self.seen_parts >= parts) && self.has_sightings()
    }

    fn has_sightings(&self) -> bool {
        let parts = self.sighting_parts;
        parts.is_some_and(|parts| self.seen_sighting_parts >= parts)
    }

    /// Whether `set` is consistent with earlier messages.
    fn check_patches(&self, set: &PatchSet) -> Result<(), Refused> {
        let contradicts = contradicts(self.parts, set.parts)
            || contradicts(self.sighting_parts, set.sighting_parts);
        if contradicts || set.part >= set.parts {
            return Err(Refused::RepeatedPart);
        }
        if self.persons.len() + set.persons.len() > MAX_PERSONS {
            return Err(Refused::TooMany);
        }
        let mut persons = BTreeSet::new();
        let is_new = |id| !self.persons.contains(&id) && persons.insert(id);
        if set.persons.iter().map(|patch| patch.person).all(is_new) {
            Ok(())
        } else {
            Err(Refused::RepeatedPerson)
        }
    }

    /// Whether `set` is consistent with earlier messages.
    fn check_sightings(&self, set: &SightingSet) -> Result<(), Refused> {
        if contradicts(self.sighting_parts, set.parts) || set.part >= set.parts {
            return Err(Refused::RepeatedPart);
        }
        if self.n_sightings + set.sightings.len() > MAX_SIGHTINGS {
            return Err(Refused::TooMany);
        }
        Ok(())
    }
}

/// Whether `announced` differs from the known value.
fn contradicts(known: Option<u16>, announced: u16) -> bool {
    known.is_some_and(|known| known != announced)
}

/// Gathers the messages of one tick after the other.
#[derive(Debug, Clone)]
pub struct Gather {
    session: SessionId,
    group: TickGroup,
    progress: Vec<ViewpointProgress>,
}

impl Gather {
    /// Starts with `tick`, for the viewpoints `0..n_viewpoints` of the venue.
    pub fn new(session: SessionId, tick: Tick, n_viewpoints: usize) -> Self {
        let group = TickGroup {
            tick,
            ..TickGroup::default()
        };
        Self {
            session,
            group,
            progress: vec![ViewpointProgress::default(); n_viewpoints],
        }
    }

    /// The tick being gathered.
    pub fn tick(&self) -> Tick {
        self.group.tick
    }

    /// Adds a patch set.
    ///
    /// # Errors
    /// [`Refused`] if it does not belong here; the set is dropped.
    pub fn add_patches(&mut self, set: PatchSet) -> Result<(), Refused> {
        self.place(set.session, set.tick, set.viewpoint)?;
        let key = (set.viewpoint, set.part);
        let Err(at) = self
            .group
            .patch_sets
            .binary_search_by_key(&key, |s| (s.viewpoint, s.part))
        else {
            return Err(Refused::RepeatedPart);
        };
        let progress = &mut self.progress[usize::from(set.viewpoint.0)];
        progress.check_patches(&set)?;
        progress.parts = Some(set.parts);
        progress.sighting_parts = Some(set.sighting_parts);
        progress.seen_parts += 1;
        progress
            .persons
            .extend(set.persons.iter().map(|patch| patch.person));
        self.group.patch_sets.insert(at, set);
        Ok(())
    }

    /// Adds a sighting set.
    ///
    /// # Errors
    /// [`Refused`] if it does not belong here; the set is dropped.
    pub fn add_sightings(&mut self, set: SightingSet) -> Result<(), Refused> {
        self.place(set.session, set.tick, set.viewpoint)?;
        let key = (set.viewpoint, set.part);
        let Err(at) = self
            .group
            .sighting_sets
            .binary_search_by_key(&key, |s| (s.viewpoint, s.part))
        else {
            return Err(Refused::RepeatedPart);
        };
        let progress = &mut self.progress[usize::from(set.viewpoint.0)];
        progress.check_sightings(&set)?;
        progress.sighting_parts = Some(set.parts);
        progress.seen_sighting_parts += 1;
        progress.n_sightings += set.sightings.len();
        self.group.sighting_sets.insert(at, set);
        Ok(())
    }

    /// Whether every viewpoint has sent all announced parts.
    pub fn is_complete(&self) -> bool {
        self.progress.iter().all(ViewpointProgress::is_complete)
    }

    /// Whether `viewpoint` has sent all announced parts.
    pub fn is_complete_of(&self, viewpoint: ViewpointIndex) -> bool {
        let progress = self.progress.get(usize::from(viewpoint.0));
        progress.is_some_and(ViewpointProgress::is_complete)
    }

    /// Whether `viewpoint` has sent all announced sightings.
    pub fn has_sightings_of(&self, viewpoint: ViewpointIndex) -> bool {
        let progress = self.progress.get(usize::from(viewpoint.0));
        progress.is_some_and(ViewpointProgress::has_sightings)
    }

    /// The messages so far.
    pub fn group(&self) -> &TickGroup {
        &self.group
    }

    /// Returns the messages, and ends.
    pub fn into_group(self) -> TickGroup {
        self.group
    }

    /// The viewpoints that are still awaited.
    pub fn missing(&self) -> Vec<ViewpointIndex> {
        let waiting = self
            .progress
            .iter()
            .enumerate()
            .filter(|(_, p)| !p.is_complete());
        waiting.map(|(i, _)| ViewpointIndex(i as u16)).collect()
    }

    /// Returns the messages, and begins the next tick.
    pub fn take(&mut self) -> TickGroup {
        let next = TickGroup {
            tick: self.group.tick + 1,
            ..TickGroup::default()
        };
        self.progress.fill(ViewpointProgress::default());
        std::mem::replace(&mut self.group, next)
    }

    fn place(
        &self,
        session: SessionId,
        tick: Tick,
        viewpoint: ViewpointIndex,
    ) -> Result<(), Refused> {
        if session != self.session {
            return Err(Refused::OtherSession);
        }
        if usize::from(viewpoint.0) >= self.progress.len() {
            return Err(Refused::UnknownViewpoint);
        }
        match tick.cmp(&self.group.tick) {
            std::cmp::Ordering::Less => Err(Refused::Late),
            std::cmp::Ordering::Greater => Err(Refused::Early),
            std::cmp::Ordering::Equal => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use farfield_proto::id::CameraIndex;
    use farfield_proto::message::{PersonPatch, Sighting};
    use farfield_proto::patch::EncodedMaps;

    const SESSION: SessionId = SessionId(7);

    fn patches(viewpoint: u16, part: u16, parts: u16, sighting_parts: u16) -> PatchSet {
        let viewpoint = ViewpointIndex(viewpoint);
        PatchSet {
            session: SESSION,
            tick: Tick(5),
            viewpoint,
            part,
            parts,
            sighting_parts,
            timing: None,
            persons: Vec::new(),
        }
    }

    fn of_persons(ids: impl IntoIterator<Item = u32>, mut set: PatchSet) -> PatchSet {
        let patch = |id| PersonPatch {
            person: PersonId(id),
            camera: CameraIndex(0),
            box_tick: Tick(5),
            capture_offset_us: 0,
            crops: Vec::new(),
            crop_of_keypoint: Vec::new(),
            maps: EncodedMaps {
                width: 1,
                height: 1,
                keypoints: 1,
                bytes: Vec::new(),
            },
        };
        set.persons = ids.into_iter().map(patch).collect();
        set
    }

    fn many_sightings(n: usize, part: u16, parts: u16) -> SightingSet {
        let sighting = Sighting {
            camera: CameraIndex(0),
            score: 1.0,
            keypoints: Vec::new(),
        };
        SightingSet {
            part,
            parts,
            sightings: vec![sighting; n],
            ..sightings(0)
        }
    }

    fn sightings(viewpoint: u16) -> SightingSet {
        let viewpoint = ViewpointIndex(viewpoint);
        SightingSet {
            session: SESSION,
            tick: Tick(5),
            viewpoint,
            part: 0,
            parts: 1,
            sightings: Vec::new(),
        }
    }

    #[test]
    fn a_tick_is_complete_when_all_announced_parts_are_there() {
        let mut gather = Gather::new(SESSION, Tick(5), 2);
        gather.add_patches(patches(1, 1, 2, 1)).unwrap();
        gather.add_patches(patches(0, 0, 1, 0)).unwrap();
        gather.add_patches(patches(1, 0, 2, 1)).unwrap();
        assert_eq!(
            gather.missing(),
            [ViewpointIndex(1)],
            "its sightings are still on the way"
        );
        gather.add_sightings(sightings(1)).unwrap();
        assert!(gather.is_complete());
        let order: Vec<_> = gather
            .take()
            .patch_sets
            .iter()
            .map(|s| (s.viewpoint.0, s.part))
            .collect();
        assert_eq!(
            order,
            [(0, 0), (1, 0), (1, 1)],
            "the order of arrival must not reach a result"
        );
        assert_eq!(gather.tick(), Tick(6));
        assert!(!gather.is_complete());
    }

    #[test]
    fn a_sighting_before_its_patches_is_kept() {
        let mut gather = Gather::new(SESSION, Tick(5), 1);
        gather.add_sightings(sightings(0)).unwrap();
        assert!(!gather.is_complete());
        gather.add_patches(patches(0, 0, 1, 1)).unwrap();
        assert!(gather.is_complete());
    }

    #[test]
    fn messages_of_other_ticks_are_refused_with_the_reason() {
        let mut gather = Gather::new(SESSION, Tick(5), 1);
        let late = PatchSet {
            tick: Tick(4),
            ..patches(0, 0, 1, 0)
        };
        let early = PatchSet {
            tick: Tick(6),
            ..patches(0, 0, 1, 0)
        };
        let stranger = PatchSet {
            session: SessionId(8),
            ..patches(0, 0, 1, 0)
        };
        assert_eq!(gather.add_patches(late), Err(Refused::Late));
        assert_eq!(gather.add_patches(early), Err(Refused::Early));
        assert_eq!(gather.add_patches(stranger), Err(Refused::OtherSession));
        assert_eq!(
            gather.add_patches(patches(3, 0, 1, 0)),
            Err(Refused::UnknownViewpoint)
        );
        gather.add_patches(patches(0, 0, 2, 0)).unwrap();
        assert_eq!(
            gather.add_patches(patches(0, 0, 2, 0)),
            Err(Refused::RepeatedPart)
        );
        assert_eq!(
            gather.add_patches(patches(0, 1, 3, 0)),
            Err(Refused::RepeatedPart)
        );
        assert!(!gather.is_complete());
    }

    #[test]
    fn sightings_are_bounded_over_all_parts() {
        // Symptom to prevent: each of 1,024 parts is within the bound, and the search for new
        // people over all of their pairs never ends.
        let mut gather = Gather::new(SESSION, Tick(5), 2);
        let gathered = |gather: &Gather| gather.group.sighting_sets.len();
        gather
            .add_sightings(many_sightings(MAX_SIGHTINGS - 1, 0, 3))
            .unwrap();
        assert_eq!(
            gather.add_sightings(many_sightings(2, 1, 3)),
            Err(Refused::TooMany)
        );
        assert_eq!(gathered(&gather), 1, "what is refused leaves no trace");
        gather.add_sightings(many_sightings(1, 1, 3)).unwrap();
        let of_another = SightingSet {
            viewpoint: ViewpointIndex(1),
            ..many_sightings(MAX_SIGHTINGS, 0, 1)
        };
        gather.add_sightings(of_another).unwrap();
        gather.take();
        let of_next_tick = SightingSet {
            tick: Tick(6),
            ..many_sightings(MAX_SIGHTINGS, 0, 1)
        };
        gather.add_sightings(of_next_tick).unwrap();
    }

    #[test]
    fn persons_are_bounded_over_all_parts() {
        let mut gather = Gather::new(SESSION, Tick(5), 1);
        let most = MAX_PERSONS as u32;
        gather
            .add_patches(of_persons(1..most, patches(0, 0, 2, 0)))
            .unwrap();
        assert_eq!(
            gather.add_patches(of_persons([most, most + 1], patches(0, 1, 2, 0))),
            Err(Refused::TooMany)
        );
        gather
            .add_patches(of_persons([most], patches(0, 1, 2, 0)))
            .unwrap();
        assert!(gather.is_complete());
    }

    #[test]
    fn a_viewpoint_sends_a_person_once_a_tick() {
        let mut gather = Gather::new(SESSION, Tick(5), 2);
        let twice = of_persons([1, 1], patches(0, 0, 2, 0));
        assert_eq!(gather.add_patches(twice), Err(Refused::RepeatedPerson));
        gather
            .add_patches(of_persons([1, 2], patches(0, 0, 2, 0)))
            .unwrap();
        let same_part = of_persons([1, 2], patches(0, 0, 2, 0));
        assert_eq!(gather.add_patches(same_part), Err(Refused::RepeatedPart));
        let again = of_persons([3, 2], patches(0, 1, 2, 0));
        assert_eq!(gather.add_patches(again), Err(Refused::RepeatedPerson));
        gather
            .add_patches(of_persons([1, 2], patches(1, 0, 1, 0)))
            .unwrap();
    }

    #[test]
    fn patches_and_sightings_must_agree_on_the_parts_in_any_order() {
        let mut gather = Gather::new(SESSION, Tick(5), 1);
        gather.add_sightings(many_sightings(1, 0, 2)).unwrap();
        assert_eq!(
            gather.add_patches(patches(0, 0, 1, 1)),
            Err(Refused::RepeatedPart)
        );
        gather.add_patches(patches(0, 0, 1, 2)).unwrap();
        assert_eq!(
            gather.add_sightings(many_sightings(1, 1, 3)),
            Err(Refused::RepeatedPart)
        );
        assert_eq!(
            gather.add_sightings(many_sightings(1, 2, 2)),
            Err(Refused::RepeatedPart),
            "a part past the last one"
        );
        gather.add_sightings(many_sightings(1, 1, 2)).unwrap();
        assert!(gather.is_complete());

        let mut without_pass = Gather::new(SESSION, Tick(5), 1);
        without_pass.add_patches(patches(0, 0, 1, 0)).unwrap();
        assert_eq!(
            without_pass.add_sightings(sightings(0)),
            Err(Refused::RepeatedPart)
        );
    }
}
