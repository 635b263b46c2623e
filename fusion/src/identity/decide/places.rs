//! Positions of people relative to the field and to each other.

use farfield_proto::id::PersonId;
use farfield_proto::message::identity_event::DropReason;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::identity::event::{Event, EventKind};
use crate::identity::facts::{Rules, TrackFacts};
use crate::identity::phase::Phase;

/// Largest distance of two pelvises at which two people can share a place, metres.
const APART_M: f64 = 0.6;

/// Drops people outside the field and its margin.
pub(crate) fn outside_the_field(tracks: &[TrackFacts], rules: &Rules) -> Vec<Event> {
    let (min_m, max_m) = (rules.field.min_m, rules.field.max_m);
    let margin_m = rules.births.outside_field_m;
    let inside =
        |value: f64, i: usize| (min_m[i] - margin_m..=max_m[i] + margin_m).contains(&value);
    let is_outside = |facts: &&TrackFacts| !(0..3).all(|i| inside(facts.joints_m[0][i], i));
    let leaves = |facts: &TrackFacts| Event {
        wire_id: facts.wire_id,
        kind: EventKind::Drop {
            reason: DropReason::OutsideField {
                at_m: facts.joints_m[0].map(|v| v as f32).into(),
            },
        },
    };
    tracks.iter().filter(is_outside).map(leaves).collect()
}

/// A person given by hand with its pelvis at `given_m` (world, metres) replaces a track that stands
/// there.
pub(crate) fn replaced_by_hand(
    tracks: &[TrackFacts],
    given_m: &Vector3<f64>,
    rules: &Rules,
) -> Vec<Event> {
    let near_m = rules.births.explained_m;
    let is_near = |facts: &&TrackFacts| (facts.joints_m[0] - given_m).norm() < near_m;
    let leaves = |facts: &TrackFacts| Event {
        wire_id: facts.wire_id,
        kind: EventKind::Drop {
            reason: DropReason::GivenByHand,
        },
    };
    tracks.iter().filter(is_near).map(leaves).collect()
}

/// A suspect person in the place of a sure person has followed the evidence of that person. It
/// steps back to where it last stood alone, if that is known.
pub(crate) fn step_back(tracks: &[TrackFacts], tick: Tick, rules: &Rules) -> Vec<Event> {
    let near_m = rules.births.same_place_m;
    let is_sure = |facts: &TrackFacts| {
        // A newcomer that never stood alone may have been initiated on the body of another person.
        let has_own_body = !facts.phase.is_tentative() || facts.alone_at.is_some();
        !facts.phase.is_suspect() && has_own_body
    };
    let mut events = Vec::new();
    for (index, facts) in tracks.iter().enumerate() {
        let Some(alone_at) = facts.alone_at.filter(|_| facts.phase.is_suspect()) else {
            continue;
        };
        let others = tracks.iter().enumerate();
        let mut others = others.filter(|(other, _)| *other != index);
        let sure_person = others.find_map(|(_, other)| {
            let distance_m = is_sure(other).then(|| facts.distance_m(other))?;
            (distance_m < near_m).then_some((other.id, distance_m))
        });
        if let Some((other, distance_m)) = sure_person
            && !is_alone(tracks, index)
        {
            events.push(Event {
                wire_id: facts.wire_id,
                kind: EventKind::StepBack {
                    other,
                    distance_m,
                    ticks: u32::try_from(tick - alone_at).unwrap_or(0).max(1),
                },
            });
        }
    }
    events
}

/// Whether the person at `index` surely has a body of its own. Either it is alone, or its identity
/// is sure and everyone else is at least twice `same_place_m` away. So people who walk side by side
/// are still recorded.
pub(crate) fn has_own_body(tracks: &[TrackFacts], index: usize, rules: &Rules) -> bool {
    let own = &tracks[index];
    let apart_m = 2.0 * rules.births.same_place_m;
    let others = tracks.iter().enumerate();
    let mut others = others.filter(|(other, _)| *other != index);
    others.all(|(_, other)| {
        let is_sure = own.phase == Phase::Tracked;
        is_apart(&other.joints_m[0], &own.joints_m[0]) || is_sure && own.distance_m(other) > apart_m
    })
}

/// Whether no other person is near the person at `index`.
pub(crate) fn is_alone(tracks: &[TrackFacts], index: usize) -> bool {
    let own_m = tracks[index].joints_m[0];
    let others = tracks.iter().enumerate();
    let mut others = others.filter(|(other, _)| *other != index);
    others.all(|(_, other)| is_apart(&other.joints_m[0], &own_m))
}

fn is_apart(a_m: &Vector3<f64>, b_m: &Vector3<f64>) -> bool {
    (a_m - b_m).norm() > APART_M
}

/// Pairs of persons in one place, and for how many ticks in a row.
#[derive(Debug, Clone, Default)]
pub(crate) struct SharedPlaces {
    pairs: Vec<SharedPlace>,
    /// Buffer: the pairs of the previous tick.
    before: Vec<SharedPlace>,
}

#[derive(Debug, Clone, Copy)]
struct SharedPlace {
    /// The one that was initiated first.
    older: PersonId,
    younger: PersonId,
    ticks: u32,
}

impl SharedPlaces {
    /// Whether `id` shared a place at the last counted tick.
    pub(crate) fn includes(&self, id: PersonId) -> bool {
        self.pairs
            .iter()
            .any(|pair| pair.older == id || pair.younger == id)
    }

    /// Counts a tick: two tracks share a place if their bodies are nearer than
    /// `births.same_place_m`.
    pub(crate) fn count(&mut self, tracks: &[TrackFacts], rules: &Rules) {
        std::mem::swap(&mut self.pairs, &mut self.before);
        self.pairs.clear();
        for (index, a) in tracks.iter().enumerate() {
            for b in &tracks[index + 1..] {
                if a.distance_m(b) >= rules.births.same_place_m {
                    continue;
                }
                let is_pair = |pair: &&SharedPlace| (pair.older, pair.younger) == (a.id, b.id);
                let ticks = self
                    .before
                    .iter()
                    .find(is_pair)
                    .map_or(0, |pair| pair.ticks);
                self.pairs.push(SharedPlace {
                    older: a.id,
                    younger: b.id,
                    ticks: ticks + 1,
                });
            }
        }
    }
}

/// Two tracks never stay on one body: of two that have shared a place for `births.same_place_s`,
/// the weaker is dropped.
pub(crate) fn same_place(
    tracks: &[TrackFacts],
    shared: &SharedPlaces,
    rules: &Rules,
) -> Vec<Event> {
    let limit = (rules.births.same_place_s * rules.rate_hz).ceil() as u32;
    let track_of = |id: PersonId| tracks.iter().find(|facts| facts.id == id);
    let mut events: Vec<Event> = Vec::new();
    for pair in shared.pairs.iter().filter(|pair| pair.ticks > limit) {
        let (Some(older), Some(younger)) = (track_of(pair.older), track_of(pair.younger)) else {
            continue;
        };
        let (goes, stays) = weaker(older, younger);
        if events.iter().all(|event| event.wire_id != goes.wire_id) {
            events.push(Event {
                wire_id: goes.wire_id,
                kind: EventKind::Drop {
                    reason: DropReason::SamePlace {
                        other: stays.id,
                        for_s: rules.seconds(pair.ticks) as f32,
                    },
                },
            });
        }
    }
    events
}

/// Of two tracks in one place, the one to drop and the one to keep. The tentative one is dropped,
/// else the one that has lacked evidence for longer, else the younger.
fn weaker<'a>(older: &'a TrackFacts, younger: &'a TrackFacts) -> (&'a TrackFacts, &'a TrackFacts) {
    let weakness = |facts: &TrackFacts| (facts.phase.is_tentative(), facts.coverage.missing);
    if weakness(older) > weakness(younger) {
        (older, younger)
    } else {
        (younger, older)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOST: Phase = Phase::Lost {
        since: Tick(5),
        is_seen_again: true,
    };

    fn rules() -> Rules {
        Rules::example(20.0)
    }

    fn ids(events: &[Event]) -> Vec<u32> {
        events.iter().map(|event| event.wire_id.0).collect()
    }

    #[test]
    fn a_person_outside_the_field_margin_is_dropped() {
        let at = |x_m| TrackFacts::example(1, Phase::Tracked).at_x(x_m);
        let margin_m = rules().births.outside_field_m;
        let events = |x_m: f64| outside_the_field(&[at(x_m)], &rules());
        assert!(events(4.0 + margin_m).is_empty());
        assert_eq!(ids(&events(4.1 + margin_m)), [1]);
    }

    #[test]
    fn a_person_given_by_hand_replaces_a_track_that_stands_there() {
        let near_m = rules().births.explained_m;
        let at = |id, x_m| TrackFacts::example(id, Phase::Tracked).at_x(x_m);
        let tracks = [at(1, 1.0), at(2, 1.0 + near_m), at(3, 0.99 - near_m)];
        let given_m = Vector3::new(1.0, 0.0, 1.0);
        assert_eq!(ids(&replaced_by_hand(&tracks, &given_m, &rules())), [1]);
    }

    #[test]
    fn a_suspect_person_steps_back_from_a_sure_one() {
        let suspect = TrackFacts {
            alone_at: Some(Tick(4)),
            ..TrackFacts::example(1, LOST)
        };
        let cases = [
            (TrackFacts::example(2, Phase::Tracked), true),
            (TrackFacts::example(2, Phase::Tracked).at_x(0.5), false),
            (TrackFacts::example(2, LOST), false),
            // A tentative track may have been initiated on this very body: nothing steps back for
            // it.
            (TrackFacts::sighted(2, 0), false),
        ];
        for (other, steps_back) in cases {
            let events = step_back(&[suspect.clone(), other], Tick(9), &rules());
            assert_eq!(ids(&events), if steps_back { vec![1] } else { vec![] });
            for event in events {
                assert!(matches!(event.kind, EventKind::StepBack { ticks: 5, .. }));
            }
        }
        let never_alone = [
            TrackFacts::example(1, LOST),
            TrackFacts::example(2, Phase::Tracked),
        ];
        assert!(step_back(&never_alone, Tick(9), &rules()).is_empty());
    }

    #[test]
    fn the_weaker_of_two_in_one_place_is_dropped() {
        let tracked = |id| TrackFacts::example(id, Phase::Tracked);
        let unseen = |id| {
            let mut facts = tracked(id);
            facts.coverage.missing = 1;
            facts
        };
        let tentative = |id| TrackFacts::sighted(id, 0);
        let limit = (rules().births.same_place_s * rules().rate_hz).ceil() as u32;
        for (older, younger, goes) in [
            (tracked(1), tracked(2), 2),
            (unseen(1), tracked(2), 1),
            (tentative(1), unseen(2), 1),
        ] {
            let (tracks, mut shared) = ([older, younger], SharedPlaces::default());
            for _ in 0..limit {
                shared.count(&tracks, &rules());
                assert!(same_place(&tracks, &shared, &rules()).is_empty());
            }
            shared.count(&tracks, &rules());
            assert_eq!(ids(&same_place(&tracks, &shared, &rules())), [goes]);
        }
    }

    #[test]
    fn a_sure_person_side_by_side_with_another_is_itself() {
        let apart_m = 2.0 * rules().births.same_place_m;
        let own = |phase| TrackFacts::example(1, phase).at_x(0.0);
        let other = |x_m| TrackFacts::example(2, Phase::Tracked).at_x(x_m);
        for (phase, x_m, expected) in [
            (Phase::Tracked, apart_m + 0.01, true),
            (Phase::Tracked, apart_m - 0.01, false),
            (LOST, apart_m + 0.01, false),
            (LOST, APART_M + 0.01, true),
        ] {
            let tracks = [own(phase), other(x_m)];
            assert_eq!(
                has_own_body(&tracks, 0, &rules()),
                expected,
                "{phase:?} {x_m}"
            );
        }
    }

    #[test]
    fn leaving_a_shared_place_resets_its_count() {
        let here = [
            TrackFacts::example(1, Phase::Tracked),
            TrackFacts::example(2, Phase::Tracked),
        ];
        let apart = [here[0].clone(), here[1].clone().at_x(2.0)];
        let mut shared = SharedPlaces::default();
        for _ in 0..100 {
            shared.count(&here, &rules());
            shared.count(&apart, &rules());
        }
        shared.count(&here, &rules());
        assert!(same_place(&here, &shared, &rules()).is_empty());
    }
}
