//! Who is given by hand, and whom no two viewpoints saw there: nobody stood at that place, or at another time.

use farfield_proto::id::PersonId;
use farfield_proto::message::identity_event::{Change, IdentityEvent};
use farfield_proto::tick::Tick;
use farfield_proto::venue::{GivenPerson, Venue};

use crate::camera_agreement::report::DisagreementCause;
use crate::identity::track::Track;

/// Within which time of the tick at which somebody is given two viewpoints must have begun to show them, seconds.
const SEEN_WITHIN_S: f64 = 1.0;

/// Those whom a venue gives by hand.
#[derive(Debug, Clone)]
pub(in crate::camera_agreement) struct GivenPeople {
    all: Vec<Given>,
    /// Ticks in a row with evidence from two viewpoints that make somebody seen: as many as confirm those who are found.
    enough_ticks: u32,
    within_ticks: i64,
}

/// One of them.
#[derive(Debug, Clone, Copy)]
struct Given {
    tick: Tick,
    /// The middle of the keypoints, world, metres.
    place_m: [f64; 2],
    state: GivenState,
}

/// What became of somebody who is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum GivenState {
    /// The tick has not come.
    Expected,
    /// Followed by this wire id, and not seen yet.
    Followed(PersonId),
    Seen,
    /// Gone, or followed elsewhere, without having been seen.
    Unseen,
}

impl GivenPeople {
    /// Nobody has come yet.
    pub(in crate::camera_agreement) fn of(venue: &Venue) -> Self {
        // Where there is one viewpoint no two ever see anybody.
        let is_told = venue.viewpoints.len() > 1;
        let given = venue.given_persons.iter().filter(|_| is_told);
        Self {
            all: given.map(Given::of).collect(),
            enough_ticks: u32::try_from(venue.parameters.births.confirm_ticks(venue.rate_hz))
                .unwrap_or(u32::MAX),
            within_ticks: (SEEN_WITHIN_S * venue.rate_hz).round() as i64,
        }
    }

    /// None are given.
    #[cfg(test)]
    pub(in crate::camera_agreement) fn nobody() -> Self {
        Self {
            all: Vec::new(),
            enough_ticks: 1,
            within_ticks: 1,
        }
    }

    /// Keeps what became of them at `tick`, with what changed at it.
    pub(in crate::camera_agreement) fn note(
        &mut self,
        tick: Tick,
        events: &[IdentityEvent],
        tracks: &[Track],
    ) {
        for event in events {
            match event.change {
                // They come at the end of the tick before theirs, those of a run's first tick before it; of one tick in the
                // order of the venue.
                Change::Given => {
                    let own = |given: &&mut Given| {
                        given.state == GivenState::Expected
                            && (0..=1).contains(&(given.tick - tick))
                    };
                    let next = self
                        .all
                        .iter_mut()
                        .filter(own)
                        .min_by_key(|given| given.tick);
                    if let Some(next) = next {
                        next.state = GivenState::Followed(event.wire_id);
                    }
                }
                // From here on it follows a sighting, which may be anywhere.
                Change::Revive { .. } => self.settle(event.wire_id),
                _ => {}
            }
        }
        let (enough_ticks, within_ticks) = (self.enough_ticks, self.within_ticks);
        for given in &mut self.all {
            let GivenState::Followed(wire_id) = given.state else {
                continue;
            };
            let track = tracks.iter().find(|track| track.wire_id() == wire_id);
            let streak = track.map(|track| track.identity.coverage.streak);
            let began = tick - given.tick - i64::from(streak.unwrap_or(0));
            given.state = match streak {
                Some(streak) if streak >= enough_ticks => GivenState::Seen,
                Some(_) if began < within_ticks => continue,
                // Before its tick it cannot have gone.
                None if tick < given.tick => continue,
                _ => GivenState::Unseen,
            };
        }
    }

    fn settle(&mut self, wire_id: PersonId) {
        let mut all = self.all.iter_mut();
        if let Some(given) = all.find(|given| given.state == GivenState::Followed(wire_id)) {
            given.state = GivenState::Unseen;
        }
    }

    /// Those whom no two viewpoints saw, in the order of the venue.
    pub(in crate::camera_agreement) fn unseen(&self) -> impl Iterator<Item = DisagreementCause> {
        let unseen = self
            .all
            .iter()
            .filter(|given| given.state == GivenState::Unseen);
        unseen.map(|given| DisagreementCause::GivenUnseen {
            tick: given.tick.0,
            at_m: given.place_m.map(|m| (100.0 * m).round() / 100.0),
        })
    }
}

impl Given {
    fn of(person: &GivenPerson) -> Self {
        Self {
            tick: person.tick,
            place_m: [person.middle_m().x, person.middle_m().y],
            state: GivenState::Expected,
        }
    }
}
