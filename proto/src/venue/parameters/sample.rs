//! The parameters' part of a sample venue file.

use std::fmt::Write as _;

use super::{Audience, PARAMETERS, Parameter, Parameters, Range, TABLES, TUNING};

/// Columns before the sentences.
const COLUMNS: usize = 34;

/// The users' tables with every default, as a venue file has them, and a word about the others.
pub fn sample() -> String {
    let mut text = String::from("# All that follows is optional, and states the defaults.\n");
    let defaults: Vec<_> = Parameters::default().values().collect();
    for (table, about) in TABLES {
        let users = defaults
            .iter()
            .filter(|(p, _)| p.table == *table && p.audience == Audience::User);
        let mut lines = users.map(|(p, value)| line(p, value.as_ref())).peekable();
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

fn line(parameter: &Parameter, value: Option<&toml::Value>) -> String {
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
    let range = parameter
        .range
        .map_or_else(String::new, |range| format!(" [{range}]"));
    format!(
        "{setting:COLUMNS$} # {}{unset}{range}\n",
        parameter.sentence
    )
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
