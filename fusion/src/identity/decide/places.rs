//! Where people stand against the field and each other.

use farfield_proto::id::PersonId;
use farfield_proto::message::identity_event::DropReason;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::identity::event::{Event, EventKind};
use crate::identity::facts::{Rules, TrackFacts};
use crate::identity::phase::Phase;

/// Two people whose pelvises are farther apart do not stand in each other's place, metres.
const APART_M: f64 = 0.6;

/// Who has left the field with its margin goes.
pub(crate) fn outside_the_field(everybody: &[TrackFacts], rules: &Rules) -> Vec<Event> {
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
    everybody.iter().filter(is_outside).map(leaves).collect()
}

/// A person given by hand with its pelvis at `given_m` (world, metres) replaces a track that stands there.
pub(crate) fn replaced_by_hand(
    everybody: &[TrackFacts],
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
    everybody.iter().filter(is_near).map(leaves).collect()
}

/// Who is doubtful and has come to stand in the place of somebody who is surely there has followed what was
/// seen of that one: it steps back to where it stood alone, if it ever did.
pub(crate) fn step_back(everybody: &[TrackFacts], tick: Tick, rules: &Rules) -> Vec<Event> {
    let near_m = rules.births.same_place_m;
    let is_sure = |facts: &TrackFacts| {
        // A newcomer that never stood alone was initiated on somebody's body.
        let is_itself = !facts.phase.is_tentative() || facts.alone_at.is_some();
        !facts.phase.is_doubtful() && is_itself
    };
    let mut events = Vec::new();
    for (index, facts) in everybody.iter().enumerate() {
        let Some(alone_at) = facts.alone_at.filter(|_| facts.phase.is_doubtful()) else {
            continue;
        };
        let others = everybody.iter().enumerate();
        let mut others = others.filter(|(other, _)| *other != index);
        let in_the_way = others.find_map(|(_, other)| {
            let distance_m = is_sure(other).then(|| facts.distance_m(other))?;
            (distance_m < near_m).then_some((other.id, distance_m))
        });
        if let Some((other, distance_m)) = in_the_way
            && !is_alone(everybody, index)
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

/// Whether the person at `index` is surely on a body of its own: nobody else is near, or it is sure who it is, and
/// twice as far from everybody as two who stand in one place. So it is noted of people who walk side by side where
/// they are.
pub(crate) fn is_itself(everybody: &[TrackFacts], index: usize, rules: &Rules) -> bool {
    let own = &everybody[index];
    let apart_m = 2.0 * rules.births.same_place_m;
    let others = everybody.iter().enumerate();
    let mut others = others.filter(|(other, _)| *other != index);
    others.all(|(_, other)| {
        let is_sure = own.phase == Phase::Tracked;
        is_apart(&other.joints_m[0], &own.joints_m[0]) || is_sure && own.distance_m(other) > apart_m
    })
}

/// Whether nobody else is near the person at `index`.
pub(crate) fn is_alone(everybody: &[TrackFacts], index: usize) -> bool {
    let own_m = everybody[index].joints_m[0];
    let others = everybody.iter().enumerate();
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
    /// Buffer: those of the tick before.
    before: Vec<SharedPlace>,
}

#[derive(Debug, Clone, Copy)]
struct SharedPlace {
    /// Who was initiated first.
    older: PersonId,
    younger: PersonId,
    ticks: u32,
}

impl SharedPlaces {
    /// Whether `id` was in one place with anybody at the last tick that was counted.
    pub(crate) fn hold(&self, id: PersonId) -> bool {
        self.pairs
            .iter()
            .any(|pair| pair.older == id || pair.younger == id)
    }

    /// Counts a tick: two tracks are in one place whose bodies are nearer than `births.same_place_m`.
    pub(crate) fn count(&mut self, everybody: &[TrackFacts], rules: &Rules) {
        std::mem::swap(&mut self.pairs, &mut self.before);
        self.pairs.clear();
        for (index, a) in everybody.iter().enumerate() {
            for b in &everybody[index + 1..] {
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

/// Two tracks never stay on one body: of two who have been in one place for `births.same_place_s` the weaker
/// goes.
pub(crate) fn same_place(
    everybody: &[TrackFacts],
    shared: &SharedPlaces,
    rules: &Rules,
) -> Vec<Event> {
    let limit = (rules.births.same_place_s * rules.rate_hz).ceil() as u32;
    let who = |id: PersonId| everybody.iter().find(|facts| facts.id == id);
    let mut events: Vec<Event> = Vec::new();
    for pair in shared.pairs.iter().filter(|pair| pair.ticks > limit) {
        let (Some(older), Some(younger)) = (who(pair.older), who(pair.younger)) else {
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

/// Who of two in one place goes, and who stays: the one goes who is not confirmed, else who has lacked
/// evidence for longer, else the younger.
fn weaker<'a>(older: &'a TrackFacts, younger: &'a TrackFacts) -> (&'a TrackFacts, &'a TrackFacts) {
    let doubt = |facts: &TrackFacts| (facts.phase.is_tentative(), facts.coverage.missing);
    if doubt(older) > doubt(younger) {
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

    fn who(events: &[Event]) -> Vec<u32> {
        events.iter().map(|event| event.wire_id.0).collect()
    }

    #[test]
    fn who_has_left_the_field_with_its_margin_goes() {
        let at = |x_m| TrackFacts::example(1, Phase::Tracked).at_x(x_m);
        let margin_m = rules().births.outside_field_m;
        let events = |x_m: f64| outside_the_field(&[at(x_m)], &rules());
        assert!(events(4.0 + margin_m).is_empty());
        assert_eq!(who(&events(4.1 + margin_m)), [1]);
    }

    #[test]
    fn a_person_given_by_hand_replaces_a_track_that_stands_there() {
        let near_m = rules().births.explained_m;
        let at = |id, x_m| TrackFacts::example(id, Phase::Tracked).at_x(x_m);
        let everybody = [at(1, 1.0), at(2, 1.0 + near_m), at(3, 0.99 - near_m)];
        let given_m = Vector3::new(1.0, 0.0, 1.0);
        assert_eq!(who(&replaced_by_hand(&everybody, &given_m, &rules())), [1]);
    }

    #[test]
    fn who_is_doubtful_steps_back_from_who_is_surely_there() {
        let doubtful = TrackFacts {
            alone_at: Some(Tick(4)),
            ..TrackFacts::example(1, LOST)
        };
        let cases = [
            (TrackFacts::example(2, Phase::Tracked), true),
            (TrackFacts::example(2, Phase::Tracked).at_x(0.5), false),
            (TrackFacts::example(2, LOST), false),
            // For somebody tentative nobody steps back: it may have been initiated on this very body.
            (TrackFacts::sighted(2, 0), false),
        ];
        for (other, steps_back) in cases {
            let events = step_back(&[doubtful.clone(), other], Tick(9), &rules());
            assert_eq!(who(&events), if steps_back { vec![1] } else { vec![] });
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
    fn of_two_in_one_place_the_weaker_goes_after_a_while() {
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
            let (everybody, mut shared) = ([older, younger], SharedPlaces::default());
            for _ in 0..limit {
                shared.count(&everybody, &rules());
                assert!(same_place(&everybody, &shared, &rules()).is_empty());
            }
            shared.count(&everybody, &rules());
            assert_eq!(who(&same_place(&everybody, &shared, &rules())), [goes]);
        }
    }

    #[test]
    fn who_walks_beside_somebody_is_itself_and_who_may_follow_another_is_not() {
        let apart_m = 2.0 * rules().births.same_place_m;
        let own = |phase| TrackFacts::example(1, phase).at_x(0.0);
        let other = |x_m| TrackFacts::example(2, Phase::Tracked).at_x(x_m);
        for (phase, x_m, expected) in [
            (Phase::Tracked, apart_m + 0.01, true),
            (Phase::Tracked, apart_m - 0.01, false),
            (LOST, apart_m + 0.01, false),
            (LOST, APART_M + 0.01, true),
        ] {
            let everybody = [own(phase), other(x_m)];
            assert_eq!(
                is_itself(&everybody, 0, &rules()),
                expected,
                "{phase:?} {x_m}"
            );
        }
    }

    #[test]
    fn a_place_that_is_left_is_not_shared_any_more() {
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
