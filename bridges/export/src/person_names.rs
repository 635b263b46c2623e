//! The exported people and their names, in files and in file names.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::error::{ExportError, OptionField};
use crate::options::{Format, Options};
use crate::run::{PersonSurvey, Survey};
use crate::target_names::file_word;

/// The name of a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct PersonName {
    /// In files: as given; with a number if another person has the same name.
    pub(crate) name: String,
    /// In file names.
    pub(crate) word: String,
}

/// The exported people with their names: from the options, otherwise from `names`, otherwise the
/// id.
///
/// # Errors
/// If a requested person is not present at `ticks`, no person is, or a name is invalid.
pub(crate) fn people_of(
    survey: &Survey,
    options: &Options,
    names: &BTreeMap<u32, String>,
    ticks: &Range<i64>,
) -> Result<BTreeMap<u32, PersonName>, ExportError> {
    let is_present = |person: &PersonSurvey| person.present.is_some();
    let present = survey.people.iter().filter(|(_, it)| is_present(it));
    let present: Vec<u32> = present.map(|(id, _)| *id).collect();
    if let Some(person) = options
        .called
        .keys()
        .find(|person| !survey.people.contains_key(person))
    {
        let known: Vec<&u32> = survey.people.keys().collect();
        return Err(ExportError::option(
            OptionField::Called,
            format!("found a name for person {person}, expected one of {known:?}"),
        ));
    }
    let requested = if options.people.is_empty() {
        &present
    } else {
        &options.people
    };
    if let Some(person) = requested.iter().find(|person| !present.contains(person)) {
        return Err(ExportError::option(
            OptionField::People,
            format!("found person {person}, expected one of {present:?}"),
        ));
    }
    if present.is_empty() {
        let problem = format!("no people in ticks {}..{}", ticks.start, ticks.end);
        let given = options.ticks.as_ref().map(|_| OptionField::Ticks);
        return Err(ExportError::with_option(given, problem));
    }
    // Over all present people, so that a name does not depend on the selection.
    let mut all = BTreeMap::new();
    for &person in &present {
        all.insert(person, name_of(person, options, names)?);
    }
    make_unique(&mut all);
    all.retain(|person, _| requested.contains(person));
    Ok(all)
}

fn name_of(
    person: u32,
    options: &Options,
    names: &BTreeMap<u32, String>,
) -> Result<PersonName, ExportError> {
    let option = options.called.get(&person);
    let Some(name) = option.or_else(|| names.get(&person)) else {
        let name = person.to_string();
        return Ok(PersonName {
            word: name.clone(),
            name,
        });
    };
    if name.trim().is_empty() || name.chars().any(char::is_control) {
        let problem = format!("found {name:?} as the name of person {person}, expected letters");
        let given = option.map(|_| OptionField::Called);
        return Err(ExportError::with_option(given, problem));
    }
    Ok(PersonName {
        name: name.clone(),
        word: file_word(name),
    })
}

/// Makes names unique: appends the id to names that are equal, or equal to the name of a shared
/// file; if that is taken too, the next free number.
fn make_unique(people: &mut BTreeMap<u32, PersonName>) {
    // Some file systems ignore case.
    let lower = |text: &str| text.to_lowercase();
    let taken = Format::TAKEN_WORDS.map(str::to_owned).into_iter();
    let of_people = people.values().map(|name| lower(&name.word));
    let mut words = counts_of(taken.chain(of_people));
    let mut names = counts_of(people.values().map(|name| name.name.clone()));
    for (&person, name) in people {
        if words.get(&lower(&name.word)).is_some_and(|n| *n > 1) {
            let numbered = |number: u64| format!("{}_{number}", name.word);
            name.word = free(person, numbered, |word| words.contains_key(&lower(word)));
            words.insert(lower(&name.word), 1);
        }
        if names.get(&name.name).is_some_and(|n| *n > 1) {
            let numbered = |number: u64| format!("{} {number}", name.name);
            name.name = free(person, numbered, |name| names.contains_key(name));
            names.insert(name.name.clone(), 1);
        }
    }
}

/// Number of occurrences of each text.
fn counts_of(texts: impl Iterator<Item = String>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for text in texts {
        *counts.entry(text).or_insert(0) += 1;
    }
    counts
}

/// The first text with a number from `person`'s id up that is not taken, since `Ada_3` may be a
/// name too.
fn free(person: u32, numbered: impl Fn(u64) -> String, is_taken: impl Fn(&str) -> bool) -> String {
    let mut texts = (u64::from(person)..).map(numbered);
    texts.find(|text| !is_taken(text)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(names: &[(u32, &str)]) -> Vec<String> {
        let named = |name: &str| PersonName {
            name: name.to_owned(),
            word: file_word(name),
        };
        let people = names.iter().map(|(person, name)| (*person, named(name)));
        let mut people = people.collect();
        make_unique(&mut people);
        people.into_values().map(|it| it.word).collect()
    }

    #[test]
    fn names_of_shared_files_get_the_id_appended() {
        assert_eq!(words(&[(1, "Ada"), (2, "tidy")]), ["Ada", "tidy_2"]);
        assert_eq!(words(&[(3, "Tidy"), (4, "tidy")]), ["Tidy_3", "tidy_4"]);
    }

    #[test]
    fn a_taken_id_is_replaced_by_the_next_free_number() {
        assert_eq!(words(&[(1, "tidy_2"), (2, "tidy")]), ["tidy_2", "tidy_3"]);
        let people = [(3, "Ada"), (4, "ada"), (7, "ADA_3")];
        assert_eq!(words(&people), ["Ada_4", "ada_5", "ADA_3"]);
        assert_eq!(
            words(&[(u32::MAX, "tidy"), (1, "tidy_4294967295")]),
            ["tidy_4294967295", "tidy_4294967296"]
        );
    }

    #[test]
    fn invalid_names_are_attributed_to_their_source() {
        let name = BTreeMap::from([(1, "a\tb".to_owned())]);
        let mut options = Options::default();
        let of_edits = name_of(1, &options, &name);
        assert!(matches!(of_edits, Err(ExportError::Options(_))));
        options.called = name.clone();
        let of_option = name_of(1, &options, &BTreeMap::new());
        let field = OptionField::Called;
        assert!(matches!(of_option, Err(ExportError::Option { field: it, .. }) if it == field));
    }

    #[test]
    fn names_of_all_shared_files_are_reserved() {
        let formats = Format::ALL.map(|(_, format)| format);
        for all in formats.into_iter().filter(|it| it.holds_all()) {
            let name = all.file_name("");
            for one in formats.into_iter().filter(|it| !it.holds_all()) {
                let of_one = one.file_name("?");
                let (head, tail) = of_one.split_once('?').unwrap();
                let word = name
                    .strip_prefix(head)
                    .and_then(|rest| rest.strip_suffix(tail));
                let is_taken = word.is_none_or(|word| Format::TAKEN_WORDS.contains(&word));
                assert!(is_taken, "{name}, {of_one}");
            }
        }
    }
}
