//! People who left or were lost, for as long as they may come back.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::recognise::{Appearance, Lengths, LikenessModel};
use super::shown::ShownPeople;
use super::whereabouts::LastSeen;
use crate::body::measured::MeasuredBody;
use crate::body::skeleton::Skeleton;

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
        (newcomer, since): (&Appearance, Tick),
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
