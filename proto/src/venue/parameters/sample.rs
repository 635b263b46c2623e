//! The parameters' part of a sample venue file.

use std::fmt::Write as _;

use super::{Audience, PARAMETERS, Parameter, Parameters, Range, TABLES, TUNING};

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

impl std::fmt::Display for Range {
    /// `0.01 to 2 m`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { unit, min, max } = self;
        write!(f, "{min} to {max}")?;
        if unit.is_empty() {
            Ok(())
        } else {
            write!(f, " {unit}")
        }
    }
}
