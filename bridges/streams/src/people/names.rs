//! Names that tell people apart: protocols that label joints and bodies by name take two of one name for one.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::id::PersonId;

/// Gives who is called like another, or like `person_7`, who has no name, the id besides: `Anna 3`.
pub(crate) fn tell_apart(names: &mut BTreeMap<PersonId, String>) {
    let mut alike: BTreeSet<PersonId> = names
        .iter()
        .filter(|(_, name)| is_of_nobody(name))
        .map(|(id, _)| *id)
        .collect();
    alike.extend(sharers(names));
    // `Anna 3` may be a name that was given, too. Two that end with their ids differ, so every round ends at least one of
    // those that do not.
    while !alike.is_empty() {
        for id in &alike {
            if let Some(name) = names.get_mut(id) {
                *name = format!("{name} {id}");
            }
        }
        alike = sharers(names);
    }
}

/// Whether who has no name may be called so.
fn is_of_nobody(name: &str) -> bool {
    let number = name.strip_prefix("person_");
    number.is_some_and(|it| !it.is_empty() && it.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Who has a name that another has too.
fn sharers(names: &BTreeMap<PersonId, String>) -> BTreeSet<PersonId> {
    let mut called: BTreeMap<&str, Vec<PersonId>> = BTreeMap::new();
    for (id, name) in names {
        called.entry(name).or_default().push(*id);
    }
    let shared = called.into_values().filter(|ids| ids.len() > 1);
    shared.flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told<const N: usize>(given: [(u32, &str); N]) -> Vec<String> {
        let names = given.map(|(id, name)| (PersonId(id), name.to_owned()));
        let mut names = BTreeMap::from(names);
        tell_apart(&mut names);
        names.into_values().collect()
    }

    #[test]
    fn people_of_one_name_have_their_ids_besides() {
        let names = told([(3, "Anna"), (4, "Bo"), (7, "Anna")]);
        assert_eq!(names, ["Anna 3", "Bo", "Anna 7"]);
    }

    #[test]
    fn nobody_is_called_like_one_without_a_name() {
        let names = told([(3, "person_4"), (4, "person_x"), (5, "person_")]);
        assert_eq!(names, ["person_4 3", "person_x", "person_"]);
    }

    #[test]
    fn a_name_with_an_id_besides_is_nobody_elses() {
        let names = told([(3, "Anna"), (4, "Anna"), (5, "Anna 3")]);
        assert_eq!(names, ["Anna 3 3", "Anna 4", "Anna 3 5"]);
    }
}
