//! The file of names and edits next to a run or recording: read completely, extended line by line.

use std::path::{Path, PathBuf};

use farfield_proto::toml_file::FileError;

use crate::edits::{Change, Edit, EditList, RefusedEdit, Roll, list};
use crate::error::ExportError;
use crate::files;

/// The file of names and edits of a run or recording; it need not exist.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EditsFile {
    path: PathBuf,
}

impl EditsFile {
    /// The file at `path`.
    pub fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// The file of the run in `folder`.
    pub fn of_run(folder: &Path) -> Self {
        Self::at(list::of_run(folder))
    }

    /// The file next to a recording.
    pub fn of_recording(recording: &Path) -> Self {
        Self::at(list::of_recording(recording))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the edits; none if the file does not exist.
    ///
    /// # Errors
    /// If the file cannot be read; with the line.
    pub fn read(&self) -> Result<EditList, ExportError> {
        let text = files::read_lines_if_there(&self.path)?;
        Ok(EditList::parse(&text, &self.path)?)
    }

    /// Appends the edit that `change` makes from the existing edits, with the time `at` (RFC 3339),
    /// and returns all edits. Several processes may do this at once. Existing content stays
    /// unchanged, even if the disk is full.
    ///
    /// # Errors
    /// If the file cannot be read or written, or the edit is impossible, checked against the
    /// presence of people (`roll`) if given.
    pub fn add(
        &self,
        at: &str,
        roll: Option<&Roll>,
        change: impl FnOnce(&EditList) -> Result<Change, String>,
    ) -> Result<EditList, ExportError> {
        self.add_all(at, roll, |list| Ok(vec![change(list)?]))
    }

    /// Like [`Self::add`], for several edits; all are added or none.
    ///
    /// # Errors
    /// As [`Self::add`], for the first edit that is impossible.
    pub fn add_all(
        &self,
        at: &str,
        roll: Option<&Roll>,
        changes: impl FnOnce(&EditList) -> Result<Vec<Change>, String>,
    ) -> Result<EditList, ExportError> {
        let mut edited = EditList::default();
        files::append(&self.path, |text| {
            let list = EditList::parse(text, &self.path)?;
            let changes = changes(&list).map_err(ExportError::Options)?;
            edited = list;
            let mut lines = String::new();
            for change in changes {
                let edit = Edit {
                    at: at.to_owned(),
                    change,
                };
                lines.push_str(&edit.line());
                let with = edited.with(edit, roll);
                edited = with.map_err(|fault| self.refused(fault))?;
            }
            Ok(lines)
        })?;
        Ok(edited)
    }

    /// A refusal because of an existing edit is an error of the file.
    fn refused(&self, fault: RefusedEdit) -> ExportError {
        let is_new = |list: EditList| fault.number >= list.next_number();
        if self.read().is_ok_and(is_new) {
            return ExportError::Options(fault.problem);
        }
        let fault: FileError = fault.in_file(&self.path);
        fault.into()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn name(person: u32, name: &str) -> Change {
        Change::Name {
            person,
            name: name.to_owned(),
        }
    }

    #[test]
    fn lines_are_appended_and_existing_ones_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_run(folder.path());
        assert!(file.read().unwrap().is_empty());
        file.add("now", None, |_| Ok(name(3, "Anna"))).unwrap();
        let before = fs::read_to_string(file.path()).unwrap();
        // Edited by hand, without a final line end.
        let by_hand = r#"{"at":"later","edit":"drop","person":9}"#;
        fs::write(file.path(), format!("{before}\n{by_hand}")).unwrap();
        let list = file.add("now", None, |list| {
            assert_eq!(list.in_force().len(), 2);
            Ok(name(4, "Bo"))
        });
        assert_eq!(list.unwrap(), file.read().unwrap());
        let after = fs::read_to_string(file.path()).unwrap();
        assert!(
            after.starts_with(&format!("{before}\n{by_hand}\n")),
            "{after}"
        );
        let numbers: Vec<usize> = file
            .read()
            .unwrap()
            .all()
            .map(|(number, _)| number)
            .collect();
        assert_eq!(numbers, [1, 3, 4]);
    }

    #[test]
    fn an_incomplete_last_line_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_run(folder.path());
        file.add("now", None, |_| Ok(name(3, "Anna"))).unwrap();
        let before = fs::read(file.path()).unwrap();
        let second = Edit {
            at: "later".to_owned(),
            change: name(4, "Žofia"),
        };
        let second = second.line().into_bytes();
        // Cut off at any place, also inside a character.
        for end in 1..second.len() - 1 {
            fs::write(file.path(), [&before, &second[..end]].concat()).unwrap();
            let list = file.read().unwrap();
            assert!(list.has_torn_line(), "{end}");
            assert_eq!(list.in_force().len(), 1);
            let added = file.add("now", None, |_| Ok(name(5, "Bo"))).unwrap();
            assert_eq!(added, file.read().unwrap());
            let numbers: Vec<usize> = added.all().map(|(number, _)| number).collect();
            assert_eq!(numbers, [1, 2]);
            assert!(fs::read(file.path()).unwrap().starts_with(&before));
        }
        // Invalid lines written by hand are not treated as cut off.
        for by_hand in ["an edit", r#"{"at":"later","edit":"drop","person":"x"}"#] {
            fs::write(file.path(), [&before, by_hand.as_bytes()].concat()).unwrap();
            assert!(file.read().is_err(), "{by_hand}");
        }
    }

    #[test]
    fn several_edits_are_added_all_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_run(folder.path());
        let both = |second| file.add_all("now", None, |_| Ok(vec![name(3, "Anna"), second]));
        both(Change::Undo { number: 9 }).unwrap_err();
        assert!(!file.path().exists());
        let list = both(Change::Merge { person: 4, into: 3 }).unwrap();
        assert_eq!((list.in_force().len(), list), (2, file.read().unwrap()));
    }

    #[test]
    fn a_refused_edit_leaves_no_trace() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_recording(&folder.path().join("hall.mcap"));
        let refused = file.add("now", None, |_| Ok(Change::Undo { number: 1 }));
        let error = refused.unwrap_err().to_string();
        assert_eq!(error, "found 1, expected the number of an edit before");
        assert!(!file.path().exists());
        file.add("now", None, |_| Ok(Change::Drop { person: 9 }))
            .unwrap();
        let before = fs::read(file.path()).unwrap();
        let refused = file.add("now", None, |_| Ok(name(9, "Bo"))).unwrap_err();
        assert!(
            refused.to_string().starts_with("found person 9, which"),
            "{refused}"
        );
        assert_eq!(fs::read(file.path()).unwrap(), before);
    }

    #[test]
    fn concurrent_edits_are_all_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_run(folder.path());
        std::thread::scope(|scope| {
            for person in 0..8 {
                let file = &file;
                scope.spawn(move || {
                    for n in 0..10 {
                        let name_text = format!("p{n}");
                        file.add("now", None, |_| Ok(name(person, &name_text)))
                            .unwrap();
                    }
                });
            }
        });
        assert_eq!(file.read().unwrap().in_force().len(), 80);
    }
}
