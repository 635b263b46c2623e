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
/// 1: every parameter stood in its table, two of them were counted in ticks, and `[security] pictures` meant nothing.
/// 2: all but the users' stand under `[tuning]`, in seconds.
pub const LAYOUT: u32 = 2;

/// How it begins what is said of something that moved.
const IS_NOW: &str = "it is now ";

/// Parameters that layout 1 counted in ticks: the table, the name there, the name of today.
const IN_TICKS: [[&str; 3]; 2] = [
    ["births", "confirm_ticks", "confirm_s"],
    ["births", "look_again_ticks", "look_again_s"],
];

/// The name in layout 1 of a parameter that was counted in ticks then.
pub(super) fn name_in_ticks(parameter: &Parameter) -> Option<&'static str> {
    let found = IN_TICKS.iter();
    let mut found = found.filter(|[table, ..]| *table == parameter.table);
    found.find_map(|[_, old, now]| (*now == parameter.name).then_some(*old))
}

/// Where a parameter stood in layout 1, where that was elsewhere.
fn old_place(parameter: &Parameter) -> Option<[&'static str; 2]> {
    let name = name_in_ticks(parameter).unwrap_or(parameter.name);
    is_tuning(parameter).then_some([parameter.table, name])
}

/// The parameter of a table that has this name, or had it when it was counted in ticks.
fn named(table: &str, name: &str) -> Option<&'static Parameter> {
    in_table(table).find(|p| p.name == name || name_in_ticks(p) == Some(name))
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
            match named(table, key) {
                Some(parameter) if !is_tuning(parameter) => {}
                Some(parameter) => {
                    moved += 1;
                    wrong.push(file.error(&place, now(parameter, key)));
                }
                None => wrong.push(file.error(&place, unknown(table, key))),
            }
        }
        let here = tuning.key(table);
        for key in file.keys(&here) {
            let place = here.key(key);
            match named(table, key) {
                Some(parameter) if parameter.name != key => {
                    wrong.push(file.error(&place, now(parameter, key)));
                }
                Some(parameter) if is_tuning(parameter) => {}
                Some(parameter) => wrong.push(file.error(&place, belongs(parameter))),
                None => wrong.push(file.error(&place, unknown(table, key))),
            }
        }
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

/// What is said of a parameter at its old place, under its old name.
fn now(parameter: &Parameter, name: &str) -> String {
    let seconds = if name == parameter.name {
        ""
    } else {
        ", in seconds"
    };
    format!("{IS_NOW}`{}`{seconds}", parameter.stands())
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
    let rate_hz = root.get("rate_hz").and_then(number);
    for parameter in PARAMETERS {
        let Some([table, name]) = old_place(parameter) else {
            continue;
        };
        let found = root.get_mut(table).and_then(Value::as_table_mut);
        if let Some(value) = found.and_then(|table| table.remove(name)) {
            let value = match (number(&value), rate_hz) {
                (Some(ticks), Some(rate_hz)) if name != parameter.name => {
                    Value::Float(ticks / rate_hz)
                }
                _ => value,
            };
            set(&mut root, &parameter.keys(), value);
        }
    }
    // What is left of the others' tables: none of them has a field of a user's.
    root.retain(|table, value| {
        let is_empty = value.as_table().is_some_and(Table::is_empty);
        !(is_empty && TABLES.iter().any(|(name, _)| *name == table))
    });
    if let Some(security) = root.get_mut("security").and_then(Value::as_table_mut) {
        // No edge of that time sent any, whatever it said.
        security.remove("pictures");
    }
    let written = toml::to_string(&root);
    let failed = |error| FileError::new(path, format!("it cannot be translated: {error}"));
    written.map(Cow::Owned).map_err(failed)
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or(value.as_integer().map(|i| i as f64))
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
