//! `farfield parameters`: every parameter of a venue file, with unit, default, range and meaning.

use std::fmt::Write as _;

use anyhow::Context as _;
use clap::Args;
use farfield_node::process::NodeError;
use farfield_proto::venue::Parameters;
use farfield_proto::venue::parameters::{Audience, Parameter, TUNING};
use serde::Serialize;
use toml::Value;

use crate::output;

/// Remedy for parameters far from their defaults.
pub(crate) const FAR_REMEDY: &str = "remove them from the venue file, or from `--set`, unless they are intended: `farfield parameters` describes each";

/// A line on the parameters that are far from their defaults; `None` if there are none.
pub(crate) fn far_parameters(parameters: &Parameters) -> Option<String> {
    let far: Vec<String> = parameters
        .far_from_defaults()
        .iter()
        .map(ToString::to_string)
        .collect();
    let sets = if far.len() == 1 {
        "a parameter is set"
    } else {
        "parameters are set"
    };
    (!far.is_empty()).then(|| format!("{sets} far from the default: {}", far.join(", ")))
}

/// Arguments of `farfield parameters`.
#[derive(Debug, Args)]
pub(crate) struct ParametersArgs {
    /// Print the list as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Prints the list.
///
/// # Errors
/// When it cannot be written.
pub(crate) fn print(args: &ParametersArgs) -> Result<(), NodeError> {
    print_list(args).map_err(NodeError::Failed)
}

fn print_list(args: &ParametersArgs) -> anyhow::Result<()> {
    let all = listed();
    let text = if args.json {
        serde_json::to_string_pretty(&all).context("writing the parameters as JSON")? + "\n"
    } else {
        table(&all)
    };
    output::print(&text)
}

/// One row of the list.
#[derive(Debug, Serialize)]
struct Listed {
    /// `table.name`.
    name: String,
    /// Whether it belongs to `[tuning]`.
    tuning: bool,
    /// `None`: no unit.
    unit: Option<&'static str>,
    /// `None`: no default of its own, see `unset`.
    default: Option<Value>,
    /// Meaning of a parameter that is not set and has no default of its own.
    unset: Option<&'static str>,
    min: Option<f64>,
    max: Option<f64>,
    /// The words that it can take.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    words: &'static [&'static str],
    sentence: &'static str,
}

impl Listed {
    fn new(parameter: &Parameter, default: Option<Value>) -> Self {
        Self {
            name: parameter.to_string(),
            tuning: parameter.audience == Audience::Tuning,
            unit: parameter.range.map(|r| r.unit).filter(|u| !u.is_empty()),
            default,
            unset: parameter.unset.map(|unset| unset.words),
            min: parameter.range.map(|range| range.min),
            max: parameter.range.map(|range| range.max),
            words: parameter.words,
            sentence: parameter.sentence,
        }
    }

    /// Name, unit, default, range and sentence.
    fn columns(&self) -> [String; 5] {
        let default = self.default.as_ref().map(ToString::to_string);
        let range = match self.min.zip(self.max) {
            Some((min, max)) => format!("{min} to {max}"),
            None => self.words.join(", "),
        };
        let unset = self.unset.map(|words| format!(" Without: {words}."));
        [
            self.name.clone(),
            self.unit.unwrap_or("-").to_owned(),
            default.unwrap_or_else(|| "-".to_owned()),
            if range.is_empty() {
                "-".to_owned()
            } else {
                range
            },
            self.sentence.to_owned() + &unset.unwrap_or_default(),
        ]
    }
}

/// Every parameter, those for users first.
fn listed() -> Vec<Listed> {
    let defaults = Parameters::default();
    let all = defaults.values();
    let mut all: Vec<Listed> = all.map(|(p, default)| Listed::new(p, default)).collect();
    all.sort_by_key(|listed| listed.tuning);
    all
}

/// A row for each, in columns.
fn table(all: &[Listed]) -> String {
    const INTRODUCTION: &str = "A venue file can set each of these in its table; `--set TABLE.FIELD=VALUE` of `run`, `demo` and `replay` changes one for a single run.";
    const HEAD: [&str; 5] = ["parameter", "unit", "default", "range", "meaning"];
    let rows: Vec<[String; 5]> = all.iter().map(Listed::columns).collect();
    let width = |i: usize| {
        let rows = rows.iter().map(|row| row[i].chars().count());
        rows.max().unwrap_or(0).max(HEAD[i].len())
    };
    let [name, unit, default, range] = [0, 1, 2, 3].map(width);
    let line = |row: [&str; 5]| {
        let [a, b, c, d, e] = row;
        format!("{a:name$}  {b:unit$}  {c:default$}  {d:range$}  {e}\n")
    };
    let mut text = format!("{INTRODUCTION}\n\n");
    text += &line(HEAD);
    let users = all.iter().filter(|listed| !listed.tuning).count();
    for (i, row) in rows.iter().enumerate() {
        if i == users {
            // Writing to a String cannot fail.
            let _infallible = writeln!(text, "\n[{TUNING}]");
        }
        text += &line(row.each_ref().map(String::as_str));
    }
    text
}

#[cfg(test)]
mod tests {
    use farfield_proto::venue::parameters::PARAMETERS;

    use super::*;

    #[test]
    fn the_table_has_every_parameter_with_those_for_users_first() {
        let text = table(&listed());
        let at = |p: &Parameter| {
            let line = format!("\n{p} ");
            assert_eq!(text.matches(&line).count(), 1, "{p}");
            text.find(&line).unwrap()
        };
        let tuning = text.find("\n[tuning]\n").unwrap();
        for parameter in PARAMETERS {
            assert!(text.contains(parameter.sentence), "{parameter}");
            let is_below = at(parameter) > tuning;
            assert_eq!(
                is_below,
                parameter.audience == Audience::Tuning,
                "{parameter}"
            );
        }
        assert_eq!(text.lines().count(), PARAMETERS.len() + 5);
    }

    #[test]
    fn parameters_far_from_their_defaults_are_reported_in_one_line() {
        let mut parameters = Parameters::default();
        assert_eq!(far_parameters(&parameters), None);
        parameters.ik.change_sigma_rad = 100.0;
        parameters.smoothing.cutoff_hz = 0.01;
        assert_eq!(
            far_parameters(&parameters).unwrap(),
            "parameters are set far from the default: [tuning] ik.change_sigma_rad is 100.0 rad, the default 0.25, \
             [tuning] smoothing.cutoff_hz is 0.01 Hz, the default 1.5"
        );
    }

    #[test]
    fn the_json_has_numbers_as_numbers() {
        let json = serde_json::to_value(listed()).unwrap();
        let all = json.as_array().unwrap();
        assert_eq!(all.len(), PARAMETERS.len());
        let named = |name: &str| all.iter().find(|listed| listed["name"] == name).unwrap();
        let flat = named("births.flat_m");
        assert_eq!(
            (
                &flat["default"],
                &flat["unit"],
                &flat["max"],
                &flat["tuning"]
            ),
            (&0.04.into(), &"m".into(), &1.0.into(), &true.into())
        );
        assert_eq!(named("prediction.predictor")["words"][0], "paper");
        assert!(named("boxes.margin")["default"].is_null());
        assert_eq!(named("births.tiles_per_look")["default"], 8);
    }
}
