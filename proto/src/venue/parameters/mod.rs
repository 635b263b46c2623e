//! The parameters of the method: the settings of a venue file, with defaults and ranges. Every
//! table and field is optional.
//!
//! `table.rs` contains the list; `declare.rs` generates structs, defaults, parsing and descriptions
//! from it. A parameter is named `table.name` everywhere: a user's parameter is in the table of
//! that name, the others under `[tuning]`.

mod choices;
mod declare;
mod far;
mod sample;
mod table;

use std::fmt;

pub use choices::{CameraChoice, Predictor};
pub use far::FarParameter;
pub use sample::sample;
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

#[cfg(test)]
mod tests;
