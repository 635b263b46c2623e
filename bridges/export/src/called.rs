//! Who is exported, and what they are called: in files, and in their names.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::error::{ExportError, OptionField};
use crate::options::{Format, Options};
use crate::run::{PersonSurvey, Survey};
use crate::target_names::file_word;

/// What a person is called.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Called {
    /// In files: as it was given, with the id where another has the same name.
    pub(crate) name: String,
    /// In their names.
    pub(crate) word: String,
}

/// Who is exported, and what they are called: as the options say, else as `names` say, else by the id.
///
/// # Errors
/// Who is asked for and not there at `ticks`, or that nobody is; names that cannot be.
pub(crate) fn people_of(
    survey: &Survey,
    options: &Options,
    names: &BTreeMap<u32, String>,
    ticks: &Range<i64>,
) -> Result<BTreeMap<u32, Called>, ExportError> {
    let is_present = |person: &PersonSurvey| person.present.is_some();
    let there = survey.people.iter().filter(|(_, it)| is_present(it));
    let there: Vec<u32> = there.map(|(id, _)| *id).collect();
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
    let asked = if options.people.is_empty() {
        &there
    } else {
        &options.people
    };
    if let Some(person) = asked.iter().find(|person| !there.contains(person)) {
        return Err(ExportError::option(
            OptionField::People,
            format!("found person {person}, expected one of {there:?}"),
        ));
    }
    if there.is_empty() {
        let problem = format!("nobody is there in ticks {}..{}", ticks.start, ticks.end);
        let given = options.ticks.as_ref().map(|_| OptionField::Ticks);
        return Err(ExportError::of(given, problem));
    }
    // Of everybody who is there: a name does not change with who else is asked for.
    let mut all = BTreeMap::new();
    for &person in &there {
        all.insert(person, called(person, options, names)?);
    }
    tell_apart(&mut all);
    all.retain(|person, _| asked.contains(person));
    Ok(all)
}

fn called(
    person: u32,
    options: &Options,
    names: &BTreeMap<u32, String>,
) -> Result<Called, ExportError> {
    let option = options.called.get(&person);
    let Some(name) = option.or_else(|| names.get(&person)) else {
        let name = person.to_string();
        return Ok(Called {
            word: name.clone(),
            name,
        });
    };
    if name.trim().is_empty() || name.chars().any(char::is_control) {
        let problem = format!("found {name:?} as the name of person {person}, expected letters");
        let given = option.map(|_| OptionField::Called);
        return Err(ExportError::of(given, problem));
    }
    Ok(Called {
        name: name.clone(),
        word: file_word(name),
    })
}

/// Gives people who are called alike, or as a file of everybody is, their ids besides; where somebody else is called so, the
/// next number that is free.
fn tell_apart(people: &mut BTreeMap<u32, Called>) {
    // Some systems do not tell capital letters apart.
    let lower = |text: &str| text.to_lowercase();
    let taken = Format::TAKEN_WORDS.map(str::to_owned).into_iter();
    let of_people = people.values().map(|called| lower(&called.word));
    let mut words = counted(taken.chain(of_people));
    let mut names = counted(people.values().map(|called| called.name.clone()));
    for (&person, called) in people {
        if words.get(&lower(&called.word)).is_some_and(|n| *n > 1) {
            let numbered = |number: u64| format!("{}_{number}", called.word);
            called.word = free(person, numbered, |word| words.contains_key(&lower(word)));
            words.insert(lower(&called.word), 1);
        }
        if names.get(&called.name).is_some_and(|n| *n > 1) {
            let numbered = |number: u64| format!("{} {number}", called.name);
            called.name = free(person, numbered, |name| names.contains_key(name));
            names.insert(called.name.clone(), 1);
        }
    }
}

/// How often each of `texts` is there.
fn counted(texts: impl Iterator<Item = String>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for text in texts {
        *counts.entry(text).or_insert(0) += 1;
    }
    counts
}

/// The first text with a number, the `person`'s id or more, that is not taken: `Ada_3` may be a name, too.
fn free(person: u32, numbered: impl Fn(u64) -> String, is_taken: impl Fn(&str) -> bool) -> String {
    let mut texts = (u64::from(person)..).map(numbered);
    texts.find(|text| !is_taken(text)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(names: &[(u32, &str)]) -> Vec<String> {
        let called = |name: &str| Called {
            name: name.to_owned(),
            word: file_word(name),
        };
        let people = names.iter().map(|(person, name)| (*person, called(name)));
        let mut people = people.collect();
        tell_apart(&mut people);
        people.into_values().map(|it| it.word).collect()
    }

    #[test]
    fn who_is_called_as_a_file_of_everybody_has_the_id_besides() {
        assert_eq!(words(&[(1, "Ada"), (2, "tidy")]), ["Ada", "tidy_2"]);
        assert_eq!(words(&[(3, "Tidy"), (4, "tidy")]), ["Tidy_3", "tidy_4"]);
    }

    #[test]
    fn an_id_with_which_somebody_else_is_called_gives_way_to_the_next_number() {
        assert_eq!(words(&[(1, "tidy_2"), (2, "tidy")]), ["tidy_2", "tidy_3"]);
        let people = [(3, "Ada"), (4, "ada"), (7, "ADA_3")];
        assert_eq!(words(&people), ["Ada_4", "ada_5", "ADA_3"]);
        assert_eq!(
            words(&[(u32::MAX, "tidy"), (1, "tidy_4294967295")]),
            ["tidy_4294967295", "tidy_4294967296"]
        );
    }

    #[test]
    fn a_name_that_cannot_be_is_of_the_option_only_where_that_gave_it() {
        let name = BTreeMap::from([(1, "a\tb".to_owned())]);
        let mut options = Options::default();
        let of_edits = called(1, &options, &name);
        assert!(matches!(of_edits, Err(ExportError::Options(_))));
        options.called = name.clone();
        let of_option = called(1, &options, &BTreeMap::new());
        let field = OptionField::Called;
        assert!(matches!(of_option, Err(ExportError::Option { field: it, .. }) if it == field));
    }

    #[test]
    fn every_word_that_files_of_everybody_have_is_taken() {
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
