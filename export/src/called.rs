//! Who is exported, and what they are called: in files, and in their names.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::error::ExportError;
use crate::options::Options;
use crate::run::{PersonSurvey, Survey};

/// Most characters of a name that go into the name of a file.
const MOST_WORD_CHARACTERS: usize = 64;

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
/// Who is asked for and not there at `ticks`, or that nobody is; names that cannot be, or that two people would have in names of files.
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
        return Err(ExportError::Options(format!(
            "found a name for person {person}, expected one of {:?}",
            survey.people.keys().collect::<Vec<_>>()
        )));
    }
    let asked = if options.people.is_empty() {
        &there
    } else {
        &options.people
    };
    if let Some(person) = asked.iter().find(|person| !there.contains(person)) {
        return Err(ExportError::Options(format!(
            "found person {person}, expected one of {there:?}"
        )));
    }
    if there.is_empty() {
        return Err(ExportError::Options(format!(
            "nobody is there in ticks {}..{}",
            ticks.start, ticks.end
        )));
    }
    // Of everybody who is there: a name does not change with who else is asked for.
    let mut all = BTreeMap::new();
    for &person in &there {
        all.insert(person, called(person, options, names)?);
    }
    tell_apart(&mut all);
    all.retain(|person, _| asked.contains(person));
    check_words(&all)?;
    Ok(all)
}

fn called(
    person: u32,
    options: &Options,
    names: &BTreeMap<u32, String>,
) -> Result<Called, ExportError> {
    let given = options.called.get(&person).or_else(|| names.get(&person));
    let Some(name) = given else {
        let name = person.to_string();
        return Ok(Called {
            word: name.clone(),
            name,
        });
    };
    if name.trim().is_empty() || name.chars().any(char::is_control) {
        return Err(ExportError::Options(format!(
            "found {name:?} as the name of person {person}, expected letters"
        )));
    }
    Ok(Called {
        name: name.clone(),
        word: file_word(name),
    })
}

/// Gives people who are called alike their ids besides.
fn tell_apart(people: &mut BTreeMap<u32, Called>) {
    // Some systems do not tell capital letters apart.
    let lower = |text: &str| text.to_lowercase();
    let (mut names, mut words) = (BTreeMap::new(), BTreeMap::new());
    for called in people.values() {
        *names.entry(called.name.clone()).or_insert(0) += 1;
        *words.entry(lower(&called.word)).or_insert(0) += 1;
    }
    for (person, called) in people {
        if words.get(&lower(&called.word)).is_some_and(|n| *n > 1) {
            called.word = format!("{}_{person}", called.word);
        }
        if names.get(&called.name).is_some_and(|n| *n > 1) {
            called.name = format!("{} {person}", called.name);
        }
    }
}

/// With their ids besides people can still be called as others are: `Ada_3` may be a name.
fn check_words(people: &BTreeMap<u32, Called>) -> Result<(), ExportError> {
    let mut taken = BTreeMap::new();
    for (person, called) in people {
        if let Some(other) = taken.insert(called.word.to_lowercase(), person) {
            return Err(ExportError::Options(format!(
                "persons {other} and {person} are both called `{}` in names of files",
                called.word
            )));
        }
    }
    Ok(())
}

/// `name` as a part of a file's name: what is no letter, digit, `-` or `_` becomes `_`.
fn file_word(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || c == '-' {
            c
        } else {
            '_'
        }
    };
    name.chars().take(MOST_WORD_CHARACTERS).map(safe).collect()
}
