//! Which sighted persons are a tentative track that waits for its crops, or a lost person. The
//! others are new.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::identity::event::{Event, EventKind};
use crate::identity::facts::{Rules, TrackFacts};
use crate::identity::known::Candidate;
use crate::identity::recognise::{Appearance, LikenessModel, assign_known};
use crate::identity::whereabouts::Whereabouts;

/// How far from its place a standing person may be sighted, metres.
const SIGHTED_OFF_M: f64 = 0.3;
/// Least ln of the likelihood ratio at which a sighted person is a lost one: it is expected.
const LEAST_FOUND: f64 = 0.0;

/// The event of a sighted person, with the index of that person.
pub(crate) type Taken = (usize, Event);

/// Which sighted persons (pelvises, world, metres; `None` if it cannot be a body) are tentative
/// tracks whose first crops are still on the way. Pairs are made nearest first. A pair farther
/// apart than people run is excluded.
pub(crate) fn reinitiate(
    sighted_m: &[Option<Vector3<f64>>],
    tracks: &[TrackFacts],
    awaited_ticks: u32,
    rules: &Rules,
) -> Vec<Taken> {
    let mut pairs = Vec::new();
    for (which, sighted_m) in sighted_m.iter().enumerate() {
        let Some(sighted_m) = sighted_m else { continue };
        for facts in tracks.iter().filter(|facts| facts.is_awaited()) {
            let waited_s = f64::from(facts.coverage.since_two) * rules.dt_s();
            let off_m = (sighted_m - facts.joints_m[0]).norm();
            if off_m <= SIGHTED_OFF_M + rules.births.return_speed_m_s * waited_s {
                pairs.push((off_m, which, facts.wire_id));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken: Vec<Taken> = Vec::new();
    for (moved_m, which, wire_id) in pairs {
        let is_free = |(sighted, event): &Taken| *sighted != which && event.wire_id != wire_id;
        if taken.iter().all(is_free) {
            let kind = EventKind::Reinitiate {
                moved_m,
                awaited_ticks,
            };
            taken.push((which, Event { wire_id, kind }));
        }
    }
    taken.sort_by_key(|(which, _)| *which);
    taken
}

#[derive(Debug, Clone)]
pub(crate) struct LostPerson {
    pub(crate) wire_id: PersonId,
    /// The person, and where it was surely seen last; `None` if it never was.
    pub(crate) known: Option<Candidate>,
    /// Where one viewpoint has led it since, world, metres.
    pub(crate) led_m: Option<Vector3<f64>>,
}

/// Which persons sighted at `tick` (`None` if it cannot be a body) are which of the lost.
pub(crate) fn revive(
    sighted: &[Option<Appearance>],
    lost: &[LostPerson],
    tick: Tick,
    rules: &Rules,
) -> Vec<Taken> {
    let model = LikenessModel::new(&rules.field, &rules.births);
    let absence_s = |known: &Candidate| (tick - known.last_seen.tick) as f64 / rules.rate_hz;
    let likeness: Vec<Vec<Option<f64>>> = sighted
        .iter()
        .map(|sighted| {
            let pair = |lost: &LostPerson| {
                let known = lost.known.as_ref()?;
                // It has moved on from its last place, or one viewpoint has led it on.
                let last = known.appearance;
                let led = lost.led_m.map(|led_m| Appearance {
                    whereabouts: Whereabouts::at(led_m),
                    ..last
                });
                let sighted = sighted.as_ref()?;
                let likeness = |at: &Appearance| model.likeness(sighted, at, absence_s(known));
                let last = known.likeness(sighted, tick, &model, rules.rate_hz);
                [last, led.as_ref().and_then(likeness)]
                    .into_iter()
                    .flatten()
                    .reduce(f64::max)
            };
            lost.iter().map(pair).collect()
        })
        .collect();
    let chosen = assign_known(&likeness, LEAST_FOUND);
    let pairs = sighted.iter().zip(chosen).enumerate();
    pairs
        .filter_map(|(which, (sighted, chosen))| {
            let (sighted, chosen) = (sighted.as_ref()?, chosen?);
            let lost = &lost[chosen.column];
            let known = lost.known.as_ref()?;
            let why = chosen.why(sighted, &known.appearance, absence_s(known));
            let event = Event {
                wire_id: lost.wire_id,
                kind: EventKind::Revive { why },
            };
            Some((which, event))
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

    fn at(x_m: f64) -> Vector3<f64> {
        Vector3::new(x_m, 0.0, 1.0)
    }

    fn ids(taken: &[Taken]) -> Vec<(usize, u32)> {
        let ids = taken.iter();
        ids.map(|(which, event)| (*which, event.wire_id.0))
            .collect()
    }

    #[test]
    fn nearest_pairs_come_first_and_speed_is_limited() {
        let rules = Rules::example(20.0);
        let waiting = |id, x_m| TrackFacts::sighted(id, 9).at_x(x_m);
        let tracks = [waiting(1, 0.0), waiting(2, 0.25)];
        let sighted = [Some(at(0.2)), None, Some(at(0.1)), Some(at(3.0))];
        let taken = reinitiate(&sighted, &tracks, 9, &rules);
        assert_eq!(ids(&taken), [(0, 2), (2, 1)]);
        let mut late = waiting(1, 0.0);
        late.coverage.since_two = 20;
        let taken = reinitiate(&[Some(at(3.0))], &[late], 9, &rules);
        assert_eq!(ids(&taken), [(0, 1)], "it has had a second to get there");
    }

    #[test]
    fn a_track_with_crops_is_not_reinitiated() {
        let rules = Rules::example(20.0);
        for facts in [
            TrackFacts::sighted(1, 0),
            TrackFacts::example(1, Phase::Tracked),
        ] {
            let tracks = [facts.at_x(0.0)];
            assert!(reinitiate(&[Some(at(0.0))], &tracks, 0, &rules).is_empty());
        }
    }

    #[test]
    fn a_lost_person_is_revived_at_its_last_or_led_place() {
        let rules = Rules::example(20.0);
        let appearance = |x_m| Appearance {
            lengths: Lengths::from_skeleton(&Skeleton::new(&Proportions::from_stature(1.75)), 5.0),
            whereabouts: Whereabouts::at(at(x_m)),
        };
        let lost = LostPerson {
            wire_id: PersonId(4),
            known: Some(Candidate {
                id: PersonId(4),
                last_seen: LastSeen {
                    tick: Tick(0),
                    whereabouts: Whereabouts::at(at(0.0)),
                },
                shown: Vec::new(),
                appearance: appearance(0.0),
                is_expected: true,
            }),
            led_m: Some(at(3.0)),
        };
        let revived = |x_m| {
            let sighted = [None, Some(appearance(x_m))];
            ids(&revive(
                &sighted,
                std::slice::from_ref(&lost),
                Tick(4),
                &rules,
            ))
        };
        assert_eq!(revived(0.2), [(1, 4)]);
        assert_eq!(revived(3.1), [(1, 4)]);
        assert!(revived(-3.5).is_empty());
    }
}
