//! Table of rules: who is confirmed, lost, found, or dropped for lack of evidence.
//! Rules are tried in order; for each track the first that returns an event wins.

use farfield_proto::message::identity_event::DropReason;
use farfield_proto::tick::Tick;

use crate::identity::event::{Event, EventKind};
use crate::identity::facts::{Rules, TrackFacts};
use crate::identity::phase::Phase;

/// Time without evidence from two viewpoints after which a confirmed person is lost, and below
/// which it can be found again, seconds. Longer than eight ticks at 60 Hz, which is one round of
/// turns on a slow link.
const LOST_S: f64 = 0.15;
/// How long a lost person must be seen again before it counts as the same person, seconds.
const FOUND_S: f64 = 0.5;

/// What rules need in addition to the track itself.
#[derive(Debug, Clone, Copy)]
struct Situation<'a> {
    tick: Tick,
    tracks: &'a [TrackFacts],
    rules: &'a Rules,
}

type Rule = fn(&TrackFacts, &Situation<'_>) -> Option<EventKind>;

/// The rules, in order of priority.
const TABLE: [Rule; 9] = [
    contradicted,
    a_poster,
    enough_seen,
    not_seen_again,
    unseen_for_too_long,
    one_view_for_too_long,
    lost,
    seen_again,
    found,
];

/// The events of `tracks` at `tick`. The facts already include that tick.
pub(crate) fn decide(tracks: &[TrackFacts], tick: Tick, rules: &Rules) -> Vec<Event> {
    let situation = Situation {
        tick,
        tracks,
        rules,
    };
    let event = |facts: &TrackFacts| {
        let kind = TABLE.iter().find_map(|rule| rule(facts, &situation))?;
        Some(Event {
            wire_id: facts.wire_id,
            kind,
        })
    };
    tracks.iter().filter_map(event).collect()
}

fn leaves(reason: DropReason) -> EventKind {
    EventKind::Drop { reason }
}

/// Drops a tentative body that viewpoints should see and do not.
fn contradicted(facts: &TrackFacts, _: &Situation<'_>) -> Option<EventKind> {
    let votes = facts.votes;
    if !facts.phase.is_tentative() || !votes.are_against() {
        return None;
    }
    Some(leaves(DropReason::Contradicted {
        seen: votes.seen,
        missed: votes.missed.round() as u32,
    }))
}

/// Drops a tentative body that has been flat and still for `births.still_s`.
fn a_poster(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    let births = &situation.rules.births;
    let stillness = facts.stillness.filter(|still| still.is_poster(births))?;
    if !facts.phase.is_tentative() || tentative_s(facts, situation) <= births.still_s {
        return None;
    }
    Some(leaves(DropReason::Poster {
        flat_m: stillness.flat_m as f32,
        moved_m: stillness.moved_m as f32,
    }))
}

/// Confirms a tentative body that was seen often enough, unless it is flat and still or stands in
/// the place of a confirmed person.
fn enough_seen(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    let births = &situation.rules.births;
    if !facts.phase.is_tentative() {
        return None;
    }
    let supported = facts.coverage.supported;
    let confirm_ticks = births.confirm_ticks(situation.rules.rate_hz) as usize;
    let is_open = facts.tentative_ticks < confirm_ticks
        || facts.stillness.is_some_and(|still| still.is_poster(births));
    if (supported as usize) < confirm_ticks || is_open {
        return None;
    }
    let near_m = births.same_place_m;
    let confirmed = situation.tracks.iter();
    let mut confirmed = confirmed.filter(|other| !other.phase.is_tentative());
    if confirmed.any(|other| facts.distance_m(other) < near_m) {
        return None;
    }
    Some(EventKind::Confirm {
        seen_s: situation.rules.seconds(supported),
    })
}

/// Drops a tentative body that has lacked evidence for `births.tentative_s`, not counting the time
/// before its crops can arrive.
fn not_seen_again(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    if !facts.phase.is_tentative() {
        return None;
    }
    let (rules, coverage) = (situation.rules, facts.coverage);
    let missing_s = rules.seconds(coverage.missing);
    if missing_s <= rules.births.tentative_s + rules.seconds(coverage.awaited) {
        return None;
    }
    Some(leaves(DropReason::NotSeenAgain {
        missing_s: missing_s as f32,
    }))
}

/// While all viewpoints are silent, a person is carried for this many times `births.coast_s`. After
/// that a runner may be anywhere; body, place, and where edges showed it decide who it is. After
/// fusion stopped for 3 s, 10 of 42 runners got the id of another person when people were carried
/// for 5 s, and 7 when carried for 2 s.
const SILENT_COASTS: f64 = 2.0;

/// Drops a confirmed person that no viewpoint has seen for `births.coast_s`, counting only time in
/// which a viewpoint could see it.
fn unseen_for_too_long(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    let (rules, coverage) = (situation.rules, facts.coverage);
    let [unseen_s, absent_s] = [coverage.unseen, coverage.absent].map(|ticks| rules.seconds(ticks));
    let coast_s = rules.births.coast_s;
    let is_here = absent_s <= coast_s && unseen_s <= SILENT_COASTS * coast_s;
    if facts.phase.is_tentative() || is_here {
        return None;
    }
    Some(leaves(DropReason::Unseen {
        unseen_s: unseen_s as f32,
    }))
}

/// Drops a confirmed person that no two viewpoints have seen for `births.one_view_s`.
fn one_view_for_too_long(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    let missing_s = situation.rules.seconds(facts.coverage.missing);
    if facts.phase.is_tentative() || missing_s <= situation.rules.births.one_view_s {
        return None;
    }
    Some(leaves(DropReason::OneView {
        missing_s: missing_s as f32,
    }))
}

/// A tracked person becomes lost when it has lacked evidence for [`LOST_S`].
fn lost(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    let missing_s = situation.rules.seconds(facts.coverage.missing);
    let is_lost = facts.phase == Phase::Tracked && missing_s >= LOST_S;
    is_lost.then_some(EventKind::Lose { missing_s })
}

/// A lost person is seen again, or is no longer seen.
fn seen_again(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    let Phase::Lost { is_seen_again, .. } = facts.phase else {
        return None;
    };
    let is_seen_now = situation.rules.seconds(facts.coverage.streak) >= LOST_S;
    if is_seen_now == is_seen_again || is_found(facts, situation.rules) {
        return None;
    }
    Some(if is_seen_now {
        EventKind::SeenAgain
    } else {
        EventKind::UnseenAgain
    })
}

/// A lost person is found when it has been seen again for [`FOUND_S`].
fn found(facts: &TrackFacts, situation: &Situation<'_>) -> Option<EventKind> {
    let Phase::Lost { since, .. } = facts.phase else {
        return None;
    };
    let lost_s = (situation.tick - since) as f64 / situation.rules.rate_hz;
    is_found(facts, situation.rules).then_some(EventKind::Find { lost_s })
}

fn is_found(facts: &TrackFacts, rules: &Rules) -> bool {
    let seconds = |ticks| rules.seconds(ticks);
    seconds(facts.coverage.missing) < LOST_S && seconds(facts.coverage.streak) >= FOUND_S
}

fn tentative_s(facts: &TrackFacts, situation: &Situation<'_>) -> f64 {
    facts.tentative_ticks as f64 * situation.rules.dt_s()
}

#[cfg(test)]
#[path = "lives_tests.rs"]
mod tests;
