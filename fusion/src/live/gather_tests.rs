//! Messages in any order, repeated, late, early, or from unknown senders.

use proptest::prelude::*;

use super::*;
use crate::live::fixture::{SESSION, of_persons, patches};

const VIEWPOINTS: u16 = 3;

fn gather() -> LiveGather {
    LiveGather::new(SESSION, Tick(10), VIEWPOINTS.into(), [8, 6])
}

fn parts(group: &TickGroup) -> Vec<(u16, u16)> {
    let sets = group.patch_sets.iter();
    sets.map(|set| (set.viewpoint.0, set.part)).collect()
}

#[test]
fn ticks_are_taken_in_order_also_without_messages() {
    let mut gather = gather();
    assert_eq!(gather.add_patches(patches(12, 1, 0, 1), 50), Taken::Open);
    assert!(gather.has_all(Tick(12), ViewpointIndex(1)));
    assert!(!gather.has_all(Tick(12), ViewpointIndex(0)));
    let taken: Vec<(i64, usize)> = (0..4)
        .map(|_| gather.take())
        .map(|group| (group.tick.0, group.patch_sets.len()))
        .collect();
    assert_eq!(taken, [(10, 0), (11, 0), (12, 1), (13, 0)]);
}

#[test]
fn a_message_after_its_tick_is_late_once_then_repeated() {
    let mut gather = gather();
    gather.add_patches(patches(10, 0, 0, 1), 50);
    gather.take();
    let repeated = gather.add_patches(patches(10, 0, 0, 1), 50);
    assert_eq!(repeated, Taken::Refused(Refused::RepeatedPart));
    let late = patches(10, 1, 0, 1);
    assert!(!gather.has_any(Tick(10), ViewpointIndex(1)));
    assert_eq!(
        gather.add_patches(late.clone(), 50),
        Taken::Late(late.clone())
    );
    assert!(gather.has_any(Tick(10), ViewpointIndex(1)));
    assert_eq!(
        gather.add_patches(late, 50),
        Taken::Refused(Refused::RepeatedPart)
    );
    (0..8).for_each(|_| drop(gather.take()));
    let forgotten = gather.add_patches(patches(10, 2, 0, 1), 50);
    assert_eq!(forgotten, Taken::Refused(Refused::Late));
}

#[test]
fn a_person_counts_once_per_tick_also_after_the_tick() {
    let mut gather = gather();
    let first = of_persons(patches(10, 0, 0, 1000), 0..2);
    assert_eq!(gather.add_patches(first, 50), Taken::Open);
    gather.take();
    let again = of_persons(patches(10, 0, 1, 1000), 1..3);
    let refused = Taken::Refused(Refused::RepeatedPerson);
    assert_eq!(gather.add_patches(again, 50), refused);
    let new = of_persons(patches(10, 0, 2, 1000), 2..4);
    assert!(matches!(gather.add_patches(new, 50), Taken::Late(_)));
    let of_another = of_persons(patches(10, 1, 0, 1), 0..2);
    assert!(matches!(gather.add_patches(of_another, 50), Taken::Late(_)));
}

#[test]
fn late_patches_between_two_ticks_are_bounded() {
    let mut gather = gather();
    (0..8).for_each(|_| drop(gather.take()));
    let mut late = 0;
    let send = |gather: &mut LiveGather, tick, viewpoint| {
        let set = of_persons(patches(tick, viewpoint, 0, 1), 0..MAX_PERSONS as u32);
        matches!(gather.add_patches(set, 50), Taken::Late(_))
    };
    for tick in 10..16 {
        late += usize::from(send(&mut gather, tick, 0));
    }
    assert_eq!(late, MAX_LATE_PATCHES / MAX_PERSONS);
    gather.take();
    assert!(send(&mut gather, 16, 0), "there is room again");
}

#[test]
fn early_and_unknown_messages_are_refused() {
    let mut gather = gather();
    let refused = |taken| match taken {
        Taken::Refused(refused) => refused,
        other => panic!("{other:?}"),
    };
    for tick in [16, 17, i64::MAX] {
        let early = gather.add_patches(patches(tick, 0, 0, 1), 50);
        assert_eq!(refused(early), Refused::Early);
    }
    let old = gather.add_patches(patches(i64::MIN, 0, 0, 1), 50);
    assert_eq!(refused(old), Refused::Late);
    let unknown = gather.add_patches(patches(10, VIEWPOINTS, 0, 1), 50);
    assert_eq!(refused(unknown), Refused::UnknownViewpoint);
    let other = PatchSet {
        session: SessionId(8),
        ..patches(10, 0, 0, 1)
    };
    assert_eq!(
        refused(gather.add_patches(other, 50)),
        Refused::OtherSession
    );
}

#[test]
fn one_viewpoint_cannot_fill_the_memory() {
    let mut gather = gather();
    let big = MAX_WAITING_BYTES / 2;
    for (part, taken) in [Taken::Open, Taken::Open, Taken::Refused(Refused::TooMany)]
        .into_iter()
        .enumerate()
    {
        assert_eq!(
            gather.add_patches(patches(11, 0, part as u16, 9), big),
            taken
        );
    }
    assert_eq!(gather.add_patches(patches(11, 1, 0, 1), big), Taken::Open);
    gather.take();
    gather.take();
    assert_eq!(gather.add_patches(patches(12, 0, 0, 1), big), Taken::Open);
}

/// The messages of some ticks: each viewpoint sends one or two parts of each.
fn messages() -> Vec<PatchSet> {
    let of = |tick: i64, viewpoint: u16| {
        let parts = 1 + (tick as u16 + viewpoint) % 2;
        (0..parts).map(move |part| patches(tick, viewpoint, part, parts))
    };
    let ticks = (10..16).flat_map(move |tick| (0..VIEWPOINTS).flat_map(move |v| of(tick, v)));
    ticks.collect()
}

proptest! {
    #[test]
    fn order_and_repeats_do_not_matter(
        order in Just(messages()).prop_shuffle(), again in prop::collection::vec(0usize..27, 0..40),
    ) {
        let mut gather = gather();
        let repeats = again.iter().filter_map(|&i| order.get(i));
        for set in order.iter().chain(repeats) {
            gather.add_patches(set.clone(), 50);
        }
        for tick in 10..16 {
            let group = gather.take();
            let expected: Vec<_> = messages().into_iter().filter(|set| set.tick == Tick(tick)).collect();
            prop_assert_eq!(group.patch_sets, expected);
        }
    }

    #[test]
    fn every_message_counts_once_at_any_time_of_taking_ticks(
        order in Just(messages()).prop_shuffle(),
        takes in prop::collection::vec(any::<bool>(), 27..60),
    ) {
        let mut gather = gather();
        let (mut used, mut late) = (Vec::new(), Vec::new());
        let mut messages = order.iter().chain(order.iter()).cloned();
        let mut ticks = 10;
        for take in takes {
            if take && ticks < 16 {
                let group = gather.take();
                prop_assert_eq!(group.tick, Tick(ticks));
                ticks += 1;
                used.extend(parts(&group).into_iter().map(|key| (group.tick.0, key)));
            } else if let Some(set) = messages.next()
                && let Taken::Late(set) = gather.add_patches(set, 50)
            {
                late.push((set.tick.0, (set.viewpoint.0, set.part)));
            }
        }
        for set in messages {
            if let Taken::Late(set) = gather.add_patches(set, 50) {
                late.push((set.tick.0, (set.viewpoint.0, set.part)));
            }
        }
        for _ in ticks..16 {
            let group = gather.take();
            used.extend(parts(&group).into_iter().map(|key| (group.tick.0, key)));
        }
        used.extend(late);
        used.sort_unstable();
        let mut all: Vec<_> = order.iter().map(|s| (s.tick.0, (s.viewpoint.0, s.part))).collect();
        all.sort_unstable();
        prop_assert_eq!(used, all);
    }
}
