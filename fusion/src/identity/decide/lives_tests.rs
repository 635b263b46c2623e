//! Every rule of the table, and what they come to together.

use super::*;
use crate::estimate::uncertainty::MadeOf;
use crate::identity::phase::published;
use crate::identity::poster::Stillness;
use crate::identity::tentative::Votes;
use farfield_proto::message::PersonState;

const RATE_HZ: f64 = 50.0;
const STILL: Option<Stillness> = Some(Stillness {
    flat_m: 0.0,
    moved_m: 0.0,
});

/// Somebody whose ticks are counted and decided as the registry does.
struct Life {
    facts: TrackFacts,
    tick: Tick,
    is_gone: bool,
}

impl Life {
    fn of(phase: Phase) -> Self {
        Self {
            facts: TrackFacts {
                // The first sighting is one.
                tentative_ticks: usize::from(phase.is_tentative()),
                ..TrackFacts::example(1, phase)
            },
            tick: Tick(0),
            is_gone: false,
        }
    }

    fn tick(&mut self, made_of: MadeOf) -> Option<EventKind> {
        if self.is_gone {
            return None;
        }
        let facts = &mut self.facts;
        self.tick = self.tick + 1;
        facts.coverage.count(made_of);
        facts.phase = facts.phase.counted(made_of);
        facts.tentative_ticks += 1;
        let everybody = std::slice::from_ref(&*facts);
        let event = decide(everybody, self.tick, &Rules::example(RATE_HZ)).pop()?;
        facts.phase = facts.phase.after(&event.kind, self.tick);
        self.is_gone = matches!(event.kind, EventKind::Drop { .. });
        Some(event.kind)
    }

    /// What becomes of it in `n` ticks that are made of `made_of`.
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
        EventKind::Waver { is_back: true } => "back",
        EventKind::Waver { is_back: false } => "away",
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
fn a_newborn_is_confirmed_after_enough_ticks_with_evidence() {
    let mut life = Life::of(Phase::tentative(0));
    assert!(life.live(MadeOf::Views, 10).is_empty());
    assert_eq!(life.published(), PersonState::Tentative);
    assert_eq!(life.live(MadeOf::Views, 1), ["confirm"]);
    assert_eq!(life.published(), PersonState::Tracked);
}

#[test]
fn a_newborn_far_away_is_not_gone_before_its_crops_can_have_come() {
    let mut life = Life::of(Phase::tentative(15));
    assert!(life.live(MadeOf::Motion, 25).is_empty());
    life.live(MadeOf::Views, 1);
    assert!(life.live(MadeOf::Motion, 10).is_empty());
    assert_eq!(life.live(MadeOf::Motion, 1), ["not seen again"]);
    let mut life = Life::of(Phase::tentative(15));
    assert_eq!(life.live(MadeOf::Motion, 26), ["not seen again"]);
}

#[test]
fn a_newborn_that_is_not_seen_again_is_gone_soon() {
    let mut life = Life::of(Phase::tentative(0));
    assert!(life.live(MadeOf::Motion, 10).is_empty());
    assert_eq!(life.live(MadeOf::Motion, 1), ["not seen again"]);
}

#[test]
fn a_confirmed_person_coasts_and_comes_back() {
    let mut life = Life::of(Phase::Tracked);
    assert_eq!(life.live(MadeOf::Motion, 50), ["lose"]);
    assert_eq!(life.published(), PersonState::Coasting);
    life.live(MadeOf::Views, 1);
    assert_eq!(life.published(), PersonState::Tracked);
    assert_eq!(life.live(MadeOf::Motion, 60), ["unseen"]);
}

#[test]
fn one_view_carries_a_person_on_for_longer_but_not_for_good() {
    let mut life = Life::of(Phase::Tracked);
    assert_eq!(life.live(MadeOf::OneView, 250), ["lose"]);
    assert_eq!(life.published(), PersonState::Coasting);
    assert_eq!(life.live(MadeOf::OneView, 1), ["one view"]);
}

#[test]
fn who_was_lost_is_doubtful_for_a_while() {
    let mut life = Life::of(Phase::Tracked);
    assert!(life.live(MadeOf::OneView, 7).is_empty());
    assert!(!life.facts.phase.is_lost());
    assert_eq!(life.live(MadeOf::OneView, 1), ["lose"]);
    assert!(life.facts.phase.is_lost() && life.facts.phase.is_doubtful());
    assert_eq!(life.live(MadeOf::Views, 8), ["back"]);
    assert!(!life.facts.phase.is_lost() && life.facts.phase.is_doubtful());
    assert_eq!(life.live(MadeOf::Views, 20), ["find"]);
    assert!(!life.facts.phase.is_doubtful());
}

#[test]
fn who_was_revived_is_lost_again_unless_it_goes_on_being_seen() {
    let mut life = Life::of(Phase::Lost {
        since: Tick(0),
        is_back: true,
    });
    assert_eq!(life.live(MadeOf::Views, 1), ["away"]);
}

#[test]
fn an_open_question_holds_a_confirmation_back_and_a_poster_is_gone() {
    let mut life = Life::of(Phase::tentative(0));
    life.facts.stillness = STILL;
    assert!(life.live(MadeOf::Views, 50).is_empty());
    let still_s = Rules::example(RATE_HZ).births.still_s;
    let rest = (still_s * RATE_HZ) as u32 - 51;
    assert!(life.live(MadeOf::Views, rest).is_empty());
    assert_eq!(life.live(MadeOf::Views, 1), ["poster"]);
}

/// What the table says of one track among others.
fn of(facts: &TrackFacts, others: &[TrackFacts]) -> Option<&'static str> {
    let everybody = [std::slice::from_ref(facts), others].concat();
    let events = decide(&everybody, Tick(100), &Rules::example(RATE_HZ));
    let own = events.iter().find(|event| event.wire_id == facts.wire_id);
    own.map(|event| name(&event.kind))
}

/// A tentative track that nothing holds back.
fn ready() -> TrackFacts {
    TrackFacts {
        tentative_ticks: 12,
        ..TrackFacts::example(
            1,
            Phase::Tentative {
                supported_ticks: 12,
                awaited_ticks: 0,
            },
        )
    }
}

#[test]
fn the_table_rule_by_rule() {
    let against = Votes {
        passes: 3,
        seen: 4,
        missed: 5,
    };
    let missing = |ticks, facts: TrackFacts| {
        let mut facts = facts;
        facts.coverage.missing = ticks;
        facts
    };
    let tracked = || TrackFacts::example(1, Phase::Tracked);
    let cases: [(TrackFacts, Option<&str>); 10] = [
        (ready(), Some("confirm")),
        (
            TrackFacts {
                votes: against,
                ..ready()
            },
            Some("contradicted"),
        ),
        (
            TrackFacts {
                votes: against,
                ..tracked()
            },
            None,
        ),
        (
            TrackFacts {
                stillness: STILL,
                ..ready()
            },
            None,
        ),
        (
            TrackFacts {
                stillness: STILL,
                tentative_ticks: 10_000,
                ..ready()
            },
            Some("poster"),
        ),
        (
            TrackFacts {
                tentative_ticks: 11,
                ..ready()
            },
            None,
        ),
        (
            missing(11, TrackFacts::example(1, Phase::tentative(0))),
            Some("not seen again"),
        ),
        (missing(8, tracked()), Some("lose")),
        (missing(7, tracked()), None),
        (missing(251, tracked()), Some("one view")),
    ];
    for (facts, expected) in cases {
        assert_eq!(of(&facts, &[]), expected, "{facts:?}");
    }
}

#[test]
fn who_stands_in_the_place_of_somebody_confirmed_is_not_confirmed() {
    let other = TrackFacts::example(2, Phase::Tracked);
    assert_eq!(of(&ready(), std::slice::from_ref(&other)), None);
    assert_eq!(of(&ready(), &[other.at_x(2.0)]), Some("confirm"));
    let tentative = TrackFacts::example(2, Phase::tentative(0));
    assert_eq!(of(&ready(), &[tentative]), Some("confirm"));
}
