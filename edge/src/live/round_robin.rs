//! Round robin: the persons sent at a tick if not all fit.
//!
//! A person is measured if two viewpoints show it at the same tick, so all edges must serve it at
//! the same ticks. The choice therefore depends only on the tick and the person's id. A round takes
//! 1, 2, 4, 8, ... ticks, so that the ticks of an edge on a thin link are a subset of those on a
//! wider link.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;

/// Processed ticks after which other persons are the ones sent more often.
const TURN_TICKS: i64 = 256;

/// Fills `chosen` with those of `persons` that are due at the processed tick with this `number`, in
/// order of their ids. On average at most `most` (at least 1) persons are sent per tick.
///
/// A person is sent once per round. If a round has room for more, some persons are sent twice, in
/// turn, depending only on tick and id.
pub fn choose(
    persons: impl Iterator<Item = PersonId>,
    most: f64,
    number: Tick,
    chosen: &mut Vec<PersonId>,
) {
    chosen.clear();
    chosen.extend(persons);
    let n = chosen.len() as f64;
    let most = most.max(1.0);
    let mut round: i64 = 1;
    while (round as f64) * most < n {
        round *= 2;
    }
    // If k of n persons are sent twice per round, (n + k) / round are sent per tick.
    let twice = (round as f64 * most - n).max(0.0) as usize;
    let turn = number.0.div_euclid(TURN_TICKS);
    chosen.sort_unstable_by_key(|person| (rank(*person, turn), *person));
    let mut place = 0;
    chosen.retain(|person| {
        let of = if place < twice {
            (round / 2).max(1)
        } else {
            round
        };
        place += 1;
        (number.0 + i64::from(person.0)).rem_euclid(of) == 0
    });
    chosen.sort_unstable();
}

/// The priority of a person in a turn: a hash that is equal at all edges (the finalizer of
/// `SplitMix64`, Steele 2014, figure 13).
fn rank(person: PersonId, turn: i64) -> u64 {
    let mut z = (turn as u64)
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(u64::from(person.0));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ids(n: u32) -> impl Iterator<Item = PersonId> + Clone {
        (1..=n).map(PersonId)
    }

    fn at(n: u32, most: f64, tick: i64) -> Vec<PersonId> {
        let mut chosen = Vec::new();
        choose(ids(n), most, Tick(tick), &mut chosen);
        chosen
    }

    #[test]
    fn all_persons_are_sent_if_there_is_room() {
        assert_eq!(at(3, 9.0, 7), ids(3).collect::<Vec<_>>());
        assert_eq!(at(0, 1.0, 7), []);
    }

    #[test]
    fn on_average_the_number_of_persons_stays_within_the_room() {
        for tick in 0..8 {
            assert_eq!(at(8, 2.0, tick).len(), 2);
        }
    }

    #[test]
    fn room_for_two_and_three_quarter_persons_is_used_fully() {
        let sent: usize = (0..4096).map(|tick| at(8, 2.75, tick).len()).sum();
        assert_eq!(sent, 4096 * 11 / 4);
    }

    #[test]
    fn the_persons_sent_less_often_take_turns() {
        let mut turns = [0; 8];
        for tick in 0..TURN_TICKS * 100 {
            for person in at(8, 3.0, tick) {
                turns[person.0 as usize - 1] += 1;
            }
        }
        let [least, most] = [turns.iter().min(), turns.iter().max()].map(|n| *n.unwrap());
        assert!(10 * least > 8 * most, "{turns:?}");
    }

    proptest! {
        #[test]
        fn each_person_is_sent_once_per_round_within_the_room(
            n in 1u32..20, most in 1.0f64..20.0, start in -1000i64..1000,
        ) {
            let round = i64::from(((f64::from(n) / most).ceil() as u32).next_power_of_two());
            let start = start * round;
            let turns: Vec<_> = (start..start + round).flat_map(|tick| at(n, most, tick)).collect();
            prop_assert!(turns.len() as f64 <= round as f64 * most + 1e-9);
            for person in ids(n) {
                prop_assert!((1..=2).contains(&turns.iter().filter(|of| **of == person).count()));
            }
        }

        #[test]
        fn persons_sent_on_a_thin_link_are_sent_on_a_wider_one(
            n in 1u32..20, thin in 1.0f64..20.0, more in 0.0f64..20.0, tick in 0i64..1000,
        ) {
            let wide = at(n, thin + more, tick);
            prop_assert!(at(n, thin, tick).iter().all(|person| wide.contains(person)));
        }
    }
}
