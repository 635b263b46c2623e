//! Who left or was lost, for as long as it may come back.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::recognise::{Appearance, Lengths};
use crate::body::measured::MeasuredBody;
use crate::body::skeleton::Skeleton;

/// Most people who are remembered; of more, those who left first are forgotten.
const MAX_REMEMBERED: usize = 256;

/// Where a person was surely itself: seen by two viewpoints, with nobody else in its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LastSeen {
    pub(crate) tick: Tick,
    /// The pelvis, world metres.
    pub(crate) place_m: Vector3<f64>,
}

/// What is compared of somebody who is known: a body itself takes a hundred kilobytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub(crate) id: PersonId,
    pub(crate) last_seen: LastSeen,
    pub(crate) appearance: Appearance,
}

impl Candidate {
    /// Who was `last_seen` there, with the body `skeleton`, known for `lived_s` seconds.
    pub(crate) fn new(
        id: PersonId,
        last_seen: LastSeen,
        skeleton: &Skeleton,
        lived_s: f64,
    ) -> Self {
        Self {
            id,
            last_seen,
            appearance: Appearance {
                lengths: Lengths::of(skeleton, lived_s),
                place_m: last_seen.place_m,
            },
        }
    }
}

/// Somebody who is known, but not seen.
#[derive(Debug, Clone)]
pub(crate) struct Departed {
    pub(crate) id: PersonId,
    pub(crate) last_seen: LastSeen,
    pub(crate) body: MeasuredBody,
    /// How long the person was there, seconds.
    pub(crate) lived_s: f64,
}

impl Departed {
    /// Ticks of life so far.
    pub(crate) fn lived_ticks(&self, rate_hz: f64) -> u32 {
        (self.lived_s * rate_hz).round() as u32
    }
}

/// Those who are gone, in the order in which they went.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory {
    gone: Vec<Departed>,
}

impl Memory {
    /// Remembers `departed`, from now on.
    pub(crate) fn remember(&mut self, departed: Departed) {
        self.gone.retain(|other| other.id != departed.id);
        if self.gone.len() == MAX_REMEMBERED {
            self.gone.remove(0);
        }
        self.gone.push(departed);
    }

    /// Forgets who was last seen more than `return_s` before `now`.
    pub(crate) fn forget(&mut self, now: Tick, return_s: f64, rate_hz: f64) {
        let limit = return_s * rate_hz;
        self.gone
            .retain(|departed| (now - departed.last_seen.tick) as f64 <= limit);
    }

    /// Those who may come back.
    pub(crate) fn candidates(&self) -> impl Iterator<Item = Candidate> + '_ {
        self.gone.iter().map(|departed| {
            let skeleton = &departed.body.skeleton;
            Candidate::new(departed.id, departed.last_seen, skeleton, departed.lived_s)
        })
    }

    /// Hands out who has come back.
    pub(crate) fn take(&mut self, id: PersonId) -> Option<Departed> {
        let at = self.gone.iter().position(|departed| departed.id == id)?;
        Some(self.gone.remove(at))
    }
}
