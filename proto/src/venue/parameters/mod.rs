//! The parameters of the method: the settings of a venue file, with defaults and ranges. Every
//! table and field is optional.
//!
//! `table.rs` contains the list; `declare.rs` generates structs, defaults, parsing and descriptions
//! from it. A parameter is named `table.name` everywhere: a user's parameter is in the table of
//! that name, the others under `[tuning]`.

mod choices;
mod declare;
mod far;
mod table;

use std::fmt::{self, Write as _};

pub use choices::{CameraChoice, Predictor};
pub use far::FarParameter;
pub(super) use table::ParameterTables;
pub use table::*;
use toml::Value;

use crate::toml_file::{FileError, Place, TomlFile};

/// The table of a venue file for all parameters except the users'.
pub const TUNING: &str = "tuning";

/// The intended user of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Audience {
    /// A user at a venue; the parameter has a table of its own.
    User,
    /// A developer of the method; the parameter is under `[tuning]`.
    Tuning,
}

/// The range of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Its unit; empty for shares, factors and counts.
    pub unit: &'static str,
    /// The minimum, in [`Range::unit`].
    pub min: f64,
    /// The maximum, in [`Range::unit`].
    pub max: f64,
}

/// The effect of omitting a parameter without a default.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unset {
    /// A valid value, as TOML.
    pub example: &'static str,
    /// What is used instead.
    pub words: &'static str,
}

/// The description of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its table, without `tuning`.
    pub table: &'static str,
    /// Its name in the table.
    pub name: &'static str,
    /// Its intended user.
    pub audience: Audience,
    /// Its meaning: a sentence.
    pub sentence: &'static str,
    /// Its range; `None` if it is not a number.
    pub range: Option<Range>,
    /// Its named values; empty for other types.
    pub words: &'static [&'static str],
    /// The effect of omitting it; `None`: its default applies.
    pub unset: Option<Unset>,
}

impl Parameter {
    /// Its tables in a venue file, and its name.
    pub fn keys(&self) -> Vec<&'static str> {
        match self.audience {
            Audience::User => vec![self.table, self.name],
            Audience::Tuning => vec![TUNING, self.table, self.name],
        }
    }

    /// Its place in a venue file.
    pub(super) fn place(&self) -> Place {
        let keys = self.keys();
        keys.iter().fold(Place::default(), |at, key| at.key(key))
    }

    /// Its place as text for a user: `[births] coast_s`, `[tuning] births.flat_m`.
    pub(super) fn stands(&self) -> String {
        let Self { table, name, .. } = self;
        match self.audience {
            Audience::User => format!("[{table}] {name}"),
            Audience::Tuning => format!("[{TUNING}] {table}.{name}"),
        }
    }
}

impl fmt::Display for Parameter {
    /// Its name, `table.name`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.table, self.name)
    }
}

/// The parameter `name`, for example `births.flat_m`.
pub fn find(name: &str) -> Option<&'static Parameter> {
    let (table, field) = name.split_once('.')?;
    in_table(table).find(|parameter| parameter.name == field)
}

/// The parameters of a table.
pub(super) fn in_table(table: &str) -> impl Iterator<Item = &'static Parameter> {
    let all = PARAMETERS.iter();
    all.filter(move |parameter| parameter.table == table)
}

impl Parameters {
    /// Every parameter with its value here, as TOML; `None` if it has none.
    pub fn values(&self) -> impl Iterator<Item = (&'static Parameter, Option<Value>)> {
        PARAMETERS.iter().zip(self.in_order())
    }

    /// Refuses the first parameter out of range, with its place in `file`.
    pub(super) fn check(&self, file: &TomlFile<'_>) -> Result<(), FileError> {
        for (parameter, value) in self.values() {
            let number = value.and_then(|v| v.as_float().or(v.as_integer().map(|i| i as f64)));
            let Some((Range { min, max, .. }, number)) = parameter.range.zip(number) else {
                continue;
            };
            // NaN is in no range.
            if !(min..=max).contains(&number) {
                let problem = format!("found {number:?}, expected a number from {min} to {max}");
                return Err(file.error(&parameter.place(), problem));
            }
        }
        self.boxes.check(file)
    }
}

impl BoxParameters {
    fn check(&self, file: &TomlFile<'_>) -> Result<(), FileError> {
        if self.rotate_until_deg <= self.rotate_from_deg {
            return Ok(());
        }
        let place = Place::field(TUNING).key("boxes").key("rotate_until_deg");
        let problem = format!(
            "found {:?}, expected at most `rotate_from_deg` ({:?})",
            self.rotate_until_deg, self.rotate_from_deg
        );
        Err(file.error(&place, problem))
    }
}

impl BirthParameters {
    /// Ticks from one regular detection pass to the next, at least 1: all viewpoints detect at
    /// multiples of it.
    pub fn ticks_per_look(&self, rate_hz: f64) -> i64 {
        ticks(self.sight_every_s, rate_hz).max(1)
    }

    /// Ticks with evidence from two viewpoints until a person is confirmed, at least 1.
    pub fn confirm_ticks(&self, rate_hz: f64) -> i64 {
        ticks(self.confirm_s, rate_hz).max(1)
    }

    /// Consecutive ticks with detection passes after an unexplained sighting.
    pub fn look_again_ticks(&self, rate_hz: f64) -> i64 {
        ticks(self.look_again_s, rate_hz)
    }
}

/// The nearest integer number of ticks.
fn ticks(seconds: f64, rate_hz: f64) -> i64 {
    (seconds * rate_hz).round() as i64
}

/// Longest line of the comment above a value.
const COLUMNS: usize = 100;
/// Column of the range after a value.
const SETTING_COLUMNS: usize = 28;

/// The users' tables with all defaults, as in a venue file, and a note about the others.
pub fn sample() -> String {
    let mut text = String::from("# All that follows is optional, and states the defaults.\n");
    let defaults: Vec<_> = Parameters::default().values().collect();
    for (table, about) in TABLES {
        let users = defaults
            .iter()
            .filter(|(p, _)| p.table == *table && p.audience == Audience::User);
        let mut lines = users.map(|(p, value)| entry(p, value.as_ref())).peekable();
        if lines.peek().is_some() {
            // Writing to a String cannot fail.
            let _infallible = write!(text, "\n# {about}\n[{table}]\n");
            text.extend(lines);
        }
    }
    let tuned = PARAMETERS
        .iter()
        .find(|p| p.audience == Audience::Tuning)
        .map_or_else(String::new, ToString::to_string);
    text + &format!(
        "\n# [{TUNING}] holds the numbers of the method ({tuned} and others): `farfield parameters` lists them.\n"
    )
}

/// A parameter's sentence, then its setting and range.
fn entry(parameter: &Parameter, value: Option<&toml::Value>) -> String {
    let name = parameter.name;
    let (setting, unset) = match (value, parameter.unset) {
        (Some(value), _) => (format!("{name} = {value}"), String::new()),
        (None, unset) => {
            let (example, words) = unset.map_or(("", ""), |unset| (unset.example, unset.words));
            (
                format!("# {name} = {example}"),
                format!(" Default: {words}."),
            )
        }
    };
    let words = format!("{}{unset}", parameter.sentence);
    let above = comment(&words);
    match parameter.range {
        Some(range) => format!("{above}{setting:SETTING_COLUMNS$} # {range}\n"),
        None => format!("{above}{setting}\n"),
    }
}

/// `words` as comment lines of at most [`COLUMNS`].
fn comment(words: &str) -> String {
    let mut text = String::new();
    let mut columns = COLUMNS;
    for word in words.split(' ') {
        let more = 1 + word.chars().count();
        if columns + more > COLUMNS {
            text += if text.is_empty() { "#" } else { "\n#" };
            columns = 1;
        }
        text += " ";
        text += word;
        columns += more;
    }
    text + "\n"
}

impl fmt::Display for Range {
    /// `0.01 to 2 m`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { unit, min, max } = self;
        write!(f, "{min} to {max}")?;
        if unit.is_empty() {
            Ok(())
        } else {
            write!(f, " {unit}")
        }
    }
}

#[cfg(test)]
mod tests;
