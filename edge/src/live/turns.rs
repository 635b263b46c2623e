//! Whose turn it is when not everybody fits into a tick: who has waited longest goes first.

use std::collections::BTreeMap;

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;

/// When each person was last sent.
#[derive(Debug, Clone, Default)]
pub struct Turns {
    last: BTreeMap<PersonId, Option<Tick>>,
    /// Kept for its memory.
    order: Vec<(Option<Tick>, PersonId)>,
}

impl Turns {
    /// Puts into `chosen` those `most` of `persons` who have waited longest, new ones first, in order of
    /// their ids. Who is not among `persons` any more is forgotten.
    pub fn choose(
        &mut self,
        persons: impl Iterator<Item = PersonId> + Clone,
        most: usize,
        chosen: &mut Vec<PersonId>,
    ) {
        self.last
            .retain(|known, _| persons.clone().any(|person| person == *known));
        self.order.clear();
        for person in persons {
            let last = *self.last.entry(person).or_default();
            self.order.push((last, person));
        }
        self.order.sort_unstable();
        chosen.clear();
        chosen.extend(self.order.iter().take(most).map(|(_, person)| *person));
        chosen.sort_unstable();
    }

    /// Notes that `person` had its turn at `tick`.
    pub fn served(&mut self, person: PersonId, tick: Tick) {
        self.last.insert(person, Some(tick));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ids(n: u32) -> impl Iterator<Item = PersonId> + Clone {
        (1..=n).map(PersonId)
    }

    #[test]
    fn everybody_goes_when_there_is_room() {
        let mut chosen = Vec::new();
        Turns::default().choose(ids(3), 9, &mut chosen);
        assert_eq!(chosen, ids(3).collect::<Vec<_>>());
    }

    #[test]
    fn who_was_held_back_goes_first_the_next_time() {
        let mut turns = Turns::default();
        let mut chosen = Vec::new();
        turns.choose(ids(3), 2, &mut chosen);
        turns.served(PersonId(1), Tick(0));
        turns.choose(ids(3), 1, &mut chosen);
        assert_eq!(chosen, [PersonId(2)]);
    }

    proptest! {
        #[test]
        fn nobody_waits_longer_than_one_round(n in 1u32..20, most in 1usize..20) {
            let mut turns = Turns::default();
            let mut chosen = Vec::new();
            let round = (n as usize).div_ceil(most);
            let mut waited = vec![0usize; n as usize];
            for tick in 0..100 {
                turns.choose(ids(n), most, &mut chosen);
                prop_assert_eq!(chosen.len(), most.min(n as usize));
                for w in &mut waited {
                    *w += 1;
                }
                for person in &chosen {
                    turns.served(*person, Tick(tick));
                    waited[person.0 as usize - 1] = 0;
                }
                prop_assert!(waited.iter().all(|&w| w < round), "{:?}", waited);
            }
        }

        #[test]
        fn those_who_leave_are_forgotten(n in 1u32..20) {
            let mut turns = Turns::default();
            let mut chosen = Vec::new();
            turns.choose(ids(n), 1, &mut chosen);
            turns.choose(ids(0), 1, &mut chosen);
            prop_assert!(turns.last.is_empty() && chosen.is_empty());
        }
    }
}
