//! Every event comes back from the wire, and says itself in a line.

use proptest::prelude::*;

use super::*;
use crate::wire::{WireError, decode, encode};

fn likeness(numbers: [f32; 5], has_margin: bool) -> Likeness {
    let [distance_m, absence_s, lengths_sigma, log_ratio, margin] = numbers;
    Likeness {
        distance_m,
        absence_s,
        lengths_sigma,
        log_ratio,
        margin: has_margin.then_some(margin),
    }
}

/// Every kind of change, made of these numbers.
fn changes(n: [f32; 5], other: u32, flag: bool) -> Vec<Change> {
    let (old, why) = (PersonId(other), likeness(n, flag));
    let reasons = [
        DropReason::Contradicted {
            seen: other,
            missed: other / 2,
        },
        DropReason::Poster {
            flat_m: n[0],
            moved_m: n[1],
        },
        DropReason::NotSeenAgain { missing_s: n[0] },
        DropReason::Unseen { unseen_s: n[0] },
        DropReason::OneView { missing_s: n[0] },
        DropReason::OutsideField {
            at_m: [n[0], n[1], n[2]],
        },
        DropReason::SamePlace {
            other: old,
            for_s: n[0],
        },
        DropReason::FoundElsewhere,
        DropReason::GivenByHand,
    ];
    let mut all = vec![
        Change::Initiate {
            views: other as u16,
        },
        Change::Given,
        Change::Reinitiate { moved_m: n[0] },
        Change::Confirm { seen_s: n[0] },
        Change::Recognise { old, why },
        Change::Lose { missing_s: n[0] },
        Change::Find { lost_s: n[0] },
        Change::Revive { why },
        Change::StepBack {
            other: old,
            distance_m: n[0],
            since_s: n[1],
        },
    ];
    all.extend(reasons.map(|reason| Change::Drop { reason }));
    all
}

fn set(changes: Vec<Change>) -> IdentityEventSet {
    let event = |change| IdentityEvent {
        person: PersonId(7),
        wire_id: PersonId(9),
        change,
    };
    IdentityEventSet {
        session: SessionId(1 << 63),
        tick: Tick(300),
        events: changes.into_iter().map(event).collect(),
    }
}

/// Every kind of event, made of numbers that floats hold exactly: for the bytes that must not change.
pub(crate) fn every_event() -> IdentityEventSet {
    set(changes([0.5, 1.0, 1.5, -2.0, 0.25], 300, true))
}

#[test]
fn a_recognition_says_what_speaks_for_it() {
    let why = likeness([0.4, 3.0, 1.1, 4.0, 5.2], true);
    let old = PersonId(3);
    let events = set(vec![Change::Recognise { old, why }]).events;
    assert_eq!(
        events[0].to_string(),
        "id 7 is id 3 again: place 0.4 m after 3.0 s, lengths 1.1 sigma, second best 5.2 behind"
    );
}

#[test]
fn every_change_has_a_name_and_a_line_of_its_own() {
    use std::collections::BTreeSet;

    let all = changes([0.5; 5], 3, true);
    let names: BTreeSet<&str> = all.iter().map(Change::name).collect();
    assert_eq!(names.len(), all.len());
    let events = set(all).events;
    let lines: BTreeSet<String> = events.iter().map(ToString::to_string).collect();
    assert_eq!(lines.len(), events.len());
    assert!(lines.iter().all(|line| line.starts_with("id 7 ")));
}

#[test]
fn more_events_than_a_tick_may_have_are_no_message() {
    let most = set(vec![Change::Given; MAX_EVENTS]);
    assert!(decode::<IdentityEventSet>(&encode(&most)).is_ok());
    let more = set(vec![Change::Given; MAX_EVENTS + 1]);
    let read = decode::<IdentityEventSet>(&encode(&more));
    assert!(matches!(read, Err(WireError::Invalid(_))));
}

#[test]
fn one_number_that_is_none_is_no_message() {
    for bad in [f32::NAN, f32::INFINITY] {
        for place in 0..5 {
            let mut numbers = [0.5; 5];
            numbers[place] = bad;
            let spoilt = changes(numbers, 3, true);
            for (change, sound) in spoilt.into_iter().zip(changes([0.5; 5], 3, true)) {
                let read = decode::<IdentityEventSet>(&encode(&set(vec![change])));
                // Who has not that many numbers is the same as before.
                assert_eq!(read.is_err(), change != sound, "{change:?}");
            }
        }
    }
}

proptest! {
    #[test]
    fn every_event_comes_back(
        numbers in prop::array::uniform5(-1e6f32..1e6), other in any::<u32>(), flag in any::<bool>(),
    ) {
        let set = set(changes(numbers, other, flag));
        prop_assert_eq!(decode::<IdentityEventSet>(&encode(&set)), Ok(set));
    }

    #[test]
    fn no_bytes_bring_the_reader_down(bytes in any::<Vec<u8>>()) {
        drop(decode::<IdentityEventSet>(&[&[crate::wire::VERSION], &bytes[..]].concat()));
    }
}
