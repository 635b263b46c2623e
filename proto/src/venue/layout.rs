//! The places of fields in a venue file: users' parameters have their own tables, all others are
//! under `[tuning]`. A field in the wrong place is refused with the right one.

use toml::{Table, Value};

use super::parameters::{
    Audience, Parameter, ParameterTables, Parameters, TABLES, TUNING, find, in_table,
};
use crate::toml_file::{FileError, Place, TomlFile, nearest};

/// The parameter `name` of a table.
fn named(table: &str, name: &str) -> Option<&'static Parameter> {
    in_table(table).find(|p| p.name == name)
}

fn is_tuning(parameter: &Parameter) -> bool {
    parameter.audience == Audience::Tuning
}

impl Parameters {
    /// The defaults, changed by the users' tables and `[tuning]` of a text; ranges are not checked.
    /// `file` must have no other table.
    ///
    /// # Errors
    /// [`FileError`] for an unknown, mistyped or misplaced field.
    pub fn read(file: &TomlFile<'_>) -> Result<Self, FileError> {
        check(file)?;
        Ok(file.read::<ParameterTables>()?.into())
    }
}

/// Refuses unknown or misplaced fields in the parameters' tables.
pub(super) fn check(file: &TomlFile<'_>) -> Result<(), FileError> {
    let tuning = Place::field(TUNING);
    let mut wrong = Vec::new();
    for (table, _) in TABLES {
        let of_users = Place::field(table);
        let keys = file.keys(&of_users);
        if keys.is_empty() && file.has(&of_users) && in_table(table).all(is_tuning) {
            wrong.push(file.error(&of_users, format!("it belongs at `[{TUNING}] {table}`")));
        }
        for key in keys {
            let place = of_users.key(key);
            match named(table, key) {
                Some(parameter) if !is_tuning(parameter) => {}
                Some(parameter) => {
                    let problem = format!("it belongs at `{}`", parameter.stands());
                    wrong.push(file.error(&place, problem));
                }
                None => wrong.push(file.error(&place, unknown(table, key))),
            }
        }
        let here = tuning.key(table);
        for key in file.keys(&here) {
            let place = here.key(key);
            match named(table, key) {
                Some(parameter) if is_tuning(parameter) => {}
                Some(parameter) => wrong.push(file.error(&place, belongs(parameter))),
                None => wrong.push(file.error(&place, unknown(table, key))),
            }
        }
    }
    let first = wrong.into_iter().min_by_key(|error| error.line);
    first.map_or(Ok(()), Err)
}

/// The error for a user's parameter under `[tuning]`.
fn belongs(parameter: &Parameter) -> String {
    let Parameter { table, name, .. } = parameter;
    format!("`{name}` is a user's field: write it in `[{table}]`")
}

/// The error for an unknown parameter of the table.
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

/// Puts `value` at the path `keys` from the file's root; creates missing tables. Returns false if
/// the path contains another value than a table.
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
