//! Round robin: which persons are sent at a tick when not all fit.
//!
//! A person is measured where two viewpoints show it at the same tick, so all edges must serve it at the same ticks: the
//! choice follows from the tick and the person's id alone. A round takes 1, 2, 4, 8, ... ticks, so that an edge on a
//! thin link serves a person at a subset of the ticks at which an edge on a wider one does.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;

/// Puts into `chosen` those of `persons` that are due at the `number`th processed tick, in order of their ids, so that
/// on average at most `most` (at least 1) persons are sent per tick.
pub fn choose(
    persons: impl Iterator<Item = PersonId> + Clone,
    most: usize,
    number: Tick,
    chosen: &mut Vec<PersonId>,
) {
    let least = persons.clone().count().div_ceil(most.max(1));
    let mut round: i64 = 1;
    while round.unsigned_abs() < least as u64 {
        round *= 2;
    }
    chosen.clear();
    chosen.extend(persons.filter(|person| (number.0 + i64::from(person.0)).rem_euclid(round) == 0));
    chosen.sort_unstable();
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ids(n: u32) -> impl Iterator<Item = PersonId> + Clone {
        (1..=n).map(PersonId)
    }

    fn at(n: u32, most: usize, tick: i64) -> Vec<PersonId> {
        let mut chosen = Vec::new();
        choose(ids(n), most, Tick(tick), &mut chosen);
        chosen
    }

    #[test]
    fn everybody_goes_when_there_is_room() {
        assert_eq!(at(3, 9, 7), ids(3).collect::<Vec<_>>());
        assert_eq!(at(0, 1, 7), []);
    }

    #[test]
    fn no_more_go_than_there_is_room_for_on_average() {
        for tick in 0..8 {
            assert_eq!(at(8, 2, tick).len(), 2);
        }
    }

    proptest! {
        #[test]
        fn everybody_goes_once_in_a_round(n in 1u32..20, most in 1usize..20, start in -1000i64..1000) {
            let round = i64::try_from((n as usize).div_ceil(most).next_power_of_two()).unwrap();
            let mut turns: Vec<_> = (start..start + round).flat_map(|tick| at(n, most, tick)).collect();
            turns.sort_unstable();
            prop_assert_eq!(turns, ids(n).collect::<Vec<_>>());
        }

        #[test]
        fn who_goes_at_a_thin_link_goes_at_a_wider_one_too(
            n in 1u32..20, thin in 1usize..20, more in 0usize..20, tick in 0i64..1000,
        ) {
            let wide = at(n, thin + more, tick);
            prop_assert!(at(n, thin, tick).iter().all(|person| wide.contains(person)));
        }
    }
}
