//! Where the fields of a venue file stand, where older versions had them, and how a text of an older version
//! is brought to the layout of today.
//!
//! A file of a user is refused where a field stands at an old place, with the new one. The venue inside a
//! recording nobody can edit: it is translated.

use std::borrow::Cow;
use std::path::Path;

use toml::{Table, Value};

use super::parameters::{
    Audience, PARAMETERS, Parameter, ParameterTables, Parameters, TABLES, TUNING, find, in_table,
};
use crate::toml_file::{FileError, Place, TomlFile, nearest};

/// The layout of venue files that is read and written today.
///
/// 1: every parameter stood in its table, and `[security]` had `pictures`. 2: all but the users' stand under
/// `[tuning]`.
pub const LAYOUT: u32 = 2;

/// What is said of `[security] pictures`, which was never read.
const NO_PICTURES: &str =
    "there is no such switch: pictures never leave an edge; take the line out";

/// How it begins what is said of something that moved.
const IS_NOW: &str = "it is now ";

/// Where a parameter stood in layout 1, where that was elsewhere.
fn old_place(parameter: &Parameter) -> Option<[&'static str; 2]> {
    is_tuning(parameter).then_some([parameter.table, parameter.name])
}

fn is_tuning(parameter: &Parameter) -> bool {
    parameter.audience == Audience::Tuning
}

impl Parameters {
    /// The defaults, with what the users' tables and `[tuning]` of a text say otherwise; ranges are not
    /// checked. `file` must have no other table.
    ///
    /// # Errors
    /// [`FileError`] for an unknown, mistyped or misplaced field.
    pub fn read(file: &TomlFile<'_>) -> Result<Self, FileError> {
        check(file)?;
        Ok(file.read::<ParameterTables>()?.into())
    }
}

/// Refuses fields of the parameters' tables that are unknown, or not where they belong.
pub(super) fn check(file: &TomlFile<'_>) -> Result<(), FileError> {
    let tuning = Place::field(TUNING);
    let mut wrong = Vec::new();
    let mut moved = 0;
    for (table, _) in TABLES {
        let old = Place::field(table);
        let keys = file.keys(&old);
        if keys.is_empty() && file.has(&old) && in_table(table).all(is_tuning) {
            wrong.push(file.error(&old, format!("{IS_NOW}`[{TUNING}] {table}`")));
        }
        for key in keys {
            let place = old.key(key);
            match in_table(table).find(|p| p.name == key) {
                Some(parameter) if !is_tuning(parameter) => {}
                Some(parameter) => {
                    moved += 1;
                    wrong.push(file.error(&place, now(parameter)));
                }
                None => wrong.push(file.error(&place, unknown(table, key))),
            }
        }
        let here = tuning.key(table);
        for key in file.keys(&here) {
            let place = here.key(key);
            match in_table(table).find(|p| p.name == key) {
                Some(parameter) if is_tuning(parameter) => {}
                Some(parameter) => wrong.push(file.error(&place, belongs(parameter))),
                None => wrong.push(file.error(&place, unknown(table, key))),
            }
        }
    }
    let pictures = Place::field("security").key("pictures");
    if file.has(&pictures) {
        wrong.push(file.error(&pictures, NO_PICTURES));
    }
    let first = wrong.into_iter().min_by_key(|error| error.line);
    first.map_or(Ok(()), |mut error| {
        if moved > 1 && error.problem.starts_with(IS_NOW) {
            error.problem = format!(
                "{} ({moved} fields of this file have moved so)",
                error.problem
            );
        }
        Err(error)
    })
}

/// What is said of a parameter at its old place.
fn now(parameter: &Parameter) -> String {
    format!("{IS_NOW}`{}`", parameter.stands())
}

/// What is said of a user's parameter under `[tuning]`.
fn belongs(parameter: &Parameter) -> String {
    let Parameter { table, name, .. } = parameter;
    format!("`{name}` is a user's field: write it in `[{table}]`")
}

/// What is said of a name that no parameter of the table has.
fn unknown(table: &str, name: &str) -> String {
    let known: Vec<&str> = in_table(table).map(|p| p.name).collect();
    match nearest(name, &known).and_then(|known| find(&format!("{table}.{known}"))) {
        Some(parameter) => format!(
            "unknown field `{name}`, did you mean `{}`?",
            parameter.stands()
        ),
        None => format!(
            "unknown field `{name}`, expected one of `{}`",
            known.join("`, `")
        ),
    }
}

/// The text of a venue file of this `layout`, in that of today. `path` is only named in errors.
///
/// # Errors
/// [`FileError`] when the text is not TOML, or of a layout that this version does not know.
pub fn translated<'a>(text: &'a str, path: &Path, layout: u32) -> Result<Cow<'a, str>, FileError> {
    match layout {
        LAYOUT => return Ok(Cow::Borrowed(text)),
        1 => {}
        _ => {
            let problem = format!(
                "it has layout {layout} of venue files, and this version reads layouts 1 to {LAYOUT}"
            );
            return Err(FileError::new(path, problem));
        }
    }
    let mut root: Table = TomlFile::parse(text, path)?.read()?;
    for parameter in PARAMETERS {
        let Some([table, name]) = old_place(parameter) else {
            continue;
        };
        let found = root.get_mut(table).and_then(Value::as_table_mut);
        if let Some(value) = found.and_then(|table| table.remove(name)) {
            set(&mut root, &parameter.keys(), value);
        }
    }
    // What is left of the others' tables: none of them has a field of a user's.
    root.retain(|table, value| {
        let is_empty = value.as_table().is_some_and(Table::is_empty);
        !(is_empty && TABLES.iter().any(|(name, _)| *name == table))
    });
    if let Some(security) = root.get_mut("security").and_then(Value::as_table_mut) {
        security.remove("pictures");
    }
    let written = toml::to_string(&root);
    let failed = |error| FileError::new(path, format!("it cannot be translated: {error}"));
    written.map(Cow::Owned).map_err(failed)
}

/// Puts `value` where `keys` lead from the file's root; tables that are not there are made. Whether there
/// was nothing but tables on the way.
pub fn set(root: &mut Table, keys: &[&str], value: Value) -> bool {
    let Some((name, tables)) = keys.split_last() else {
        return false;
    };
    let mut at = root;
    for table in tables {
        let next = at
            .entry(*table)
            .or_insert_with(|| Value::Table(Table::new()));
        let Some(next) = next.as_table_mut() else {
            return false;
        };
        at = next;
    }
    at.insert((*name).to_owned(), value);
    true
}
