//! Which of the newly confirmed people were here before.

use farfield_proto::id::PersonId;
use farfield_proto::message::identity_event::DropReason;
use farfield_proto::tick::Tick;

use crate::identity::event::{Event, EventKind};
use crate::identity::facts::{Rules, TrackFacts};
use crate::identity::known::Candidate;
use crate::identity::recognise::{Appearance, LikenessModel, assign_known};

/// Least ln of the likelihood ratio at which a newcomer is a known person.
const LEAST_RETURN: f64 = 1.0;
/// By how much this limit is lower for a person who is expected back: few strangers arrive just
/// then.
const EXPECTED: f64 = 1.5;

/// A person who is tentative, or confirmed at this tick.
#[derive(Debug, Clone)]
pub(crate) struct Newcomer {
    pub(crate) wire_id: PersonId,
    /// From its tentative ticks.
    pub(crate) appearance: Appearance,
    /// Its first tick.
    pub(crate) since: Tick,
    /// Whether it is confirmed at this tick. Others compete for the known people but get no id.
    pub(crate) is_confirmed: bool,
}

/// Decides which of the `newcomers` are which of the `known`.
pub(crate) fn decide(newcomers: &[Newcomer], known: &[Candidate], rules: &Rules) -> Vec<Event> {
    let model = LikenessModel::new(&rules.field, &rules.births);
    let absence_s = |newcomer: &Newcomer, known: &Candidate| {
        (newcomer.since - known.last_seen.tick) as f64 / rules.rate_hz
    };
    let likeness: Vec<Vec<Option<f64>>> = newcomers
        .iter()
        .map(|newcomer| {
            let pair = |known: &Candidate| {
                let (seen, since) = (&newcomer.appearance, newcomer.since);
                let likeness = known.likeness(seen, since, &model, rules.rate_hz)?;
                Some(likeness + if known.is_expected { EXPECTED } else { 0.0 })
            };
            known.iter().map(pair).collect()
        })
        .collect();
    let chosen = assign_known(&likeness, LEAST_RETURN);
    let pairs = newcomers.iter().zip(chosen);
    let confirmed = pairs.filter(|(newcomer, _)| newcomer.is_confirmed);
    confirmed
        .filter_map(|(newcomer, chosen)| {
            let chosen = chosen?;
            let known = &known[chosen.column];
            let absence_s = absence_s(newcomer, known);
            Some(Event {
                wire_id: newcomer.wire_id,
                kind: EventKind::Recognise {
                    old: known.id,
                    why: chosen.why(&newcomer.appearance, &known.appearance, absence_s),
                },
            })
        })
        .collect()
}

/// Drops a lost track if one of the `confirmed` (wire ids) got its id: the person was found
/// elsewhere.
pub(crate) fn found_elsewhere(tracks: &[TrackFacts], confirmed: &[PersonId]) -> Vec<Event> {
    let is_confirmed = |facts: &&TrackFacts| confirmed.contains(&facts.wire_id);
    let others = tracks.iter().filter(|facts| !is_confirmed(facts));
    others
        .filter(|facts| {
            let mut confirmed = tracks.iter().filter(is_confirmed);
            confirmed.any(|confirmed| confirmed.id == facts.id)
        })
        .map(|facts| Event {
            wire_id: facts.wire_id,
            kind: EventKind::Drop {
                reason: DropReason::FoundElsewhere,
            },
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Proportions, Skeleton};
    use crate::identity::phase::Phase;
    use crate::identity::recognise::Lengths;
    use crate::identity::whereabouts::LastSeen;
    use crate::identity::whereabouts::Whereabouts;
    use nalgebra::Vector3;

    fn appearance(stature_m: f64, seconds: f64) -> Appearance {
        let skeleton = Skeleton::new(&Proportions::from_stature(stature_m));
        Appearance {
            lengths: Lengths::from_skeleton(&skeleton, seconds),
            whereabouts: Whereabouts::at(Vector3::new(-3.0, 0.0, 0.95)),
        }
    }

    fn known(id: u32, stature_m: f64) -> Candidate {
        let appearance = appearance(stature_m, 20.0);
        Candidate {
            id: PersonId(id),
            last_seen: LastSeen {
                tick: Tick(100),
                whereabouts: appearance.whereabouts,
            },
            shown: Vec::new(),
            appearance,
            is_expected: false,
        }
    }

    fn newcomer(stature_m: f64, is_confirmed: bool) -> Newcomer {
        Newcomer {
            wire_id: PersonId(9),
            appearance: appearance(stature_m, 0.2),
            since: Tick(140),
            is_confirmed,
        }
    }

    #[test]
    fn a_returning_person_is_recognised_and_a_stranger_is_not() {
        let rules = Rules::example(20.0);
        let known = [known(3, 1.7)];
        let events = decide(&[newcomer(1.7, true)], &known, &rules);
        let [event] = events.as_slice() else {
            panic!("{events:?}")
        };
        let EventKind::Recognise { old, why } = event.kind else {
            panic!("{event:?}")
        };
        assert_eq!((event.wire_id.0, old.0), (9, 3));
        assert!(why.distance_m < 0.01 && why.lengths_sigma < 1.0, "{why:?}");
        assert!((why.absence_s - 2.0).abs() < 1e-6);
        assert!(decide(&[newcomer(1.95, true)], &known, &rules).is_empty());
    }

    #[test]
    fn an_expected_person_needs_less_evidence() {
        let rules = Rules::example(20.0);
        let is_recognised = |stature_m, is_expected| {
            let known = Candidate {
                is_expected,
                ..known(3, stature_m)
            };
            !decide(&[newcomer(1.7, true)], &[known], &rules).is_empty()
        };
        let taller = (0..30).map(|step| 1.7 + 0.01 * f64::from(step));
        let [expected, not] =
            [true, false].map(|is| taller.clone().filter(|&s| is_recognised(s, is)).count());
        assert!(expected > not && not > 0, "{expected} {not}");
    }

    #[test]
    fn places_shown_by_edges_identify_people_after_a_gap() {
        let rules = Rules::example(20.0);
        let at = |x_m: f64| Whereabouts::at(Vector3::new(x_m, 0.0, 0.95));
        // They ran past each other: each stands where the other was.
        let known = |id, x_m, shown: Option<f64>| {
            let mut known = known(id, 1.75);
            known.last_seen.whereabouts = at(x_m);
            known.appearance.whereabouts = at(x_m);
            let tick = Tick(141);
            let shown = shown
                .map(at)
                .map(|whereabouts| LastSeen { tick, whereabouts });
            known.shown.extend(shown);
            known
        };
        let newcomer = |wire_id, x_m| {
            let mut newcomer = newcomer(1.75, true);
            newcomer.wire_id = PersonId(wire_id);
            newcomer.appearance.whereabouts = at(x_m);
            newcomer
        };
        let ids = |shown: [Option<f64>; 2]| -> Vec<(u32, u32)> {
            let known = [known(3, -1.5, shown[0]), known(4, 1.5, shown[1])];
            let newcomers = [newcomer(8, -1.4), newcomer(9, 1.4)];
            let events = decide(&newcomers, &known, &rules).into_iter();
            let old = |event: Event| match event.kind {
                EventKind::Recognise { old, .. } => (event.wire_id.0, old.0),
                other => panic!("{other:?}"),
            };
            events.map(old).collect()
        };
        assert_eq!(ids([Some(1.3), Some(-1.3)]), [(8, 4), (9, 3)]);
        // The places where edges showed them contradict each other: neither gets an id.
        assert!(ids([Some(1.3), None]).is_empty());
    }

    #[test]
    fn a_tentative_newcomer_competes_but_gets_no_id() {
        let rules = Rules::example(20.0);
        let known = [known(3, 1.7)];
        assert!(decide(&[newcomer(1.7, false)], &known, &rules).is_empty());
        let twins = [newcomer(1.7, true), newcomer(1.7, false)];
        assert!(decide(&twins, &known, &rules).is_empty());
    }

    #[test]
    fn the_lost_track_of_a_recognised_person_is_dropped() {
        let lost = Phase::Lost {
            since: Tick(1),
            is_seen_again: false,
        };
        let recognised = TrackFacts {
            wire_id: PersonId(9),
            ..TrackFacts::example(3, Phase::Tracked)
        };
        let tracks = [
            TrackFacts::example(3, lost),
            TrackFacts::example(4, lost),
            recognised,
        ];
        let events = found_elsewhere(&tracks, &[PersonId(9)]);
        assert_eq!(events.len(), 1);
        assert_eq!(events[0].wire_id, PersonId(3));
    }
}
