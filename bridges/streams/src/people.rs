//! Unique names and fixed places of people, for protocols that need them.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::id::PersonId;

/// Appends the id to names that are not unique or that look like the default name `person_7`: `Anna
/// 3`.
pub(crate) fn make_unique(names: &mut BTreeMap<PersonId, String>) {
    let mut ambiguous: BTreeSet<PersonId> = names
        .iter()
        .filter(|(_, name)| is_default_name(name))
        .map(|(id, _)| *id)
        .collect();
    ambiguous.extend(duplicates(names));
    // `Anna 3` may itself be a given name. Two names that end with their ids differ, so every round
    // resolves at least one conflict.
    while !ambiguous.is_empty() {
        for id in &ambiguous {
            if let Some(name) = names.get_mut(id) {
                *name = format!("{name} {id}");
            }
        }
        ambiguous = duplicates(names);
    }
}

/// Whether this could be the default name of a person without a name.
fn is_default_name(name: &str) -> bool {
    let number = name.strip_prefix("person_");
    number.is_some_and(|it| !it.is_empty() && it.bytes().all(|byte| byte.is_ascii_digit()))
}

/// People whose name another person also has.
fn duplicates(names: &BTreeMap<PersonId, String>) -> BTreeSet<PersonId> {
    let mut by_name: BTreeMap<&str, Vec<PersonId>> = BTreeMap::new();
    for (id, name) in names {
        by_name.entry(name).or_default().push(*id);
    }
    let shared = by_name.into_values().filter(|ids| ids.len() > 1);
    shared.flatten().collect()
}

/// Assignment of places to people. A person keeps the place while in the roster; the caller
/// provides the roster.
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

    /// Frees the places of people who left the roster, and assigns the lowest free places to new
    /// people, in order.
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

    /// The place of a person, from 0; `None` if there were none left.
    pub fn get(&self, id: PersonId) -> Option<u16> {
        self.taken.get(&id).copied()
    }

    /// Number of taken places.
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

    fn unique<const N: usize>(given: [(u32, &str); N]) -> Vec<String> {
        let names = given.map(|(id, name)| (PersonId(id), name.to_owned()));
        let mut names = BTreeMap::from(names);
        make_unique(&mut names);
        names.into_values().collect()
    }

    #[test]
    fn equal_names_get_their_ids_appended() {
        let names = unique([(3, "Anna"), (4, "Bo"), (7, "Anna")]);
        assert_eq!(names, ["Anna 3", "Bo", "Anna 7"]);
    }

    #[test]
    fn default_names_get_their_id_appended() {
        let names = unique([(3, "person_4"), (4, "person_x"), (5, "person_")]);
        assert_eq!(names, ["person_4 3", "person_x", "person_"]);
    }

    #[test]
    fn a_name_with_an_appended_id_is_unique() {
        let names = unique([(3, "Anna"), (4, "Anna"), (5, "Anna 3")]);
        assert_eq!(names, ["Anna 3 3", "Anna 4", "Anna 3 5"]);
    }

    #[test]
    fn people_keep_their_places_and_others_get_free_ones() {
        let mut places = Places::new(16);
        let assign = |places: &mut Places, ids: &[u32]| {
            places.assign(ids.iter().copied().map(PersonId));
        };
        let get = |places: &Places, id| places.get(PersonId(id));
        assign(&mut places, &[5, 3, 9]);
        assert_eq!(
            [5, 3, 9].map(|id| get(&places, id)),
            [Some(0), Some(1), Some(2)]
        );
        assign(&mut places, &[5, 9, 4]);
        assert_eq!(
            [5, 9, 4, 3].map(|id| get(&places, id)),
            [Some(0), Some(2), Some(1), None]
        );
        let many: Vec<u32> = (100..130).collect();
        assign(&mut places, &many);
        assert_eq!(places.len(), 16);
    }
}
