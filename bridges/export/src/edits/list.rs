//! The file of edits: one line each, append-only.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use farfield_fusion::export::EDITS;
use farfield_proto::toml_file::FileError;

use super::change::{Change, Edit, RefusedEdit, check_name};
use super::identities::{Identities, Roll};

/// Maximum number of lines.
const MOST_LINES: usize = 100_000;

/// The edits of a file, in order.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct EditList {
    /// Each with its number, which is its line, from 1.
    edits: Vec<(usize, Edit)>,
    /// The numbers of undone edits.
    undone: BTreeSet<usize>,
    n_lines: usize,
    has_torn_line: bool,
}

/// Path of the edits of the run in `folder`.
pub fn of_run(folder: &Path) -> PathBuf {
    folder.join(EDITS)
}

/// Path of the edits of a recording: next to it, `hall.edits.jsonl` for `hall.mcap`.
pub fn of_recording(recording: &Path) -> PathBuf {
    recording.with_extension(EDITS)
}

/// The complete lines of `text`. An incomplete last line that looks like the start of an edit was
/// cut off, for example by a power failure, and is ignored.
pub(crate) fn whole_lines(text: &str) -> &str {
    let begin = text.rfind('\n').map_or(0, |at| at + 1);
    let (before, last) = text.split_at_checked(begin).unwrap_or((text, ""));
    let read = serde_json::from_str::<serde::de::IgnoredAny>(last);
    let is_torn = last.starts_with('{') && read.is_err_and(|error| error.is_eof());
    if is_torn { before } else { text }
}

impl EditList {
    /// Parses the edits in `text`, the content of `path`. Blank lines and an incomplete last line
    /// ([`Self::has_torn_line`]) are skipped.
    ///
    /// # Errors
    /// The first invalid line, or undo of an edit that is not in force.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let whole = whole_lines(text);
        let mut list = Self {
            has_torn_line: whole.len() < text.len(),
            ..Self::default()
        };
        for line in whole.lines() {
            list.n_lines += 1;
            let number = list.n_lines;
            let at = |problem: String| FileError::new(path, problem).at_line(number);
            if number > MOST_LINES {
                let problem = format!("found more than {MOST_LINES} lines, expected edits");
                return Err(at(problem));
            }
            if line.trim().is_empty() {
                continue;
            }
            let edit = Edit::read(line).map_err(|(field, problem)| match field {
                Some(field) => at(problem).at_field(field),
                None => at(problem),
            })?;
            if let Change::Undo { number } = edit.change {
                let undone = list.check_undo(number);
                undone.map_err(|problem| at(problem).at_field("number"))?;
                list.undone.insert(number);
            }
            list.edits.push((number, edit));
        }
        Ok(list)
    }

    /// All edits with their numbers, including undone ones and undos.
    pub fn all(&self) -> impl DoubleEndedIterator<Item = (usize, &Edit)> {
        self.edits.iter().map(|(number, edit)| (*number, edit))
    }

    /// Whether the file ends with an incomplete line, which was ignored and will be replaced by the
    /// next one.
    pub fn has_torn_line(&self) -> bool {
        self.has_torn_line
    }

    /// Whether there are no edits.
    pub fn is_empty(&self) -> bool {
        self.edits.is_empty()
    }

    /// The edits in force, in order: without undos and undone edits.
    pub fn in_force(&self) -> Vec<(usize, &Change)> {
        self.all()
            .filter(|(number, edit)| {
                !self.undone.contains(number) && !matches!(edit.change, Change::Undo { .. })
            })
            .map(|(number, edit)| (number, &edit.change))
            .collect()
    }

    /// Applies the edits in force, in order. If the presence of people (`roll`) is given, edits are
    /// checked against it.
    ///
    /// # Errors
    /// The first edit that is impossible: of a person that no longer exists or (by `roll`) never
    /// existed, a merge of people present at the same tick, or a new id in use.
    pub fn identities(&self, roll: Option<&Roll>) -> Result<Identities, RefusedEdit> {
        let made = |(_, edit): (usize, &Edit)| match edit.change {
            Change::Split { new, .. } => Some(new),
            _ => None,
        };
        let ever_made = self.all().filter_map(made).collect();
        let mut identities = Identities::from_changes(&self.in_force(), &ever_made, roll)?;
        let undone = self
            .all()
            .filter(|(number, _)| self.undone.contains(number));
        identities.take_back(undone.filter_map(|(_, edit)| match edit.change {
            Change::Guess { person, .. } => Some(person),
            _ => None,
        }));
        Ok(identities)
    }

    /// The number of the next edit.
    pub fn next_number(&self) -> usize {
        self.n_lines + 1
    }

    /// The largest id in any edit.
    pub fn largest_id(&self) -> Option<u32> {
        let id_of = |(_, edit): (usize, &Edit)| match edit.change {
            Change::Name { person, .. }
            | Change::Guess { person, .. }
            | Change::Drop { person } => Some(person),
            Change::Merge { person, into } => Some(person.max(into)),
            Change::Split { person, new, .. } => Some(person.max(new)),
            Change::Undo { .. } => None,
        };
        self.all().filter_map(id_of).max()
    }

    /// Returns the list with one more edit, checked against the presence of people (`roll`) if
    /// given.
    ///
    /// # Errors
    /// If this edit is impossible, or an undo makes a later edit impossible.
    pub fn with(&self, edit: Edit, roll: Option<&Roll>) -> Result<Self, RefusedEdit> {
        let number = self.next_number();
        let refused = |problem| RefusedEdit { number, problem };
        edit.check().map_err(|(_, problem)| refused(problem))?;
        if let Change::Name { name, .. } | Change::Guess { name, .. } = &edit.change {
            check_name(name).map_err(refused)?;
        }
        if number > MOST_LINES {
            return Err(refused(format!(
                "found {MOST_LINES} lines already, expected fewer"
            )));
        }
        if let (Some(roll), Change::Name { person, .. } | Change::Drop { person }) =
            (roll, &edit.change)
        {
            let people = self.identities(Some(roll))?.edited(roll);
            if !people.contains_key(person) {
                let known: Vec<&u32> = people.keys().collect();
                return Err(refused(format!(
                    "found person {person}, expected one of {known:?}"
                )));
            }
        }
        if let Change::Undo { number } = edit.change {
            self.check_undo(number).map_err(refused)?;
        }
        let mut list = self.clone();
        // It replaces an incomplete line.
        list.has_torn_line = false;
        let is_undo = match edit.change {
            Change::Undo { number } => list.undone.insert(number),
            _ => false,
        };
        list.edits.push((number, edit));
        list.n_lines = number;
        match list.identities(roll) {
            Err(fault) if is_undo => Err(refused(format!(
                "{fault}: undo edit {} before",
                fault.number
            ))),
            Err(fault) => Err(fault),
            Ok(_) => Ok(list),
        }
    }

    fn check_undo(&self, number: usize) -> Result<(), String> {
        let edit = self
            .edits
            .binary_search_by_key(&number, |(known, _)| *known);
        match edit.ok().and_then(|index| self.edits.get(index)) {
            None => Err(format!(
                "found {number}, expected the number of an edit before"
            )),
            Some((_, edit)) if matches!(edit.change, Change::Undo { .. }) => Err(format!(
                "found {number}, which is an undo: expected an edit, make it again instead"
            )),
            Some(_) if self.undone.contains(&number) => {
                Err(format!("found {number}, which is undone already"))
            }
            Some(_) => Ok(()),
        }
    }
}
