//! One edit, as a line of the file.

use std::fmt;
use std::path::Path;

use farfield_proto::person_name::check_stored_name;
pub use farfield_proto::person_name::{MOST_NAME_CHARACTERS, check_name};
use farfield_proto::toml_file::FileError;
use serde::{Deserialize, Serialize};

/// Maximum length of the time of an edit, characters.
const MOST_TIME_CHARACTERS: usize = 40;

/// An edit with its time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Edit {
    /// Time of the edit, for people: RFC 3339 if written by us. Edits apply in the order of the
    /// file, independent of the time.
    pub at: String,
    /// The change.
    pub change: Change,
}

/// The change of an edit. Persons are ids of the poses, or new ids of earlier splits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// Names a person; an empty name removes the name.
    Name {
        /// The person.
        person: u32,
        /// At most [`MOST_NAME_CHARACTERS`], without control characters.
        name: String,
    },
    /// Fusion recognises a subject of the venue by the body. A name given by a user wins.
    Guess {
        /// The person.
        person: u32,
        /// As for [`Self::Name`], and not empty.
        name: String,
    },
    /// Two ids are one person.
    Merge {
        /// The id that disappears.
        person: u32,
        /// The id that remains.
        into: u32,
    },
    /// From a tick on, an id is another person.
    Split {
        /// The person that keeps the id before the tick.
        person: u32,
        /// The first tick of the other person.
        tick: i64,
        /// The id of the other person, unused so far.
        new: u32,
    },
    /// Drops a person.
    Drop {
        /// The person.
        person: u32,
    },
    /// Undoes an earlier edit.
    Undo {
        /// Its number: its line in the file, from 1.
        number: usize,
    },
}

/// The fields of a line.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    at: String,
    edit: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    person: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    into: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tick: Option<i64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    new: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    number: Option<usize>,
}

/// The invalid field, if known, and the problem.
pub(super) type Fault = (Option<&'static str>, String);

impl Edit {
    /// Parses a line.
    pub(super) fn read(line: &str) -> Result<Self, Fault> {
        let fields: Fields = serde_json::from_str(line).map_err(|e| (None, e.to_string()))?;
        let edit = Self {
            change: fields.change()?,
            at: fields.at,
        };
        edit.check()?;
        Ok(edit)
    }

    /// Checks whether the edit is a valid line of the file.
    pub(super) fn check(&self) -> Result<(), Fault> {
        let is_valid_time = self.at.chars().count() <= MOST_TIME_CHARACTERS
            && !self.at.chars().any(char::is_control);
        if !is_valid_time {
            let problem = format!("found {:?}, expected a time of day", self.at);
            return Err((Some("at"), problem));
        }
        match &self.change {
            Change::Guess { name, .. } if name.is_empty() => {
                Err((Some("name"), "found none, expected a name".to_owned()))
            }
            Change::Name { name, .. } | Change::Guess { name, .. } => {
                check_stored_name(name).map_err(|problem| (Some("name"), problem))
            }
            Change::Merge { person, into } if person == into => {
                let problem = format!("found {into}, expected another than `person`");
                Err((Some("into"), problem))
            }
            Change::Split { person, new, .. } if person == new => {
                let problem = format!("found {new}, expected another than `person`");
                Err((Some("new"), problem))
            }
            _ => Ok(()),
        }
    }

    /// The line, including its end.
    pub fn line(&self) -> String {
        let mut fields = Fields {
            at: self.at.clone(),
            edit: self.change.name().to_owned(),
            person: None,
            name: None,
            into: None,
            tick: None,
            new: None,
            number: None,
        };
        match &self.change {
            Change::Name { person, name } | Change::Guess { person, name } => {
                (fields.person, fields.name) = (Some(*person), Some(name.clone()));
            }
            Change::Merge { person, into } => {
                (fields.person, fields.into) = (Some(*person), Some(*into));
            }
            Change::Split { person, tick, new } => {
                (fields.person, fields.tick, fields.new) = (Some(*person), Some(*tick), Some(*new));
            }
            Change::Drop { person } => fields.person = Some(*person),
            Change::Undo { number } => fields.number = Some(*number),
        }
        // Text and numbers always serialise.
        let mut line = serde_json::to_string(&fields).unwrap_or_default();
        line.push('\n');
        line
    }
}

impl Fields {
    fn change(&self) -> Result<Change, Fault> {
        let person = || self.need("person", self.person);
        let change = match self.edit.as_str() {
            "name" => Change::Name {
                person: person()?,
                name: self.need("name", self.name.clone())?,
            },
            "guess" => Change::Guess {
                person: person()?,
                name: self.need("name", self.name.clone())?,
            },
            "merge" => Change::Merge {
                person: person()?,
                into: self.need("into", self.into)?,
            },
            "split" => Change::Split {
                person: person()?,
                tick: self.need("tick", self.tick)?,
                new: self.need("new", self.new)?,
            },
            "drop" => Change::Drop { person: person()? },
            "undo" => Change::Undo {
                number: self.need("number", self.number)?,
            },
            other => {
                let problem = format!(
                    "found {other:?}, expected one of name, guess, merge, split, drop, undo"
                );
                return Err((Some("edit"), problem));
            }
        };
        self.check_no_more(&change)?;
        Ok(change)
    }

    fn need<T>(&self, field: &'static str, value: Option<T>) -> Result<T, Fault> {
        value.ok_or_else(|| {
            let problem = format!("missing, expected with the edit `{}`", self.edit);
            (Some(field), problem)
        })
    }

    /// Refuses fields of another kind of edit, since their author intended something.
    fn check_no_more(&self, change: &Change) -> Result<(), Fault> {
        let wanted: &[&str] = match change {
            Change::Name { .. } | Change::Guess { .. } => &["person", "name"],
            Change::Merge { .. } => &["person", "into"],
            Change::Split { .. } => &["person", "tick", "new"],
            Change::Drop { .. } => &["person"],
            Change::Undo { .. } => &["number"],
        };
        let present = [
            ("person", self.person.is_some()),
            ("name", self.name.is_some()),
            ("into", self.into.is_some()),
            ("tick", self.tick.is_some()),
            ("new", self.new.is_some()),
            ("number", self.number.is_some()),
        ];
        let more = present
            .into_iter()
            .find(|(field, is_present)| *is_present && !wanted.contains(field));
        more.map_or(Ok(()), |(field, _)| {
            let problem = format!("found it with the edit `{}`, expected none", self.edit);
            Err((Some(field), problem))
        })
    }
}

impl Change {
    /// Its name in the file.
    fn name(&self) -> &'static str {
        match self {
            Self::Name { .. } => "name",
            Self::Guess { .. } => "guess",
            Self::Merge { .. } => "merge",
            Self::Split { .. } => "split",
            Self::Drop { .. } => "drop",
            Self::Undo { .. } => "undo",
        }
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name { person, name } if name.is_empty() => write!(f, "{person} has no name"),
            Self::Name { person, name } => write!(f, "{person} is called {name}"),
            Self::Guess { person, name } => write!(f, "{person} is {name}, by the body"),
            Self::Merge { person, into } => write!(f, "{person} is {into}"),
            Self::Split { person, tick, new } => {
                write!(f, "{person} is {new} from tick {tick} on")
            }
            Self::Drop { person } => write!(f, "{person} is left out"),
            Self::Undo { number } => write!(f, "edit {number} is undone"),
        }
    }
}

/// Why an edit is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("edit {number}: {problem}")]
pub struct RefusedEdit {
    /// Its number.
    pub number: usize,
    /// What was found and what was expected.
    pub problem: String,
}

impl RefusedEdit {
    /// The error with the file and the line.
    pub fn in_file(self, path: &Path) -> FileError {
        FileError::new(path, self.problem).at_line(self.number)
    }
}
