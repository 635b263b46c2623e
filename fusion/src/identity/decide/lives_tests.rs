//! Tests of each rule of the table, and of the rules together.

use super::*;
use crate::estimate::uncertainty::MadeOf;
use crate::identity::phase::{Coverage, Showable, published};
use crate::identity::poster::Stillness;
use crate::identity::track::Votes;
use farfield_proto::message::PersonState;

const RATE_HZ: f64 = 50.0;
const STILL: Option<Stillness> = Some(Stillness {
    flat_m: 0.0,
    moved_m: 0.0,
});

/// A track whose ticks are counted and decided as in the registry.
struct Life {
    facts: TrackFacts,
    tick: Tick,
    is_gone: bool,
    showable: Showable,
}

impl Life {
    fn in_phase(phase: Phase) -> Self {
        Self {
            facts: TrackFacts::example(1, phase),
            tick: Tick(0),
            is_gone: false,
            showable: Showable::BY_ALL,
        }
    }

    /// Sighted at its first tick; its first crops arrive in `awaited` ticks.
    fn sighted(awaited: u32) -> Self {
        Self {
            facts: TrackFacts {
                tentative_ticks: 1,
                ..TrackFacts::sighted(1, awaited)
            },
            ..Self::in_phase(Phase::Tentative)
        }
    }

    fn tick(&mut self, made_of: MadeOf) -> Option<EventKind> {
        if self.is_gone {
            return None;
        }
        let facts = &mut self.facts;
        self.tick = self.tick + 1;
        facts.coverage.count(made_of, self.showable);
        facts.tentative_ticks += 1;
        let tracks = std::slice::from_ref(&*facts);
        let event = decide(tracks, self.tick, &Rules::example(RATE_HZ)).pop()?;
        match Phase::after(Some(facts.phase), &event.kind, self.tick) {
            Some(phase) => facts.phase = phase,
            None => self.is_gone = true,
        }
        Some(event.kind)
    }

    /// The events of `n` ticks that are made of `made_of`.
    fn live(&mut self, made_of: MadeOf, n: u32) -> Vec<&'static str> {
        (0..n)
            .filter_map(|_| self.tick(made_of))
            .map(|kind| name(&kind))
            .collect()
    }

    fn published(&self) -> PersonState {
        published(self.facts.phase, self.facts.coverage)
    }
}

fn name(kind: &EventKind) -> &'static str {
    match kind {
        EventKind::Confirm { .. } => "confirm",
        EventKind::Lose { .. } => "lose",
        EventKind::SeenAgain => "back",
        EventKind::UnseenAgain => "away",
        EventKind::Find { .. } => "find",
        EventKind::Drop { reason } => match reason {
            DropReason::Contradicted { .. } => "contradicted",
            DropReason::Poster { .. } => "poster",
            DropReason::NotSeenAgain { .. } => "not seen again",
            DropReason::Unseen { .. } => "unseen",
            DropReason::OneView { .. } => "one view",
            _ => "another reason",
        },
        _ => "another event",
    }
}

#[test]
fn a_newcomer_is_confirmed_after_enough_evidence() {
    let mut life = Life::sighted(0);
    assert!(life.live(MadeOf::Views, 10).is_empty());
    assert_eq!(life.published(), PersonState::Tentative);
    assert_eq!(life.live(MadeOf::Views, 1), ["confirm"]);
    assert_eq!(life.published(), PersonState::Tracked);
}

#[test]
fn a_newcomer_is_kept_until_its_crops_can_arrive() {
    let mut life = Life::sighted(15);
    assert!(life.live(MadeOf::Motion, 25).is_empty());
    life.live(MadeOf::Views, 1);
    assert!(life.live(MadeOf::Motion, 10).is_empty());
    assert_eq!(life.live(MadeOf::Motion, 1), ["not seen again"]);
    let mut life = Life::sighted(15);
    assert_eq!(life.live(MadeOf::Motion, 26), ["not seen again"]);
}

#[test]
fn a_newcomer_not_seen_again_is_dropped_soon() {
    let mut life = Life::sighted(0);
    assert!(life.live(MadeOf::Motion, 10).is_empty());
    assert_eq!(life.live(MadeOf::Motion, 1), ["not seen again"]);
}

#[test]
fn a_confirmed_person_coasts_and_comes_back() {
    let mut life = Life::in_phase(Phase::Tracked);
    assert_eq!(life.live(MadeOf::Motion, 50), ["lose"]);
    assert_eq!(life.published(), PersonState::Coasting);
    life.live(MadeOf::Views, 1);
    assert_eq!(life.published(), PersonState::Tracked);
    assert_eq!(life.live(MadeOf::Motion, 60), ["unseen"]);
}

#[test]
fn an_unseeable_person_is_carried_twice_as_long() {
    let by_none = Showable {
        by_two: true,
        by_any: false,
    };
    let mut life = Life::in_phase(Phase::Tracked);
    life.showable = by_none;
    assert_eq!(life.live(MadeOf::Motion, 100), ["lose"]);
    assert_eq!(life.live(MadeOf::Motion, 1), ["unseen"]);
    let mut life = Life::in_phase(Phase::Tracked);
    life.showable = by_none;
    assert_eq!(life.live(MadeOf::Motion, 50), ["lose"]);
    life.showable = Showable::BY_ALL;
    assert!(
        life.live(MadeOf::Motion, 50).is_empty(),
        "a second to be found"
    );
    assert_eq!(life.live(MadeOf::Motion, 1), ["unseen"]);
}

#[test]
fn skipped_ticks_do_not_change_the_life_of_a_track() {
    let left_out = Showable {
        by_two: false,
        by_any: false,
    };
    let mut life = Life::sighted(0);
    let mut became = Vec::new();
    for _ in 0..40 {
        life.showable = left_out;
        became.extend(life.live(MadeOf::Motion, 4));
        life.showable = Showable::BY_ALL;
        became.extend(life.live(MadeOf::Views, 1));
    }
    assert_eq!(became, ["confirm"]);
    assert_eq!(life.live(MadeOf::Motion, 100), ["lose", "unseen"]);
}

#[test]
fn one_view_carries_a_person_for_longer_but_not_forever() {
    let mut life = Life::in_phase(Phase::Tracked);
    assert_eq!(life.live(MadeOf::OneView, 250), ["lose"]);
    assert_eq!(life.published(), PersonState::Coasting);
    assert_eq!(life.live(MadeOf::OneView, 1), ["one view"]);
}

#[test]
fn a_lost_person_stays_suspect_for_a_while() {
    let mut life = Life::in_phase(Phase::Tracked);
    assert!(life.live(MadeOf::OneView, 7).is_empty());
    assert!(!life.facts.phase.is_lost());
    assert_eq!(life.live(MadeOf::OneView, 1), ["lose"]);
    assert!(life.facts.phase.is_lost() && life.facts.phase.is_suspect());
    assert_eq!(life.live(MadeOf::Views, 8), ["back"]);
    assert!(!life.facts.phase.is_lost() && life.facts.phase.is_suspect());
    assert_eq!(life.live(MadeOf::Views, 20), ["find"]);
    assert!(!life.facts.phase.is_suspect());
}

#[test]
fn a_revived_person_is_lost_again_if_it_is_not_seen() {
    let mut life = Life::in_phase(Phase::Lost {
        since: Tick(0),
        is_seen_again: true,
    });
    assert_eq!(life.live(MadeOf::Views, 1), ["away"]);
}

#[test]
fn open_stillness_delays_confirmation_and_a_poster_is_dropped() {
    let mut life = Life::sighted(0);
    life.facts.stillness = STILL;
    assert!(life.live(MadeOf::Views, 50).is_empty());
    let still_s = Rules::example(RATE_HZ).births.still_s;
    let rest = (still_s * RATE_HZ) as u32 - 51;
    assert!(life.live(MadeOf::Views, rest).is_empty());
    assert_eq!(life.live(MadeOf::Views, 1), ["poster"]);
}

/// The event of one track among others.
fn event_of(facts: &TrackFacts, others: &[TrackFacts]) -> Option<EventKind> {
    let tracks = [std::slice::from_ref(facts), others].concat();
    let events = decide(&tracks, Tick(100), &Rules::example(RATE_HZ));
    let own = events.iter().find(|event| event.wire_id == facts.wire_id);
    own.map(|event| event.kind)
}

/// A tentative track that is ready for confirmation.
fn ready() -> TrackFacts {
    TrackFacts {
        tentative_ticks: 12,
        coverage: Coverage {
            supported: 12,
            ..Coverage::default()
        },
        ..TrackFacts::example(1, Phase::Tentative)
    }
}

const CONFIRMED: Option<EventKind> = Some(EventKind::Confirm { seen_s: 0.24 });

/// `facts` with one change.
fn with(mut facts: TrackFacts, change: impl FnOnce(&mut TrackFacts)) -> TrackFacts {
    change(&mut facts);
    facts
}

fn missing(ticks: u32, facts: TrackFacts) -> TrackFacts {
    with(facts, |facts| facts.coverage.missing = ticks)
}

fn unseen(ticks: u32, facts: TrackFacts) -> TrackFacts {
    let facts = missing(ticks.max(facts.coverage.missing), facts);
    with(facts, |facts| {
        (facts.coverage.unseen, facts.coverage.absent) = (ticks, ticks);
    })
}

fn dropped(reason: DropReason) -> EventKind {
    EventKind::Drop { reason }
}

/// Each row: a track, and its expected event.
fn check(rows: impl IntoIterator<Item = (TrackFacts, Option<EventKind>)>) {
    for (row, (facts, expected)) in rows.into_iter().enumerate() {
        assert_eq!(event_of(&facts, &[]), expected, "row {row}: {facts:?}");
    }
}

#[test]
fn rules_for_contradicted_tracks_and_posters() {
    let voted = |passes, seen, missed: u32| {
        let missed = f64::from(missed);
        let votes = Votes {
            passes,
            seen,
            missed,
        };
        with(ready(), |facts| facts.votes = votes)
    };
    let contradicted = |seen, missed| Some(dropped(DropReason::Contradicted { seen, missed }));
    let poster = Some(dropped(DropReason::Poster {
        flat_m: 0.0,
        moved_m: 0.0,
    }));
    let still = |ticks, facts| {
        with(facts, |facts| {
            facts.stillness = STILL;
            facts.tentative_ticks = ticks;
        })
    };
    let tracked = |votes| {
        let mut facts = TrackFacts::example(1, Phase::Tracked);
        facts.votes = votes;
        still(251, facts)
    };
    check([
        (voted(3, 5, 4), CONFIRMED),
        (voted(3, 5, 5), contradicted(5, 5)),
        (voted(2, 4, 5), CONFIRMED),
        (voted(3, 4, 5), contradicted(4, 5)),
        (still(250, ready()), None),
        (still(251, ready()), poster),
        (still(251, voted(3, 4, 5)), contradicted(4, 5)),
        (tracked(voted(3, 4, 5).votes), None),
    ]);
}

#[test]
fn rules_for_confirmation_and_missing_tentative_tracks() {
    let not_seen_again = |missing_s| Some(dropped(DropReason::NotSeenAgain { missing_s }));
    let sighted = |awaited| TrackFacts::sighted(1, awaited);
    check([
        (ready(), CONFIRMED),
        (with(ready(), |facts| facts.coverage.supported = 11), None),
        (with(ready(), |facts| facts.tentative_ticks = 11), None),
        (missing(11, ready()), CONFIRMED),
        (missing(10, sighted(0)), None),
        (missing(11, sighted(0)), not_seen_again(0.22)),
        (missing(25, sighted(15)), None),
        (missing(26, sighted(15)), not_seen_again(0.52)),
        // Tentative tracks are dropped sooner than confirmed ones.
        (unseen(51, sighted(90)), None),
    ]);
}

#[test]
fn rules_for_tracked_people() {
    let tracked = || TrackFacts::example(1, Phase::Tracked);
    let lose = |missing_s| Some(EventKind::Lose { missing_s });
    let gone_unseen = |unseen_s| Some(dropped(DropReason::Unseen { unseen_s }));
    let one_view = |missing_s| Some(dropped(DropReason::OneView { missing_s }));
    check([
        (missing(7, tracked()), None),
        (missing(8, tracked()), lose(0.16)),
        (unseen(50, tracked()), lose(1.0)),
        (unseen(51, tracked()), gone_unseen(1.02)),
        (missing(250, tracked()), lose(5.0)),
        (missing(251, tracked()), one_view(5.02)),
        (unseen(50, missing(251, tracked())), one_view(5.02)),
        (unseen(51, missing(251, tracked())), gone_unseen(1.02)),
    ]);
}

#[test]
fn rules_for_lost_people() {
    // Lost since one second before the tick of the decision.
    let lost = |is_seen_again, streak| {
        let since = Tick(50);
        let phase = Phase::Lost {
            since,
            is_seen_again,
        };
        with(TrackFacts::example(1, phase), |facts| {
            facts.coverage.streak = streak;
        })
    };
    let found = Some(EventKind::Find { lost_s: 1.0 });
    check([
        (lost(false, 7), None),
        (lost(false, 8), Some(EventKind::SeenAgain)),
        (lost(true, 8), None),
        (lost(true, 7), Some(EventKind::UnseenAgain)),
        (lost(true, 24), None),
        (lost(true, 25), found),
        (lost(false, 25), found),
        // A streak that has ended does not count.
        (missing(8, lost(true, 25)), None),
        (
            unseen(51, lost(false, 0)),
            Some(dropped(DropReason::Unseen { unseen_s: 1.02 })),
        ),
        (
            missing(251, lost(false, 0)),
            Some(dropped(DropReason::OneView { missing_s: 5.02 })),
        ),
    ]);
}

#[test]
fn two_tracks_in_one_place_are_not_both_confirmed() {
    let other = TrackFacts::example(2, Phase::Tracked);
    assert_eq!(event_of(&ready(), std::slice::from_ref(&other)), None);
    assert_eq!(event_of(&ready(), &[other.at_x(2.0)]), CONFIRMED);
    let tentative = TrackFacts::sighted(2, 0);
    assert_eq!(event_of(&ready(), &[tentative]), CONFIRMED);
}
