//! Every event is read back, and has a line of text.

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

/// Every kind of change with these numbers.
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

/// Every kind of event, with numbers that floats represent exactly, for the golden bytes.
pub(crate) fn every_event() -> IdentityEventSet {
    set(changes([0.5, 1.0, 1.5, -2.0, 0.25], 300, true))
}

#[test]
fn the_text_of_a_recognition_contains_its_evidence() {
    let why = likeness([0.4, 3.0, 1.1, 4.0, 5.2], true);
    let old = PersonId(3);
    let events = set(vec![Change::Recognise { old, why }]).events;
    assert_eq!(
        events[0].to_string(),
        "id 7 is id 3 again: place 0.4 m after 3.0 s, lengths 1.1 sigma, second best 5.2 behind"
    );
}

#[test]
fn every_change_has_its_own_name_and_text() {
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
fn too_many_events_are_refused() {
    let most = set(vec![Change::Given; MAX_EVENTS]);
    assert!(decode::<IdentityEventSet>(&encode(&most)).is_ok());
    let more = set(vec![Change::Given; MAX_EVENTS + 1]);
    let read = decode::<IdentityEventSet>(&encode(&more));
    assert!(matches!(read, Err(WireError::Invalid(_))));
}

#[test]
fn a_number_that_is_not_finite_is_refused() {
    for bad in [f32::NAN, f32::INFINITY] {
        for place in 0..5 {
            let mut numbers = [0.5; 5];
            numbers[place] = bad;
            let spoilt = changes(numbers, 3, true);
            for (change, sound) in spoilt.into_iter().zip(changes([0.5; 5], 3, true)) {
                let read = decode::<IdentityEventSet>(&encode(&set(vec![change])));
                // A change without that many numbers is unchanged.
                assert_eq!(read.is_err(), change != sound, "{change:?}");
            }
        }
    }
}

proptest! {
    #[test]
    fn every_event_is_read_back(
        numbers in prop::array::uniform5(-1e6f32..1e6), other in any::<u32>(), flag in any::<bool>(),
    ) {
        let set = set(changes(numbers, other, flag));
        prop_assert_eq!(decode::<IdentityEventSet>(&encode(&set)), Ok(set));
    }

    #[test]
    fn arbitrary_bytes_cause_no_panic(bytes in any::<Vec<u8>>()) {
        drop(decode::<IdentityEventSet>(&[&[crate::wire::VERSION], &bytes[..]].concat()));
    }
}
