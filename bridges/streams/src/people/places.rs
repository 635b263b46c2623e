//! Places for people in protocols that have a fixed number of them: ports, blocks of channels.

use std::collections::BTreeMap;

use farfield_proto::id::PersonId;

/// Who has which place. A person keeps the place for as long as it is in the roster, which this does not know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Places {
    n: u16,
    taken: BTreeMap<PersonId, u16>,
}

impl Places {
    /// `n` places, all free.
    pub fn new(n: u16) -> Self {
        Self {
            n,
            taken: BTreeMap::new(),
        }
    }

    /// Gives those of the roster's people who have none the lowest free place, in their order; takes those of people who are not in it any more.
    pub fn assign(&mut self, people: impl Iterator<Item = PersonId> + Clone) {
        self.taken
            .retain(|id, _| people.clone().any(|it| it == *id));
        for id in people {
            let free = (0..self.n).find(|place| !self.taken.values().any(|taken| taken == place));
            if let Some(place) = free {
                self.taken.entry(id).or_insert(place);
            }
        }
    }

    /// The place of a person, from 0; `None` where there were none left.
    pub fn of(&self, id: PersonId) -> Option<u16> {
        self.taken.get(&id).copied()
    }

    /// How many are taken.
    pub fn len(&self) -> usize {
        self.taken.len()
    }

    /// Whether all are free.
    pub fn is_empty(&self) -> bool {
        self.taken.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_person_keeps_its_place_and_others_take_those_that_are_free() {
        let mut places = Places::new(16);
        let assign = |places: &mut Places, ids: &[u32]| {
            places.assign(ids.iter().copied().map(PersonId));
        };
        let of = |places: &Places, id| places.of(PersonId(id));
        assign(&mut places, &[5, 3, 9]);
        assert_eq!(
            [5, 3, 9].map(|id| of(&places, id)),
            [Some(0), Some(1), Some(2)]
        );
        assign(&mut places, &[5, 9, 4]);
        assert_eq!(
            [5, 9, 4, 3].map(|id| of(&places, id)),
            [Some(0), Some(2), Some(1), None]
        );
        let many: Vec<u32> = (100..130).collect();
        assign(&mut places, &many);
        assert_eq!(places.len(), 16);
    }
}
