//! The people who were present when fusion ended (ids, places, bodies), so that the next run can
//! recognise them.

use std::collections::BTreeSet;

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::recognise::{Appearance, Lengths, LikenessModel};
use super::shown::ShownPeople;
use super::whereabouts::{LastSeen, Whereabouts};
use crate::body::measured::MeasuredBody;
use crate::body::skeleton::{Proportions, Site, Skeleton};

/// Most people that are handed over.
const MAX_PEOPLE: usize = 512;
/// Largest id that may be handed over: it leaves ids for new people.
const MAX_ID: u32 = u32::MAX / 2;
/// Greatest plausible distance from the origin, metres.
const FARTHEST_M: f64 = 1e5;

/// All people who may come back, and the next unused id.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct KnownPeople {
    /// The id of the next new person.
    pub next_id: u32,
    /// The known people.
    pub people: Vec<KnownPerson>,
}

/// One known person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KnownPerson {
    /// The id.
    pub id: u32,
    /// The person's id on the edges, if it differs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wire_id: Option<u32>,
    /// The last tick at which the person was surely itself.
    pub seen: Tick,
    /// When it left; `None` if it was still present.
    pub gone: Option<Tick>,
    /// Where the pelvis was at that tick, world, metres.
    pub place_m: [f64; 3],
    /// Velocity on the floor, world, metres per second.
    pub velocity_m_s: Option<[f64; 2]>,
    /// Unit vector on the floor from its right to its left.
    pub to_left: Option<[f64; 2]>,
    /// The lengths of the body, metres, in the order of [`Proportions::lengths_m`].
    pub lengths_m: Vec<f64>,
    /// How long it was present, seconds.
    pub lived_s: f64,
}

impl KnownPeople {
    /// Returns `self` if all its values are plausible.
    ///
    /// # Errors
    /// The first value that is not plausible.
    pub fn checked(self) -> Result<Self, &'static str> {
        if self.people.len() > MAX_PEOPLE {
            return Err("more people than a venue may have");
        }
        if self.next_id > MAX_ID {
            return Err("a next id that is too large");
        }
        if self.people.iter().any(|person| person.id >= self.next_id) {
            return Err("an id that is not below the next id");
        }
        let ids: BTreeSet<u32> = self.people.iter().map(|person| person.id).collect();
        if ids.len() != self.people.len() {
            return Err("two people with the same id");
        }
        let is_in_order = |person: &KnownPerson| person.gone.is_none_or(|gone| person.seen <= gone);
        if !self.people.iter().all(is_in_order) {
            return Err("a person seen after leaving");
        }
        if self.people.iter().any(|person| person.body().is_none()) {
            return Err("implausible body lengths");
        }
        let is_possible = |person: &KnownPerson| {
            let numbers = person
                .place_m
                .iter()
                .chain(person.velocity_m_s.iter().flatten())
                .chain(person.to_left.iter().flatten())
                .chain([&person.lived_s]);
            let mut numbers = numbers.copied();
            numbers.all(|v| v.abs() < FARTHEST_M) && person.lived_s >= 0.0
        };
        if !self.people.iter().all(is_possible) {
            return Err("an implausible place or speed");
        }
        Ok(self)
    }
}

impl KnownPerson {
    /// A remembered person; `is_present` if it has not left yet.
    pub(crate) fn from_departed(departed: &Departed, is_present: bool) -> Self {
        let Whereabouts {
            place_m,
            velocity_m_s,
            to_left,
        } = departed.last_seen.whereabouts;
        let proportions = departed.body.skeleton.proportions();
        Self {
            id: departed.id.0,
            wire_id: (departed.wire_id != departed.id).then_some(departed.wire_id.0),
            seen: departed.last_seen.tick,
            gone: (!is_present).then_some(departed.gone),
            place_m: place_m.into(),
            velocity_m_s: velocity_m_s.map(Into::into),
            to_left: to_left.map(Into::into),
            lengths_m: proportions.lengths_m().map(|(_, m)| m).collect(),
            lived_s: departed.lived_s,
        }
    }

    /// The person as remembered by a run that begins at `tick`; `sites` come from the network's
    /// card. `None` if the lengths are implausible, or the person was seen after `tick`.
    pub(crate) fn departed(&self, tick: Tick, sites: &[Option<Site>]) -> Option<Departed> {
        if self.seen > tick || self.gone.is_some_and(|gone| gone > tick) {
            return None;
        }
        Some(Departed {
            id: PersonId(self.id),
            wire_id: PersonId(self.wire_id.unwrap_or(self.id)),
            last_seen: LastSeen {
                tick: self.seen,
                whereabouts: Whereabouts {
                    place_m: Vector3::from(self.place_m),
                    velocity_m_s: self.velocity_m_s.map(Vector2::from),
                    to_left: self.to_left.map(Vector2::from),
                },
            },
            gone: self.gone.unwrap_or(tick),
            is_missed: self.gone.is_none(),
            body: MeasuredBody::new(self.body()?, sites.to_vec()),
            lived_s: self.lived_s,
        })
    }

    fn body(&self) -> Option<Skeleton> {
        let proportions = Proportions::from_lengths(&self.lengths_m)?.checked().ok()?;
        Some(Skeleton::new(&proportions))
    }
}

/// Most people that are remembered; those who left first are forgotten first.
const MAX_REMEMBERED: usize = 256;

/// How long extra detection passes search for missed people, seconds. Mostly links or lights fail,
/// and then all people are missed together.
const MISSED_S: f64 = 3.0;

/// The data of a known person that is compared: a whole body takes a hundred kilobytes.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub(crate) id: PersonId,
    pub(crate) last_seen: LastSeen,
    /// Where edges have shown it since; they follow people on their own.
    pub(crate) shown: Vec<LastSeen>,
    pub(crate) appearance: Appearance,
    /// Whether it is expected back: lost, or missed for a short time.
    pub(crate) is_expected: bool,
}

impl Candidate {
    /// A person that was `last_seen` there, with the body `skeleton`, known for `lived_s` seconds.
    pub(crate) fn new(
        id: PersonId,
        last_seen: LastSeen,
        skeleton: &Skeleton,
        lived_s: f64,
    ) -> Self {
        Self {
            id,
            last_seen,
            shown: Vec::new(),
            appearance: Appearance {
                lengths: Lengths::from_skeleton(skeleton, lived_s),
                whereabouts: last_seen.whereabouts,
            },
            is_expected: true,
        }
    }

    /// L of a newcomer that was first seen at `since`. It starts from where this person was last
    /// seen, or from where edges showed it nearest to that time, whichever is likelier. Places that
    /// are out of reach do not count.
    pub(crate) fn likeness(
        &self,
        newcomer: &Appearance,
        since: Tick,
        model: &LikenessModel,
        rate_hz: f64,
    ) -> Option<f64> {
        let absence_s = |seen: &LastSeen| (since - seen.tick) as f64 / rate_hz;
        let last = model.likeness(newcomer, &self.appearance, absence_s(&self.last_seen))?;
        let nearest = self.shown.iter().min_by_key(|at| (since - at.tick).abs());
        let shown = nearest.and_then(|at| {
            let appearance = Appearance {
                whereabouts: at.whereabouts,
                ..self.appearance
            };
            model.likeness(newcomer, &appearance, absence_s(at).abs())
        });
        Some(shown.map_or(last, |shown| last.max(shown)))
    }
}

/// A person who is known, but not tracked.
#[derive(Debug, Clone)]
pub(crate) struct Departed {
    pub(crate) id: PersonId,
    /// The person's id on the edges.
    pub(crate) wire_id: PersonId,
    pub(crate) last_seen: LastSeen,
    /// When it left. That is later than `last_seen` if it was close to another person.
    pub(crate) gone: Tick,
    /// Whether it was unseen while it should have been visible.
    pub(crate) is_missed: bool,
    pub(crate) body: MeasuredBody,
    /// How long the person was present, seconds.
    pub(crate) lived_s: f64,
}

impl Departed {
    /// Whether it has been missed for less than [`MISSED_S`].
    fn is_expected(&self, now: Tick, rate_hz: f64) -> bool {
        self.is_missed && (now - self.gone) as f64 <= MISSED_S * rate_hz
    }

    /// Ticks of life so far.
    pub(crate) fn lived_ticks(&self, rate_hz: f64) -> u32 {
        (self.lived_s * rate_hz).round() as u32
    }
}

/// People who left, in the order in which they left.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory {
    gone: Vec<Departed>,
}

impl Memory {
    /// Remembers `departed` from now on.
    pub(crate) fn remember(&mut self, departed: Departed) {
        self.gone.retain(|other| other.id != departed.id);
        if self.gone.len() == MAX_REMEMBERED {
            self.gone.remove(0);
        }
        self.gone.push(departed);
    }

    /// Forgets the people who left more than `return_s` before `now`.
    pub(crate) fn forget(&mut self, now: Tick, return_s: f64, rate_hz: f64) {
        let limit = return_s * rate_hz;
        self.gone
            .retain(|departed| (now - departed.gone) as f64 <= limit);
    }

    /// People who may come back.
    pub(crate) fn candidates<'a>(
        &'a self,
        now: Tick,
        rate_hz: f64,
        shown: &'a ShownPeople,
    ) -> impl Iterator<Item = Candidate> + 'a {
        self.gone.iter().map(move |departed| {
            let skeleton = &departed.body.skeleton;
            let (id, last_seen, lived_s) = (departed.id, departed.last_seen, departed.lived_s);
            Candidate {
                is_expected: departed.is_expected(now, rate_hz),
                shown: shown.places_of(departed.wire_id),
                ..Candidate::new(id, last_seen, skeleton, lived_s)
            }
        })
    }

    /// Last places of the people missed for less than [`MISSED_S`], and when they were last seen.
    pub(crate) fn places_of_missed(
        &self,
        now: Tick,
        rate_hz: f64,
    ) -> impl Iterator<Item = (Vector3<f64>, Tick)> + '_ {
        let is_expected = move |departed: &&Departed| departed.is_expected(now, rate_hz);
        let missed = self.gone.iter().filter(is_expected);
        missed.map(|departed| {
            let seen = &departed.last_seen;
            (seen.whereabouts.place_m, seen.tick)
        })
    }

    /// The wire ids of the people missed for less than [`MISSED_S`].
    pub(crate) fn missed(&self, now: Tick, rate_hz: f64) -> impl Iterator<Item = PersonId> + '_ {
        let gone = self.gone.iter();
        let missed = gone.filter(move |departed| departed.is_expected(now, rate_hz));
        missed.map(|departed| departed.wire_id)
    }

    /// All remembered people, in the order in which they left.
    pub(crate) fn remembered(&self) -> &[Departed] {
        &self.gone
    }

    /// Takes out a person who has come back.
    pub(crate) fn take(&mut self, id: PersonId) -> Option<Departed> {
        let at = self.gone.iter().position(|departed| departed.id == id)?;
        Some(self.gone.remove(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(id: u32) -> KnownPerson {
        let proportions = Proportions::from_stature(1.81);
        KnownPerson {
            id,
            wire_id: None,
            seen: Tick(100),
            gone: None,
            place_m: [1.0, -2.0, 0.95],
            velocity_m_s: Some([0.1, 1.3]),
            to_left: None,
            lengths_m: proportions.lengths_m().map(|(_, m)| m).collect(),
            lived_s: 12.5,
        }
    }

    #[test]
    fn a_known_person_survives_the_round_trip() {
        let before = known(7);
        let departed = before.departed(Tick(130), &[]).unwrap();
        assert!(departed.is_missed && departed.gone == Tick(130));
        assert_eq!(KnownPerson::from_departed(&departed, true), before);
        let gone = KnownPerson {
            gone: Some(Tick(90)),
            ..before
        };
        let departed = gone.departed(Tick(130), &[]).unwrap();
        assert!(!departed.is_missed);
        assert_eq!(KnownPerson::from_departed(&departed, false), gone);
        let renamed = KnownPerson {
            wire_id: Some(11),
            ..known(7)
        };
        let departed = renamed.departed(Tick(130), &[]).unwrap();
        assert_eq!((departed.id.0, departed.wire_id.0), (7, 11));
        assert_eq!(KnownPerson::from_departed(&departed, true), renamed);
    }

    #[test]
    fn implausible_values_are_refused() {
        let people = |spoil: fn(&mut KnownPerson)| {
            let mut person = known(7);
            spoil(&mut person);
            let people = vec![person];
            KnownPeople { next_id: 8, people }.checked()
        };
        assert!(people(|_| ()).is_ok());
        assert!(people(|p| p.id = 8).is_err());
        assert!(people(|p| p.lengths_m[3] = f64::NAN).is_err());
        assert!(people(|p| p.lengths_m.truncate(3)).is_err());
        assert!(people(|p| p.place_m[1] = f64::INFINITY).is_err());
        assert!(people(|p| p.lived_s = -1.0).is_err());
        assert!(people(|p| p.gone = Some(Tick(99))).is_err());
        let many = |next_id, ids: [u32; 2]| KnownPeople {
            next_id,
            people: ids.map(known).into(),
        };
        assert!(many(8, [6, 7]).checked().is_ok());
        assert!(many(8, [7, 7]).checked().is_err());
        assert!(many(u32::MAX, [6, 7]).checked().is_err());
    }

    #[test]
    fn a_person_seen_after_the_run_begins_is_ignored() {
        assert!(known(7).departed(Tick(99), &[]).is_none());
        let later = KnownPerson {
            gone: Some(Tick(i64::MAX)),
            ..known(7)
        };
        assert!(later.departed(Tick(130), &[]).is_none());
    }
}
